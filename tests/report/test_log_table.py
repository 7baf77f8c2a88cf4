"""Tests of `uvms_drake.report.log_table`: what a plotter of CSV files reads."""

import csv
import io

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
             "force/x": record.force[:, 0], "force_last_valid/y": record.signals["force_last_valid"][:, 1],
             "joints/q4": record.config[:, 9], "vehicle_velocity/p": record.zeta[:, 3],
             "joint_velocity/q1": record.zeta[:, 6], "slope": record.signals["slope"][:, 0]}
    for name, values in known.items():
        assert table[name] == pytest.approx(values, rel=1e-5, abs=1e-12)
    assert np.array_equal(np.isnan(table["contact_depth"]),
                          np.isnan(record.signals["contact_depth"][:, 0]))


def test_what_a_run_does_not_have_is_no_column():
    columns = log_columns(synthetic_record(0.5))
    assert "tip/x" in columns
    assert not any(name.startswith(("force_last_valid", "mission")) for name in columns)
