"""Tests of `uvms_drake.report.log_table`: what a plotter of CSV files reads."""

import csv
import io
import json
import re
import sys
from dataclasses import replace

import numpy as np
import pytest
from support.synthetic import synthetic_record, synthetic_sensed_record

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.report.log_export import format_log, write_mcap


def table_of(record):
    """Returns the columns of the CSV by name."""
    header, *rows = csv.reader(io.StringIO(format_log(record)))
    assert len(set(header)) == len(header)
    return dict(zip(header, np.array(rows, dtype=float).T, strict=True))


def test_it_is_a_line_a_sample_under_names_with_units_that_differ():
    """D10: 51 columns without a unit, an input, a disturbance or a thruster."""
    base = synthetic_sensed_record(2.0)
    thrust = np.outer(np.sin(base.time), np.arange(1.0, 6.0))
    record = replace(base, signals=base.signals | {"thruster_force": thrust})
    table = table_of(record)
    assert next(iter(table)) == "time_s"
    known = {"time_s": record.time, "chi/z_m": record.chi[:, 2], "chi/yaw_rad": record.chi[:, 5],
             "state/q4_rad": record.config[:, 9], "state/p_rad_s": record.zeta[:, 3],
             "state/qdot1_rad_s": record.zeta[:, 6], "force/x_N": record.force[:, 0],
             "force/my_Nm": record.force[:, 4], "u/u_m_s2": record.u[:, 0],
             "u/qddot4_rad_s2": record.u[:, 9], "tau/K_Nm": record.tau[:, 3],
             "tau/q2_Nm": record.tau[:, 7], "disturbance/w_m_s2": record.disturbance[:, 2],
             "thruster_force/t5_N": thrust[:, 4], "tube_bound/position_m": record.tube_bound[:, 1],
             "force_last_valid/y_N": record.signals["force_last_valid"][:, 1],
             "penetration_m": record.penetration,
             "stiffness_used_N_m": record.signals["stiffness_used"][:, 0],
             "state_lost": record.state_lost}
    for name, values in known.items():
        assert table[name] == pytest.approx(values, rel=1e-5, abs=1e-12), name
    assert np.array_equal(np.isnan(table["contact_depth_m"]),
                          np.isnan(record.signals["contact_depth"][:, 0]))
    flags = {"state_lost", "input_limited"}
    assert all(re.search(r"_(m|rad|s|N|Nm|m_s|rad_s|m_s2|rad_s2|N_m|m_rad|m_s_rad_s)$", name)
               for name in table if name not in flags)


def test_a_table_of_pandas_has_the_same_columns():
    pytest.importorskip("pandas", reason="the package pandas is not installed")
    record = synthetic_record(0.5)
    frame = record.to_pandas()
    assert ["time_s", *frame.columns] == list(record.columns())
    np.testing.assert_array_equal(frame["force/x_N"].to_numpy(), record.force[:, 0])
    np.testing.assert_array_equal(frame.index.to_numpy(), record.time)


def test_the_reader_of_foxglove_opens_the_mcap_with_every_column(tmp_path):
    reader = pytest.importorskip("mcap.reader", reason="the extra 'mcap' is not installed")
    record = synthetic_sensed_record(3.0)
    write_mcap(record, tmp_path / "log.mcap")
    found = {}
    with (tmp_path / "log.mcap").open("rb") as file:
        for schema, channel, message in reader.make_reader(file).iter_messages():
            values = json.loads(message.data)
            assert set(values) == set(json.loads(schema.data)["properties"])
            for part, value in values.items():
                name = part if channel.topic == f"/{part}" else f"{channel.topic[1:]}/{part}"
                found.setdefault(name, []).append((message.log_time, value))
    columns = record.columns()
    time = columns.pop("time_s")
    assert set(found) == set(columns)
    for name, values in columns.items():
        when, what = zip(*found[name], strict=True)
        np.testing.assert_allclose(1e-9 * np.array(when), time, rtol=0.0, atol=1e-9)
        np.testing.assert_allclose(np.array(what, dtype=float), values, err_msg=name)


def test_without_the_extra_it_is_refused_in_a_line(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "mcap.writer", None)
    with pytest.raises(InvalidParameter, match=r"--mcap .*pip install 'uvms_drake\[mcap\]'"):
        write_mcap(synthetic_record(0.5), tmp_path / "log.mcap")
    assert list(tmp_path.iterdir()) == []


def test_the_time_of_a_long_run_does_not_repeat_and_depths_keep_their_millimetres():
    record = synthetic_record(0.5)
    time = 1e5 + 0.005 * np.arange(len(record.time))
    chi = record.chi.copy()
    chi[:, 2] = 3000.1234567 + 1e-6 * np.arange(len(chi))
    table = table_of(replace(record, time=time, chi=chi))
    np.testing.assert_allclose(np.diff(table["time_s"]), 0.005, rtol=1e-6)
    np.testing.assert_allclose(table["chi/z_m"], chi[:, 2], rtol=0.0, atol=1e-6)
