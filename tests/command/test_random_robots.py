"""What `robot` says yes to is taken by what comes after it, over legal robots at random."""

import numpy as np
import pytest
from support.random_robots import write_random_robot
from support.robot_agreement import differences
from support.robot_reading import read_robot
from support.robots import diver

from uvms_drake.command.main import main
from uvms_drake.model.robot import Robot
from uvms_drake.setup import first_scenario
from uvms_drake.station.scenario.scenario import load_scenario


@pytest.mark.parametrize("seeds", [
    range(12), pytest.param(range(12, 200), marks=pytest.mark.long)], ids=["few", "many"])
def test_a_scenario_is_made_for_every_legal_robot(seeds, tmp_path, capsys):
    """`scenario --new` builds the loop of plant and controller that `run` simulates."""
    sizes, refused = set(), []
    for seed in seeds:
        robot = write_random_robot(tmp_path / str(seed), np.random.default_rng(seed))
        file = tmp_path / str(seed) / "press.yaml"
        for words in (["robot", str(robot)],
                      ["scenario", "--new", str(file), "--robot", str(robot)]):
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
    assert main(["scenario", "--new", str(file), "--robot", "box_uvms"]) == 2
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
    assert main(["scenario", "--new", str(file), "--robot", str(robot)]) == 0
    limits = load_scenario(str(file)).limits
    assert low <= limits.q_lower[0] < limits.q_upper[0] <= high
