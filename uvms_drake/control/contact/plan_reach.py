"""How far across the direction of a contact the rest of a plan goes from where the tip is."""

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiagramBuilder,
    LeafSystem,
    OutputPort,
    ValueProducer,
)

from uvms_drake.common.wiring import added
from uvms_drake.control.contact.approach import between_knots
from uvms_drake.control.tracking_ocp import TrackingOcp
from uvms_drake.control.tracking_plan import TrackingPlan
from uvms_drake.model.spatial import times
from uvms_drake.model.surface.surface_class import SurfaceClass


def plan_places(ocp: TrackingOcp, plan: TrackingPlan) -> np.ndarray:
    """Returns points (m, 3) in whose hull across n the tip of a plan stays, and its reference [m].

    The knots, the points half an interval ahead of each, see `approach.between_knots`, and
    E ᵀ(y_des + E a): a plan that is continued by the terminal controller has no more limits of the
    front than the room at that place.
    """
    kinematics = ocp.model.kinematics(plan.config)
    knots, velocities = kinematics.chi[:, :3], times(kinematics.J_chi[:, :3], plan.zeta)
    ahead = between_knots(knots, velocities, plan.time_step)
    return np.concatenate([knots, ahead, ocp.reference(plan)[None, :3]])


class PlanReach(LeafSystem):
    """Puts out ℓ of the plan that is followed, see `front.replaces`.

    .. pydrake_system::

        name: PlanReach
        input_ports:
        - plan
        - state
        output_ports:
        - reach

    - `plan`: the current `TrackingPlan` (abstract); knots that are over count, too.
    - `state`: (𝔮, ζ) (2(6+n)) measured.
    - `reach` (1): largest distance of `plan_places` from the tip, in `SurfaceClass.around` [m].

    It has no state.

    Args:
        ocp: Its problem.
        surface: The class of walls.
    """

    def __init__(self, ocp: TrackingOcp, surface: SurfaceClass):
        super().__init__()
        self._ocp, self._surface = ocp, surface
        self._plan_port = self.DeclareAbstractInputPort("plan", Value(object()))
        self._state_port = self.DeclareVectorInputPort("state", 2 * ocp.model.size)
        # A plan is followed for many readings of a sensor.
        self._places = self.DeclareCacheEntry(
            description="where the plan goes", value_producer=ValueProducer(
                allocate=lambda: AbstractValue.Make(()), calc=self._calc_places),
            prerequisites_of_calc={self._plan_port.ticket()})
        self.DeclareVectorOutputPort(
            "reach", 1, self._calc, {self._places.ticket(), self._state_port.ticket()})

    def _calc_places(self, context: Context, value: AbstractValue) -> None:
        value.set_value(plan_places(self._ocp, self._plan_port.Eval(context)))

    def _calc(self, context: Context, output: BasicVector) -> None:
        config = self._state_port.Eval(context)[: self._ocp.model.size]
        tip = self._ocp.model.task_pose(config)[:3]
        output[0] = float(np.max(self._surface.around(self._places.Eval(context) - tip)))

    @staticmethod
    def AddToBuilder(builder: DiagramBuilder, ocp: TrackingOcp, surface: SurfaceClass, *,
                     plan: OutputPort, state: OutputPort, name: str = "plan_reach") -> "PlanReach":
        """Adds the system and connects it; the arguments are its constructor's and its inputs."""
        return added(builder, name, PlanReach(ocp, surface), plan=plan, state=state)
