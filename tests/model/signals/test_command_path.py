"""Tests of `model.signals.command_path`: from the law's command to what acts."""

from dataclasses import fields, replace
from functools import reduce

import numpy as np
import pytest

from uvms_drake.actuation import Actuator, IdealWrench, LaggedWrench, SampledCommand, Thrusters
from uvms_drake.model.signals.command_path import IDEAL_PATH, CommandPath


def through(model, *parts) -> CommandPath:
    """Returns the path through parts."""
    return reduce(CommandPath.then, (part.command_path(model) for part in parts), IDEAL_PATH)


def test_without_a_part_a_command_acts_at_once(model):
    for path in (through(model), through(model, IdealWrench(undriven=["roll"]))):
        assert path == IDEAL_PATH and not path.has_thrusters
        assert path.vehicle_age == path.joint_age == 0.0


@pytest.mark.parametrize(("period", "delay", "dead_time"), [
    (0.02, 0.01, 0.07), (0.02, 0.0, 0.06), (0.02, 0.004, 0.06), (0.01, 0.019, 0.07)])
def test_thrusters_take_what_is_there_at_their_next_sample(model, period, delay, dead_time):
    """A command that goes out with a sample of theirs is taken by the one after."""
    path = through(model, SampledCommand(period, delay),
                   Thrusters(period=0.01, lag=0.15, dead_time=0.05))
    assert (path.period, path.delay, path.joint_age) == (period, delay, period + delay)
    assert path.vehicle_dead_time == pytest.approx(dead_time)
    assert (path.vehicle_period, path.lag) == (period, 0.15)
    assert path.vehicle_age == pytest.approx(period + dead_time + 0.15)
    assert path.has_thrusters and not path.unknown


@pytest.mark.parametrize("wrench", [
    Thrusters(period=0.01, dead_time=0.02, lag=0.1), LaggedWrench(0.01, lag=0.1, dead_time=0.02)])
def test_without_a_clock_thrusters_sample_for_themselves(model, wrench):
    path = through(model, wrench)
    assert (path.vehicle_period, path.vehicle_dead_time) == (0.01, 0.02)
    assert path.lag == pytest.approx(0.1)
    assert path.joint_age == 0.0
    assert path.undriven == ((3,) if type(wrench) is Thrusters else ())


def test_behind_a_clock_alone_all_acts_as_late_as_the_joints(model):
    path = through(model, SampledCommand(0.02, 0.01))
    assert (path.vehicle_period, path.vehicle_dead_time) == (0.02, 0.01)
    assert path.vehicle_age == path.joint_age == 0.03
    assert path.mean_delays == (0.02, 0.02)


def test_a_plan_is_commanded_earlier_by_the_mean_delays_behind_thrusters_alone(model):
    """Unless it is not foreseen: then it is not, by the clock's delay either."""
    clock = SampledCommand(0.02, 0.01)
    lagged = LaggedWrench(0.01, lag=0.1, dead_time=0.05)
    path = through(model, clock, lagged)
    assert path.preview == path.mean_delays == (pytest.approx(0.02 + 0.155), 0.02)
    assert through(model, clock).preview == (0.0, 0.0)
    hidden = through(model, clock, replace(lagged, foreseen=False))
    assert hidden.preview == (0.0, 0.0) and hidden.mean_delays == path.mean_delays


def test_an_ideal_part_before_or_behind_changes_nothing(model):
    thrusters = LaggedWrench(0.01, lag=0.1, dead_time=0.05, foreseen=False)
    for path in (through(model, SampledCommand(0.02, 0.01), thrusters),
                 through(model, Thrusters(period=0.01, error=np.full(1, 0.1)))):
        assert path.then(IDEAL_PATH) == IDEAL_PATH.then(path) == path


def test_an_effect_without_a_path_is_named(model):
    clock, thrusters = SampledCommand(0.015, 0.0), Thrusters(period=0.01)
    assert "no multiple" in through(model, clock, thrusters).unknown[0]
    for parts in ((thrusters, clock), (clock, clock), (thrusters, thrusters)):
        assert "order" in through(model, *parts).unknown[0]
    path = Actuator.command_path(IdealWrench(), model).then(clock.command_path(model))
    assert "known delay" in path.unknown[0] and path.period == 0.015


def test_paths_are_equal_if_all_of_their_data_are(model):
    """Those of thrusters with a wrong model, too: in sets, and whichever datum differs."""
    def made() -> CommandPath:
        return Thrusters(error=np.array([0.1, -0.1, 0.05, 0.0, 0.2])).command_path(model)

    path = made()
    assert path == made() and len({path, made(), IDEAL_PATH}) == 2
    assert path != Thrusters(error=np.array([0.1, -0.1, 0.05, 0.0, 0.1])).command_path(model)
    other = {float: 0.5, bool: False, tuple: ((1.0,),)}
    for field in fields(CommandPath):
        value = getattr(path, field.name)
        assert replace(path, **{field.name: other[type(value)]}) != path, field.name


def test_clocks_tick_at_knots_if_their_period_is_a_binary_number():
    assert CommandPath(2.0**-8).ticks_at_knots(0.25)
    assert CommandPath(thruster_period=2.0**-8).ticks_at_knots(0.25)
    assert not CommandPath(0.007).ticks_at_knots(0.2)


def test_a_wrong_model_is_as_wrong_as_its_forces(model):
    """The rows bound the error of each thruster, for any command."""
    part = Thrusters(error=np.array([0.1, -0.1, 0.05, 0.0, 0.2]))
    path, known, true = part.command_path(model), part.known(model), part.true(model)
    rng = np.random.default_rng(0)
    worst = np.zeros(5)
    for command in rng.uniform(-1.0, 1.0, (400, 5)):
        wrong = true.forces_of(command) - known.forces_of(command)
        worst = np.maximum(worst, np.abs(wrong))
    size = np.linalg.norm(path.thruster_error, axis=1) / np.linalg.norm(known.B, axis=0)
    assert np.all(worst <= size + 1e-9)
    assert np.all(worst >= 0.95 * size)
