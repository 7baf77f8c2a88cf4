"""Extent of a plan across the direction of a contact, where the safe region must not shrink."""

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import (
    BasicVector,
    Context,
)

from uvms_drake.common.wiring import WiredSystem
from uvms_drake.control.ocp.tracking_ocp import TrackingOcp
from uvms_drake.control.plan.plan import TrackingPlan, between_knots
from uvms_drake.model.frames.spatial import times
from uvms_drake.model.surface.surface_class import SurfaceClass


def plan_extent(ocp: TrackingOcp, plan: TrackingPlan) -> np.ndarray:
    """Returns points (m, 3) [m] whose hull across n contains a plan's tip, and its reference.

    These are the knots, the points half an interval after each, see `between_knots`, and
    E ᵀ(y_des + E a): the only bound of the safe region on a plan that is continued by the terminal
    controller is the radius at that place.
    """
    kinematics = ocp.model.tip_kinematics(plan.config)
    knots, velocities = kinematics.chi[:, :3], times(kinematics.J_chi[:, :3], plan.zeta)
    between = between_knots(knots, velocities, plan.time_step)
    return np.concatenate([knots, between, ocp.reference(plan)[None, :3]])


class PlanExtent(WiredSystem):
    """Lateral extent of the current plan, see `safe_region.dominates`.

    .. pydrake_system::

        name: PlanExtent
        input_ports:
        - plan
        output_ports:
        - extent

    - `plan`: current `TrackingPlan` (abstract); past knots count, too.
    - `extent` (4): least, then largest `SurfaceClass.across` of `plan_extent` [m].

    It has no state.

    Args:
        ocp: Problem of the plan.
        surface: The class of walls.
    """

    def __init__(self, ocp: TrackingOcp, surface: SurfaceClass):
        super().__init__()
        self._ocp, self._surface = ocp, surface
        self._plan_port = self.DeclareAbstractInputPort("plan", Value(object()))
        # A plan lasts for many readings of a sensor: its extent is cached by the port.
        self.DeclareVectorOutputPort("extent", 4, self._calc, {self._plan_port.ticket()})

    def _calc(self, context: Context, output: BasicVector) -> None:
        places = self._surface.across(plan_extent(self._ocp, self._plan_port.Eval(context)))
        output.SetFromVector(np.append(places.min(axis=0), places.max(axis=0)))
