"""Every example runs, from any directory, and prints what it promises."""

import re
import runpy
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from support.quick import few_in_all_files

EXAMPLES = Path(__file__).parent.parent / "examples"
SCRIPTS = sorted(EXAMPLES.glob("*.py"))


@pytest.fixture
def run(tmp_path, monkeypatch, capsys) -> Callable[..., str]:
    """Runs an example for so long [s], with these options, in an empty folder; returns its text.

    It is run in this process, which has loaded Drake, and certifies by fewer searches: what the
    examples print of a certificate is what it fails for.
    """
    def printed(name: str, duration: float, *options: str) -> str:
        few_in_all_files(monkeypatch)
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(sys, "argv", [name, f"--duration={duration}", *options])
        runpy.run_path(str(EXAMPLES / name), run_name="__main__")
        assert list(tmp_path.iterdir()) == [], "an example leaves nothing behind"
        out, err = capsys.readouterr()
        assert only_alarms(err)
        return out

    return printed


def only_alarms(text: str) -> bool:
    """Returns whether all lines on stderr, if any, are about limits or tubes that are left."""
    return all(re.match(r"t = [\d.]+ s: left the ", line) for line in text.splitlines())


def table(text: str) -> list[list[float]]:
    """Returns the rows of numbers of a printed table."""
    rows = [line.split() for line in text.splitlines()]
    return [[float(cell) for cell in row] for row in rows
            if row and all(re.fullmatch(r"-?\d+\.\d+", cell) for cell in row)]


def last_numbers(text: str) -> list[float]:
    """Returns the numbers in the last line that is printed."""
    return [float(number) for number in re.findall(r"-?\d+\.\d+", text.splitlines()[-1])]


@pytest.mark.long
def test_a_robot_without_thrust_comes_to_the_speed_of_the_current(tmp_path):
    """In a process of its own."""
    done = subprocess.run(
        [sys.executable, str(EXAMPLES / "drift_in_current.py"), "--duration=60"], cwd=tmp_path,
        capture_output=True, text=True, timeout=900, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert list(tmp_path.iterdir()) == []
    text = done.stdout
    north = [row[1] for row in table(text)]
    assert north[0] == 0.0
    assert north == sorted(north), "it only ever gains"
    (share,) = last_numbers(text)
    assert 0.9 < share < 1.05
    depth = [row[3] for row in table(text)]
    assert depth[-1] < depth[0], "it is buoyant"


@pytest.mark.long
def test_the_loop_by_hand_comes_to_the_desired_force(run):
    text = run("closed_loop_by_hand.py", 4.0)
    rows = table(text)
    assert [row[0] for row in rows] == [0.0, 1.0, 2.0, 3.0, 4.0]
    assert rows[0][1] > 100.0, "it starts off the wall"
    assert rows[0][2] == 0.0
    reached, desired = last_numbers(text)
    assert desired == 12.0
    assert abs(reached - desired) < 1.0


@pytest.mark.long
def test_user_defined_waves_accelerate_the_vehicle_both_ways(run):
    text = run("own_disturbance.py", 5.0)
    lowest, highest = (float(x) for x in re.search(r"surge (\S+) to (\S+) m", text).groups())
    assert -0.1 < lowest < -0.02 < 0.02 < highest < 0.1
    reached, desired = last_numbers(text)
    assert abs(reached - desired) < 2.0


@pytest.mark.long
@pytest.mark.parametrize(("name", "reason"), [
    ("own_sensor.py", "sensing[0], CompassError: nothing is proven about it"),
    ("own_actuator.py", "actuation[1], ThrusterLag: the proofs assume ideal actuators"),
    ("own_law.py", "certificate of the law ProportionalDerivative, none is known"),
    ("own_cost.py", "mpc.terms[0], SlowElbow, which the terminal set leaves out"),
    ("own_surface.py", None),
    ("thrusters.py", None),
    ("two_robots.py", None)])
def test_the_force_settles_with_a_user_defined_part_and_a_missing_certificate_has_its_reason(
        name, reason, run):
    text = run(name, 4.0)
    reached, desired = last_numbers(text)
    assert abs(reached - desired) < 2.0
    assert reason is None or reason in text


@pytest.mark.long
def test_the_program_takes_a_cost_and_a_constraint_by_drake_s_own_calls(run):
    text = run("own_program.py", 3.0)
    without, limited, looped = map(float, re.findall(r"up to ([\d.]+) rad/s", text))
    assert without > 0.1 > 0.0501 > max(limited, looped)
    assert last_numbers(text)[0] > 10.0, "it presses"


@pytest.mark.long
def test_behind_thrusters_that_lag_only_the_law_tip_first_holds_the_tip(run):
    tips = re.findall(r"the tip is off by up to (\S+) mm", run("tip_first.py", 1.2))
    *others, tip_first = map(float, tips)
    assert tip_first < 1.0 < 5.0 < min(others)


@pytest.mark.long
def test_with_a_measured_force_the_error_of_the_wall_does_not_leave_the_tube(run):
    text = run("sensed_wall.py", 1.6)
    modelled, measured = (float(x) for x in re.findall(r"up to (\d+\.\d+) of the tube", text))
    assert measured < 0.5 < 2.0 < modelled


@pytest.mark.long
def test_a_time_varying_force_is_tracked_on_an_unknown_wall(run):
    text = run("changing_force.py", 4.0)
    rows = np.array(table(text))
    np.testing.assert_allclose(
        rows[:, 1], 20.0 + 5.0 * np.sin(0.2 * np.pi * rows[:, 0]), atol=0.06)
    assert rows[0, 2] == 0.0
    assert abs(rows[-1, 2] - rows[-1, 1]) < 3.0
    rms, worst = last_numbers(text)[1:]
    assert 0.0 < rms < worst < 25.0


@pytest.mark.long
def test_a_user_defined_limit_is_kept_by_the_plan(run):
    text = run("own_limit.py", 3.0)
    assert "limits.pillar, no tightening by the tube is defined" in text
    without, kept = (float(x) for x in re.findall(r"limit: (\d+\.\d+) m", text))
    assert without < 0.2
    assert kept >= 0.22 - 1e-3


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.name)
def test_an_example_is_short_and_listed(path):
    text = path.read_text(encoding="utf-8")
    assert text.count("\n") <= 100
    assert f"({path.name})" in (EXAMPLES / "README.md").read_text(encoding="utf-8")


@pytest.mark.long
def test_the_slides_have_a_table(run):
    assert run("slides.py", 0.1).split()[:4] == ["m", "mm/s", "N", "+-"]


@pytest.mark.long
def test_a_drawn_mission_ends_and_presses_no_harder_than_it_may(run):
    _, *lines, last = run("drawn_missions.py", 26.0).splitlines()
    assert last.startswith("2 missions: ")
    assert len(lines) == 2
    for line in lines:
        numbers, ended = re.fullmatch(r"(.*\d)  (\D+)", line).groups()
        assert re.match("done|skipped in part|retreated", ended)
        assert "Retreat" not in ended.replace("Retreat: retreated", "")  # By the supervisor.
        largest, allowed = (float(number) for number in numbers.split()[-2:])
        assert 5.0 < largest < allowed


@pytest.mark.long
@pytest.mark.parametrize("row", ["mass + 20 %", "current 0.25 m/s", "thrusters - 10 %",
                                 "20 Hz", "DVL gaps of 0.4 s"])
def test_limits_and_tubes_are_kept_with_each_model_error(row, run):
    found = run("each_alone.py", 20.0, f"--row={row}").splitlines()[-1]
    assert found.startswith(row)
    assert found.endswith(" all kept")
    tip, vehicle, of_tube, steady, rms, worst, lost = map(float, found[22:].split()[:7])
    assert steady < 3.0
    assert tip < 3.5
    assert vehicle < (20.0 if row == "current 0.25 m/s" else 15.0)
    assert of_tube < 1.0
    assert rms < worst < 3.0
    assert lost == 0.0


@pytest.mark.long
def test_a_tip_that_is_too_fast_for_20_hz_leaves_its_tube(run):
    # After 8 s of hovering.
    found = run("each_alone.py", 8.5, "--row=20 Hz, faster tip").splitlines()[-1]
    tip, _, of_tube = map(float, found[22:].split()[:3])
    assert tip > 10.0
    assert of_tube > 2.0
    assert "not pressed" in found


@pytest.mark.long
def test_a_mission_next_to_the_station_presses_and_slides(run):
    *lines, last = run("inspection.py", 9.0).splitlines()
    rows = [line.split() for line in lines[1:]]
    steps = [row[1] for row in rows]
    assert list(dict.fromkeys(steps)) == ["Approach", "Hold", "Slide"]
    assert all(abs(float(row[3]) - float(row[2])) < 2.0 for row in rows[steps.index("Hold"):])
    largest, allowed = (float(number) for number in re.findall(r"\d+\.\d+", last))
    assert largest < 0.5 * allowed
