"""The sub-command `scenario`: what of a base is replaced, places in words, any legal robot."""

import numpy as np
import pytest
from support.random_robots import write_random_robot
from support.robot_agreement import differences
from support.robot_reading import read_robot
from support.robots import diver

from uvms_drake.command.main import main
from uvms_drake.command.scenario import place_words
from uvms_drake.model.robot import Robot
from uvms_drake.setup import first_scenario
from uvms_drake.station.scenario.scenario import load_scenario
from uvms_drake.station.scenario.scenario_file import not_inherited

TAGGED = ("base: girona500_contact\nsurface: !ShapedSurface {friction: 0.4}\n"
          "task: {force_tolerance: 1}")


def written(folder, text):
    """Returns the path of a scenario's file with this text."""
    path = folder / "mine.yaml"
    path.write_text(text, encoding="utf-8")
    return str(path)


def test_a_tag_replaces_and_a_mapping_is_merged(tmp_path):
    lost = not_inherited(written(tmp_path, TAGGED))
    assert set(lost) == {"surface"}
    assert "creep = 0.025" in lost["surface"]
    assert not any(line.startswith("friction") for line in lost["surface"])
    merged = TAGGED.replace("!ShapedSurface ", "")
    assert not_inherited(written(tmp_path, merged)) == {}
    assert not_inherited("girona500_ideal") == {}


def test_the_check_says_it_before_the_refusal_that_it_explains(tmp_path, capsys):
    """D19: the friction's creep was lost, and the error named the step and `the loop`."""
    with_step = f"{TAGGED}\nsimulator: {{max_step_size: 0.01}}"
    assert main(["scenario", "--check", written(tmp_path, with_step)]) == 2
    out, err = capsys.readouterr()
    assert out.startswith("surface: its tag replaces the base's mapping; not inherited, so at the "
                          "default or absent: ")
    assert "creep = 0.025" in out
    assert "simulator.max_step_size" in err
    assert "the friction on the end-effector" in err
    assert "surface.creep = 0.01 m/s" in err


@pytest.mark.parametrize(("base", "command"), [
    ("girona500_real_loop", "calibrate"), ("girona500_contact", "certify")])
def test_the_check_of_a_scenario_names_the_command_that_decides_on_it(
        base, command, tmp_path, capsys):
    file = written(tmp_path, f"base: {base}")
    assert main(["scenario", "--check", file]) == 0
    assert f"a valid scenario; 'uvms-drake {command} {file}' " in capsys.readouterr().out


def test_a_sound_scenario_is_compared_with_its_base(tmp_path, capsys):
    file = written(tmp_path, "base: girona500_ideal\ndisturbance: {bound: 0.05}")
    assert main(["scenario", "--check", file]) == 0
    out = capsys.readouterr().out.splitlines()
    assert "disturbance.bound: 0.05 (base: 0.1)" in out
    assert out[-1] == (f"mine.yaml: a valid scenario; 'uvms-drake certify {file}' says whether it "
                       "holds")


def test_places_of_a_mission_are_told_by_the_axes_of_the_wall():
    scenario = load_scenario("girona500_inspection", [
        "mission.steps=[!Approach {at: [0.1, -0.2]}, !Slide {along: [0.0, 0.3]}, !Retreat {}]"])
    assert place_words(scenario) == [
        "mission.steps[0], Approach.at: 0.1 m down, -0.2 m to port",
        "mission.steps[1], Slide.along: 0 m down, 0.3 m to port"]
    floor = load_scenario("girona500_unknown_floor", [
        "mission.steps=[!Approach {at: [0.1, -0.2]}, !Hold {}, !Retreat {}]"])
    assert place_words(floor) == [
        "mission.steps[0], Approach.at: 0.1 m north, -0.2 m east"]


def test_a_scenario_that_a_run_refuses_is_refused_with_the_file_of_its_error(tmp_path, capsys):
    stuck = "base: girona500_ideal\nfaults: [!StuckJoint {joint: 9}]"
    for text, expected in ((stuck, "joint"), ("base: [a", "line 1"), ("base: mine.yaml", "base")):
        assert main(["scenario", "--check", written(tmp_path, text)]) == 2
        out, err = capsys.readouterr()
        assert expected in err
        assert "(mine.yaml" in err
        assert err.count("\n") == 1
        assert "a valid scenario" not in out


@pytest.mark.parametrize("seeds", [
    range(12), pytest.param(range(12, 200), marks=pytest.mark.long)], ids=["few", "many"])
def test_a_scenario_is_made_for_every_legal_robot(seeds, tmp_path, capsys):
    """`scenario --new` builds the loop of plant and controller that `run` simulates."""
    sizes, refused = set(), []
    for seed in seeds:
        robot = write_random_robot(tmp_path / str(seed), np.random.default_rng(seed))
        file = tmp_path / str(seed) / "press.yaml"
        for words in (["robot", str(robot)],
                      ["scenario", "--uncertified", "--new", str(file), "--robot", str(robot)]):
            if main(words) != 0:
                refused.append(f"{seed}, {words[0]}: {capsys.readouterr().err}")
                break
        loaded = Robot.load(robot)
        assert differences(loaded, read_robot(robot)) == [], seed
        sizes.add((len(loaded.uvms.joints), loaded.uvms.thrusters is None))
    assert refused == []
    assert len({n for n, _ in sizes}) >= 5
    assert {known for _, known in sizes} == {True, False}


def test_a_scenario_that_run_would_refuse_is_not_written(tmp_path, monkeypatch, capsys):
    """Its limits do not hold the task."""
    text = first_scenario.format_first_scenario

    def too_gentle(*args):
        return text(*args).replace("static_force: ", "static_force: 0.")

    monkeypatch.setattr(first_scenario, "format_first_scenario", too_gentle)
    file = tmp_path / "new" / "folder" / "press.yaml"
    assert main(["scenario", "--uncertified", "--new", str(file), "--robot", "box_uvms"]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert "static_force" in err and "the scenario made for box_uvms" in err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("ends", [(-2.2071234567, -0.3), (-0.7080549, 1.29812298)])
def test_limits_of_a_scenario_are_within_those_of_the_robot(ends, tmp_path):
    """They are written with four decimals."""
    low, high = ends
    robot = diver(tmp_path, (".urdf", 'lower="-1.4" upper="0.6"', f'lower="{low}" upper="{high}"'))
    file = tmp_path / "press.yaml"
    assert main(["scenario", "--uncertified", "--new", str(file), "--robot", str(robot)]) == 0
    limits = load_scenario(str(file)).limits
    assert low <= limits.q_lower[0] < limits.q_upper[0] <= high
