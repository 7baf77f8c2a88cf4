"""Tests of `uvms_drake.control.contact.plan_reach`: how far across a plan goes."""

import numpy as np
import pytest
from pydrake.common.value import Value
from support.tracking import DIRECTION, POSITION, at_rest, tracking_ocp

from uvms_drake.control.contact.plan_reach import PlanReach, plan_places
from uvms_drake.control.scp import SequentialConvexSolver
from uvms_drake.control.tracking_ocp import Aim
from uvms_drake.model.surface.surface_class import SurfaceClass

WALLS = SurfaceClass(DIRECTION, angle=0.1)


@pytest.fixture(scope="module")
def planned():
    """A plan aside, and its problem."""
    ocp = tracking_ocp(overrides=("mpc.horizon=4",)).aimed(
        Aim(POSITION + [0.0, 0.3, -0.2], POSITION[0] + 0.1))
    guess = ocp.resting_plan(0.0, at_rest(ocp, POSITION))
    return ocp, SequentialConvexSolver(ocp).solve(guess, 20).plan


def test_no_instant_of_the_plan_is_further_across_than_its_places(planned):
    ocp, plan = planned
    places = plan_places(ocp, plan) @ WALLS.axes[1:].T
    for time in np.linspace(0.0, 4.0 * plan.time_step, 81):
        tip = WALLS.axes[1:] @ ocp.model.task_pose(plan.at(time)[0])[:3]
        assert np.all(tip <= places.max(axis=0) + 1e-4)
        assert np.all(tip >= places.min(axis=0) - 1e-4)
    assert np.ptp(places, axis=0).max() > 0.01, "it does go somewhere"


def test_the_reach_is_the_furthest_of_them_from_the_tip(planned):
    ocp, plan = planned
    system = PlanReach(ocp, WALLS)
    context = system.CreateDefaultContext()
    system.GetInputPort("plan").FixValue(context, Value(plan))
    for state in (at_rest(ocp, POSITION), at_rest(ocp, POSITION + [0.5, 0.02, 0.01])):
        system.GetInputPort("state").FixValue(context, state)
        tip = ocp.model.task_pose(state[:10])[:3]
        expected = max(np.sum(np.abs(WALLS.axes[1:] @ (each - tip)))
                       for each in plan_places(ocp, plan))
        assert system.get_output_port().Eval(context)[0] == pytest.approx(expected)
    resting = ocp.resting_plan(0.0, at_rest(ocp, POSITION))
    system.GetInputPort("plan").FixValue(context, Value(resting))
    system.GetInputPort("state").FixValue(context, at_rest(ocp, POSITION))
    assert system.get_output_port().Eval(context)[0] == pytest.approx(0.0, abs=1e-9)
