"""The closed loop of a scenario: plant, controller and logs in one Diagram."""

from dataclasses import replace
from functools import partial
from typing import cast

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, LeafSystem, OutputPort
from pydrake.systems.primitives import ConstantVectorSource, LogVectorOutput, VectorLogSink

from uvms_drake.common.errors import require, vector, within
from uvms_drake.control.ancillary import Transpose
from uvms_drake.control.kinematic_tube_monitor import KinematicTubeMonitor
from uvms_drake.control.limits import resolved_radii
from uvms_drake.control.nominal_mpc import REPORT_FIELDS, Targets
from uvms_drake.control.tube_monitor import TubeMonitor
from uvms_drake.control.tube_mpc import make_kinematic_tube_mpc, make_tube_mpc
from uvms_drake.model.uvms_model import UvmsModel
from uvms_drake.plant.adversary import AdversarialDisturbance, Adversary, TaskAdversary
from uvms_drake.plant.disturbance import BoundedDisturbance, DisturbanceConfig
from uvms_drake.plant.kinematic_plant import make_kinematic_plant, set_configuration
from uvms_drake.plant.surface_error import displaced
from uvms_drake.plant.uvms_plant import make_uvms_plant, set_state
from uvms_drake.station.fault_systems import FaultySensor, JointBrake, SolverFaults
from uvms_drake.station.faults import COVERED, FrozenState, LostState, StuckJoint, excess
from uvms_drake.station.problem import (
    make_dynamic_ocp,
    make_kinematic_ocp,
    retargeted_ocp,
    start_state,
)
from uvms_drake.station.scenario import Scenario
from uvms_drake.visual.controls import DisturbanceSlider, ForceSlider
from uvms_drake.visual.illustration import Illustration

LOGGED = {
    "dynamic": ("state", "nominal_state", "nominal_input", "u", "tau", "lost", "limited",
                "force", "penetration", "accepted_force", "disturbance", "acceleration",
                "tube_deviation", "tube_bound"),
    "kinematic": ("state", "nominal_state", "nominal_input", "u", "lost", "disturbance",
                  "tube_deviation", "tube_bound"),
}
"""Output ports of the station that are logged every `log_period`, by the scenario's motion."""

IMPLICIT = ("implicit_euler", "radau1", "radau3", "velocity_implicit_euler")
"""Integration schemes whose steps may be much longer than 1/k, with which the command is not cut.
Their Newton iteration asks the law far from the solution, and where a limit cuts the command it is
flat: in `paper_dynamic` it would converge in far shorter steps only."""

MONITOR_SLACK = 0.01
"""Relative; a constant d takes the deviation to its bound exactly, and the integrator's error over
a step of 0.02 s through contact is 0.7 %."""
MONITOR_FLOOR = 1e-4
"""[m, rad, m/s, rad/s]; the integrator leaves 7e-5 of a deviation that is exactly zero. At most a
tenth of the tube's smallest radius, see `monitor_floor`."""


def make_station(scenario: Scenario, meshcat: Meshcat | None = None, *,
                 certified: bool = False) -> Diagram:
    """Returns the closed loop as a Diagram named "station".

    ::

        current ──▶ ┌──────┐ state   ┌──────────┐
                    │ uvms │────────▶│ tube_mpc │──┐
               ┌───▶└──────┘         └──────────┘  │ tau
               └───────────────────────────────────┘

    A `TubeMonitor` watches both. The input port `desired_force` (6) changes the task while it runs,
    see `NominalMpc`; unconnected, it stays the scenario's. With kinematic motion there is none, and
    no current; the controller reads `configuration`, and its velocity ζ = u goes to the plant. The
    command of dynamic motion is cut to `limits.u` and, if declared, to `limits.tau`, unless the
    integration scheme is one of `IMPLICIT`.

    The scenario's faults are systems between plant and controller: a `FaultySensor` in `state`, a
    `JointBrake` in `tau`, `SolverFaults` at the port `fault`. All else, the logs too, sees the true
    state and the commanded τ.

    The output ports are those of `LOGGED`, `plan`, `report`, `solve_seconds`, `tube_report` and
    `tube_alarm`; see `make_uvms_plant`, `make_tube_mpc` and `TubeMonitor`, and their kinematic
    counterparts. Each of the logged ports has a VectorLogSink named `log.<port>`; `report` and
    `solve_seconds` have one of the sampling period.

    Args:
        scenario: Everything the run depends on.
        meshcat: Where an `Illustration` draws, if at all.
        certified: Whether the tube is that of a certificate that holds; it is only shown.

    Raises:
        InvalidParameter: A value of the scenario cannot be used.
    """
    builder = DiagramBuilder()
    connect = _connect_kinematic if scenario.kinematic else _connect_dynamic
    uvms, controller, monitor = connect(builder, scenario, meshcat)
    if meshcat is not None:
        shown = ("state", "nominal_state", "u", "nominal_input", "plan", "force")
        ports = {name: system.GetOutputPort(name) for name in (*shown, "accepted_force")
                 for system in (uvms, controller) if system.HasOutputPort(name)}
        if "accepted_force" in ports:
            ports["desired_force"] = ports.pop("accepted_force")
        Illustration.AddToBuilder(builder, meshcat, scenario, certified=certified, **ports)
    logged = LOGGED[scenario.motion]
    for name in (*logged, "plan", "report", "solve_seconds", "tube_report", "tube_alarm"):
        if name.startswith("tube_"):
            port = monitor.GetOutputPort(name.removeprefix("tube_"))
        else:
            port = (uvms if uvms.HasOutputPort(name) else controller).GetOutputPort(name)
        builder.ExportOutput(port, name)
        if name not in ("plan", "tube_report", "tube_alarm"):
            period = scenario.log_period if name in logged else scenario.mpc.time_step
            LogVectorOutput(port, builder, period).set_name(f"log.{name}")
    station = builder.Build()
    station.set_name("station")
    return station


def _connect_dynamic(builder: DiagramBuilder, scenario: Scenario, meshcat: Meshcat | None
                     ) -> tuple[Diagram, Diagram, TubeMonitor]:
    """Adds plant, controller and monitor of dynamic motion, connected."""
    ocp = make_dynamic_ocp(scenario)
    start_state(scenario, ocp)
    uvms = builder.AddNamedSystem(
        "uvms", make_simulated_uvms(scenario, _disturbance_inside(scenario, meshcat)))
    cut = scenario.simulator.integration_scheme not in IMPLICIT
    with within("ancillary"):
        controller = builder.AddNamedSystem("tube_mpc", make_tube_mpc(
            ocp, scenario.ancillary, Targets(
                np.asarray(scenario.task.force, dtype=float), partial(retargeted_ocp, scenario)),
            scenario.limits if cut else None))
    if meshcat is None:
        builder.ExportInput(controller.GetInputPort("desired_force"), "desired_force")
    else:
        slider = ForceSlider.AddToBuilder(builder, scenario.task.force, meshcat)
        builder.Connect(slider.get_output_port(), controller.GetInputPort("desired_force"))
    current = builder.AddNamedSystem(
        "current", ConstantVectorSource(vector("current", scenario.current, 3)))
    builder.Connect(current.get_output_port(), uvms.GetInputPort("current"))
    builder.Connect(_measured(builder, scenario, uvms.GetOutputPort("state")),
                    controller.GetInputPort("state"))
    builder.Connect(_exerted(builder, scenario, ocp.model, controller.GetOutputPort("tau"),
                             uvms.GetOutputPort("state")), uvms.GetInputPort("tau"))
    _connect_solver_faults(builder, scenario, controller)
    monitor = TubeMonitor.AddToBuilder(
        builder, ocp.model, scenario.ancillary, scenario.disturbance.bound,
        set_wise_radii(scenario), state=uvms.GetOutputPort("state"),
        nominal_state=controller.GetOutputPort("nominal_state"),
        disturbance=uvms.GetOutputPort("disturbance"), period=scenario.log_period,
        slack=MONITOR_SLACK, floor=monitor_floor(scenario))
    _connect_disturbance(builder, scenario, ocp.model, uvms, monitor, meshcat)
    return uvms, controller, monitor


def make_simulated_uvms(scenario: Scenario, disturbance: DisturbanceConfig | None) -> Diagram:
    """Returns the robot and the surface as they are, which the controller may not know.

    Args:
        scenario: Of dynamic motion; its own disturbance is not looked at.
        disturbance: As of `make_uvms_plant`.
    """
    return make_uvms_plant(
        model=scenario.model, surface=displaced(scenario.surface, scenario.surface_error),
        disturbance=disturbance, seed=scenario.seed,
        error=scenario.model_error)


def _measured(builder: DiagramBuilder, scenario: Scenario, true: OutputPort) -> OutputPort:
    """Adds the faults of the sensors; returns what is measured of the `true` state."""
    for fault in scenario.faults:
        if isinstance(fault, FrozenState | LostState):
            true = FaultySensor.AddToBuilder(
                builder, fault, true=true, name=f"sensor.{type(fault).__name__}").get_output_port()
    return true


def _exerted(builder: DiagramBuilder, scenario: Scenario, model: UvmsModel, commanded: OutputPort,
             state: OutputPort) -> OutputPort:
    """Adds the faults of the actuators; returns the τ that moves the robot."""
    for i, fault in enumerate(scenario.faults):
        if isinstance(fault, StuckJoint):
            with within(f"faults[{i}]"):
                commanded = JointBrake.AddToBuilder(
                    builder, model, fault, commanded=commanded, state=state).get_output_port()
    return commanded


def _connect_solver_faults(builder: DiagramBuilder, scenario: Scenario, controller: Diagram
                           ) -> None:
    """Adds the faults of the solver, if any is declared."""
    faults = [fault for fault in scenario.faults if isinstance(fault, COVERED)]
    if faults:
        source = SolverFaults.AddToBuilder(
            builder, faults, scenario.seed, scenario.mpc.time_step)
        builder.Connect(source.get_output_port(), controller.GetInputPort("fault"))


def _disturbance_inside(scenario: Scenario, meshcat: Meshcat | None) -> DisturbanceConfig | None:
    """Returns the plant's own disturbance; none if it sees the robot or a slider scales it."""
    if meshcat is not None or isinstance(scenario.disturbance, AdversarialDisturbance):
        return None
    disturbance = applied_disturbance(scenario)
    assert not isinstance(disturbance, AdversarialDisturbance)
    return disturbance


def applied_disturbance(scenario: Scenario) -> DisturbanceConfig | AdversarialDisturbance:
    """Returns the disturbance with what `model_error.share` leaves of its bound, or in excess."""
    disturbance, left = scenario.disturbance, 1.0 - scenario.model_error.share
    return replace(disturbance, bound=excess(scenario.faults) * left * disturbance.bound)


def _connect_disturbance(builder: DiagramBuilder, scenario: Scenario, model: UvmsModel,
                         uvms: Diagram, monitor: TubeMonitor, meshcat: Meshcat | None) -> None:
    """Adds the disturbance of a plant that has none of its own, with Meshcat behind a slider."""
    if not uvms.HasInputPort("disturbance"):
        return
    target, config = uvms.GetInputPort("disturbance"), applied_disturbance(scenario)
    with within("disturbance"):
        if not isinstance(config, AdversarialDisturbance):
            source: LeafSystem = BoundedDisturbance.AddToBuilder(
                builder, target.size(), config, scenario.seed)
        elif scenario.kinematic:
            source = _task_adversary(builder, config, monitor)
        else:
            source = Adversary.AddToBuilder(
                builder, model, config, state=uvms.GetOutputPort("state"), monitor=monitor)
    port = source.get_output_port()
    if meshcat is not None:
        port = DisturbanceSlider.AddToBuilder(
            builder, meshcat, disturbance=port).get_output_port()
    builder.Connect(port, target)


def _connect_kinematic(builder: DiagramBuilder, scenario: Scenario, meshcat: Meshcat | None
                       ) -> tuple[Diagram, Diagram, KinematicTubeMonitor]:
    """Adds plant, controller and monitor of kinematic motion, connected."""
    require(not np.any(vector("current", scenario.current, 3)), "current", scenario.current,
            "zero where there is no water (motion: kinematic)")
    require(scenario.model_error.size == 0.0, "model_error", scenario.model_error,
            "left out where the velocity is the input (motion: kinematic)")
    require(scenario.surface_error.size == 0.0, "surface_error", scenario.surface_error,
            "left out where there is no contact (motion: kinematic)")
    ocp = make_kinematic_ocp(scenario)
    start_state(scenario, ocp)
    uvms = builder.AddNamedSystem("uvms", make_kinematic_plant(
        model=scenario.model, disturbance=_disturbance_inside(scenario, meshcat),
        seed=scenario.seed))
    with within("ancillary"):
        controller = builder.AddNamedSystem(
            "tube_mpc", make_kinematic_tube_mpc(ocp, scenario.ancillary))
    builder.Connect(_measured(builder, scenario, uvms.GetOutputPort("configuration")),
                    controller.GetInputPort("configuration"))
    _connect_solver_faults(builder, scenario, controller)
    builder.Connect(controller.GetOutputPort("u"), uvms.GetInputPort("zeta"))
    monitor = KinematicTubeMonitor.AddToBuilder(
        builder, ocp.model, scenario.ancillary, scenario.disturbance.bound,
        set_wise_radii(scenario), state=uvms.GetOutputPort("state"),
        nominal_state=controller.GetOutputPort("nominal_state"),
        disturbance=uvms.GetOutputPort("disturbance"), period=scenario.log_period,
        slack=MONITOR_SLACK, floor=monitor_floor(scenario))
    _connect_disturbance(builder, scenario, ocp.model, uvms, monitor, meshcat)
    return uvms, controller, monitor


def _task_adversary(builder: DiagramBuilder, config: AdversarialDisturbance,
                    monitor: TubeMonitor) -> TaskAdversary:
    """Adds the one adversary of kinematic motion, w along 𝔢."""
    require(config.kind == "along_task_error", "kind", config.kind,
            "along_task_error, if the motion is kinematic")
    direction = None if np.size(config.direction) == 0 else config.direction
    return TaskAdversary.AddToBuilder(
        builder, config.bound, direction, e=monitor.GetOutputPort("e"))


def monitor_floor(scenario: Scenario) -> float:
    """Returns the deviation below which a `TubeMonitor` looks at nothing."""
    radii = [radius for radius in set_wise_radii(scenario).values() if 0.0 < radius < np.inf]
    return min([MONITOR_FLOOR, *(0.1 * radius for radius in radii)])


def set_wise_radii(scenario: Scenario) -> dict[str, float]:
    """Returns the set-wise bounds that a `TubeMonitor` watches, from the scenario's tube.

    The paper's law has none for the joints.
    """
    tube, law = resolved_radii(scenario.tube), scenario.ancillary
    joints = None if isinstance(law, Transpose) and not law.joints else tube.joints
    radii = {"task": tube.e, "position": tube.position, "orientation": tube.orientation,
             "joints": joints, "z": tube.z}
    return {field: radius for field, radius in radii.items() if radius is not None}


def initialize(station: Diagram, context: Context, scenario: Scenario) -> None:
    """Sets the state of a station's `context` to the scenario's start."""
    uvms = cast(Diagram, station.GetSubsystemByName("uvms"))
    own_context = uvms.GetMyMutableContextFromRoot(context)
    config = np.concatenate([scenario.start.eta, scenario.start.q])
    if scenario.kinematic:
        set_configuration(uvms, own_context, config)
    else:
        set_state(uvms, own_context, np.concatenate([config, np.zeros_like(config)]))


def read_logs(station: Diagram, context: Context) -> dict[str, np.ndarray]:
    """Returns the logs so far: `time` (T,), each logged port (T, size), and the MPC's samples.

    The samples are `mpc_time`, `mpc_status`, `mpc_cost`, `mpc_terminal_slack`, `mpc_violation`,
    `mpc_iterations`, `mpc_refused` (K,), see `REPORT_FIELDS`, and `step_seconds` (K,), wall time.
    """
    def log(name: str):
        return cast(VectorLogSink, station.GetSubsystemByName(f"log.{name}")).FindLog(context)

    logged = [name for ports in LOGGED.values() for name in ports
              if station.HasSubsystemNamed(f"log.{name}")]
    logs = {name: log(name).data().T.copy() for name in logged}
    logs["time"] = log("state").sample_times().copy()
    logs["tube_report"] = station.GetOutputPort("tube_report").Eval(context).copy()
    # A sink publishes before the update of the same instant: the last sample is in the Context.
    ports = [station.GetOutputPort(name) for name in ("report", "solve_seconds")]
    samples = np.vstack([
        np.hstack([port.Eval(station.GetMyContextFromRoot(context)) for port in ports]),
        np.vstack([log("report").data(), log("solve_seconds").data()]).T])
    _, first = np.unique(samples[:, 0], return_index=True)
    for i, field in enumerate(REPORT_FIELDS):
        logs[f"mpc_{field}"] = samples[first, i]
    logs["step_seconds"] = samples[first, -1]
    return logs
