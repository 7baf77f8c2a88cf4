"""`campaign.induced_disturbance`: the effect of model errors, predicted and measured."""

from pathlib import Path

import numpy as np
import pytest

from uvms_drake.campaign.induced_disturbance import predicted_disturbance
from uvms_drake.control.mpc.planner import FIRST_SOLVE_ITERATIONS
from uvms_drake.control.ocp.scp import SequentialConvexSolver
from uvms_drake.plant.disturbance import ConstantDisturbance
from uvms_drake.station.motions.dynamic import make_simulated_uvms
from uvms_drake.station.motions.motions import make_ocp
from uvms_drake.station.problem import start_state
from uvms_drake.station.scenario.scenario import load_scenario
from uvms_drake.station.simulation import simulate

pytestmark = pytest.mark.long

CALM = ["duration=3.2", "disturbance.bound=0"]


@pytest.fixture(scope="module")
def first():
    """The problem of the ideal scenario and its first plan, which ends on the wall."""
    scenario = load_scenario("girona500_ideal", CALM)
    ocp = make_ocp(scenario)
    plan = SequentialConvexSolver(ocp).solve(
        ocp.resting_plan(0.0, start_state(scenario, ocp)), FIRST_SOLVE_ITERATIONS).plan
    assert ocp.model.task_pose(plan.config[-1])[0] > 0.0
    return ocp, plan


def predicted(scenario, plan, ocp):
    return predicted_disturbance(
        make_simulated_uvms(scenario, ConstantDisturbance()), scenario.current, scenario.waves,
        scenario.disturbance, plan, ocp)


def test_where_everything_is_known_nothing_is_induced(first):
    ocp, plan = first
    assert predicted(load_scenario("girona500_ideal", CALM), plan, ocp) < 1e-7
    disturbed = load_scenario("girona500_ideal", ["disturbance.bound=0.1"])
    assert predicted(disturbed, plan, ocp) < 1e-7


@pytest.mark.parametrize("override", [
    "model_error.mass=1.01", "model_error.added_mass=1.1", "model_error.drag=1.1",
    "model_error.buoyancy_lever=1.1", "surface_error.stiffness=1.01",
    "surface_error.shift=[0.001, 0, 0]", "surface_error.turn=[0, 0.01, 0]",
    "current=[0, 0.02, 0]", "waves=[{amplitude: 0.05, period: 2}]"])
def test_what_is_predicted_from_the_first_plan_is_what_the_run_then_has(first, override):
    ocp, plan = first
    scenario = load_scenario("girona500_ideal", [*CALM, override])
    measured = np.max(np.linalg.norm(simulate(scenario).effective_disturbance, axis=1))
    assert measured > 0.005
    assert predicted(scenario, plan, ocp) == pytest.approx(measured, rel=0.2)


def test_what_is_induced_is_measured_by_the_bounds_of_the_components(first):
    """A tenth of the hull's bounds makes the norm of a current up to ten times as large."""
    ocp, plan = first
    sizes = [predicted(load_scenario("girona500_ideal", [
        *CALM, "current=[0, 0.02, 0]", f"disturbance.weights={weights}"]), plan, ocp)
        for weights in ([1] * 10, [0.1] * 6 + [1] * 4, [1] * 6 + [0.9] * 4)]
    assert 3.0 * sizes[0] < sizes[1] <= 10.0 * sizes[0]
    assert sizes[0] < sizes[2] < sizes[0] / 0.9


ALL_OF_IT = {
    "4 % of the mass": "model_error.mass=1.04",
    "37 % of the added mass": "model_error.added_mass=1.37",
    "1.7 % of the surface's stiffness": "surface_error.stiffness=1.017",
    "0.4 mm of its position": "surface_error.shift=[0.0004, 0, 0]",
    "7 mrad of its tilt": "surface_error.turn=[0, 0.007, 0]",
    "0.08 m/s of current": "current=[-0.08, 0, 0]"}
"""Errors that use up all of the ideal scenario's d̃ by the README, as overrides."""


@pytest.mark.parametrize("words", ALL_OF_IT)
def test_what_the_readme_says_takes_all_of_the_bound(first, words):
    ocp, plan = first
    path = Path(__file__).parents[2] / "uvms_drake" / "campaign" / "README.md"
    readme = path.read_text(encoding="utf-8")
    assert words in " ".join(readme.split())
    bound = load_scenario("girona500_ideal").disturbance.bound
    induced = predicted(
        load_scenario("girona500_ideal", [*CALM, ALL_OF_IT[words]]), plan, ocp)
    assert induced == pytest.approx(bound, rel=0.15)
