"""The closed loop of a scenario: plant, controller and the parts between them, in one Diagram."""

from collections.abc import Mapping
from typing import cast

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.systems.framework import Context, Diagram, DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput, VectorLog, VectorLogSink

from uvms_drake.common.errors import within
from uvms_drake.control.feedback.tube_monitor import TubeMonitor
from uvms_drake.control.laws.law import AncillaryLaw
from uvms_drake.control.limits import TubeRadii, resolved_radii
from uvms_drake.control.mpc.planner import MPC_REPORT
from uvms_drake.control.mpc.solver_faults import SolverFaults
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.signals.sensor_actuator import Signals
from uvms_drake.plant.waves import WaterMotion
from uvms_drake.station.contact.mission import add_mission
from uvms_drake.station.parts import faults_at, keyed
from uvms_drake.station.plant import applied_disturbance, make_simulated_uvms
from uvms_drake.station.problem import (
    disturbance_weights,
    load_model,
    make_ocp,
    start_state,
)
from uvms_drake.station.scenario.scenario import Scenario
from uvms_drake.station.scene_setting import setting_of
from uvms_drake.station.series_connection import (
    add_actuation,
    add_chain,
    add_force_measurement,
    add_signals,
)
from uvms_drake.visual.controls import DisturbanceSlider, ForceSlider
from uvms_drake.visual.illustration import Illustration
from uvms_drake.visual.objects.contact_knowledge import KNOWN

SAMPLED = ("report", "solve_seconds")
"""Outputs of the MPC that are logged every sampling period."""

ILLUSTRATED = {"state": "state", "nominal_state": "nominal_state", "u": "u",
               "nominal_input": "nominal_input", "force": "force",
               "desired_force": "desired_force", **{name: name for name in KNOWN}}
"""Signal for each port of an `Illustration`; some may be missing."""

MONITOR_SLACK = 0.01
"""Relative excess that is not an exit: a constant d takes the deviation to its bound exactly, and
the integrator's error over a step of 0.02 s through contact is 0.7 %."""
MONITOR_FLOOR = 1e-4
"""Deviation that is not an exit [m, rad, m/s, rad/s]: the integrator makes 7e-5 of one that is
exactly zero. At most a tenth of the tube's smallest radius counts, see `monitor_floor`."""


def make_station(scenario: Scenario, meshcat: Meshcat | None = None, *,
                 certified: bool = False, model: ContactModel | None = None) -> Diagram:
    """Returns the closed loop as a Diagram named "station", which starts as the scenario says.

    ::

                       ┌──────┐ state   ┌─────────┐ (force) ┌──────────┐
        disturbance ──▶│ uvms │────────▶│ sensing │────────▶│ tube_mpc │◀── fault
                   ┌──▶└──────┘         └─────────┘         └──────────┘
                   │                   ┌───────────┐ tau     ▲   │
                   └───────────────────│ actuation │◀────────┼───┘
                                       └───────────┘─────────┘ (vehicle_wrench)

    Sensing and actuation are series of parts, none by default: the scenario's, and its faults of
    sensors and of actuators, next to the robot. The logs and a `TubeMonitor` read the true state
    and the commanded τ. The signal `force_measured` of a part of sensing goes to the law, see
    `add_force_measurement`, the signal `vehicle_wrench` of a part of actuation to a law that
    `takes_wrench`. An observer reads the output of the parts of actuation, with this wrench, as the
    applied input; it does not know of faults.

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
        meshcat: Meshcat of an `Illustration`; None: no picture.
        certified: Whether the tube is certified: then it is monitored from the start, else only
            after the robot has hovered.
        model: The controller's model; loaded if left out.

    Raises:
        InvalidParameter: A value of the scenario cannot be used.
    """
    builder, model = DiagramBuilder(), model or load_model(scenario)
    weights = disturbance_weights(scenario, model)

    # Plant and controller.
    ocp = make_ocp(scenario, model)
    start = start_state(scenario, ocp)[: model.size]
    uvms = builder.AddNamedSystem("uvms", make_simulated_uvms(scenario, None, start))
    controller = builder.AddNamedSystem("tube_mpc", scenario.contact.make_controller(
        scenario, model, ocp))
    WaterMotion.AddToBuilder(builder, scenario.current, scenario.waves, plant=uvms)
    # The desired force comes from a mission, from a slider in Meshcat, or from outside.
    desired = controller.GetInputPort("desired_force")
    if not scenario.mission.steps and meshcat is None:
        builder.ExportInput(desired, "desired_force")
    elif not scenario.mission.steps:
        slider = ForceSlider.AddToBuilder(builder, scenario.task.force, meshcat)
        builder.Connect(slider.get_output_port(), desired)
    signals = Signals()
    add_signals(scenario.contact, signals, uvms=uvms, tube_mpc=controller)

    # The parts between them.
    true = uvms.GetOutputPort("state")
    measured = add_chain(
        builder, model, true, signals,
        faults_at("sensing", scenario.faults) | keyed("sensing", scenario.sensing), scenario.seed)
    builder.Connect(measured, controller.GetInputPort("state"))
    add_force_measurement(builder, scenario, model, controller, measured, signals)
    if controller.HasInputPort("place"):
        add_mission(builder, scenario, model, controller, measured, signals, meshcat)
    applied = add_actuation(builder, scenario, model, controller, signals)
    exerted = add_chain(builder, model, applied, signals,
                        faults_at("actuation", scenario.faults), scenario.seed)
    builder.Connect(exerted, uvms.GetInputPort("tau"))
    solver_faults = faults_at("solver", scenario.faults)
    if solver_faults:
        source = SolverFaults.AddToBuilder(
            builder, list(solver_faults.values()), scenario.seed, scenario.mpc.time_step)
        builder.Connect(source.get_output_port(), controller.GetInputPort("fault"))

    # The monitor, and the disturbance, which may be aimed with the monitor's errors.
    shared = measured is true and controller.HasOutputPort("pair")
    declared, radii = scenario.disturbance, set_wise_radii(scenario.tube, scenario.ancillary)
    monitor = TubeMonitor.AddToBuilder(
        builder, model, scenario.ancillary, declared.d_bound, radii, weights=weights,
        state=signals["state"], nominal_state=signals["nominal_state"],
        disturbance=(
            signals["disturbance"] if bounds_disturbance(declared.d_bound, certified) else None),
        pair=controller.GetOutputPort("pair") if shared else None,
        along_run=scenario.contact.bounded_along_run,
        period=scenario.log_period, begin=monitor_begin(scenario.mpc.hover, certified),
        slack=MONITOR_SLACK,
        floor=monitor_floor(radii))
    for name in ("deviation", "bound"):
        signals[f"tube_{name}"] = monitor.GetOutputPort(name)
    with within("disturbance"):
        disturbance = applied_disturbance(
            declared, scenario.model_error.share, scenario.faults).add_to(
                builder, model, scenario.seed, {**signals, **{
                    name: monitor.GetOutputPort(name) for name in ("e_y", "r")}})
    if meshcat is not None:
        disturbance = DisturbanceSlider.AddToBuilder(
            builder, meshcat, disturbance=disturbance).get_output_port()
    builder.Connect(disturbance, uvms.GetInputPort("disturbance"))

    # Logs, outputs and the picture.
    for name, port in signals.items():
        builder.ExportOutput(port, name)
        LogVectorOutput(port, builder, scenario.log_period).set_name(f"log.{name}")
    for name in SAMPLED:
        port = controller.GetOutputPort(name)
        builder.ExportOutput(port, name)
        LogVectorOutput(port, builder, scenario.mpc.time_step).set_name(f"log.{name}")
    builder.ExportOutput(controller.GetOutputPort("plan"), "plan")
    for name in ("report", "alarm"):
        builder.ExportOutput(monitor.GetOutputPort(name), f"tube_{name}")
    if meshcat is not None:
        Illustration.AddToBuilder(
            builder, meshcat, setting_of(scenario, model, certified=certified),
            plan=controller.GetOutputPort("plan"),
            **{port: signals[name] for port, name in ILLUSTRATED.items() if name in signals})
    station = builder.Build()
    station.set_name("station")
    return station


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

    The samples are `mpc_time`, `mpc_status`, `mpc_cost`, `mpc_terminal_slack`, `mpc_violation`,
    `mpc_iterations`, `mpc_refused`, `mpc_rows` (K,), see `MPC_REPORT`, and `step_seconds` (K,),
    wall time.
    """
    def log(name: str) -> VectorLog:
        return cast(VectorLogSink, station.GetSubsystemByName(f"log.{name}")).FindLog(context)

    sinks = [system.get_name() for system in station.GetSystems()]
    logged = [name.removeprefix("log.") for name in sinks if name.startswith("log.")]
    logs = {name: log(name).data().T.copy() for name in logged if name not in SAMPLED}
    logs["time"] = log("state").sample_times().copy()
    # A root Context from GetMyContextFromRoot would keep itself alive for ever.
    alone = station.GetSystemPathname() == f"::{station.get_name()}"
    own = context if alone else station.GetMyContextFromRoot(context)
    logs["tube_report"] = station.GetOutputPort("tube_report").Eval(own).copy()
    # A sink publishes before the update of the same instant: the last sample is in the Context.
    ports = [station.GetOutputPort(name) for name in SAMPLED]
    samples = np.vstack([
        np.hstack([port.Eval(own) for port in ports]),
        np.vstack([log(name).data() for name in SAMPLED]).T])
    _, first = np.unique(samples[:, 0], return_index=True)
    for i, field in enumerate(MPC_REPORT):
        logs[f"mpc_{field}"] = samples[first, i]
    logs["step_seconds"] = samples[first, -1]
    return logs
