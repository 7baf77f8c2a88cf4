"""Figures of merit of a made-up trace, against sums by hand."""

import numpy as np
import pytest

from uvms_drake.benchmark.cases import CASES, drawn_case
from uvms_drake.benchmark.loop import Trace
from uvms_drake.benchmark.metrics import measure
from uvms_drake.station.problem import load_model


def test_force_settling_loss_saturation_and_energy_are_those_of_the_trace():
    scenario, _ = drawn_case("girona500_arm5e", CASES["thrusters"], 1, 0)
    model, time = load_model(scenario), np.linspace(0.0, 10.0, 501)
    force = np.where(time < 2.0, 0.0, np.where(time < 4.0, 26.0, 21.0))
    force[(time > 2.5) & (time < 3.0)] = 0.0  # The contact is lost once.
    force[(time > 3.4) & (time < 3.5)] = 28.0  # Later than the impact.
    size = len(time)
    state = np.tile(np.concatenate([scenario.start.config, np.zeros(model.size)]), (size, 1))
    state[:, model.size] = 0.3  # m/s of surge, 0.05 above its limit.
    exerted = np.zeros((size, model.size))
    exerted[:, 0] = -7.0
    chi = np.tile([0.1, 0.003, 0.004, 0.0, 0.0, 0.0], (size, 1))
    trace = Trace(time, {
        "state": state, "chi": chi, "force": np.column_stack([force, np.zeros((size, 5))]),
        "penetration": (force > 0.0).astype(float)[:, None], "tau": exerted, "exerted": exerted,
        "place": np.zeros((size, 3)), "limited": (time < 1.0).astype(float)[:, None],
    }, np.array([0.001, 0.004, 0.002]), "")
    found = measure(scenario, model, trace)
    assert found["force_rms"] == pytest.approx(1.0)
    assert (found["impact"], found["peak"]) == (26.0, 28.0)
    assert found["touch"] == pytest.approx(2.0)
    assert found["settling"] == pytest.approx(2.0)
    assert found["lateral"] == pytest.approx(0.005)
    assert found["lost"] == 1
    assert found["limits"]["nu1"] == pytest.approx(0.05)
    assert "force" not in found["limits"]
    assert found["limits"].get("qdot") is None
    assert found["saturated"] == pytest.approx(0.1, abs=0.002)
    assert found["energy"] == pytest.approx(7.0 * 0.3 * 10.0)
    assert (found["step_ms"], found["worst_step_ms"]) == pytest.approx((2.0, 4.0))
    assert found["chatter"] == 0.0


def test_chatter_is_the_variation_over_the_largest_command_and_a_run_without_touch_has_no_force():
    scenario, _ = drawn_case("girona500_arm5e", CASES["thrusters"], 1, 0)
    model, time = load_model(scenario), np.linspace(0.0, 1.0, 51)
    tau = np.zeros((51, model.size))
    tau[:, 4] = np.arange(51) % 2
    zero = np.zeros((51, 6))
    trace = Trace(time, {
        "state": np.tile(np.concatenate([scenario.start.config, np.zeros(model.size)]), (51, 1)),
        "chi": zero, "force": zero, "penetration": np.zeros((51, 1)), "tau": tau, "exerted": tau,
        "place": np.zeros((51, 3))}, np.ones(1), "")
    found = measure(scenario, model, trace)
    assert found["chatter"] == pytest.approx(50.0 / 90.0)  # 90 N m of pitch.
    assert found["impact"] is None and found["lateral"] is None and found["peak"] == 0.0
    assert found["force_rms"] is None and found["touch"] is None and found["settling"] is None


def test_an_excess_of_the_declared_force_and_a_run_that_ends_early_are_told():
    scenario, _ = drawn_case("girona500_arm5e", CASES["thrusters"], 1, 0)
    model, time = load_model(scenario), np.linspace(0.0, 1.0, 51)
    zero, force = np.zeros((51, 6)), np.zeros((51, 6))
    force[25:, 0] = scenario.contact.force + 3.0
    trace = Trace(time, {
        "state": np.tile(np.concatenate([scenario.start.config, np.zeros(model.size)]), (51, 1)),
        "chi": zero, "force": force, "penetration": (force[:, :1] > 0.0).astype(float),
        "tau": np.zeros((51, model.size)), "exerted": np.zeros((51, model.size)),
        "wrench_shortfall": np.tile([0.0, 2.0, 0.0, 9.0, 0.0, 0.0], (51, 1)),
        "place": np.zeros((51, 3))}, np.ones(1), "force beyond 500 N")
    found = measure(scenario, model, trace)
    assert found["limits"]["force"] == pytest.approx(3.0)
    assert found["ended"] == "force beyond 500 N"
    assert found["force_rms"] is found["settling"] is found["lateral"] is None
    assert found["touch"] == pytest.approx(0.5) and found["saturated"] == 1.0
