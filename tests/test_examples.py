"""Every example runs, from any directory, and prints what it promises."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parent.parent / "examples"
SCRIPTS = sorted(EXAMPLES.glob("*.py"))


def run(name: str, duration: float, folder: Path) -> str:
    """Returns what an example prints in a run of `duration` [s]."""
    done = subprocess.run([sys.executable, str(EXAMPLES / name), f"--duration={duration}"],
                          cwd=folder, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert list(folder.iterdir()) == [], "an example leaves nothing behind"
    return done.stdout


def table(text: str) -> list[list[float]]:
    """Returns the rows of numbers of a printed table."""
    rows = [line.split() for line in text.splitlines()]
    return [[float(cell) for cell in row] for row in rows
            if row and all(re.fullmatch(r"-?\d+\.\d+", cell) for cell in row)]


def last_numbers(text: str) -> list[float]:
    """Returns the numbers in the last line that is printed."""
    return [float(number) for number in re.findall(r"-?\d+\.\d+", text.splitlines()[-1])]


def test_a_robot_without_thrust_comes_to_the_speed_of_the_current(tmp_path):
    text = run("drift_in_current.py", 60.0, tmp_path)
    north = [row[1] for row in table(text)]
    assert north[0] == 0.0
    assert north == sorted(north), "it only ever gains"
    (share,) = last_numbers(text)
    assert 0.9 < share < 1.05
    depth = [row[3] for row in table(text)]
    assert depth[-1] < depth[0], "it is buoyant"


def test_the_loop_by_hand_comes_to_the_desired_force(tmp_path):
    text = run("closed_loop_by_hand.py", 4.0, tmp_path)
    rows = table(text)
    assert [row[0] for row in rows] == [0.0, 1.0, 2.0, 3.0, 4.0]
    assert rows[0][1] > 100.0, "it starts off the wall"
    assert rows[0][2] == 0.0
    reached, desired = last_numbers(text)
    assert desired == 12.0
    assert abs(reached - desired) < 1.0


def test_waves_of_ones_own_stay_below_their_bound_and_are_withstood(tmp_path):
    text = run("own_disturbance.py", 5.0, tmp_path)
    largest, bound = last_numbers(text)
    assert 0.2 * bound < largest <= bound
    surge = [row[2] for row in table(text)]
    assert min(surge) < -0.02 < 0.02 < max(surge), "waves push to and fro"
    assert abs(table(text)[-1][1] - 20.0) < 5.0


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.name)
def test_an_example_is_short_and_listed(path):
    text = path.read_text(encoding="utf-8")
    assert text.count("\n") <= 100
    assert f"({path.name})" in (EXAMPLES / "README.md").read_text(encoding="utf-8")
