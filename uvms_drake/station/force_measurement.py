"""From what a part of sensing measures of the force to what the law takes of it."""

from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort

from uvms_drake.common.errors import require
from uvms_drake.control.contact.tangential_filter import TangentialFilter
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.sensor_actuator import MEASURED_FORCE, Signals
from uvms_drake.sensing.force_fault_detector import ForceFaultDetector
from uvms_drake.sensing.hold_last_value import HoldLastValue
from uvms_drake.station.contact_bounds import sensed_contact, sensing_of
from uvms_drake.station.scenario.faults import faults_at
from uvms_drake.station.scenario.scenario import Scenario
from uvms_drake.station.series_connection import add_chain


def add_force_measurement(builder: DiagramBuilder, scenario: Scenario, model: ContactModel,
                   controller: Diagram, state: OutputPort, signals: Signals) -> None:
    """Connects the controller with the measured force, if a part of sensing gives it.

    ::

        force_measured ──▶ faults ──▶ ForceFaultDetector ──▶ HoldLastValue ──▶ TangentialFilter ──▶ controller
                                          └── force_valid ──────────────────────▶

    A `ForceFaultDetector` looks at it where the contact is felt, and a `TangentialFilter` is there where it has an
    `tangential_lag`. `force_last_valid` and `force_filtered` are what comes out of the last two.

    Args:
        builder: Where to add it.
        scenario: With its contact, the faults of the force, and the law.
        model: The controller's.
        controller: Who takes it.
        state: (𝔮, ζ) as it is measured.
        signals: With `force_measured`, or without; what is to be logged is added.

    Raises:
        InvalidParameter: Nothing measures a force that a fault or the contact needs, or the law
            takes none.
    """
    faults = faults_at("force", scenario.faults)
    for key, fault in faults.items():
        require(MEASURED_FORCE in signals, key, type(fault).__name__,
                "left out: nothing measures the force")
    require(not scenario.contact.felt or MEASURED_FORCE in signals, "sensing", scenario.sensing,
            "with a part that measures the force, such as !ForceSensor, for a contact that is felt")
    if MEASURED_FORCE not in signals:
        return
    require(scenario.ancillary.takes_force, "ancillary", scenario.law,
            "a law that takes the measured force, such as resolved")
    fresh = add_chain(builder, model, signals[MEASURED_FORCE], signals, faults, scenario.seed)
    if not scenario.contact.felt:
        felt = HoldLastValue.AddToBuilder(builder, measured=fresh).get_output_port()
        signals["force_last_valid"] = felt
        builder.Connect(felt, controller.GetInputPort(MEASURED_FORCE))
        return
    contact, sensing = sensed_contact(scenario), sensing_of(scenario)
    fresh = ForceFaultDetector.AddToBuilder(
        builder, model, sensing.period, repeats=sensing.repeats, tare=sensing.tare,
        largest=sensing.largest, state=state, force_measured=fresh).get_output_port()
    builder.Connect(fresh, controller.GetInputPort("force_valid"))
    signals["force_lost"] = controller.GetOutputPort("force_lost")
    felt = HoldLastValue.AddToBuilder(
        builder, measured=fresh, release=signals["force_lost"]).get_output_port()
    signals["force_last_valid"] = felt
    if contact.tangential_lag > 0.0:
        felt = TangentialFilter.AddToBuilder(builder, contact.direction, contact.tangential_lag,
                                      contact.period, measured=felt).get_output_port()
        signals["force_filtered"] = felt
    builder.Connect(felt, controller.GetInputPort(MEASURED_FORCE))
