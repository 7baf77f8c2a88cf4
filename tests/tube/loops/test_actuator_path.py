"""Tests of `uvms_drake.tube.loops.actuator_path`: from the law's command to what acts."""

import numpy as np
import pytest

from uvms_drake.actuation.sampled_command import SampledCommand
from uvms_drake.actuation.thrusters import Thrusters
from uvms_drake.model.signals.sensor_actuator import CommandPath
from uvms_drake.tube.loops.actuator_path import Path, actuators_of


def test_nothing_is_late_by_default():
    found = actuators_of([])
    assert found.vehicle == found.joints == Path()
    assert not found.delayed


@pytest.mark.parametrize(("period", "delay", "dead_time"), [
    (0.02, 0.01, 0.07), (0.02, 0.0, 0.06), (0.02, 0.004, 0.06), (0.01, 0.019, 0.07)])
def test_thrusters_take_what_is_there_at_their_next_sample(model, period, delay, dead_time):
    """A command that goes out with a sample of theirs is taken by the one after."""
    parts = SampledCommand(period, delay), Thrusters(period=0.01, lag=0.15, dead_time=0.05)
    found = actuators_of([part.command_path(model) for part in parts])
    assert found.joints == Path(period, delay)
    assert found.vehicle.dead_time == pytest.approx(dead_time)
    assert (found.vehicle.period, found.vehicle.lag) == (period, 0.15)
    assert found.vehicle.age == pytest.approx(period + dead_time + 0.15)
    assert found.thrusters
    assert not found.unknown


def test_without_a_clock_thrusters_sample_for_themselves(model):
    found = actuators_of([Thrusters(period=0.01, dead_time=0.02, lag=0.1).command_path(model)])
    assert found.vehicle == Path(0.01, 0.02, 0.1)
    assert found.joints.age == 0.0
    assert found.undriven == (3,)


def test_an_effect_without_a_path_is_named(model):
    clock, thrusters = SampledCommand(0.015, 0.0), Thrusters(period=0.01)
    paths = [part.command_path(model) for part in (clock, thrusters)]
    assert "no multiple" in actuators_of(paths).unknown[0]
    assert "order" in actuators_of(paths[::-1]).unknown[0]
    assert "known delay" in actuators_of([None, paths[0]]).unknown[0]
    assert actuators_of([CommandPath(0.01, 0.0)]).joints.period == 0.01


def test_a_wrong_model_is_as_wrong_as_its_forces(model):
    """The columns bound the error of each thruster, for any command."""
    part = Thrusters(error=np.array([0.1, -0.1, 0.05, 0.0, 0.2]))
    off, known, true = part.command_path(model).off, part.known(model), part.true(model)
    rng = np.random.default_rng(0)
    worst = np.zeros(5)
    for command in rng.uniform(-1.0, 1.0, (400, 5)):
        wrong = true.forces_of(command) - known.forces_of(command)
        worst = np.maximum(worst, np.abs(wrong))
    size = np.linalg.norm(off, axis=0) / np.linalg.norm(known.B, axis=0)
    assert np.all(worst <= size + 1e-9)
    assert np.all(worst >= 0.95 * size)
