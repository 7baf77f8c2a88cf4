"""Tests of `uvms_drake.report.log_table`: what a plotter of CSV files reads."""

import csv
import io
from dataclasses import replace

import numpy as np
import pytest
from support.synthetic import synthetic_record, synthetic_sensed_record

from uvms_drake.report.log_table import format_log, log_columns


def test_it_is_a_line_a_sample_under_names_that_differ():
    record = synthetic_sensed_record(2.0)
    header, *rows = csv.reader(io.StringIO(format_log(record)))
    assert header[0] == "time"
    assert len(set(header)) == len(header)
    table = dict(zip(header, np.array(rows, dtype=float).T, strict=True))
    known = {"time": record.time, "tip/z": record.chi[:, 2], "tip/yaw": record.chi[:, 5],
             "force/x": record.force[:, 0],
             "force_last_valid/y": record.signals["force_last_valid"][:, 1],
             "joints/q4": record.config[:, 9], "vehicle_velocity/p": record.zeta[:, 3],
             "joint_velocity/q1": record.zeta[:, 6],
             "stiffness_used": record.signals["stiffness_used"][:, 0]}
    for name, values in known.items():
        assert table[name] == pytest.approx(values, rel=1e-5, abs=1e-12)
    assert np.array_equal(np.isnan(table["contact_depth"]),
                          np.isnan(record.signals["contact_depth"][:, 0]))


def test_what_a_run_does_not_have_is_no_column():
    columns = log_columns(synthetic_record(0.5))
    assert "tip/x" in columns
    assert not any(name.startswith(("force_last_valid", "mission")) for name in columns)


def test_the_time_of_a_long_run_does_not_repeat_and_depths_keep_their_millimetres():
    record = synthetic_record(0.5)
    time = 1e5 + 0.005 * np.arange(len(record.time))
    chi = record.chi.copy()
    chi[:, 2] = 3000.1234567 + 1e-6 * np.arange(len(chi))
    text = format_log(replace(record, time=time, chi=chi))
    header, *rows = csv.reader(io.StringIO(text))
    table = dict(zip(header, np.array(rows, dtype=float).T, strict=True))
    np.testing.assert_allclose(np.diff(table["time"]), 0.005, rtol=1e-6)
    np.testing.assert_allclose(table["tip/z"], chi[:, 2], rtol=0.0, atol=1e-6)


def test_a_time_is_written_as_it_is_meant():
    """0.15, not 0.15000000000000002."""
    record = synthetic_record(0.5)
    time = np.cumsum(np.full(len(record.time), 0.1)) * 1.5
    rows = format_log(replace(record, time=time)).splitlines()[1:]
    assert [row.partition(",")[0] for row in rows[:4]] == ["0.15", "0.3", "0.45", "0.6"]
