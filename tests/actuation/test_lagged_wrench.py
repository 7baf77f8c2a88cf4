"""Tests of `uvms_drake.actuation.lagged_wrench`."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from uvms_drake.actuation import LaggedWrench
from uvms_drake.certificate.certify import assumed_conditions
from uvms_drake.common.errors import InvalidParameter
from uvms_drake.model.propulsion.allocation import Allocation
from uvms_drake.model.signals.sensor_actuator import VEHICLE_WRENCH, Signals
from uvms_drake.station.scenario.scenario import load_scenario

TAU = np.array([300.0, -90.0, 70.0, 20.0, 40.0, -30.0, 1.0, 2.0, 3.0, 4.0])


def test_the_wrench_follows_on_every_axis_and_the_torques_at_once(model):
    """τ_v(t) = τ + (τ₀ − τ) exp(−(t − θ)/T), τ₀ what holds the robot at rest."""
    at = np.array([0.1, -0.2, 0.3, 0.1, -0.05, 0.4, 0.2, 0.9, 0.3, -0.1])
    hover = -model.mass_matrix(model.kinematics(at)) @ model.drift(at, np.zeros(10), np.zeros(6))
    builder, signals = DiagramBuilder(), Signals()
    for name, value in (("state", np.append(at, np.zeros(10))), ("force", np.zeros(6))):
        signals[name] = builder.AddSystem(ConstantVectorSource(value)).get_output_port()
    part = LaggedWrench(period=0.01, lag=0.06, dead_time=0.02)
    part.check()
    tau = builder.AddSystem(ConstantVectorSource(TAU)).get_output_port()
    out = part.add_to(builder, model, tau, signals, seed=0)
    builder.ExportOutput(out, "exerted")
    builder.ExportOutput(signals[VEHICLE_WRENCH], "wrench")
    diagram = builder.Build()
    simulator = Simulator(diagram)
    for time in (0.01, 0.05, 0.2):
        simulator.AdvanceTo(time)
        exerted, known = (diagram.GetOutputPort(name).Eval(simulator.get_context())
                          for name in ("exerted", "wrench"))
        left = np.exp(-max(time - 0.02, 0.0) / 0.06)
        np.testing.assert_allclose(exerted[:6], TAU[:6] + left * (hover - TAU)[:6], atol=0.02)
        np.testing.assert_array_equal(exerted[6:], TAU[6:])
        np.testing.assert_allclose(known, exerted[:6], atol=1e-9)


def test_its_delay_is_known_and_previewed_or_not(model):
    path = LaggedWrench(period=0.01, lag=0.06, dead_time=0.02).command_path(model)
    assert path.preview == path.mean_delays == (pytest.approx(0.085), 0.0)
    assert path.undriven == () and not np.any(path.thruster_error)
    hidden = LaggedWrench(foreseen=False).command_path(model)
    assert hidden.preview == (0.0, 0.0) and hidden.mean_delays == (pytest.approx(0.055), 0.0)


@pytest.mark.parametrize("wrench", [
    np.array([3e5, -7.0, -2e4, 1e6, 0.0, -1e5]), np.full(6, np.nan)])
def test_no_wrench_is_cut(model, wrench):
    """Without a limit the wrench is whole, and a NaN stays one."""
    thrusters = LaggedWrench().true(model)
    given = thrusters.forces_of(thrusters.commands_of(Allocation.to(thrusters).forces(wrench)))
    np.testing.assert_array_equal(given, wrench)


@pytest.mark.parametrize(("part", "message"), [
    (LaggedWrench(lag=None), r"^lag = None: must be a number"),
    (LaggedWrench(sag=1.0), r"^sag = 1\.0: must be 0"),
    (LaggedWrench(error=np.full(1, 0.1)), r"^error = .*0\.1.*: must be 0"),
    (LaggedWrench(dead_time=0.012), r"^dead_time = 0\.012: must be a multiple of the period")])
def test_a_value_without_a_meaning_is_refused(part, message):
    with pytest.raises(InvalidParameter, match=message):
        part.check()


WRENCH = "!IdealWrench {undriven: [roll]}"
BINARY = "period: 0.00390625"


@pytest.mark.parametrize(("part", "law", "counted"), [
    (f"{BINARY}, foreseen: false", [], True),
    (f"{BINARY}, foreseen: false, dead_time: 0.0078125", [], True),
    (BINARY, [], False),
    ("period: 0.007, foreseen: false", [], False),
    (f"{BINARY}, foreseen: false", ["ancillary.vehicle.observer=1.0"], False),
    (f"{BINARY}, foreseen: false", ["ancillary.undriven=[roll]"], False)])
def test_a_proof_covers_a_lag_without_preview_and_nothing_else(part, law, counted):
    """The knots of plans are ticks to the last digit, it is as known, no axis is missing."""
    scenario = load_scenario(
        "girona500_sampled", [f"actuation=[!LaggedWrench {{lag: 0.05, {part}}}, {WRENCH}]", *law])
    broken_assumptions = [item.name for item in assumed_conditions(scenario) if not item.holds]
    assert broken_assumptions == ([] if counted else [
        "actuation[0], LaggedWrench: the proofs take the vehicle's wrench for given at once"])
