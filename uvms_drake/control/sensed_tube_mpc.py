"""Controller for an unknown wall: nominal MPC, feedback, contact estimator and press target."""

from typing import Any

from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import PassThrough

from uvms_drake.common.errors import require
from uvms_drake.control.contact.contact_estimator import ContactEstimator
from uvms_drake.control.contact.contact_state import ForceSensorModel
from uvms_drake.control.contact.desired_force import DesiredForce
from uvms_drake.control.contact.press_target import PressTarget, search_speed, touch_to_plan
from uvms_drake.control.contact.wall_normal import WallNormal
from uvms_drake.control.feedback.ancillary import AncillaryFeedback
from uvms_drake.control.feedback.disturbance_observer import add_observer, export_inputs
from uvms_drake.control.feedback.feedforward_preview import add_feedforward_preview
from uvms_drake.control.laws.law import AncillaryLaw
from uvms_drake.control.limits import Limits
from uvms_drake.control.mpc.nominal_mpc import NominalMpc
from uvms_drake.control.mpc.plan_extent import PlanExtent
from uvms_drake.control.ocp.solver import Solver
from uvms_drake.control.ocp.solvers import make_solver
from uvms_drake.control.ocp.tracking_ocp import TURNED_FREELY, TrackingOcp
from uvms_drake.control.plan.commitment import committed_intervals
from uvms_drake.model.signals.sensor_actuator import ON_TIME, ActuationDelay
from uvms_drake.model.surface.surface_class import SurfaceClass


def make_sensed_tube_mpc(
    ocp: TrackingOcp, law: AncillaryLaw, walls: SurfaceClass, sensing: ForceSensorModel, *,
    force: float, largest: float, margin: float, limits: Limits | None = None,
    actuation_delay: ActuationDelay = ON_TIME, solver: Solver[Any] | None = None,
) -> Diagram:
    """Returns the tube-based NMPC that presses on a wall of a class, as a Diagram named "tube_mpc".

    ::

        desired_force ─▶ desired_force ─▶ press_target ◀─ place, deepest
                                  ▲ contact state  │ target
                                  │                ▼
        force_valid ──────▶ contact_estimator ──▶ nominal_mpc ◀─ turn, of wall_normal
                                  ▲   safe_depth   │ nominal state, ...
                           state ─┴──────────▶ ancillary ──▶ tau, u
        force_measured, vehicle_wrench ─────────▲

    .. pydrake_system::

        name: tube_mpc
        input_ports:
        - state
        - force_measured
        - vehicle_wrench (optional)
        - applied (optional, with an observer)
        - force_valid
        - fault (optional)
        - desired_force (optional)
        - place (optional)
        - deepest (optional)
        output_ports:
        - tau
        - u
        - lost
        - limited
        - pair
        - nominal_state
        - nominal_input
        - plan
        - report
        - solve_seconds
        - accepted_force
        - target
        - turn
        - safe_depth
        - touched
        - stiffness_estimate
        - stiffness_std
        - stiffness_used
        - force_lost
        - contact_depth

    - `force_measured`: 𝔉_s (6) [N, N m] for the law, through a `HoldLastValue` that `force_lost`
      releases.
    - `force_valid`: 𝔉_s (6) of the sensor, through a `ForceFaultDetector` if its `repeats` are not
      0; not finite in a gap. The safe region must not be extended by an old value.
    - `place`: place across n at which to press (3) in Σ_I [m]; that of y_des if unconnected. It may
      jump: a plan slides as fast as limits and safe region allow.
    - `deepest`: largest depth along n to steer for (1) [m]; see `PressTarget`.
    - `accepted_force`: desired force, clipped by `DesiredForce` (6) [N, N m].
    - `target`: target of the end-effector (3) in Σ_I [m].
    - `turn`: desired turn of the reference about the vertical, after the wall's normal (1) [rad];
      zero without `ocp.turn`.
    - `safe_depth`, `touched`, `stiffness_estimate`, `stiffness_std`, `stiffness_used`,
      `contact_depth`, `force_lost`: see `ContactEstimator`.
    - The others: see `make_tube_mpc`.

    Args:
        ocp: The problem; its model has no contact, its y_des has the place across n.
        law: The feedback law and its gains; it takes the measured force.
        walls: Class of the wall.
        sensing: Model of the force sensor.
        force: Default of the desired force along n [N].
        largest: Largest desired force along n that is accepted [N].
        margin: E, largest distance of the real tip beyond the planned one [m]; see
            `ContactEstimator`.
        limits: Limits of the real robot, to which `u` and `tau` are clipped; None: no clipping.
        actuation_delay: Delay of the commands, see `make_tube_mpc`.
        solver: Solver of the problem; that of its `MpcConfig` if None.
    """
    require(largest + sensing.noise < sensing.largest, "largest", largest,
            "a force that is measured before the end of the sensor's range")
    builder = DiagramBuilder()
    state = builder.AddNamedSystem("state", PassThrough(2 * ocp.model.size))
    measured = state.get_output_port()

    # Contact state, and from it the turn, the desired force and the next target.
    estimator = ContactEstimator.AddToBuilder(
        builder, ocp.model, walls, sensing.watched, margin=margin, state=measured)
    normal = WallNormal.AddToBuilder(
        builder, estimator, walls, TURNED_FREELY * ocp.turn, sensing.period)
    desired = DesiredForce.AddToBuilder(builder, walls.direction, force, largest)
    committed = committed_intervals(law, actuation_delay, ocp.time_step)
    search_lead = ocp.following_lag(committed) * search_speed(
        1.0, walls.stiffness, touch_to_plan(ocp.time_step, committed, sensing))
    press = PressTarget.AddToBuilder(
        builder, estimator, walls.direction, ocp.y_des[:3],
        desired_force=desired.GetOutputPort("along"), search_lead=search_lead)

    # Planner on the target within the safe region; its extent keeps that region from shrinking.
    mpc = NominalMpc.AddToBuilder(
        builder, solver or make_solver(ocp), state=measured, committed=committed)
    for source, port in ((press.get_output_port(), "target"),
                         (normal.get_output_port(), "turn"),
                         (estimator.GetOutputPort("facet_depths"), "safe_depth")):
        if port in ocp.inputs_given:
            builder.Connect(source, mpc.GetInputPort(port))
    extent = PlanExtent.AddToBuilder(builder, ocp, walls, plan=mpc.GetOutputPort("plan"))
    builder.Connect(extent.get_output_port(), estimator.GetInputPort("extent"))

    # Feedback about the plan, with the plan's forces and the wall's reaction in advance.
    feedback = AncillaryFeedback.AddToBuilder(
        builder, ocp.model, law, nominal=mpc, state=measured, limits=limits)
    add_feedforward_preview(
        builder, ocp.model, law, feedback, actuation_delay, nominal=mpc, estimator=estimator,
        direction=walls.direction)

    # Ports of the controller: its systems' own, by their names.
    builder.ExportInput(state.get_input_port(), "state")
    export_inputs(builder, feedback, add_observer(
        builder, ocp.model, law, feedback, state=measured))
    builder.ExportInput(estimator.GetInputPort("force_measured"), "force_valid")
    builder.ConnectInput("force_valid", normal.GetInputPort("force_measured"))
    builder.ExportInput(mpc.GetInputPort("fault"), "fault")
    builder.ExportInput(desired.GetInputPort("desired_force"), "desired_force")
    for name in ("place", "deepest"):
        builder.ExportInput(press.GetInputPort(name), name)
    for system, names in (
        (feedback, ("tau", "u", "lost", "limited", "pair")),
        (mpc, ("nominal_state", "nominal_input", "plan", "report", "solve_seconds")),
        (desired, ("accepted_force",)),
        (press, ("target",)),
        (normal, ("turn",)),
        (estimator, ("safe_depth", "touched", "stiffness_estimate", "stiffness_std",
                     "stiffness_used", "contact_depth", "force_lost")),
    ):
        for name in names:
            builder.ExportOutput(system.GetOutputPort(name), name)
    diagram = builder.Build()
    diagram.set_name("tube_mpc")
    return diagram
