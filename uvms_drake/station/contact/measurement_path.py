"""Systems between the sensors of a sensed contact and the law, each with its theorem, or none.

A system that stands between a sensor and the law may change a measurement whose error is within its
bounds, so each is named here with the theorem that covers it; an empty theorem is "not covered".
"""

from typing import NamedTuple

from uvms_drake.model.signals.sensor_actuator import Part
from uvms_drake.sensing.force_fault_detector import CHANCE
from uvms_drake.sensing.force_sensor import ForceSensor
from uvms_drake.sensing.navigation import Navigation
from uvms_drake.station.contact.bounds import LONGEST_FREEZE, sensed_contact, sensing_of
from uvms_drake.station.scenario.parts import faults_at
from uvms_drake.station.scenario.scenario import Scenario

ERROR_BOUND = "sensing/theory.md#error-bound-of-the-force-sensor"
DETECTION = "sensing/theory.md#detection-of-a-frozen-force"
SENSOR_MAKER = "sensor's maker"


class PathElement(NamedTuple):
    """System between a sensor and the law."""

    system: str
    """Name of its class."""
    statement: str
    """Effect on the measurement, and the assumption under which the theorem covers it."""
    theorem: str = ""
    """Link below `uvms_drake/`; empty: no theorem covers it."""
    guaranteed_by: str = "not covered"
    """Person or maker that has to guarantee the assumption."""


def measurement_path(scenario: Scenario) -> list[PathElement]:
    """Returns the systems of a scenario with a sensed contact, from the sensors to the law."""
    elements, measures_state = [], False
    if faults_at("sensing", scenario.faults):
        measures_state = True
        elements.append(PathElement("FaultySignal", "fault of the measured state"))
    for part in scenario.sensing:
        elements += _of_part(part, measures_state)
        measures_state = measures_state or not isinstance(part, ForceSensor)
    if faults_at("force", scenario.faults):
        elements.append(PathElement("FaultySignal", "fault of the measured force"))
    elements += [_detector(scenario), PathElement(
        "HoldLastValue", "passes valid readings; there is no gap, and of a reading that is lost "
        "nothing is proven", DETECTION, SENSOR_MAKER)]
    if sensed_contact(scenario).tangential_lag > 0.0:
        elements.append(PathElement("TangentialFilter", "lag of the force across the direction"))
    return elements


def _of_part(part: Part, measures_state: bool) -> list[PathElement]:
    """Returns the systems that a part of sensing adds; `measures_state` of one before it."""
    if isinstance(part, Navigation):
        return [PathElement("SampledVector", "delay, hold and errors of the navigation")]
    if not isinstance(part, ForceSensor):
        return [PathElement(type(part).__name__, "user-defined part of sensing")]
    sensor = PathElement(
        "WristSensor", "noise, resolution, bias, drift, lag, tare and the tool's weight are within "
        "the declared bounds", ERROR_BOUND, SENSOR_MAKER)
    attitude = PathElement("TipPose", "attitude of the tip in a measured state")
    return [sensor, attitude] if measures_state else [sensor]


def _detector(scenario: Scenario) -> PathElement:
    """Returns the detector of frozen and saturated readings."""
    repeats = sensing_of(scenario).repeats
    if not repeats:
        return PathElement(
            "ForceFaultDetector", "detects no frozen sensor, whose noise is too small for its "
            f"resolution or is not declared, within {LONGEST_FREEZE:g} s: it does not freeze",
            DETECTION, SENSOR_MAKER)
    return PathElement(
        "ForceFaultDetector", f"no {repeats} readings in a row repeat all six components, which "
        f"its declared noise and resolution do with a probability of {CHANCE:g} per reading",
        DETECTION, SENSOR_MAKER)
