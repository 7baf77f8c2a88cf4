"""Tests of `uvms_drake.control.contact.press_control`: where across a plan goes."""

import numpy as np
import pytest
from pydrake.common.value import Value
from support.tracking import DIRECTION, POSITION, at_rest, tracking_ocp

from uvms_drake.control.contact.press_control import PlanExtent, plan_extent
from uvms_drake.control.ocp.scp import SequentialConvexSolver
from uvms_drake.control.ocp.tracking_ocp import TrackingTarget
from uvms_drake.model.surface.surface_class import SurfaceClass

WALLS = SurfaceClass(DIRECTION, angle=0.1)


@pytest.fixture(scope="module")
def planned():
    """A plan off to the side, and its problem."""
    ocp = tracking_ocp(overrides=("mpc.horizon=4",)).aimed(
        TrackingTarget(POSITION + [0.0, 0.3, -0.2], POSITION[0] + 0.1))
    guess = ocp.resting_plan(0.0, at_rest(ocp, POSITION))
    return ocp, SequentialConvexSolver(ocp).solve(guess, 20).plan


def test_no_instant_of_the_plan_is_further_across_than_its_places(planned):
    ocp, plan = planned
    places = plan_extent(ocp, plan) @ WALLS.axes[1:].T
    for time in np.linspace(0.0, 4.0 * plan.time_step, 81):
        tip = WALLS.axes[1:] @ ocp.model.task_pose(plan.at(time)[0])[:3]
        assert np.all(tip <= places.max(axis=0) + 1e-4)
        assert np.all(tip >= places.min(axis=0) - 1e-4)
    assert np.ptp(places, axis=0).max() > 0.01, "it does go somewhere"


def test_its_places_are_between_the_ends_that_are_put_out(planned):
    ocp, plan = planned
    system = PlanExtent(ocp, WALLS)
    context = system.CreateDefaultContext()
    system.GetInputPort("plan").FixValue(context, Value(plan))
    places = plan_extent(ocp, plan) @ WALLS.axes[1:].T
    ends = system.get_output_port().Eval(context).reshape(2, 2)
    np.testing.assert_allclose(ends, [places.min(axis=0), places.max(axis=0)])
    resting = ocp.resting_plan(0.0, at_rest(ocp, POSITION))
    system.GetInputPort("plan").FixValue(context, Value(resting))
    ends = system.get_output_port().Eval(context).reshape(2, 2)
    np.testing.assert_allclose(ends, np.tile(WALLS.axes[1:] @ POSITION, (2, 1)), atol=1e-9)
