"""Tests of `model.signals.command_path`: from the law's command to what acts."""

from functools import reduce

import pytest

from uvms_drake.actuation import IdealWrench, SampledCommand, Thrusters
from uvms_drake.model.signals.command_path import IDEAL_PATH, CommandPath

CLOCK = SampledCommand(0.02, 0.01)


def through(model, *parts) -> CommandPath:
    """Returns the path through parts."""
    return reduce(CommandPath.then, (part.command_path(model) for part in parts), IDEAL_PATH)


def test_a_plan_is_commanded_earlier_by_the_mean_delays_behind_thrusters_alone(model):
    """δ + h/2 for the joints, and h_t/2 + D + T more for the wrench."""
    thrusters = Thrusters(period=0.01, lag=0.1, dead_time=0.05)
    path = through(model, CLOCK, thrusters)
    assert path.preview == path.mean_delays == (pytest.approx(0.02 + 0.155), 0.02)
    assert through(model, thrusters).mean_delays == (pytest.approx(0.155), 0.0)
    assert through(model, CLOCK).mean_delays == (0.02, 0.02)
    assert through(model, CLOCK).preview == (0.0, 0.0)


def test_an_ideal_part_before_or_behind_changes_nothing(model):
    assert through(model, IdealWrench(undriven=["roll"])) == IDEAL_PATH
    path = through(model, CLOCK, Thrusters())
    assert path.then(IDEAL_PATH) == IDEAL_PATH.then(path) == path
