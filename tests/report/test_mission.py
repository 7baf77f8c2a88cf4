"""Tests of the report of a mission: table, figure, readings and estimated normal."""

from dataclasses import replace

import numpy as np
import pytest
from support.drawings import panels_of
from support.missions import OFF, TIMES, mission_record
from support.synthetic import aimed_at, synthetic_record, synthetic_sensed_record

from uvms_drake.command.files import DATA_FILES, write_data
from uvms_drake.common.output import output_folder
from uvms_drake.control.limits import HoldRadii
from uvms_drake.mission.law import FORCE_LOST, REASONS, RUNNING, SKIPPED, SUPERVISED
from uvms_drake.report.contact_figures import mission_drawing
from uvms_drake.report.drawing import draw
from uvms_drake.report.figures import figures_of
from uvms_drake.report.metrics import summarise_contact
from uvms_drake.report.mission import COLUMNS, inspection_table, learned_normals
from uvms_drake.report.signals import DONE_STEP, attempts_of, losses_of, motor_torques
from uvms_drake.report.summary import format_summary, summarise
from uvms_drake.tube.ultimate_bounds import hold_band, tip_errors


@pytest.fixture(scope="module")
def record():
    return mission_record()


def test_the_table_has_what_every_step_reached(record):
    rows = summarise(record)["mission"]
    assert (rows["outcome"], rows["over_s"], rows["not_begun"]) == ("done", 5.0, 0)
    assert [row["kind"] for row in rows["steps"]] == ["Approach", "Hold", "Slide", "Retreat"]
    assert [row["seconds"] for row in rows["steps"]] == pytest.approx([1.0, 1.0, 2.0, 1.0])
    hold, slide = rows["steps"][1:3]
    # A sine of 1.5 N: its rms, and the share of its time within 1 N.
    assert hold["force_rms"] == pytest.approx(1.5 / np.sqrt(2.0), rel=1e-2)
    assert hold["force_worst"] == pytest.approx(1.5, rel=1e-2)
    assert hold["within"] == pytest.approx(2.0 / np.pi * np.arcsin(1.0 / 1.5), abs=0.03)
    assert hold["mean_force"] == pytest.approx(10.0, abs=0.05)
    assert slide["within"] == 1.0
    assert (slide["off_rms"], slide["off_worst"]) == pytest.approx((OFF, OFF))
    assert slide["behind"] == pytest.approx(0.004)


def test_what_is_certified_of_a_step_grows_with_what_its_plans_were_short_of(record):
    assert summarise(record)["mission"]["steps"][1]["certified"] is None
    found = []
    for short in ([0.0, 0.0, 0.0], [0.002, 0.0, 0.0], [-0.002, 0.0, 0.0], [0.0, 0.01, 0.0]):
        target = record.chi_nominal[:, :3] + short
        known = replace(
            record, certified=np.array(True), signals=record.signals | aimed_at(target))
        found.append([row["certified"] for row in summarise(known)["mission"]["steps"][1:3]])
    contact, (there, less, more, beside) = record.scenario.contact, np.array(found)
    assert there[0] == contact.band(10.0, tip_errors(record.scenario.tube))
    assert there[1] == contact.band(10.0, tip_errors(record.scenario.tube), 0.05)
    assert less == pytest.approx(more)
    ratio = contact.walls.tilt * 0.01 / 0.002
    assert beside - there == pytest.approx(ratio * (less - there))
    assert np.all(less - there >= 0.002 * contact.stiffness)


def test_a_hold_has_the_band_of_a_plan_that_has_stood_and_what_was_held(record):
    """The plan of the record stands throughout: after the time of the radii the band is smaller."""
    hold = HoldRadii(time=1.5, depth=1e-4, position=2e-4, advance=0.002, standing=0.001,
                     reading=0.5, age=0.03)
    scenario = replace(record.scenario, tube=replace(record.scenario.tube, hold=hold))
    state = record.nominal_state.copy()
    state[:, state.shape[1] // 2:] = 0.0
    known = replace(record, scenario=scenario, certified=np.array(True), nominal_state=state)
    known = replace(known, signals=known.signals | aimed_at(known.chi_nominal[:, :3]))
    first, slide = summarise(known)["mission"]["steps"][1:3]
    late = known.time[known.signals["mission_progress"][:, 0] == 1][-1]
    assert first["certified"] == pytest.approx(scenario.contact.band(
        10.0, tip_errors(scenario.tube)))
    assert first["certified_hold"] == pytest.approx(hold_band(scenario.contact, 10.0, hold))
    assert first["certified_hold"] < first["certified"]
    assert first["held"] == pytest.approx(np.max(np.abs(
        1.5 * np.sin(2.0 * np.pi * known.time[(known.time >= 1.5) & (known.time <= late)]))))
    assert slide["certified_hold"] is None  # However slow its plan: the tip slides.
    shorter = replace(scenario, tube=replace(scenario.tube, hold=replace(hold, time=10.0)))
    never = summarise(replace(known, scenario=shorter))["mission"]["steps"][1]
    assert (never["held"], never["certified_hold"]) == (None, None)
    (line,) = (line for line in format_summary(summarise(known)).splitlines() if " Hold " in line)
    assert [f"{first[key]:.2f}" for key in ("certified", "held", "certified_hold")] == (
        line.split()[7:10])


def test_a_step_that_failed_says_why_and_what_was_not_begun_is_counted():
    base = synthetic_sensed_record(6.0)
    late = base.time + 1e-9 >= 2.0  # From then on the hold has failed, and the retreat goes on.
    record = mission_record(step=np.where(late, 3, np.searchsorted(TIMES, base.time + 1e-9) - 1),
                  reason=FORCE_LOST * late, failures=1.0 * late,
                  outcome=np.where(base.time + 1e-9 >= 5.0, SKIPPED, RUNNING))
    assert [(each.step, each.ended) for each in attempts_of(record)] == [
        (0, "done"), (1, "force lost"), (3, "done")]
    rows = summarise(record)["mission"]
    assert (rows["outcome"], rows["failures"], rows["not_begun"]) == ("skipped in part", 1, 1)


def test_the_end_of_the_run_may_cut_a_step_off():
    record = mission_record(duration=3.0)
    assert [each.ended for each in attempts_of(record)] == ["done", "done", "not over"]
    rows = summarise(record)["mission"]
    assert rows["outcome"] == "not over at the end of the run"
    assert rows["over_s"] is None


def test_without_a_mission_nothing_is_said_or_written(tmp_path):
    record = synthetic_record(4.0)
    assert summarise(record)["mission"] == {}
    assert "mission " not in format_summary(summarise(record))
    assert "mission.png" not in figures_of(record.scenario)
    with output_folder(tmp_path, DATA_FILES) as output:
        write_data(record, output)
    assert not (tmp_path / "inspection.csv").exists()


def test_every_reading_of_a_step_that_presses_is_a_line(record, tmp_path):
    with output_folder(tmp_path, DATA_FILES) as output:
        write_data(record, output)
    text = (tmp_path / "inspection.csv").read_text().splitlines()
    assert text[0].split(",") == list(COLUMNS)
    rows = np.array([[float(each) for each in line.split(",")] for line in text[1:]])
    assert rows == pytest.approx(inspection_table(record), abs=1e-3)
    pressing = (record.time + 1e-9 >= 1.0) & (record.time + 1e-9 < 4.0)
    assert rows[:, 0] == pytest.approx(record.time[pressing], abs=1e-3)
    assert set(rows[:, 1]) == {1.0, 2.0}
    found = rows[:, COLUMNS.index("slid")]
    assert not np.any(found[rows[:, 0] < 2.0])
    assert np.all(found[rows[:, 0] > 2.5])
    assert rows[:, 5] == pytest.approx(np.ones(len(rows)), abs=1e-2)


def test_an_inspector_is_told_how_far_the_tool_is_off_the_normal():
    record = mission_record()
    chi = record.chi.copy()
    chi[:, 3:6] = [0.3, 0.06, -0.08]  # Its roll turns the tool about its own axis.
    rows = inspection_table(replace(record, chi=chi))
    held = rows[rows[:, COLUMNS.index("slid")] == 0.0]
    assert len(held) > 10
    assert held[:, COLUMNS.index("tool_angle_rad")] == pytest.approx(
        np.arccos(np.cos(0.06) * np.cos(0.08)), abs=1e-9)


@pytest.mark.parametrize("friction", [0.0, 0.3, 0.5])
@pytest.mark.parametrize("angle", [0.0, 0.05, -0.08])
def test_the_normal_that_is_learned_on_a_straight_way_has_no_friction_in_it(friction, angle):
    """On a plane: the force is F (n + μ t), which is off n by atan μ; the way says which part."""
    time = np.arange(0.0, 6.0, 0.02)
    n = np.array([np.cos(angle), 0.6 * np.sin(angle), 0.8 * np.sin(angle)])
    t = np.cross(n, [0.0, 0.8, -0.6])
    t /= np.linalg.norm(t)
    tip = 0.02 * np.maximum(time - 1.0, 0.0)[:, None] * t
    sliding = (time > 1.0)[:, None]
    force = (10.0 + np.sin(time))[:, None] * (n + friction * sliding * t)
    found = learned_normals(time, tip, force)
    slid = np.isfinite(found[:, 0])
    assert np.all(slid == (np.linalg.norm(tip - tip[np.maximum(
        np.arange(len(time)) - 100, 0)], axis=1) >= 0.02 - 1e-9))
    assert found[slid] == pytest.approx(np.broadcast_to(n, found[slid].shape), abs=1e-9)
    raw = force[-1] / np.linalg.norm(force[-1])
    assert np.arccos(min(raw @ n, 1.0)) == pytest.approx(np.arctan(friction), abs=1e-6)


def test_the_figure_has_the_force_over_time_and_line(record):
    assert "mission.png" in figures_of(record.scenario)
    over_time, over_line, off = panels_of(mission_drawing(record))
    assert np.max(over_line.series[0].x) == pytest.approx(96.0, abs=3.0)
    (line,) = off.series
    assert line.y == pytest.approx(np.full(100, 1e3 * OFF))
    assert [mark.text for mark in over_time.instants] == ["approach", "hold", "slide", "retreat"]
    assert len(draw(mission_drawing(record)).axes) == 3


def test_places_are_those_of_the_navigation(record):
    def table(state):
        return inspection_table(
            replace(record, signals={**record.signals, "measured_state": state}))

    drifted = record.state.copy()
    drifted[:, 1] += 0.02
    shift = table(drifted) - table(record.state)
    assert shift[:, COLUMNS.index("y_m")] == pytest.approx(0.02)
    assert np.delete(shift, COLUMNS.index("y_m"), axis=1) == pytest.approx(0.0, abs=1e-9)


def test_a_contact_is_lost_only_in_a_step_that_needs_one():
    """The hold from 1 to 2 s and the slide from 2 to 4 s do, approach and retreat do not."""
    run = mission_record()
    for apart, losses in (((0.4, 0.5), 0), ((1.4, 1.5), 1), ((1.9, 2.1), 1), ((4.4, 4.5), 0),
                          ((3.9, 4.2), 1), ((4.1, 6.1), 0),
                          # From the first sample of the hold, or of the slide, on.
                          ((0.99, 1.1), 1), ((1.99, 2.1), 1), ((0.9, 1.1), 0)):
        off = (run.time > apart[0]) & (run.time < apart[1])
        left = replace(run, penetration=np.where(off, -1e-3, 1e-3))
        assert losses_of(left) == summarise_contact(left)["losses"] == losses, apart


def test_a_step_that_is_begun_again_is_another_attempt():
    """From the same step, as after a retreat of the supervisor: the first one has failed."""
    time = mission_record().time
    tries = (time >= 0.5).astype(float)
    run = mission_record(failures=tries, tries=tries, reason=float(SUPERVISED) * tries)
    ended = [(attempt.step, attempt.ended) for attempt in attempts_of(run)]
    assert ended == [(0, REASONS[SUPERVISED]), (0, DONE_STEP), (1, DONE_STEP), (2, DONE_STEP),
                     (3, DONE_STEP)]


def test_torques_asked_of_motors_are_those_behind_all_parts(record):
    assert np.array_equal(motor_torques(record), np.abs(record.tau[:, 6:]))
    sent = replace(record, signals={**record.signals, "exerted": 0.5 * record.tau})
    np.testing.assert_allclose(motor_torques(sent), 0.5 * np.abs(record.tau[:, 6:]))
