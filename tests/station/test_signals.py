"""Tests of `uvms_drake.station.signals`: one name, and one description, of every signal."""

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

import uvms_drake
import uvms_drake as uv
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
    assert len(set(IN_NAMES.values())) == len(IN_NAMES)


def test_signals_of_a_part_of_ones_own_are_numbered():
    columns = columns_of({"mine": np.ones((3, 2)), "one": np.zeros(3)}, [])
    assert list(columns) == ["mine/0", "mine/1", "one"]
