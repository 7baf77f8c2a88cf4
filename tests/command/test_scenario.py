"""The sub-command `scenario --check`: what of a base is replaced, and places in words."""

import numpy as np
import pytest

from uvms_drake.command.main import main
from uvms_drake.command.scenario import compass, place_words
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


def test_a_sound_scenario_is_compared_with_its_base(tmp_path, capsys):
    file = written(tmp_path, "base: girona500_ideal\ndisturbance: {bound: 0.05}")
    assert main(["scenario", "--check", file]) == 0
    out = capsys.readouterr().out.splitlines()
    assert "disturbance.bound: 0.05 (base: 0.1)" in out
    assert out[-1] == (f"mine.yaml: a valid scenario; 'uvms-drake certify {file}' says whether it "
                       "holds")


@pytest.mark.parametrize("args", [["--new", "x.yaml"], ["--check", "girona500_ideal", "--robot",
                                                         "girona500_arm5e"]])
def test_a_robot_belongs_to_a_new_scenario_alone(args, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["scenario", *args]) == 2
    assert capsys.readouterr().err.startswith("uvms-drake: error: --robot = ")


def test_places_of_a_mission_are_told_by_the_compass():
    """D18: of (a, b) one has to know t₁ and t₂; for n = north they are down and west."""
    scenario = load_scenario("girona500_inspection", [
        "mission.steps=[!Approach {at: [0.1, -0.2]}, !Slide {along: [0.0, 0.3]}, !Retreat {}]"])
    assert place_words(scenario) == [
        "mission.steps[0], Approach.at: 0.2 m east, 0.1 m down",
        "mission.steps[1], Slide.along: 0.3 m west"]
    assert compass(np.array([-1.0, 0.0, 2e-12])) == "1 m south"
    assert compass(np.zeros(3)) == "no offset"


def test_a_scenario_that_a_run_refuses_is_refused_with_the_file_of_its_error(tmp_path, capsys):
    stuck = "base: girona500_ideal\nfaults: [!StuckJoint {joint: 9}]"
    for text, expected in ((stuck, "joint"), ("base: [a", "line 1"), ("base: mine.yaml", "base")):
        assert main(["scenario", "--check", written(tmp_path, text)]) == 2
        out, err = capsys.readouterr()
        assert expected in err
        assert "(mine.yaml" in err
        assert err.count("\n") == 1
        assert "a valid scenario" not in out
