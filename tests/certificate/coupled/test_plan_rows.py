"""Tests of `certificate.coupled.plan_rows`: the part of a declared class that a plan uses."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from uvms_drake.certificate.coupled.linear_run import plan_accelerations
from uvms_drake.certificate.coupled.loop_at_task import loop_parts, press_configuration
from uvms_drake.certificate.coupled.plan_rows import (
    PlanResponses,
    in_contact,
    plan_ratios,
    plan_responses,
    plan_rows,
)
from uvms_drake.mission.steps import Approach, Mission, Retreat
from uvms_drake.station.problem import load_model
from uvms_drake.station.scenario.scenario import load_scenario
from uvms_drake.tube.coupled.budget import APPROACH, PRESS
from uvms_drake.tube.coupled.coupled_loop import PLAN, coupled_loop, operating_point
from uvms_drake.tube.coupled.simulated import simulated

STEP, SIZE, KNOTS = 0.2, 10, 40
TOUCH = 5.0  # s


def record(scenario, rates, touch=TOUCH, roll=0.0):
    """Returns what is read of a run whose plan has accelerations (T, 10) between its knots."""
    time = np.arange(0.0, STEP * len(rates) + 1e-9, 0.02)
    knots = np.concatenate([np.zeros((1, SIZE)), np.cumsum(STEP * rates, axis=0)])
    zeta = np.array([np.interp(time, STEP * np.arange(len(knots)), row) for row in knots.T]).T
    config = np.zeros((len(time), SIZE))
    config[:, 3] = roll
    return SimpleNamespace(scenario=scenario, time=time, nominal_zeta=zeta, nominal_config=config,
                           penetration=np.where(time >= touch, 1e-3, -1.0))


@pytest.fixture(scope="module")
def scenario():
    return load_scenario("girona500_real_loop")


def test_a_stage_has_the_rows_of_its_own_time_and_all_accelerations(scenario):
    """With responses that are a pulse of the last acceleration, and one of that before it."""
    h = np.zeros((2, 1, SIZE))
    h[0, 0, 0], h[1, 0, 1] = 1.0, 10.0
    of_stage = PlanResponses(SimpleNamespace(rows=("row",)), ((0.1, h),), 0.05)
    rates = np.zeros((KNOTS, SIZE))
    rates[3, 0], rates[24, 1], rates[30, 0] = 0.5, -0.02, 0.1
    found = plan_rows(record(scenario, rates), {APPROACH: of_stage, PRESS: of_stage})
    # Acceleration 24 acts one interval later, at 5.05 s: after the touch at 5 s.
    assert found[APPROACH] == pytest.approx(0.5) and found[PRESS] == pytest.approx(0.2)
    later = plan_rows(record(scenario, rates, 5.1), {APPROACH: of_stage, PRESS: of_stage})
    assert later[PRESS] == pytest.approx(0.1)
    never = plan_rows(record(scenario, rates, np.inf), {APPROACH: of_stage, PRESS: of_stage})
    assert never[PRESS] == 0.0


def test_a_contact_ends_in_a_mission_alone_and_after_its_patience(scenario):
    """On the wall from 2 to 3 s, briefly off it, and again until 4 s."""
    time = np.arange(0.0, 6.0, 0.02)
    on = ((time > 1.99) & (time < 3.01)) | ((time > 3.29) & (time < 4.01))
    instants = np.array([0.0, 1.9, 2.0, 2.5, 3.2, 3.9, 4.4, 4.6, 5.9])
    pressing = SimpleNamespace(scenario=scenario, time=time, penetration=np.where(on, 1e-3, -1e-3))
    assert in_contact(pressing, instants).tolist() == [False] * 2 + [True] * 7
    pressing.scenario = replace(scenario, mission=Mission([Approach(), Retreat()], patience=0.5))
    assert in_contact(pressing, instants).tolist() == [False] * 2 + [True] * 5 + [False] * 2


@pytest.mark.slow
def test_the_rows_are_those_of_a_simulation_of_the_linear_loop(scenario):
    """Of the stiffest wall, from the touch on; and a ratio is that to the declared class."""
    rates = np.zeros((KNOTS, SIZE))
    rng = np.random.default_rng(2)
    # The simulation begins at 0 s, when the first two would have entered by the preview.
    rates[2:30] = 0.02 * rng.normal(size=(28, SIZE)) * (np.arange(SIZE) != 3)
    run = record(scenario, rates, roll=0.06)
    np.testing.assert_allclose(plan_accelerations(run, STEP), rates, atol=1e-12)
    responses = plan_responses(scenario)
    found = plan_rows(run, responses)[PRESS]
    model, (_, wall, _) = load_model(scenario), scenario.contact.linear_walls(scenario.task.force)
    parts = loop_parts(scenario, model)
    loop = coupled_loop(parts, operating_point(
        parts, press_configuration(scenario.task, model), wall), wall, planned=True)
    preview = responses[PRESS].preview
    time, rows = simulated([(0.0, loop.system)], {loop.entry(PLAN): lambda now: rates[min(
        round((now + preview) / STEP), KNOTS - 1)]}, STEP * (KNOTS - 1))
    expected = np.max(np.abs(rows[time >= TOUCH]), axis=0)
    # Looked at four times between two knots instead of forty.
    slow = [loop.rows.index(name) for name in ("depth", "vehicle x", "yaw", "q1", "q3")]
    np.testing.assert_allclose(found[slow], expected[slow], rtol=0.03)
    assert np.all(found <= expected + 1e-9)
    ratios = plan_ratios(run, scenario)
    declared = scenario.certificate.plans.press.rows()
    assert ratios[PRESS] == pytest.approx(np.max(found / declared))
    rest = responses[APPROACH].loop.at.state[3]  # Under the moment of the lateral thruster.
    assert -0.003 < rest < -0.0005
    assert ratios["start"] == pytest.approx((0.06 - rest) / 0.075)
    gentler = replace(scenario, certificate=replace(scenario.certificate, plans=replace(
        scenario.certificate.plans, start=0.03)))
    assert plan_ratios(run, gentler)["start"] > 1.9
