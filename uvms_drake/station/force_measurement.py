"""Force measurement pipeline: from the sensor's signal to the input of the law."""

from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort

from uvms_drake.common.errors import require
from uvms_drake.control.contact.tangential_filter import TangentialFilter
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.signals.sensor_actuator import MEASURED_FORCE, Signals
from uvms_drake.sensing.force_fault_detector import ForceFaultDetector
from uvms_drake.sensing.hold_last_value import HoldLastValue
from uvms_drake.station.contact_bounds import sensed_contact, sensing_of
from uvms_drake.station.scenario.faults import faults_at
from uvms_drake.station.scenario.scenario import Scenario
from uvms_drake.station.series_connection import add_chain


def add_force_measurement(builder: DiagramBuilder, scenario: Scenario, model: ContactModel,
                          controller: Diagram, state: OutputPort, signals: Signals) -> None:
    """Connects the controller with the measured force, if a part of sensing provides it.

    ::

        force_measured ─▶ faults ─▶ ForceFaultDetector ─▶ HoldLastValue ─▶ TangentialFilter ─▶ law
                                            └─ force_valid ─▶ contact estimator

    `force_last_valid` and `force_filtered` are the outputs of the last two. The detector is only
    there for a sensed contact, the filter for one with a `tangential_lag`.

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
    # Refuse a missing sensor, and a law without a port for the force.
    faults = faults_at("force", scenario.faults)
    for key, fault in faults.items():
        require(MEASURED_FORCE in signals, key, type(fault).__name__,
                "left out: no part measures the force")
    require(not scenario.contact.is_sensed or MEASURED_FORCE in signals, "sensing",
            scenario.sensing,
            "with a part that measures the force, such as !ForceSensor, for a sensed contact")
    if MEASURED_FORCE not in signals:
        return
    require(scenario.ancillary.takes_force, "ancillary", scenario.law,
            "a law that takes the measured force, such as resolved")
    # A known surface takes the last valid force.
    valid = add_chain(builder, model, signals[MEASURED_FORCE], signals, faults, scenario.seed)
    if not scenario.contact.is_sensed:
        force = HoldLastValue.AddToBuilder(builder, measured=valid).get_output_port()
        signals["force_last_valid"] = force
        builder.Connect(force, controller.GetInputPort(MEASURED_FORCE))
        return
    # A sensed contact: fault detection, hold and release, filter normal to n.
    contact, sensing = sensed_contact(scenario), sensing_of(scenario)
    detector = ForceFaultDetector.AddToBuilder(
        builder, model, sensing.period, repeats=sensing.repeats, tare=sensing.tare,
        largest=sensing.largest, state=state, force_measured=valid)
    valid = detector.GetOutputPort("force_valid")
    signals["force_status"] = detector.GetOutputPort("force_status")
    builder.Connect(valid, controller.GetInputPort("force_valid"))
    signals["force_lost"] = controller.GetOutputPort("force_lost")
    force = HoldLastValue.AddToBuilder(
        builder, measured=valid, release=signals["force_lost"]).get_output_port()
    signals["force_last_valid"] = force
    if contact.tangential_lag > 0.0:
        force = TangentialFilter.AddToBuilder(
            builder, contact.direction, contact.tangential_lag, contact.period,
            measured=force).get_output_port()
        signals["force_filtered"] = force
    builder.Connect(force, controller.GetInputPort(MEASURED_FORCE))
