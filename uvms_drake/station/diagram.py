"""The closed loop of a scenario: plant, controller and the parts between them, in one Diagram."""

from collections.abc import Iterable, Mapping
from typing import cast

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, OutputPort, System
from pydrake.systems.primitives import LogVectorOutput, VectorLog, VectorLogSink

from uvms_drake.common.errors import within
from uvms_drake.common.schema import check_values
from uvms_drake.common.wiring import outputs, wire
from uvms_drake.control.feedback.tube_monitor import TubeMonitor
from uvms_drake.control.laws.law import AncillaryLaw
from uvms_drake.control.limits import TubeRadii, resolved_radii, tighten
from uvms_drake.control.mpc.planner import MPC_REPORT
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.signals.sensor_actuator import Signals
from uvms_drake.plant.waves import WaterMotion
from uvms_drake.station import problem
from uvms_drake.station.contact.bounds import safe_depth_margin
from uvms_drake.station.controller import SAMPLED, connect_controller, make_tube, signals_of
from uvms_drake.station.plant import applied_disturbance, make_simulated_uvms
from uvms_drake.station.scenario.parts import faults_at
from uvms_drake.station.scenario.scenario import Scenario
from uvms_drake.station.supervision import MONITOR_FLOOR, MONITOR_SLACK
from uvms_drake.visual.controls import DisturbanceSlider
from uvms_drake.visual.scene import Illustration, LimitUse, Setting

UNLOGGED = {"plant_state", "configuration"}
"""Vector outputs of the plant that are not logged: they repeat `state` in other coordinates."""

PAINTED = 1.5
"""End of the colour scale of a mission over its largest desired force."""


def make_station(scenario: Scenario, *, controller: System | None = None,
                 meshcat: Meshcat | None = None, certified: bool = False,
                 model: ContactModel | None = None) -> Diagram:
    """Returns the closed loop as a Diagram named "station", which starts as the scenario says.

    ::

                       ┌──────┐ state   ┌─────────┐ (force) ┌────────────┐
        disturbance ──▶│ uvms │────────▶│ sensing │────────▶│ controller │◀── fault
                   ┌──▶└──────┘         └─────────┘         └────────────┘
                   │                   ┌───────────┐ tau     ▲   │
                   └───────────────────│ actuation │◀────────┼───┘
                                       └───────────┘─────────┘ (vehicle_wrench)

    Sensing and actuation are series of parts, none by default: the scenario's, and its faults of
    sensors and of actuators, next to the robot. The logs and a `TubeMonitor` read the true state
    and the commanded τ. The signal `force_measured` of a part of sensing goes to the law, see
    `controller.add_measured_force`, the signal `vehicle_wrench` of a part of actuation to a law
    that `takes_wrench`. The disturbance observer takes the output of the parts of actuation, with
    this wrench, for the applied input; a fault injected behind them is hidden from it.

    A controller of one's own has the input port `state`, in general `force_measured`, and others of
    these names if it wants to; and the output port `tau`. Its other outputs of vectors are logged.
    There is no tube about it, and so no monitor.

    .. pydrake_system::

        name: station
        input_ports:
        - desired_force (optional)
        - place (optional, with a sensed contact)
        - deepest (optional, with a sensed contact)
        - stop (optional, with a mission and without meshcat)
        output_ports:
        - state, force, u, tau, ... (each signal)
        - tube_deviation
        - tube_bound
        - report
        - solve_seconds
        - plan
        - tube_report
        - tube_alarm

    `desired_force` (6) [N, N m] and `place` (3) [m] change the task during a run, see `NominalMpc`
    and `PressControl`; unconnected, they stay the scenario's. With a mission, a
    `MissionControl` sets both, and `deepest`; `stop` (1) above zero, or a button in Meshcat, stops
    it. The other ports are in `station/README.md`.

    Args:
        scenario: Everything the run depends on.
        controller: A controller of one's own in place of the scenario's tube MPC.
        meshcat: Meshcat of an `Illustration`; None: no picture.
        certified: Whether the tube is certified: then it is monitored from the start, else only
            after the robot has hovered.
        model: The controller's model; loaded if left out.

    Raises:
        InvalidParameter: A value of the scenario cannot be used.
    """
    builder, model = DiagramBuilder(), model or problem.load_model(scenario)
    check_values(scenario)
    with_mpc, start = controller is None, scenario.start.config
    if controller is None:
        ocp = problem.make_ocp(scenario, model)
        start = problem.start_state(scenario, ocp)[: model.size]
        controller = make_tube(scenario, model, ocp)

    # Plant and controller, and the parts between them.
    uvms = builder.AddNamedSystem("uvms", make_simulated_uvms(scenario, None, start))
    builder.AddNamedSystem("tube_mpc" if with_mpc else "controller", controller)
    signals = Signals({name: port for name, port in (
        outputs(uvms) | signals_of(controller)).items() if name not in UNLOGGED})
    true = uvms.GetOutputPort("state")
    measured, exerted = connect_controller(
        builder, scenario, model, controller, true, signals, scenario.faults, meshcat)
    builder.Connect(exerted, uvms.GetInputPort("tau"))
    if exerted is not controller.GetOutputPort("tau"):
        signals["exerted"] = exerted
    water = builder.AddNamedSystem("water", WaterMotion(scenario.current, [
        *scenario.waves, *faults_at("water", scenario.faults).values()]))
    wire(builder, uvms, outputs(water))

    # The monitor, and the disturbance, which may be aimed with the monitor's errors.
    errors: dict[str, OutputPort] = {}
    if with_mpc:
        pair = controller.GetOutputPort("pair") if measured is true and (
            controller.HasOutputPort("pair")) else None
        monitor = add_monitor(builder, scenario, model, signals, pair, certified=certified)
        errors = outputs(monitor)
        for name in ("deviation", "bound"):
            signals[f"tube_{name}"] = errors.pop(name)
        for name in ("report", "alarm"):
            builder.ExportOutput(monitor.GetOutputPort(name), f"tube_{name}")
    with within("disturbance"):
        disturbance = applied_disturbance(
            scenario.disturbance, scenario.model_error.share, scenario.faults).add_to(
                builder, model, scenario.seed, errors | signals)
    if meshcat is not None:
        disturbance = DisturbanceSlider.AddToBuilder(
            builder, disturbance.size(), meshcat, disturbance=disturbance).get_output_port()
    builder.Connect(disturbance, uvms.GetInputPort("disturbance"))

    # Logs, outputs and the picture.
    for name, port in signals.items():
        builder.ExportOutput(port, name)
        LogVectorOutput(port, builder, scenario.log_period).set_name(f"log.{name}")
    for name in SAMPLED:
        if controller.HasOutputPort(name):
            port = controller.GetOutputPort(name)
            builder.ExportOutput(port, name)
            LogVectorOutput(port, builder, scenario.mpc.time_step).set_name(f"log.{name}")
    if controller.HasOutputPort("plan"):
        builder.ExportOutput(controller.GetOutputPort("plan"), "plan")
    if meshcat is not None and with_mpc:
        picture = builder.AddNamedSystem("illustration", Illustration(
            meshcat, setting_of(scenario, model, certified=certified)))
        wire(builder, picture, {**signals, "plan": controller.GetOutputPort("plan")})
    station = builder.Build()
    station.set_name("station")
    return station


def add_monitor(builder: DiagramBuilder, scenario: Scenario, model: ContactModel,
                signals: Mapping[str, OutputPort], pair: OutputPort | None, *, certified: bool
                ) -> TubeMonitor:
    """Adds the monitor of the scenario's tube.

    Args:
        builder: Builder to add to.
        scenario: Scenario with law, tube and disturbance.
        model: The controller's model.
        signals: Signals of the loop.
        pair: Output port of the controller's `Pair`, if the state that it measures is the true one.
        certified: As of `make_station`.
    """
    declared = scenario.disturbance
    radii = set_wise_radii(scenario.tube, scenario.ancillary)
    monitor = builder.AddNamedSystem("tube_monitor", TubeMonitor(
        model, scenario.ancillary, declared.d_bound, radii,
        weights=problem.disturbance_weights(scenario, model),
        along_run=scenario.contact.declared_wall() is None, period=scenario.log_period,
        begin=monitor_begin(scenario.mpc.hover, certified), slack=MONITOR_SLACK,
        floor=monitor_floor(radii)))
    read = {name: signals[name] for name in ("state", "nominal_state", "safety")
            if name in signals}
    if bounds_disturbance(declared.d_bound, certified):
        read["disturbance"] = signals["disturbance"]
    if pair is not None:
        read["pair"] = pair
    wire(builder, monitor, read)
    return monitor


def monitor_begin(hover: float, certified: bool) -> float:
    """Returns the start of a `TubeMonitor` [s]: zero for a certified tube, else after hovering."""
    return 0.0 if certified else hover


def bounds_disturbance(d_bound: float, certified: bool) -> bool:
    """Returns whether d̃ bounds the whole disturbance.

    An uncertified d̃ of zero bounds nothing: the model errors are not part of it.
    """
    return certified or d_bound > 0.0


def monitor_floor(radii: Mapping[str, float]) -> float:
    """Returns the deviation below which a `TubeMonitor` of `set_wise_radii` counts no exit."""
    return min([MONITOR_FLOOR, *(0.1 * each for each in radii.values() if 0.0 < each < np.inf)])


def set_wise_radii(radii: TubeRadii, law: AncillaryLaw) -> dict[str, float]:
    """Returns the set-wise bounds that a `TubeMonitor` watches, from the radii of a tube."""
    tube = resolved_radii(radii)
    joints = tube.joints if law.protects_joints else None
    bounds = {"task": tube.e, "position": tube.position, "orientation": tube.orientation,
              "joints": joints, "z": tube.z}
    return {field: bound for field, bound in bounds.items() if bound is not None}


def read_logs(station: Diagram, context: Context) -> dict[str, np.ndarray]:
    """Returns the logs so far, from a root context: `time` (T,), signals (T, size), MPC's samples.

    The samples, of an MPC alone, are `mpc_time`, `mpc_status`, `mpc_cost`, `mpc_terminal_slack`,
    `mpc_violation`, `mpc_iterations`, `mpc_refused`, `mpc_rows` (K,), see `MPC_REPORT`, and
    `step_seconds` (K,), wall time. An instant that not all sinks have logged, of an exception, is
    left out.
    """
    def log(name: str) -> VectorLog:
        return cast(VectorLogSink, station.GetSubsystemByName(f"log.{name}")).FindLog(context)

    def together(names: Iterable[str]) -> list[np.ndarray]:
        """Returns the data of some logs (T, size), of the samples that all of them have."""
        data = [log(name).data().T for name in names]
        return [each[: min(map(len, data))].copy() for each in data]

    sinks = [system.get_name() for system in station.GetSystems()]
    logged = [name.removeprefix("log.") for name in sinks if name.startswith("log.")]
    names = [name for name in logged if name not in SAMPLED]
    logs = dict(zip(names, together(names), strict=True))
    logs["time"] = log("state").sample_times()[: len(logs["state"])].copy()
    if not all(f"log.{name}" in sinks for name in SAMPLED):
        return logs
    # A root Context from GetMyContextFromRoot would keep itself alive for ever.
    alone = station.GetSystemPathname() == f"::{station.get_name()}"
    inside = context if alone else station.GetMyContextFromRoot(context)
    if station.HasOutputPort("tube_report"):
        logs["tube_report"] = station.GetOutputPort("tube_report").Eval(inside).copy()
    # A sink publishes before the update of the same instant: the last sample is in the Context.
    ports = [station.GetOutputPort(name) for name in SAMPLED]
    samples = np.vstack([
        np.hstack([port.Eval(inside) for port in ports]),
        np.hstack(together(SAMPLED))])
    _, first = np.unique(samples[:, 0], return_index=True)
    for i, field in enumerate(MPC_REPORT):
        logs[f"mpc_{field}"] = samples[first, i]
    logs["step_seconds"] = samples[first, -1]
    return logs


def setting_of(scenario: Scenario, model: ContactModel, *, certified: bool = False) -> Setting:
    """Returns the setting of a `Scene` of a run.

    Args:
        scenario: Scenario of the run, with the settings of the picture in `visual`.
        model: The controller's model.
        certified: Whether its tube is that of a certificate that holds.
    """
    force, limits = np.asarray(scenario.task.force, dtype=float), problem.limits_of(scenario, model)
    wall = scenario.contact.declared_wall()
    return Setting(
        robot=scenario.model, model=model, surface=problem.shown_surface(scenario, model),
        start=scenario.start.config, force=force,
        goal=model.surface.pose_for(force, scenario.task.pose),
        radius=float(resolved_radii(scenario.tube).position or 0.0),
        limit_use=LimitUse(model, limits, tighten(limits, scenario.tube)),
        horizon=scenario.mpc.horizon, visual=scenario.visual, certified=certified,
        heading=problem.surface_heading(scenario),
        direction=None if wall is None else wall.direction,
        margin=0.0 if wall is None else safe_depth_margin(scenario),
        painted=PAINTED * max(step.strongest for step in scenario.mission.steps)
        if scenario.mission.steps else None)
