"""The tube-based NMPC: nominal MPC and ancillary feedback as one Diagram."""

from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import PassThrough

from uvms_drake.common.errors import require
from uvms_drake.common.wiring import outputs, wire
from uvms_drake.control.contact.contact_estimator import ContactEstimator
from uvms_drake.control.contact.press_control import PressControl
from uvms_drake.control.feedback.ancillary import AncillaryFeedback
from uvms_drake.control.feedback.disturbance_observer import (
    RowObserver,
    add_observer,
    export_inputs,
)
from uvms_drake.control.feedback.feedforward_preview import add_feedforward_preview
from uvms_drake.control.laws.law import AncillaryLaw
from uvms_drake.control.laws.tip_first import TipFirst
from uvms_drake.control.limits import Limits
from uvms_drake.control.mpc.nominal_mpc import NominalMpc
from uvms_drake.control.mpc.planner import Targets, committed_intervals
from uvms_drake.control.ocp.ocp import Ocp
from uvms_drake.control.ocp.scp import Solver
from uvms_drake.control.ocp.solvers import make_solver
from uvms_drake.control.ocp.tracking_ocp import TrackingOcp
from uvms_drake.control.supervisor.supervisor import Safety, Supervisor
from uvms_drake.model.signals.command_path import IDEAL_PATH, CommandPath
from uvms_drake.model.uvms_model import UvmsModel


def make_tube_mpc(ocp: Ocp, law: AncillaryLaw,
                  targets: Targets | None = None, limits: Limits | None = None,
                  command_path: CommandPath = IDEAL_PATH,
                  solver: Solver | None = None,
                  press: PressControl | None = None,
                  safety: Safety | None = None) -> Diagram:
    """Returns the tube-based NMPC of a task, as a Diagram named "tube_mpc".

    ::

                  ┌─────────────┐ nominal_state, nominal_acceleration, nominal_input
        state ─┬─▶│ nominal_mpc │──────────────┐
               │  └─────────────┘        ┌─────▼─────┐
               └────────────────────────▶│ ancillary │──▶ tau, u
        force_measured, vehicle_wrench ─▶└───────────┘

    .. pydrake_system::

        name: tube_mpc
        input_ports:
        - state
        - force_measured (optional)
        - vehicle_wrench (optional)
        - applied (optional, with an observer)
        - fault (optional)
        - desired_force (optional, with targets or a press control)
        - force_valid, place, deepest (with a press control)
        - force_status, fix_age, resume (optional, with a supervisor)
        output_ports:
        - tau
        - u
        - state_lost
        - input_limited
        - pair
        - safety, safety_ratio, input_filtered (with a supervisor)
        - nominal_state
        - nominal_input
        - plan
        - report
        - solve_seconds
        - desired_force (with targets or a press control)
        - target, safe_depth, ... (with a press control)

    - `state`: (𝔮, ζ) measured (2(6+n)), in the paper's order.
    - `force_measured`: 𝔉_s (6) [N, N m], see `AncillaryFeedback`.
    - `vehicle_wrench`: τ_v (6) [N, N m], likewise.
    - `applied`: τ (6+n) as known actuators give it, for the law's observer; see `RowObserver`.
    - `tau`: τ (6+n), wrench on the vehicle in body axes and joint torques [N, N m].
    - `u`: 𝔲 (6+n) [m/s², rad/s²].
    - `state_lost`: 1 while the measured state is not finite and τ is the plan's own, else 0 (1).
    - `input_limited`: 1 while a limit cuts the law's command, else 0 (1).
    - `pair`: `Pair` of measured and nominal motion, for a `TubeMonitor`.
    - `force_status`, `fix_age`, `resume`, `safety`, `safety_ratio`: see `Supervisor`.
    - `input_filtered`: 1 while the filter of the joints cuts the command, else 0 (1).
    - Those of a press control: see `PressControl`; its law takes the measured force, through a
      `HoldLastValue` that `force_lost` releases.
    - The others: see `NominalMpc`.

    Args:
        ocp: The problem that the nominal MPC solves; its model is the controller's.
        law: The feedback law and its gains.
        targets: Problems of other desired forces; None: the desired force is constant.
        limits: Limits of the real robot, to which `u` and `tau` are clipped; None: no clipping.
        command_path: Path of the commands, for a law that takes the thrusters' wrench; see
            `control.feedback.feedforward_preview` and `control.mpc.planner`.
        solver: Solver of the problem; that of its `MpcConfig` if None, see `make_solver`.
        press: Press on an unknown wall by the measured force, for a `TrackingOcp`; None: the model
            has the force.
        safety: Supervisor of a press; None: there is none.

    Raises:
        InvalidParameter: The problem is that of a sensed contact, without a press control.
    """
    require(press is not None or not isinstance(ocp, TrackingOcp), "ocp", type(ocp).__name__,
            "that of a known surface: for a sensed contact `uv.make_controller(scenario)` connects "
            "force sensor, contact estimator and press target")
    # The planner, between the systems that make its target from the measured force, if they do.
    builder = DiagramBuilder()
    state = builder.AddNamedSystem("state", PassThrough(2 * ocp.model.size))
    measured = state.get_output_port()
    committed = int(ocp.in_advance) + committed_intervals(law, command_path, ocp.time_step)
    pressing = None if press is None else press.add_to(builder, ocp, measured, committed)
    mpc = NominalMpc.AddToBuilder(
        builder, solver or make_solver(ocp), targets=targets, committed=committed, state=measured,
        undriven=law.undriven_rows if isinstance(law, TipFirst) else ())
    if pressing is not None:
        pressing.connect(builder, mpc)
    # Feedback about the plan, with the plan's forces in advance.
    feedback = AncillaryFeedback.AddToBuilder(
        builder, ocp.model, law, limits, None if safety is None else safety.retreat,
        None if safety is None else safety.allocation, name="ancillary", state=measured)
    wire(builder, feedback, outputs(mpc))
    add_feedforward_preview(
        builder, ocp.model, law, feedback, command_path, nominal=mpc,
        estimator=None if pressing is None else pressing.estimator,
        direction=None if pressing is None else pressing.walls.direction)

    # Ports of the controller: its systems' own, by their names.
    builder.ExportInput(state.get_input_port(), "state")
    observer = add_observer(builder, ocp.model, law, feedback, state=measured)
    export_inputs(builder, feedback, observer)
    builder.ExportInput(mpc.GetInputPort("fault"), "fault")
    for name in ("tau", "u", "pair"):
        builder.ExportOutput(feedback.GetOutputPort(name), name)
    builder.ExportOutput(feedback.GetOutputPort("lost"), "state_lost")
    builder.ExportOutput(feedback.GetOutputPort("limited"), "input_limited")
    for name in ("nominal_state", "nominal_input", "plan", "report", "solve_seconds"):
        builder.ExportOutput(mpc.GetOutputPort(name), name)
    if pressing is not None:
        pressing.export(builder)
        if safety is not None:
            _add_supervisor(builder, ocp.model, safety, command_path, mpc, feedback, observer,
                            pressing.estimator)
    elif targets is not None:
        builder.ExportInput(mpc.GetInputPort("desired_force"), "desired_force")
        builder.ExportOutput(mpc.GetOutputPort("accepted_force"), "desired_force")
    diagram = builder.Build()
    diagram.set_name("tube_mpc")
    return diagram


def _add_supervisor(builder: DiagramBuilder, model: UvmsModel, safety: Safety, path: CommandPath,
                    mpc: NominalMpc, feedback: AncillaryFeedback, observer: RowObserver | None,
                    estimator: ContactEstimator) -> None:
    """Adds the supervisor of a press, at the ticks of the clock of the law if it has one."""
    supervisor = Supervisor.AddToBuilder(
        builder, model, safety.thresholds, safety.retreat, path.period,
        pair=feedback.GetOutputPort("pair"), report=mpc.GetOutputPort("report"),
        force_lost=estimator.GetOutputPort("force_lost"), raised=feedback.GetOutputPort("raised"),
        limited=feedback.GetOutputPort("limited"),
        estimate=None if observer is None else observer.get_output_port())
    for name in ("state", "force_valid"):
        builder.ConnectInput(name, supervisor.GetInputPort(name))
    for name in ("force_status", "fix_age", "resume"):
        builder.ExportInput(supervisor.GetInputPort(name), name)
    for listener in (mpc, feedback):
        builder.Connect(supervisor.GetOutputPort("retreat"), listener.GetInputPort("retreat"))
    for name in ("safety", "safety_ratio"):
        builder.ExportOutput(supervisor.GetOutputPort(name), name)
    builder.ExportOutput(feedback.GetOutputPort("filtered"), "input_filtered")
