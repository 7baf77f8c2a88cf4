"""Press by a measured force: contact estimator, desired force and press target of a controller."""

from dataclasses import dataclass

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import Context, DiagramBuilder, OutputPort

from uvms_drake.common.wiring import WiredSystem, output_of, outputs, wire
from uvms_drake.control.contact.contact_estimator import ContactEstimator
from uvms_drake.control.contact.contact_state import EstimatorSettings
from uvms_drake.control.contact.desired_force import DesiredForce
from uvms_drake.control.contact.press_target import PressTarget, search_speed, touch_to_plan
from uvms_drake.control.mpc.nominal_mpc import NominalMpc
from uvms_drake.control.ocp.ocp import Ocp
from uvms_drake.control.ocp.tracking_ocp import TrackingOcp
from uvms_drake.control.plan.plan import TrackingPlan, between_knots
from uvms_drake.model.frames.spatial import times
from uvms_drake.model.surface.surface_class import SurfaceClass


@dataclass(frozen=True)
class PressControl:
    """Part of a `tube_mpc` that presses on a wall of a class with a measured force.

    ::

        desired_force ─▶ desired_force ─▶ press_target ◀─ place, deepest
                                  ▲ contact state  │ target
                                  │                ▼
        force_valid ──────▶ contact_estimator ──▶ nominal_mpc
                                  ▲   safe_depth
                                state

    Input ports of the controller:

    - `force_valid`: 𝔉_s (6) of the sensor, through a `ForceFaultDetector` if its `repeats` are not
      0; not finite in a gap. The safe region must not be extended by an old value.
    - `desired_force` (optional): 𝔉_des (6) [N, N m], see `DesiredForce`.
    - `place` (optional): place across n at which to press (3) in Σ_I [m]; that of y_des if
      unconnected. It may jump: a plan slides as fast as limits and safe region allow.
    - `deepest` (optional): largest depth along n to steer for (1) [m]; see `PressTarget`.

    Output ports of the controller:

    - `desired_force`: desired force, clipped by `DesiredForce` (6) [N, N m].
    - `target`, `unclipped_target`, `target_of_reading`: target of the end-effector, without
      `deepest`, and likewise by the last reading alone (3) in Σ_I [m].
    - `safe_depth`, `touched`, `stiffness_estimate`, `stiffness_std`, `stiffness_used`,
      `contact_depth`, `force_lost`: see `ContactEstimator`.
    """

    walls: SurfaceClass
    """Class of the wall."""
    sensing: EstimatorSettings
    """Declared bounds of the readings."""
    force: float
    """Default of the desired force along n [N]."""
    largest: float
    """Largest desired force along n that is accepted [N]."""
    margin: float
    """E, largest distance of the real tip beyond the planned one [m]; see `ContactEstimator`."""

    def add_to(self, builder: DiagramBuilder, ocp: Ocp, state: OutputPort,
               committed: int) -> "PressSystems":
        """Adds contact estimator, desired force and press target.

        Args:
            builder: Builder of the controller.
            ocp: A `TrackingOcp`; its model has no contact, its y_des has the place across n.
            state: Output port of the measured (𝔮, ζ).
            committed: Number of committed intervals of a plan.
        """
        assert isinstance(ocp, TrackingOcp), "a measured force is pressed by a TrackingOcp"
        walls, sensing = self.walls, self.sensing
        estimator = ContactEstimator.AddToBuilder(
            builder, ocp.model, walls, sensing.watched, margin=self.margin, state=state)
        desired = DesiredForce.AddToBuilder(builder, walls.direction, self.force, self.largest)
        search_lead = ocp.following_lag(committed) * search_speed(
            1.0, walls.stiffness, touch_to_plan(ocp.time_step, committed, sensing))
        press = PressTarget.AddToBuilder(
            builder, walls.direction, ocp.y_des[:3], search_lead=search_lead,
            desired_force=desired.GetOutputPort("along"))
        wire(builder, press, outputs(estimator))
        return PressSystems(ocp, walls, estimator, desired, press)


@dataclass(frozen=True)
class PressSystems:
    """Systems of a `PressControl`."""

    ocp: TrackingOcp
    walls: SurfaceClass
    estimator: ContactEstimator
    desired: DesiredForce
    press: PressTarget

    def connect(self, builder: DiagramBuilder, mpc: NominalMpc) -> None:
        """Connects them with the planner, whose extent keeps the safe region from shrinking."""
        for source, port in ((self.press.GetOutputPort("target"), "target"),
                             (self.estimator.GetOutputPort("facet_depths"), "safe_depth")):
            if port in self.ocp.inputs_given:
                builder.Connect(source, mpc.GetInputPort(port))
        extent = PlanExtent.AddToBuilder(
            builder, self.ocp, self.walls, plan=mpc.GetOutputPort("plan"))
        builder.Connect(extent.get_output_port(), self.estimator.GetInputPort("extent"))

    def export(self, builder: DiagramBuilder) -> None:
        """Exports their ports, by their names."""
        builder.ExportInput(self.estimator.GetInputPort("force_measured"), "force_valid")
        builder.ExportInput(self.desired.GetInputPort("desired_force"), "desired_force")
        for name in ("place", "deepest"):
            builder.ExportInput(self.press.GetInputPort(name), name)
        builder.ExportOutput(self.desired.GetOutputPort("accepted_force"), "desired_force")
        for system, names in (
            (self.press, ("target", "unclipped_target", "target_of_reading")),
            (self.estimator, ("safe_depth", "touched", "stiffness_estimate", "stiffness_std",
                              "stiffness_used", "contact_depth", "force_lost")),
        ):
            for name in names:
                builder.ExportOutput(system.GetOutputPort(name), name)


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
        output_of(self, "extent", 4, self._extent, {self._plan_port.ticket()})

    def _extent(self, context: Context) -> np.ndarray:
        places = self._surface.across(plan_extent(self._ocp, self._plan_port.Eval(context)))
        return np.append(places.min(axis=0), places.max(axis=0))
