"""Series connections of parts between plant and controller, and that of the measured force."""

from dataclasses import fields

from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort, System

from uvms_drake.common.errors import require, within
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.signals.sensor_actuator import (
    MEASURED_FORCE,
    PAYLOAD,
    PAYLOAD_AT_REST,
    VEHICLE_WRENCH,
    Part,
    Signals,
)
from uvms_drake.model.uvms_model import UvmsModel
from uvms_drake.station.contact import Contact
from uvms_drake.station.parts import faults_at, keyed
from uvms_drake.station.record import Record
from uvms_drake.station.scenario.scenario import Scenario
from uvms_drake.station.signals import LOGGED_AS

PLANT_SIGNALS = ("state", "chi", "force", "penetration", "disturbance", "acceleration")
"""Output ports of the plant that are logged."""
CONTROLLER_SIGNALS = ("nominal_state", "nominal_input", "u", "tau", "lost", "limited",
                      "accepted_force")
"""Output ports of the controller that are logged."""
RESERVED = {"plan", "report", "solve_seconds", "tube_alarm",
            *(field.name for field in fields(Record))}
"""Reserved names of signals: a record's own fields and other outputs."""


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
            added = list(signals)[known:]
            require(not set(added) & RESERVED, "signals", added,
                    f"called otherwise than {', '.join(sorted(RESERVED))}")
        for system in builder.GetSystems()[before:]:
            system.set_name(f"{key}.{system.get_name()}")
    return port


def add_signals(contact: Contact, signals: Signals, *, uvms: System | None = None,
                tube_mpc: System | None = None) -> None:
    """Adds the output ports of a plant and of a tube MPC to the signals, by their logged names.

    Args:
        contact: Kind of contact, with the names of its signals.
        signals: Signals to add to.
        uvms: The plant; None: its signals are there.
        tube_mpc: The controller; None: its signals are there, or it is another one.
    """
    outputs: list[tuple[System, str]] = []
    if uvms is not None:  # With a payload's, if the hand holds something.
        outputs += [(uvms, name) for name in (*PLANT_SIGNALS, PAYLOAD, PAYLOAD_AT_REST)
                    if name in PLANT_SIGNALS or uvms.HasOutputPort(name)]
    if tube_mpc is not None:
        outputs += [(tube_mpc, name) for name in (
            *CONTROLLER_SIGNALS, *contact.controller_signals)]
    for system, name in outputs:
        signals[LOGGED_AS.get(name, name)] = system.GetOutputPort(name)


def add_actuation(builder: DiagramBuilder, scenario: Scenario, model: ContactModel,
                  controller: System, signals: Signals) -> OutputPort:
    """Adds the parts of actuation, without faults, and returns the output port of the last one.

    A controller that has the input ports reads the applied command and the thrusters' wrench.

    Args:
        builder: Builder to add to.
        scenario: Scenario with its actuation and law.
        model: The controller's model.
        controller: Controller of any kind, with the output port `tau`.
        signals: Signals that the parts may read and extend.
    """
    command = controller.GetOutputPort("tau")
    applied = add_chain(builder, model, command, signals,
                        keyed("actuation", scenario.actuation), scenario.seed)
    if applied is not command and controller.HasInputPort("applied"):
        builder.Connect(applied, controller.GetInputPort("applied"))
    if (VEHICLE_WRENCH in signals and controller.HasInputPort(VEHICLE_WRENCH)
            and scenario.ancillary.takes_wrench):
        builder.Connect(signals[VEHICLE_WRENCH], controller.GetInputPort(VEHICLE_WRENCH))
    return applied


def add_force_measurement(builder: DiagramBuilder, scenario: Scenario, model: ContactModel,
                          controller: Diagram, state: OutputPort, signals: Signals) -> None:
    """Connects the controller with the measured force, if a part of sensing provides it.

    ::

        force_measured ─▶ faults ─▶ parts of the kind of contact ─▶ law

    See `Contact.connect_force`.

    Args:
        builder: Builder to add to.
        scenario: Scenario with its contact, the faults of the force, and the law.
        model: The controller's model.
        controller: Controller that takes the force.
        state: Output port of the measured (𝔮, ζ).
        signals: Signals, maybe with `force_measured`; the pipeline's are added.

    Raises:
        InvalidParameter: No part measures a force that a fault or the contact needs, or the law
            takes none.
    """
    faults = faults_at("force", scenario.faults)
    for key, fault in faults.items():
        require(MEASURED_FORCE in signals, key, type(fault).__name__,
                "left out: no part measures the force")
    valid = None
    if MEASURED_FORCE in signals:
        require(scenario.ancillary.takes_force, "ancillary", scenario.law,
                "a law that takes the measured force, such as resolved")
        valid = add_chain(builder, model, signals[MEASURED_FORCE], signals, faults, scenario.seed)
    scenario.contact.connect_force(builder, scenario, model, controller, state, valid, signals)
