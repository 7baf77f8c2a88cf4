"""Force measurement pipeline: from the sensor's signal to the input of the law."""

from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort

from uvms_drake.common.errors import require
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.signals.sensor_actuator import MEASURED_FORCE, Signals
from uvms_drake.station.parts import faults_at
from uvms_drake.station.scenario.scenario import Scenario
from uvms_drake.station.series_connection import add_chain


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
