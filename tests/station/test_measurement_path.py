"""Systems between the sensors and the law: each one that a station has is listed, and no other."""

import pytest
from pydrake.systems.framework import Diagram, InputPortIndex

import uvms_drake as uv
from uvms_drake.certificate.assumptions import assumptions_of
from uvms_drake.station.contact.measurement_path import measurement_path

STATE_FAULT = "faults=[!LostState {start: 1.0}]"
FAULTS = "faults=[!LostForce {start: 1.0}, !FrozenState {start: 1.0}]"
FILTER = "contact.tangential_lag=1.0"


def between(station: Diagram) -> set[str]:
    """Names of the classes upstream of the controller's measurements, up to the plant."""
    sources, ends = station.connection_map(), ("uvms", "tube_mpc")
    controller, = (each for each in station.GetSystems() if each.get_name() == "tube_mpc")
    waiting = [(controller, controller.GetInputPort(name).get_index())
               for name in ("state", "force_measured", "force_valid")]
    found = {}
    while waiting:
        system, _ = sources[waiting.pop()]
        if system.get_name() not in ends and system.get_name() not in found:
            found[system.get_name()] = type(system).__name__
            ports = [(system, InputPortIndex(i)) for i in range(system.num_input_ports())]
            waiting += [port for port in ports if port in sources]
    return set(found.values())


@pytest.mark.parametrize(("name", "overrides"), [
    ("girona500_contact", []), ("girona500_contact", [FAULTS]), ("girona500_contact", [FILTER]),
    ("girona500_contact", [STATE_FAULT]), ("girona500_real_loop", []), ("bluerov2_contact", [])])
def test_every_system_between_a_sensor_and_the_law_has_a_line(name, overrides):
    scenario = uv.load_scenario(name, overrides)
    listed = measurement_path(scenario)
    assert {each.system for each in listed} == between(uv.make_station(scenario))
    lines = [each.statement for each in assumptions_of(scenario, uv.load_model(scenario))]
    assert all(any(each.statement in line for line in lines) for each in listed)
    covered = {each.system for each in listed if each.theorem}
    assert covered == {"WristSensor", "ForceFaultDetector", "HoldLastValue"}


def test_a_sensor_whose_freezing_would_be_found_late_or_never_is_said_to_have_no_detection():
    detector = {each.system: each for each in measurement_path(uv.load_scenario(
        "girona500_contact", ["sensing.0.noise=[0, 0, 0, 0, 0, 0]"]))}["ForceFaultDetector"]
    assert detector.statement.startswith("detects no frozen sensor")
    assert detector.guaranteed_by == "sensor's maker"
