"""Files of robots with random mistakes: refused, noted, or read as the second reader reads them.

A mistake that leaves a legal file makes another robot, and that is the robot which is to be loaded:
its masses, added masses, thrusters, limits and tip are compared with a reading by NumPy. What that
reading cannot tell from the file, the loader must not have guessed.
"""

import random
from collections import Counter
from pathlib import Path

import pytest
from support.robot_agreement import differences
from support.robot_mutations import mutated
from support.robot_reading import read_robot, words
from support.robots import DIVER, diver

import uvms_drake as uv
from uvms_drake.model.description.robot_files import model_dir
from uvms_drake.plant.model_check import sound_robot

ROBOTS = ("box_uvms", "bluerov2_alpha5")
MORE = {("link", "visual", "twice"), ("model", "frame", "twice"), ("robot", "frame", "twice")}
"""What may be there several times, and is not in each of them."""


@pytest.fixture(scope="module")
def sources() -> list[Path]:
    return [DIVER, *map(model_dir, ROBOTS)]


@pytest.mark.parametrize("name", ["diver", *ROBOTS, "girona500_arm5e"])
def test_both_readers_agree_on_a_robot_without_mistakes(name):
    folder = DIVER if name == "diver" else model_dir(name)
    robot = uv.Robot.load(folder)
    assert robot.notes == ()
    assert differences(robot, read_robot(folder)) == []


def outcome(robot: Path, source: Path) -> str:
    """Returns what becomes of a robot's folder, or what is wrong with that.

    A word that is not in the files without the mistake is none that the robot may be read by.
    """
    try:
        loaded = sound_robot(str(robot))
    except uv.InvalidParameter as error:
        return "refused" if "\n" not in str(error) else f"refused in several lines: {error}"
    except Exception as error:
        return f"refused by an error of its own: {error!r}"
    if loaded.notes:
        return "noted"
    try:
        found = differences(loaded, read_robot(robot)) + sorted(words(robot) - words(source) - MORE)
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        return f"read, though the file is not legal: {error!r}"
    return f"read otherwise: {found}" if found else "read as it is"


@pytest.mark.parametrize("seeds", [
    range(100), pytest.param(range(100, 1100), marks=pytest.mark.long)], ids=["few", "many"])
def test_no_mistake_changes_a_robot_in_silence(seeds, sources, tmp_path):
    found: dict[str, list[str]] = {}
    for seed in seeds:
        rng = random.Random(seed)
        source = rng.choice(sources)
        robot, told = mutated(source, tmp_path / str(seed), rng)
        found.setdefault(outcome(robot, source), []).append(f"{seed}, {robot.name}: {told}")
    counts = Counter({key: len(cases) for key, cases in found.items()})
    print(counts)
    assert {key: cases for key, cases in found.items()
            if key not in ("refused", "noted", "read as it is")} == {}
    assert counts["refused"] > 0.3 * len(seeds)
    assert counts["read as it is"] > 0.1 * len(seeds)


@pytest.mark.parametrize(("suffix", "old", "new", "what"), [
    (".urdf", 'value="40"', 'value="41"', "mass of vehicle"),
    (".urdf", 'xyz="0.3 0 0"', 'xyz="0.3 0 0.01"', "tip"),
    (".urdf", 'upper="2.1"', 'upper="2.2"', "limits"),
    ("hydrodynamics.yaml", "[20, 40", "[21, 40", "added mass of vehicle"),
    ("thrusters.yaml", "[0.2, 0, 0]", "[0.2, 0.1, 0]", "thruster bow")])
def test_the_comparison_would_show_it(suffix, old, new, what, tmp_path):
    """The loaded robot beside a reading of other files."""
    found = differences(uv.Robot.load(DIVER), read_robot(diver(tmp_path, (suffix, old, new))))
    assert found and all(each.startswith(what) for each in found)
