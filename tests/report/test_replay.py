"""Tests of `uvms_drake.report.replay`."""

import re
from base64 import b64decode
from dataclasses import replace

import numpy as np
import pytest
from screenshots import write_still
from support.synthetic import synthetic_record, synthetic_sensed_record

from uvms_drake.control.limits import TubeRadii
from uvms_drake.report import replay
from uvms_drake.report.replay import frame_indices, moment_of, write_replay
from uvms_drake.station.scenario.scenario import load_scenario
from uvms_drake.visual.scene import Scene

pytestmark = pytest.mark.long


def test_frames_are_thinned_to_the_rate():
    time = np.arange(0.0, 2.0, 0.001)
    frames = frame_indices(time, 25.0)
    assert len(frames) == 50
    np.testing.assert_allclose(np.diff(time[frames]), 0.04, atol=2e-3)


def test_a_long_run_is_shown_in_fewer_pictures(monkeypatch, tmp_path):
    shown = []
    monkeypatch.setattr(Scene, "show", lambda scene, moment, time: shown.append(time))
    monkeypatch.setattr(replay, "MOST_FRAMES", 20)
    write_replay(synthetic_record(2.0), tmp_path / "replay.html")
    assert len(shown) == 21


def test_a_slow_log_is_shown_in_full():
    np.testing.assert_array_equal(frame_indices(np.array([0.0, 0.5, 1.0]), 25.0), [0, 1, 2])


def test_the_path_ahead_is_what_the_nominal_robot_then_does():
    record = synthetic_record(4.0)
    path = moment_of(record, 50).path
    assert len(path) == record.scenario.mpc.horizon + 1
    np.testing.assert_allclose(path[0], record.chi_nominal[50, :3])
    np.testing.assert_allclose(path[1], record.chi_nominal[60, :3], atol=1e-9)
    np.testing.assert_array_equal(path[-1], record.chi_nominal[200, :3])


@pytest.mark.parametrize("write", [write_replay, lambda *args: write_still(args[0], 0.2, args[1])])
def test_it_is_one_html_file_that_loads_nothing(write, tmp_path):
    write(synthetic_record(0.5), tmp_path / "replay.html")
    html = (tmp_path / "replay.html").read_text(encoding="utf-8")
    assert html.lstrip().lower().startswith("<!doctype html>")
    assert not re.search(r'<(script|link|img|iframe)\b[^>]*\b(src|href)="(?!data:)', html)


def test_twenty_seconds_are_less_than_six_megabytes(tmp_path):
    write_replay(synthetic_record(20.0), tmp_path / "replay.html")
    assert (tmp_path / "replay.html").stat().st_size < 6e6


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
    known = moment_of(record, 150).known
    np.testing.assert_array_equal(known.force_last_valid, record.signals["force_last_valid"][150])
    assert known.safe_depth == record.chi_nominal[150, 0] + 0.025
    assert known.contact_depth == 0.003
    assert known.stiffness_estimate == pytest.approx(710.0)
    assert np.isnan(moment_of(record, 50).known.contact_depth)


@pytest.mark.parametrize("name", ["girona500_bilateral"])
def test_the_papers_surface_and_motion_can_be_shown(name, tmp_path):
    record = replace(synthetic_record(0.2), scenario=load_scenario(name))
    write_replay(record, tmp_path / "replay.html")
    assert (tmp_path / "replay.html").stat().st_size > 0


def test_a_run_without_a_tube_can_be_shown(tmp_path):
    record = synthetic_record(0.2)
    tube = TubeRadii(u=np.zeros(10))
    write_replay(record, tmp_path / "with.html")
    write_replay(replace(record, scenario=replace(record.scenario, tube=tube)),
                 tmp_path / "without.html")
    sizes = [(tmp_path / f"{name}.html").stat().st_size for name in ("with", "without")]
    assert 0 < sizes[1] < sizes[0], "the tube and its inset are not drawn"
