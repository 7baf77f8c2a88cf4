"""Tests of `uvms_drake.report.replay`."""

import re
from base64 import b64decode

import numpy as np
import pytest
from screenshots import write_still
from support.synthetic import synthetic_record, synthetic_sensed_record

from uvms_drake.report import replay
from uvms_drake.report.replay import frame_indices, moment_of, write_replay
from uvms_drake.visual.contact import KNOWN
from uvms_drake.visual.scene import Scene


def test_frames_are_thinned_to_the_rate():
    time = np.arange(0.0, 2.0, 0.001)
    frames = frame_indices(time, 25.0)
    assert len(frames) == 50
    np.testing.assert_allclose(np.diff(time[frames]), 0.04, atol=2e-3)
    np.testing.assert_array_equal(frame_indices(np.array([0.0, 0.5, 1.0]), 25.0), [0, 1, 2])


@pytest.mark.long
def test_a_long_run_is_shown_in_fewer_pictures(monkeypatch, tmp_path):
    shown = []
    monkeypatch.setattr(Scene, "show", lambda scene, moment, time: shown.append(time))
    monkeypatch.setattr(replay, "MOST_FRAMES", 20)
    write_replay(synthetic_record(2.0), tmp_path / "replay.html")
    assert len(shown) == 21


def test_the_path_ahead_is_what_the_nominal_robot_then_does():
    record = synthetic_record(4.0)
    path = moment_of(record, 50).path
    assert len(path) == record.scenario.mpc.horizon + 1
    np.testing.assert_allclose(path[0], record.chi_nominal[50, :3])
    np.testing.assert_allclose(path[1], record.chi_nominal[60, :3], atol=1e-9)
    np.testing.assert_array_equal(path[-1], record.chi_nominal[200, :3])


@pytest.mark.long
@pytest.mark.parametrize("write", [write_replay, lambda *args: write_still(args[0], 0.2, args[1])])
def test_it_is_one_html_file_that_loads_nothing(write, tmp_path):
    write(synthetic_record(0.5), tmp_path / "replay.html")
    html = (tmp_path / "replay.html").read_text(encoding="utf-8")
    assert html.lstrip().lower().startswith("<!doctype html>")
    assert not re.search(r'<(script|link|img|iframe)\b[^>]*\b(src|href)="(?!data:)', html)


@pytest.mark.long
@pytest.mark.parametrize(("record", "there"), [
    (synthetic_sensed_record(0.5), True), (synthetic_record(0.5), False)])
def test_the_front_and_the_believed_wall_can_be_found_in_a_replay_of_a_felt_contact(
        record, there, tmp_path):
    write_replay(record, tmp_path / "replay.html")
    packed = re.findall("base64,([A-Za-z0-9+/=]+)", (tmp_path / "replay.html").read_text("utf-8"))
    messages = b"".join(b64decode(each) for each in packed)
    assert b"ned/uvms" in messages
    assert (b"ned/contact_estimator" in messages) == (b"ned/estimated_surface" in messages) == there


def test_what_is_known_at_an_instant_is_what_was_logged():
    record = synthetic_sensed_record(4.0)
    found = moment_of(record, 150).estimate
    assert set(found) == set(KNOWN)
    for name, value in found.items():
        np.testing.assert_array_equal(value, record.signals[name][150])
    assert moment_of(synthetic_record(4.0), 150).estimate == {}
