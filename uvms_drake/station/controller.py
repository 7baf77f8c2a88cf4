"""Everything between the plant's state and its input: sensing, a controller and actuation."""

from collections.abc import Sequence
from dataclasses import fields
from functools import partial

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort, System
from pydrake.systems.primitives import ConstantVectorSource, Gain, PassThrough

from uvms_drake.common.errors import require, within
from uvms_drake.common.schema import check_values
from uvms_drake.common.wiring import outputs, wire
from uvms_drake.control.contact.press_control import PressControl
from uvms_drake.control.contact.tangential_filter import TangentialFilter
from uvms_drake.control.mpc.planner import Targets
from uvms_drake.control.mpc.solver_faults import SolverFaults
from uvms_drake.control.ocp.ocp import Ocp
from uvms_drake.control.ocp.solvers import make_solver
from uvms_drake.control.tube_mpc import make_tube_mpc
from uvms_drake.mission.system import MissionControl
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.signals.fault import Fault
from uvms_drake.model.signals.sensor_actuator import (
    MEASURED_FORCE,
    PAYLOAD,
    PAYLOAD_AT_REST,
    TICK,
    VEHICLE_WRENCH,
    Part,
    Signals,
)
from uvms_drake.model.uvms_model import UvmsModel
from uvms_drake.sensing.force_fault_detector import ForceFaultDetector
from uvms_drake.sensing.measurements import HoldLastValue, TipPose
from uvms_drake.station.contact import bounds
from uvms_drake.station.problem import load_model, make_ocp, retargeted_ocp
from uvms_drake.station.record import Record
from uvms_drake.station.scenario.parts import (
    command_path_of,
    faults_at,
    keyed,
    with_faults,
    with_lost_fixes,
)
from uvms_drake.station.scenario.scenario import Scenario
from uvms_drake.station.supervision import safety_of
from uvms_drake.visual.controls import ForceSlider, HomeButton

SAMPLED = ("report", "solve_seconds")
"""Outputs of the MPC that are logged every sampling period."""
RESERVED = {"plan", "tube_alarm", *SAMPLED, *(field.name for field in fields(Record))}
"""Reserved names of signals: a record's own fields and other outputs."""
MISSION_SIGNALS = {"due_place": "mission_place", "due_force": "mission_force",
                   "progress": "mission_progress"}
"""Signal for each output of a mission that is logged."""
TARGETS = ("desired_force", "place", "deepest")
"""Inputs of a controller by which its task is changed during a run."""
IMPLICIT = ("implicit_euler", "radau1", "radau3", "velocity_implicit_euler")
"""Integration schemes whose steps may be much longer than 1/k, with which the command is not cut.
Their Newton iteration asks the law far from the solution, and where a limit cuts the command it is
flat: in `paper_dynamic` it would converge in far shorter steps only."""


def make_controller(scenario: Scenario, model: ContactModel | None = None, *,
                    measured: bool = False) -> Diagram:
    """Returns everything between the plant's state and its input, as a Diagram "controller".

    ::

        state ─▶ sensing ─▶ tube_mpc ─▶ actuation ─▶ tau
        force ─────┘           ▲
                    desired_force, place, deepest

    It is that of `make_station`, for `make_plant` or a plant of one's own: with the scenario's
    sensors, its mission and its actuators, and without faults of the state, the solver and the
    actuators.

    .. pydrake_system::

        name: controller
        input_ports:
        - state
        - force
        - payload, payload_at_rest (optional, if the hand holds one)
        - desired_force, place, deepest (optional, as of make_station)
        - stop (optional, of a mission, in place of these three)
        - fix_age (optional, if `measured`, of a supervisor)
        output_ports:
        - tau
        - nominal_state, u, ... (each signal)
        - plan
        - report, solve_seconds

    - `state`: true (𝔮, ζ) (2(6+n)).
    - `force`: true wrench 𝔉 (6) on the surface [N, N m], for the force sensor; read with one only.
    - `payload`, `payload_at_rest` (6) [N, N m]: by which the hand holds the payload of
      `scenario.model_error`, from the plant, for the force sensor; zero if unconnected.
    - `stop` (1): above zero, it ends the mission.
    - `tau`: τ (6+n) behind the actuators [N, N m].

    With `measured`, for sensors that are not simulated, no sensor is: `state` is the measured one,
    in place of `force` and `payload` there is `force_measured` (6), 𝔉_s as of a `ForceSensor` [N,
    N m], if the scenario has a sensor of the force, and a further input `tick` (1), each change of
    which is a tick of the clock of its `SampledCommand`, see `TickedVector`. With a supervisor,
    `fix_age` (1) is the age of the last fix of the navigation [s]; zero if unconnected.

    Args:
        scenario: Task, limits, tube, sensors and actuators.
        model: The controller's model; loaded if left out.
        measured: Whether state and force are the measured ones, and ticks come from outside.

    Raises:
        InvalidParameter: A value of the scenario cannot be used.
    """
    builder, model = DiagramBuilder(), model or load_model(scenario)
    check_values(scenario)
    controller = builder.AddNamedSystem("tube_mpc", make_tube(
        scenario, model, make_ocp(scenario, model)))

    # True signals come from outside; the pose of the end-effector follows from the state. Only a
    # payload's is zero if unconnected, as of a `PassThrough`; a `Gain` wants its input.
    given, holds = Signals(), scenario.model_error.payload.present and not measured
    for name, source, needed in (
            ("state", Gain(1.0, 2 * model.size), True), ("force", Gain(1.0, 6), not measured),
            (PAYLOAD, PassThrough(6), holds), (PAYLOAD_AT_REST, PassThrough(6), holds),
            (MEASURED_FORCE, Gain(1.0, 6), measured and bounds.known_reading(scenario) is not None),
            (TICK, Gain(1.0, 1), measured),
            ("fix_age", PassThrough(1), measured and controller.HasInputPort("fix_age"))):
        if needed:
            builder.AddNamedSystem(name, source)
            builder.ExportInput(source.get_input_port(), name)
            given[name] = source.get_output_port()
    if measured:  # Thrusters hover at the start, where nothing is touched.
        given["force"] = builder.AddNamedSystem(
            "no_force", ConstantVectorSource(np.zeros(6))).get_output_port()
    tip = builder.AddNamedSystem("tip", TipPose(model))
    builder.Connect(given["state"], tip.get_input_port())
    given["chi"] = tip.get_output_port()

    # The applied command has the name of the plant's input; every other signal has its own.
    signals = Signals({**given, **signals_of(controller)})
    _, applied = connect_controller(
        builder, scenario, model, controller, given["state"], signals,
        [] if measured else [fault for fault in scenario.faults if fault.place == "force"])
    builder.ExportOutput(applied, "tau")
    for name, port in signals.items():
        if name not in {*given, "tau"}:
            builder.ExportOutput(port, name)
    for name in ("plan", *SAMPLED):
        builder.ExportOutput(controller.GetOutputPort(name), name)
    diagram = builder.Build()
    diagram.set_name("controller")
    return diagram


def make_tube(scenario: Scenario, model: ContactModel, ocp: Ocp) -> Diagram:
    """Returns the tube-based NMPC that solves a problem of `make_ocp`.

    It presses by the measured force if the contact is sensed; else it makes a problem of its own
    for each desired force. See `IMPLICIT` for the limits to which its commands are cut.
    """
    press = targets = None
    if scenario.contact.declared_wall() is not None:
        press = _press_control(scenario)
    else:
        targets = Targets(np.asarray(scenario.task.force, dtype=float),
                          partial(retargeted_ocp, scenario, model))
    safety = safety_of(scenario, model) if press is not None else None
    limits = None if scenario.simulator.integration_scheme in IMPLICIT else scenario.limits
    path = command_path_of(scenario.actuation, model)
    with within("mpc"):
        solver = make_solver(ocp)
    with within("ancillary"):
        return make_tube_mpc(ocp, scenario.ancillary, targets, limits, path, solver, press, safety)


def _press_control(scenario: Scenario) -> PressControl:
    """Returns the press of a sensed contact, after a check that its forces are admissible."""
    contact, largest = bounds.sensed_contact(scenario), bounds.largest_force(scenario)
    require(bounds.pressing_force(scenario) < largest, "task.force", scenario.task.force,
            f"less than {largest:.3g} N: contact.force less the parts of sensor, tube, angle and "
            "stiffness")
    reading, needed = bounds.known_reading(scenario), largest + contact.force_error
    for key, part in keyed("sensing", scenario.sensing).items():
        if reading is not None and part.reading(0.0, 0.0) is not None:
            require(needed < reading.largest, f"{key}.range", getattr(part, "range", part),
                    f"more than {needed:.3g} N at the tip, also by its torques over the mounting")
    for i, step in enumerate(scenario.mission.steps):
        require(step.strongest < largest, f"mission.steps[{i}].force", step.strongest,
                f"less than {largest:.3g} N, like task.force")
    return PressControl(contact.walls, bounds.sensing_of(scenario),
                        bounds.pressing_force(scenario), largest,
                        bounds.safe_depth_margin(scenario))


def signals_of(controller: System) -> dict[str, OutputPort]:
    """Returns the signals of a controller: its outputs of vectors, without the MPC's samples."""
    return {name: port for name, port in outputs(controller).items() if name not in SAMPLED}


def connect_controller(builder: DiagramBuilder, scenario: Scenario, model: ContactModel,
                       controller: System, state: OutputPort, signals: Signals,
                       faults: Sequence[Fault], meshcat: Meshcat | None = None
                       ) -> tuple[OutputPort, OutputPort]:
    """Adds sensing, mission and actuation around a controller.

    An input of the controller is connected if there is a measurement, a target or a fault of its
    name; its targets are inputs of the Diagram if there is neither mission nor Meshcat. The law
    that `takes_wrench` reads the thrusters', and an observer the applied command, neither of which
    knows of faults.

    Args:
        builder: Builder to add to, with the controller in it.
        scenario: Scenario with its sensors, mission, law and actuators.
        model: The controller's model.
        controller: Controller of any kind, with the output port `tau`.
        state: Output port of the true motion.
        signals: Signals of plant and controller; those of the parts are added.
        faults: Faults of sensors, solver and actuators.
        meshcat: Meshcat of the slider of the force, and of the mission's button.

    Returns:
        Output ports of the measured motion, and of the command that acts on the robot.
    """
    def chain(port: OutputPort, parts: dict[str, Part]) -> OutputPort:
        return add_chain(builder, model, port, signals, parts, scenario.seed)

    # Measurements, targets and faults, by the names of the controller's inputs.
    sensors = {} if TICK in signals else keyed(
        "sensing", with_lost_fixes(scenario.sensing, faults))
    measured = chain(state, faults_at("sensing", faults) | sensors)
    given = {"state": measured}
    force_faults = faults_at("force", faults)
    for key, fault in force_faults.items():
        require(MEASURED_FORCE in signals, key, type(fault).__name__,
                "left out: no part measures the force")
    require(MEASURED_FORCE in signals or not controller.HasInputPort("force_valid"), "sensing",
            scenario.sensing, "with a part that measures the force, such as !ForceSensor")
    if MEASURED_FORCE in signals:
        require(scenario.ancillary.takes_force, "ancillary", scenario.law,
                "a law that takes the measured force, such as resolved")
        valid = chain(signals[MEASURED_FORCE], force_faults)
        given |= add_measured_force(builder, scenario, model, measured, valid, signals)
    if scenario.mission.steps:
        given |= add_mission(builder, scenario, model, measured, signals, meshcat)
    elif meshcat is not None and controller.HasInputPort("desired_force"):
        slider = builder.AddNamedSystem(
            "force_slider", ForceSlider(scenario.task.force, meshcat))
        given["desired_force"] = slider.get_output_port()
    solver_faults = faults_at("solver", faults)
    if solver_faults:
        given["fault"] = builder.AddNamedSystem("solver_faults", SolverFaults(
            list(solver_faults.values()), scenario.seed, scenario.mpc.time_step)).get_output_port()
    # Actuation, of which some controllers read the effect.
    command = controller.GetOutputPort("tau")
    applied = chain(command, keyed("actuation", with_faults(
        scenario.actuation, faults, model)))
    if applied is not command:
        given["applied"] = applied
    if VEHICLE_WRENCH in signals and scenario.ancillary.takes_wrench:
        given[VEHICLE_WRENCH] = signals[VEHICLE_WRENCH]
    given |= {name: signals[name] for name in ("fix_age", "force_status") if name in signals}
    wire(builder, controller, given)
    for name in TARGETS:
        if controller.HasInputPort(name) and not builder.IsConnectedOrExported(
                controller.GetInputPort(name)):
            builder.ExportInput(controller.GetInputPort(name), name)
    return measured, chain(applied, faults_at("actuation", faults))


def add_measured_force(builder: DiagramBuilder, scenario: Scenario, model: ContactModel,
                       state: OutputPort, valid: OutputPort, signals: Signals
                       ) -> dict[str, OutputPort]:
    """Adds the systems of a measured force before a controller.

    ::

        valid ─▶ ForceFaultDetector ─▶ HoldLastValue ─▶ TangentialFilter ─▶ law
                         └─ force_valid ─▶ contact estimator

    The detector is for a controller with a contact estimator, the filter for one with a
    `tangential_lag`; others have the last valid value alone.

    Args:
        builder: Builder to add to.
        scenario: The scenario.
        model: The controller's model.
        state: Output port of the measured (𝔮, ζ).
        valid: Output port of 𝔉_s (6), which may not be finite.
        signals: Signals of the loop, to which those of the measurement are added.

    Returns:
        Ports by the names of the controller's inputs.
    """
    estimates, given = "force_lost" in signals, {}
    if estimates:
        contact, reading = bounds.sensed_contact(scenario), bounds.reading_of(scenario)
        detector = ForceFaultDetector.AddToBuilder(
            builder, model, contact.period, repeats=bounds.sensing_of(scenario).repeats,
            tare=reading.tare, largest=reading.largest, state=state, force_measured=valid)
        given["force_valid"] = valid = detector.GetOutputPort("force_valid")
        signals["force_status"] = detector.GetOutputPort("force_status")
    force = signals["force_last_valid"] = HoldLastValue.AddToBuilder(
        builder, valid.size(), measured=valid, release=signals.get("force_lost")).get_output_port()
    if estimates and contact.tangential_lag > 0.0:
        force = signals["force_filtered"] = TangentialFilter.AddToBuilder(
            builder, contact.direction, contact.tangential_lag, contact.period,
            measured=force).get_output_port()
    return {**given, MEASURED_FORCE: force}


def add_mission(builder: DiagramBuilder, scenario: Scenario, model: ContactModel,
                state: OutputPort, signals: Signals, meshcat: Meshcat | None
                ) -> dict[str, OutputPort]:
    """Adds the mission, and returns the ports of its targets by the names of those inputs.

    Args:
        builder: Builder to add to.
        scenario: The scenario, with a sensed contact.
        model: The controller's model.
        state: Output port of the measured (𝔮, ζ).
        signals: Signals of the loop, with the estimate of the contact; the mission's are added.
        meshcat: Meshcat of a stop button; None: an input port `stop`.
    """
    mission = builder.AddNamedSystem("mission", MissionControl(
        scenario.mission, model, bounds.sensed_contact(scenario).walls, scenario.task.place))
    wire(builder, mission, {**signals, "state": state})
    if meshcat is None:
        builder.ExportInput(mission.GetInputPort("stop"), "stop")
    else:
        wire(builder, mission, outputs(
            builder.AddNamedSystem("home_button", HomeButton(meshcat))))
    asked = outputs(mission)
    for port, name in MISSION_SIGNALS.items():
        signals[name] = asked.pop(port)
    return asked


def add_chain(builder: DiagramBuilder, model: UvmsModel, port: OutputPort, signals: Signals,
              parts: dict[str, Part], seed: int) -> OutputPort:
    """Adds parts in series and returns the output port of the last one.

    The names of their systems begin with their keys.

    Args:
        builder: Builder to add to.
        model: The controller's model.
        port: Output port that feeds the first part.
        signals: Signals that the parts may read and extend.
        parts: The parts by their keys in the scenario.
        seed: Seed of their random numbers.
    """
    for key, part in parts.items():
        size, known, before = port.size(), len(signals), len(builder.GetSystems())
        with within(key):
            port = part.add_to(builder, model, port, signals, seed)
            require(isinstance(port, OutputPort), "add_to", port, "the output port to go on from")
            require(port.size() == size, "size", port.size(), f"{size}, as before it")
            new = list(signals)[known:]
            require(not set(new) & RESERVED, "signals", new,
                    f"called otherwise than {', '.join(sorted(RESERVED))}")
        for system in builder.GetSystems()[before:]:
            system.set_name(f"{key}.{system.get_name()}")
    return port
