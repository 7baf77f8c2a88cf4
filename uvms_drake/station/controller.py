"""The controller of any scenario: sensing, tube-based NMPC and actuation in one Diagram."""

from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import Gain, PassThrough

from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.signals.sensor_actuator import (
    PAYLOAD,
    PAYLOAD_AT_REST,
    Signals,
)
from uvms_drake.sensing.measurements import TipPose
from uvms_drake.station.contact.mission import add_mission
from uvms_drake.station.parts import keyed
from uvms_drake.station.problem import load_model, make_ocp
from uvms_drake.station.scenario.scenario import Scenario
from uvms_drake.station.series_connection import (
    add_actuation,
    add_chain,
    add_force_measurement,
    add_signals,
)


def make_controller(scenario: Scenario, model: ContactModel | None = None) -> Diagram:
    """Returns everything between the plant's state and its input, as a Diagram "controller".

    ::

        state ─▶ sensing ─▶ tube_mpc ─▶ actuation ─▶ tau
        force ─────┘           ▲
                    desired_force, place, deepest

    It is that of `make_station`, for `make_plant` or a plant of one's own: with the scenario's
    sensors, its mission and its actuators, and without its faults.

    .. pydrake_system::

        name: controller
        input_ports:
        - state
        - force
        - payload, payload_at_rest (optional, if the hand holds one)
        - desired_force, place, deepest (optional, as of make_station)
        - stop (optional, of a mission, in place of these three)
        output_ports:
        - tau
        - nominal_state, u, ... (each signal)
        - plan
        - solve_seconds

    - `state`: true (𝔮, ζ) (2(6+n)).
    - `force`: true wrench 𝔉 (6) on the surface [N, N m], for the force sensor; read with one only.
    - `payload`, `payload_at_rest` (6) [N, N m]: by which the hand holds the payload of
      `scenario.model_error`, from the plant, for the force sensor; zero if unconnected.
    - `stop` (1): above zero, it ends the mission.
    - `tau`: τ (6+n) behind the actuators [N, N m].

    Args:
        scenario: Task, limits, tube, sensors and actuators.
        model: The controller's model; loaded if left out.

    Raises:
        InvalidParameter: A value of the scenario cannot be used.
    """
    model = model or load_model(scenario)
    builder, signals = DiagramBuilder(), Signals()
    controller = builder.AddNamedSystem("tube_mpc", scenario.contact.make_controller(
        scenario, model, make_ocp(scenario, model)))

    # True signals come from outside; the pose of the end-effector follows from the state. Only a
    # payload's is zero if unconnected, as of a `PassThrough`; a `Gain` wants its input.
    payload = (PAYLOAD, PAYLOAD_AT_REST) if scenario.model_error.payload.present else ()
    for name, source in (("state", Gain(1.0, 2 * model.size)), ("force", Gain(1.0, 6)),
                         *((name, PassThrough(6)) for name in payload)):
        builder.AddNamedSystem(name, source)
        builder.ExportInput(source.get_input_port(), name)
        signals[name] = source.get_output_port()
    true, tip = signals["state"], builder.AddNamedSystem("tip", TipPose(model))
    builder.Connect(true, tip.get_input_port())
    signals["chi"] = tip.get_output_port()
    given = set(signals)

    # Sensing, the mission or the ports in its place, and actuation.
    measured = add_chain(builder, model, true, signals, keyed("sensing", scenario.sensing),
                         scenario.seed)
    builder.Connect(measured, controller.GetInputPort("state"))
    add_signals(scenario.contact, signals, tube_mpc=controller)
    add_force_measurement(builder, scenario, model, controller, measured, signals)
    if controller.HasInputPort("place"):
        add_mission(builder, scenario, model, controller, measured, signals, None)
    if not scenario.mission.steps:
        builder.ExportInput(controller.GetInputPort("desired_force"), "desired_force")
    applied = add_actuation(builder, scenario, model, controller, signals)

    # The applied command has the name of the plant's input; every other signal has its own.
    builder.ExportOutput(applied, "tau")
    for name, port in signals.items():
        if name not in given | {"tau"}:
            builder.ExportOutput(port, name)
    for name in ("plan", "solve_seconds"):
        builder.ExportOutput(controller.GetOutputPort(name), name)
    diagram = builder.Build()
    diagram.set_name("controller")
    return diagram
