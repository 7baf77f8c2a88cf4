"""Tests of `uvms_drake.report.events` and `uvms_drake.common.alarm`: events and alarms of a run."""

import logging
from dataclasses import replace

import numpy as np
import pytest
from support.synthetic import synthetic_record, synthetic_sensed_record

from uvms_drake.campaign import run
from uvms_drake.campaign.campaign import make_campaign
from uvms_drake.command.main import main
from uvms_drake.common.alarm import LOGGER, warn
from uvms_drake.control.feedback.tube_monitor import FIELDS
from uvms_drake.report.events import ALARMING, Event, events, intervals
from uvms_drake.sensing.force_fault_detector import ForceStatus
from uvms_drake.station.scenario.scenario import load_scenario


def changed(name, when, value, channel=...):
    """Returns the synthetic record with one signal set to a value at some samples."""
    record = synthetic_record(4.0)
    signal = getattr(record, name).copy()
    signal[when, channel] = value
    return replace(record, **{name: signal})


def of_kind(record, kind) -> list[Event]:
    return [event for event in events(record) if event.kind == kind]


def test_a_run_as_planned_makes_contact_and_settles():
    record = synthetic_record()
    contact, settled = events(record)
    depth = 1e3 * np.max(record.penetration)
    assert contact == Event(pytest.approx(2.02), None, "contact",
                            f"contact, at most {depth:.3g} mm deep")
    assert settled.kind == "settled"
    assert settled.end == settled.start
    error = np.linalg.norm(record.force - record.desired_force, axis=1)
    assert np.all(error[record.time >= settled.start] <= 2.0)
    assert error[np.searchsorted(record.time, settled.start) - 1] > 2.0


def test_an_interval_ends_where_it_is_over_and_short_gaps_are_bridged():
    time = np.arange(8.0)
    holds = np.array([1, 0, 1, 0, 0, 1, 1, 1], dtype=bool)
    assert intervals(holds, time, 0.0) == [slice(0, 1), slice(2, 3), slice(5, 8)]
    assert intervals(holds, time, 1.5) == [slice(0, 3), slice(5, 8)]
    assert intervals(holds, time, 2.5) == [slice(0, 8)]
    assert intervals(~holds, time, 0.0) == [slice(1, 2), slice(3, 5)]
    assert intervals(np.zeros(3, dtype=bool), time[:3], 1.0) == []
    assert intervals(np.zeros(0, dtype=bool), time[:0], 1.0) == []


def test_a_bouncing_contact_is_one_contact():
    bouncing = changed("penetration", slice(120, 140, 2), 0.0)
    (contact,) = of_kind(bouncing, "contact")
    assert contact.end is None
    before, after = of_kind(changed("penetration", slice(120, 140), 0.0), "contact")
    assert (before.end, after.start) == (pytest.approx(2.4), pytest.approx(2.8))


def test_what_is_left_is_what_is_beyond_the_monitors_slack():
    at = FIELDS.index("z")
    assert of_kind(changed("tube_deviation", 50, 1.002 * 0.04 + 1e-4, at), "tube_left") == []
    assert len(of_kind(changed("tube_deviation", 50, 1.012 * 0.04 + 1e-4, at), "tube_left")) == 1


def test_a_lost_force_says_why_and_how_far_it_retreats():
    record = synthetic_record(4.0)
    lost = ((record.time > 1.0) & (record.time < 2.0)).astype(float)[:, None]
    chi = np.zeros_like(record.chi_nominal)
    chi[:, 1] = -0.03 * record.time
    signals = {"force_lost": lost, "force_status": ForceStatus.FROZEN * lost}
    event, = of_kind(replace(record, chi_nominal=chi, signals=signals), "force_lost")
    assert "force_lost" in ALARMING
    assert (event.start, event.end) == (pytest.approx(1.02), pytest.approx(2.0))
    assert event.text == "no valid force measurement (frozen): retreat by at most 28.8 mm"
    assert of_kind(replace(record, signals={"force_lost": 0.0 * lost}), "force_lost") == []


def test_another_place_across_the_wall_is_an_event_and_another_depth_is_none():
    record = synthetic_sensed_record(4.0)
    assert of_kind(record, "retarget") == []
    target = record.signals["target"].copy()
    target[100:, 1] = 0.05
    assert of_kind(replace(record, signals={**record.signals, "target": target}), "retarget") == [
        Event(pytest.approx(2.0), pytest.approx(2.02), "retarget",
              "the tip is sent to another point of the wall")]


def test_a_desired_force_that_is_moved_is_one_event():
    moved = 20.0 + np.clip(np.arange(201.0) - 100.0, 0.0, 50.0) / 10.0
    (event,) = of_kind(changed("desired_force", slice(None), moved, channel=0), "retarget")
    assert (event.start, event.end) == (pytest.approx(2.02), pytest.approx(3.02))
    assert event.text == "new desired force of 25 N"


def test_a_run_says_on_stderr_and_in_its_summary_what_is_alarming(tmp_path, capsys):
    assert main(["run", "girona500_ideal", "--uncertified", "--no-figures", "--no-replay",
                 "--duration", "0.5",
                 "--set", "faults=[!ExcessDisturbance {factor: 5}]",
                 "--output", str(tmp_path / "out")]) == 0
    out, err = capsys.readouterr()
    said = [line for line in err.splitlines() if line.startswith("t = ")]
    assert any(line.endswith(" s: disturbance above its bound") for line in said)
    assert any(line.endswith(" s: left the bound along the run") for line in said)
    block = out[out.index("\nevents "):]
    assert "whole disturbance above its bound of 0.1, at most " in block
    assert "left the bound along the run: " in block
    assert LOGGER.handlers == []


def test_a_worker_of_a_campaign_is_silent(monkeypatch, caplog):
    def alarmed(scenario, certified):
        warn(0.1, "left the tube")
        raise RuntimeError("enough")

    caplog.set_level(logging.WARNING, LOGGER.name)
    monkeypatch.setattr(run, "simulate", alarmed)
    campaign = make_campaign(load_scenario("girona500_ideal", ["duration=0.6"]), 3, None)
    assert run.run_one(campaign, 0)["error"] == "RuntimeError: enough"
    assert caplog.messages == []


POSITION, ROW = FIELDS.index("position"), "2 samples in a row"
PAIR = [0.3, -0.4] + 8 * [0.0]


@pytest.mark.parametrize(("changes", "found"), [
    (("tube_deviation", slice(50, 60), 0.01, POSITION), [
        (1.0, 1.2, "tube_left", "left the tube (set-wise): position at most 2 of its bound"),
        (1.0, 1.2, "bound_left", "left the bound along the run: position at most 2.5 of its "
                                 "bound")]),
    (("effective_disturbance", slice(-3, None), PAIR), [
        (3.96, None, "disturbance_exceeded",
         "whole disturbance above its bound of 0.1, at most 0.5")]),
    (("state", [50, 53], -0.35, 3), [
        (1.0, 1.08, "limit_violated", "limit roll violated, by at most 0.1")]),
    (("state", [50, 53], -0.65, 6), [
        (1.0, 1.08, "limit_violated", "limit q1_min violated, by at most 0.25")]),
    (("state", [50, 53], 1.66, 6), [
        (1.0, 1.08, "limit_violated", "limit q1_max violated, by at most 0.2")]),
    (("tau", [50, 53], -77.0, 7), [
        (1.0, 1.08, "motor_limited", "at most 77 asked of joint 2, whose motor gives 70")]),
    (("input_limited", [50, 53], 1.0), [(1.0, 1.08, "input_limited", "the command saturates")]),
    *((("mpc_status", [3, 4, 6, 19], status), [
        (0.6, 1.0, kind, f"{text}, {ROW}"), (1.2, 1.4, kind, text), (3.8, None, kind, text)])
      for status, kind, text in ((1.0, "solver_failed", "the solver failed"),
                                 (2.0, "solver_late", "the solver missed its deadline"),
                                 (3.0, "sample_dropped", "the sample was dropped"),
                                 (4.0, "plan_kept", "the last plan was better and was kept"))),
    (("mpc_refused", slice(5, 10), 1.0), [
        (1.0, 2.0, "force_refused", "another desired force was refused, 5 samples in a row")]),
    (("desired_force", slice(100, None), 25.0, 0), [
        (2.0, 2.02, "retarget", "new desired force of 25 N")]),
    (("force", -1, 0.0), [])])
def test_each_kind_of_event_has_its_times_and_numbers(changes, found):
    """Beside those of the record as planned: contact, and settling, unless the force changes."""
    kinds = {"contact", "settled"}
    assert [event for event in events(changed(*changes)) if event.kind not in kinds] == [
        Event(pytest.approx(start), None if end is None else pytest.approx(end), kind, text)
        for start, end, kind, text in found]
    if changes[0] == "force":
        assert of_kind(changed(*changes), "settled") == []
