"""Tests of `uvms_drake.station.signals`: one name, and one description, of every signal."""

import re
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from pydrake.systems.framework import Diagram, InputPortIndex

import uvms_drake
import uvms_drake as uv
from uvms_drake.certificate.assumptions import assumptions_of
from uvms_drake.station.contact.measurement_path import measurement_path
from uvms_drake.station.diagram import SAMPLED
from uvms_drake.station.signals import (
    IN_NAMES,
    MPC_SIGNALS,
    SIGNALS,
    column_names,
    columns_of,
    format_signals,
)

TABLE = Path(uvms_drake.__file__).parent / "station" / "signals.md"


def test_the_table_in_the_docs_is_current():
    """`uvms-drake keys --signals > uvms_drake/station/signals.md` writes it."""
    assert TABLE.read_text(encoding="utf-8") == f"{format_signals()}\n"


@pytest.mark.parametrize("name", [
    "girona500_contact", "jacket_inspection_real", "girona500_real_loop",
    "bluerov2_real_loop"])
def test_every_logged_signal_of_a_station_is_described_with_its_size(name):
    scenario = uv.load_scenario(name)
    station, model = uv.make_station(scenario), uv.load_model(scenario)
    logged = {system.get_name().removeprefix("log.") for system in station.GetSystems()
              if system.get_name().startswith("log.")} - set(SAMPLED)
    assert logged <= set(SIGNALS)
    for signal in logged:
        size = station.GetOutputPort(signal).size()
        columns = column_names(signal, size, model.slides)
        assert len(set(columns)) == size
        assert all(column.split("/")[0].startswith(signal) for column in columns)


def test_the_names_of_a_record_are_those_of_the_ports():
    """D10: `planned_tip` in the csv, `chi_nominal` in the npz, `nominal_state` at the port."""
    station = uv.make_station(uv.load_scenario("girona500_contact"))
    ports = {station.get_output_port(i).get_name() for i in range(station.num_output_ports())}
    derived = {name for name, signal in SIGNALS.items() if signal.source.endswith("no port")}
    of_record = {field.name for field in fields(uv.Record)} & set(SIGNALS)
    assert of_record <= ports | derived
    assert not derived & ports
    assert {f.name for f in fields(uv.Record) if f.name.startswith("mpc_")} < set(MPC_SIGNALS)


def test_units_are_in_the_names_and_a_sliding_joint_has_its_own():
    names = column_names("state", 16, [False, True])
    assert names[6:8] == ["state/q1_rad", "state/q2_m"]
    assert names[-2:] == ["state/qdot1_rad_s", "state/qdot2_m_s"]
    assert column_names("tau", 8, [False, True])[-2:] == ["tau/q1_Nm", "tau/q2_N"]
    assert column_names("thruster_command", 2, [True]) == [
        "thruster_command/t1", "thruster_command/t2"]
    assert column_names("thruster_force", 1, [True]) == ["thruster_force/t1_N"]


@pytest.mark.parametrize("size", [1, 5])
def test_a_signal_of_ones_own_with_a_name_of_the_table_is_numbered_if_its_size_differs(size):
    expected = ["force"] if size == 1 else [f"force/{i}" for i in range(size)]
    assert column_names("force", size, [True]) == expected
    assert len(set(IN_NAMES.values())) == len(IN_NAMES)


def test_signals_of_a_part_of_ones_own_are_numbered():
    columns = columns_of({"mine": np.ones((3, 2)), "one": np.zeros(3)}, [])
    assert list(columns) == ["mine/0", "mine/1", "one"]


# The station has the ports that its README says, with the sizes that it says.


README = Path(__file__).parents[2] / "uvms_drake" / "station" / "README.md"


def written() -> dict[str, str]:
    """Returns the sizes by the names of the ports in the README's tables."""
    out: dict[str, str] = {}
    for line in README.read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        names = re.findall(r"`(\w+)`", cells[0])
        if line.startswith("| `"):
            sizes = cells[1].split(", ")
            out |= dict(zip(names, sizes * len(names) if len(sizes) == 1 else sizes, strict=False))
    return out


@pytest.mark.parametrize("name", [
    "girona500_contact", "jacket_inspection", "girona500_real_loop", "girona500_ideal"])
def test_every_port_is_in_the_readme_with_its_size(name):
    scenario = uv.load_scenario(name)
    station, table = uv.make_station(scenario), written()
    size = uv.load_model(scenario).size
    sizes = {"2(6+n)": 2 * size, "6+n": size, "m": 5, "abstract": 0}
    ports = [*(station.get_input_port(i) for i in range(station.num_input_ports())),
             *(station.get_output_port(i) for i in range(station.num_output_ports()))]
    for port in ports:
        text = table[port.get_name()]
        assert port.size() == sizes.get(text, int(text) if text.isdecimal() else None), text


def test_the_readme_has_no_port_that_is_nowhere():
    found: set[str] = set()
    for name, overrides in (("jacket_inspection_real", []), ("girona500_ideal", []),
                            ("girona500_real_loop", ["model_error.payload.mass=0.1"])):
        station = uv.make_station(uv.load_scenario(name, overrides))
        found |= {station.get_input_port(i).get_name() for i in range(station.num_input_ports())}
        found |= {station.get_output_port(i).get_name() for i in range(station.num_output_ports())}
    assert set(written()) == found


# Systems between the sensors and the law: each one that a station has is listed, and no other.


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
