"""Tests of `uvms_drake.replay`."""

from dataclasses import replace

import numpy as np
from synthetic import synthetic_record

from uvms_drake.replay import FRAME_RATE, frame_indices, write_replay
from uvms_drake.scenario import load_scenario


def test_frames_are_thinned_to_the_frame_rate():
    time = np.arange(0.0, 2.0, 0.001)
    frames = frame_indices(time)
    assert len(frames) == 2.0 * FRAME_RATE
    np.testing.assert_allclose(np.diff(time[frames]), 1.0 / FRAME_RATE, atol=2e-3)


def test_a_slow_log_is_shown_in_full():
    np.testing.assert_array_equal(frame_indices(np.array([0.0, 0.5, 1.0])), [0, 1, 2])


def test_the_replay_is_one_html_file(tmp_path):
    write_replay(synthetic_record(0.5), tmp_path / "replay.html")
    html = (tmp_path / "replay.html").read_text(encoding="utf-8")
    assert html.lstrip().lower().startswith("<!doctype html>")
    assert 'src="http' not in html


def test_a_surface_that_is_no_plane_has_no_wall(tmp_path):
    record = replace(synthetic_record(0.2), scenario=load_scenario("girona500_bilateral"))
    write_replay(record, tmp_path / "replay.html")
    assert (tmp_path / "replay.html").stat().st_size > 0
