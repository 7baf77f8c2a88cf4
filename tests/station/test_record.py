"""Tests of `uvms_drake.station.record`."""

import time
from dataclasses import replace

import numpy as np
import pytest
from support.synthetic import synthetic_record

import uvms_drake as uv
from uvms_drake.station.record import LOG_FILE, save_record
from uvms_drake.station.scenario.scenario import dump_scenario


@pytest.fixture(scope="module")
def record():
    return synthetic_record(2.0)


def test_a_loaded_record_is_the_saved_one(record, tmp_path):
    folder = tmp_path / "new" / "run"
    assert all(path.is_file() for path in record.save(folder))
    loaded = uv.load_record(folder)
    assert dump_scenario(loaded.scenario) == dump_scenario(record.scenario)
    for name in vars(record):
        if name != "scenario":
            np.testing.assert_array_equal(getattr(loaded, name), getattr(record, name))


def test_a_folder_without_a_log_is_refused(record, tmp_path):
    with pytest.raises(uv.InvalidParameter, match=r"'run' or Record.save .*log.npz: No such"):
        uv.load_record(tmp_path)
    record.save(tmp_path)
    (tmp_path / LOG_FILE).write_bytes(b"")
    with pytest.raises(uv.InvalidParameter, match=r"its log\.npz or timing\.npz is damaged"):
        uv.load_record(tmp_path)


def test_whether_the_tube_is_certified_is_kept(record, tmp_path):
    for certified in (False, True):
        save_record(replace(record, certified=np.array(certified)), tmp_path)
        assert bool(uv.load_record(tmp_path).certified) is certified


def test_the_log_does_not_depend_on_when_it_is_written(record, tmp_path, monkeypatch):
    save_record(record, tmp_path)
    first = (tmp_path / LOG_FILE).read_bytes()
    now = time.time()
    monkeypatch.setattr(time, "time", lambda: now + 1e6)
    save_record(record, tmp_path)
    assert (tmp_path / LOG_FILE).read_bytes() == first


def test_wall_times_are_kept_out_of_the_log(record, tmp_path):
    save_record(record, tmp_path)
    with np.load(tmp_path / LOG_FILE) as log:
        assert not {"step_seconds", "wall_time_s"} & set(log.files)
        assert {"time", "state", "force", "mpc_status"} <= set(log.files)
