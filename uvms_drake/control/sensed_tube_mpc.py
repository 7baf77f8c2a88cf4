"""The controller for a wall that nobody measured: it presses where it feels."""

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
from uvms_drake.control.ocp.scp import SequentialConvexSolver
from uvms_drake.control.ocp.tracking_ocp import TURNED_FREELY, TrackingOcp
from uvms_drake.control.plan.commitment import committed_intervals
from uvms_drake.model.sensor_actuator import ON_TIME, ActuationDelay
from uvms_drake.model.surface.surface_class import SurfaceClass


def make_sensed_tube_mpc(ocp: TrackingOcp, law: AncillaryLaw, walls: SurfaceClass,
                         sensing: ForceSensorModel, *, force: float, largest: float, margin: float,
                         limits: Limits | None = None, actuation_delay: ActuationDelay = ON_TIME) -> Diagram:
    """Returns the tube-based NMPC that presses on a wall of a class, as a Diagram named "tube_mpc".

    ::

        desired_force ─▶ desired_force ─▶ press_target ◀─ place, deepest
                                  ▲ what was felt  │ target
                                  │                ▼
        force_valid ──────▶ contact_estimator ──▶ nominal_mpc ◀─ turn, of wall_normal
                                  ▲      front     │ nominal state, ...
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
        - slope
        - force_lost
        - contact_depth

    - `force_measured`: 𝔉_s (6) [N, N m], which the law takes: through a `HoldLastValue` that lets go
      by `force_lost`.
    - `force_valid`: 𝔉_s (6) as the sensor gives it, through a `ForceFaultDetector` if its `repeats` are not
      0; not finite in a gap. The front learns from it, and from an old value it would take for safe
      what nobody has felt.
    - `place`: where across n to press (3) in Σ_I [m]; else where y_des says. It may jump: a plan
      slides as fast as limits and front let it.
    - `deepest`: largest depth along n to steer for (1) [m]; see `PressTarget`.
    - `accepted_force`: what a `DesiredForce` leaves of the desired force (6) [N, N m].
    - `target`: where the end-effector is sent (3) in Σ_I [m].
    - `turn`: by how much the reference is to be turned about the vertical, after the wall (1)
      [rad]; zero without `ocp.turn`.
    - `safe_depth`, `touched`, `slope`, `contact_depth`, `force_lost`: what was felt, see
      `ContactEstimator`.
    - the others: see `make_tube_mpc`.

    Args:
        ocp: The problem; its model has no contact, its y_des says where across n to press.
        law: The feedback law and its gains, one that takes the measured force.
        walls: What is known of the wall.
        sensing: What is known of the force sensor.
        force: Force along n that is asked for if nobody asks for another [N].
        largest: Largest force along n that may be asked for [N].
        margin: E, how far the real tip may be beyond the planned one; see `ContactEstimator` [m].
        limits: Those of the real robot, which `u` and `tau` keep to; None: they are not cut.
        actuation_delay: Of the commands, see `make_tube_mpc`.
    """
    require(largest + sensing.noise < sensing.largest, "largest", largest,
            "a force that is read before the end of the sensor's range")
    builder = DiagramBuilder()
    state = builder.AddNamedSystem("state", PassThrough(2 * ocp.model.size))
    measured = state.get_output_port()

    # What was felt, and where to press next.
    estimator = ContactEstimator.AddToBuilder(
        builder, ocp.model, walls, sensing.watched, margin=margin, state=measured)
    normal = WallNormal.AddToBuilder(
        builder, estimator, walls, TURNED_FREELY * ocp.turn, sensing.period)
    desired = DesiredForce.AddToBuilder(builder, walls.direction, force, largest)
    committed = committed_intervals(law, actuation_delay, ocp.time_step)
    search_lead = ocp.following_lag(committed) * search_speed(
        1.0, walls.stiffness, touch_to_plan(ocp.time_step, committed, sensing))
    press = PressTarget.AddToBuilder(builder, estimator, walls.direction, ocp.y_des[:3],
                                     desired_force=desired.GetOutputPort("along"), search_lead=search_lead)

    # The plan, and the feedback about it.
    mpc = NominalMpc.AddToBuilder(
        builder, SequentialConvexSolver(ocp), state=measured, committed=committed)
    for source, port in ((press.get_output_port(), "target"),
                         (normal.get_output_port(), "turn"),
                         (estimator.GetOutputPort("facet_depths"), "safe_depth")):
        if port in ocp.inputs_given:
            builder.Connect(source, mpc.GetInputPort(port))
    extent = PlanExtent.AddToBuilder(builder, ocp, walls, plan=mpc.GetOutputPort("plan"))
    builder.Connect(extent.get_output_port(), estimator.GetInputPort("extent"))
    feedback = AncillaryFeedback.AddToBuilder(
        builder, ocp.model, law, nominal=mpc, state=measured, limits=limits)
    add_feedforward_preview(builder, ocp.model, law, feedback, actuation_delay, nominal=mpc, estimator=estimator,
                     direction=walls.direction)

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
        (estimator, ("safe_depth", "touched", "slope", "contact_depth", "force_lost")),
    ):
        for name in names:
            builder.ExportOutput(system.GetOutputPort(name), name)
    diagram = builder.Build()
    diagram.set_name("tube_mpc")
    return diagram
