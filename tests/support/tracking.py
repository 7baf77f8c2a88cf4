"""The tracking problem of the ideal scenario's robot, and its nominal motion towards many aims."""

from collections.abc import Iterable, Iterator

import numpy as np

from uvms_drake.control.costs.costs import OffsetCost
from uvms_drake.control.limits import make_limits, tighten
from uvms_drake.control.limits.input_in_contact import ForceCone, UnderContact
from uvms_drake.control.ocp.scp import SequentialConvexSolver
from uvms_drake.control.ocp.tracking_ocp import TrackingOcp, TrackingTarget
from uvms_drake.control.plan.plan import TrackingPlan
from uvms_drake.model.surface.law import check_surface
from uvms_drake.model.surface.surface_class import SurfaceClass
from uvms_drake.model.uvms_model import UvmsModel, read_uvms
from uvms_drake.station.scenario.scenario import load_scenario

DIRECTION = np.array([1.0, 0.0, 0.0])
SURFACE = SurfaceClass(DIRECTION, angle=0.05, friction=0.1)
POSITION = np.array([0.3, -0.2, 5.0])
"""Of the reference [m]; anywhere."""


def tracking_ocp(force: float = 20.0, model: UvmsModel | None = None,
                 offset: OffsetCost | None = None, overrides: tuple[str, ...] = (),
                 facets: np.ndarray | None = None) -> TrackingOcp:
    """Returns the problem with 1 s of horizon, and inputs that hold for forces up to `force` [N].

    The terminal set is a checked one for 20 N.
    """
    scenario = load_scenario("girona500_ideal", [
        "mpc.horizon=5", "mpc.terminal_radius=0.5", *overrides])
    model = model or UvmsModel(read_uvms(scenario.model))
    limits = tighten(make_limits(scenario.limits, model.q_lower, model.q_upper,
                                 check_surface(scenario.surface)), scenario.tube)
    del limits["static_force"]  # There is no surface.
    limits["u"] = UnderContact(limits["u"], ForceCone.of_surface(SURFACE, force))
    y = np.concatenate([POSITION, np.zeros(3), scenario.task.posture])
    return TrackingOcp(model, scenario.mpc, y, limits, DIRECTION, facets, offset)


def at_rest(ocp: TrackingOcp, position: np.ndarray) -> np.ndarray:
    """Returns (𝔮, 0) in the posture of the reference with the tip at `position` (3,)."""
    y = np.concatenate([position, ocp.y_des[3:]])
    return np.concatenate([ocp.model.configuration(y), np.zeros(len(y))])


def follow(ocp: TrackingOcp, aims: Iterable[TrackingTarget], plan: TrackingPlan, iterations: int = 1
           ) -> Iterator[tuple[TrackingOcp, TrackingPlan, TrackingPlan]]:
    """Yields problem, guess and plan of every sample: the nominal state is where the last one went.

    The guess is the last plan continued. What the solver returns is what is followed.
    """
    for aim in aims:
        problem = ocp.aimed(aim)
        solution = SequentialConvexSolver(problem).solve(plan, iterations)
        assert solution.plan is not None
        yield problem, plan, solution.plan
        plan = problem.continued(solution.plan)
