"""Tests of `model.signals`: samples and their instants by definition, delays of a command."""

from functools import reduce

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from support.scripts import Script

from uvms_drake.actuation import IdealWrench, SampledCommand, Thrusters
from uvms_drake.model.signals.command_path import IDEAL_PATH, CommandPath
from uvms_drake.model.signals.sample_and_hold import Clock, SampledVector, TickedVector

TIMES = np.sqrt(np.linspace(2e-4, 0.98, 171))
"""Instants between events."""


def moving(time):
    return np.array([time, 2.0 - 3.0 * time, np.sin(5.0 * time)])


def bench(clocks, start=0.0):
    builder = DiagramBuilder()
    script = builder.AddSystem(Script(vector=moving))
    system = SampledVector.AddToBuilder(
        builder, script.get_output_port().size(), clocks, vector=script.get_output_port())
    simulator = Simulator(builder.Build())
    simulator.get_mutable_context().SetTime(start)
    simulator.Initialize()
    return simulator, system


def hold(simulator, system):
    return system.GetOutputPort("hold").Eval(
        system.GetMyContextFromRoot(simulator.get_context())).copy()


@pytest.mark.parametrize(("period", "delay"), [
    (0.1, 0.0), (0.1, 0.03), (0.1, 0.1), (0.1, 0.2), (0.07, 0.3), (0.02, 0.06), (0.03, 0.1)])
def test_the_sample_of_kh_is_held_from_its_delay_on(period, delay):
    simulator, system = bench([Clock(range(3), period, delay)])
    for time in TIMES:
        simulator.AdvanceTo(time)
        k = max(np.floor((time - delay) / period), 0)
        np.testing.assert_allclose(hold(simulator, system), moving(k * period), atol=1e-12)


def test_each_component_has_its_own_clock_and_error():
    clocks = [Clock([2, 0], 0.1, 0.05, lambda time: np.array([10.0 + time, 20.0])),
              Clock([1], 0.03)]
    simulator, system = bench(clocks)
    for time in TIMES:
        simulator.AdvanceTo(time)
        slow, fast = max(np.floor((time - 0.05) / 0.1), 0) * 0.1, np.floor(time / 0.03) * 0.03
        expected = moving(slow)
        expected[1] = moving(fast)[1]
        np.testing.assert_allclose(hold(simulator, system) - expected,
                                   [20.0, 0.0, 10.0 + slow], atol=1e-12)


def test_what_is_propagated_is_the_vector_of_now_with_the_error_of_the_sample():
    simulator, system = bench([Clock(range(3), 0.1, 0.05, lambda time: np.full(3, time), True)])
    for time in TIMES:
        simulator.AdvanceTo(time)
        sampled = max(np.floor((time - 0.05) / 0.1), 0) * 0.1
        np.testing.assert_allclose(
            hold(simulator, system), moving(time) + sampled, atol=1e-12)


def test_it_is_the_vector_itself_until_the_first_sample():
    simulator, system = bench([Clock(range(3), 0.1, 0.04)], start=0.32)
    for time, of in ((0.32, 0.32), (0.39, 0.39), (0.41, 0.4), (0.43, 0.4), (0.53, 0.4),
                     (0.55, 0.5)):
        simulator.AdvanceTo(time)
        np.testing.assert_allclose(hold(simulator, system), moving(of), atol=1e-12)


def test_no_sample_gets_lost_where_instants_are_the_same_but_for_rounding():
    """0.06 + 28 · 0.02 is more than 0.62, and another clock has an event there: Drake skips it."""
    assert 0.06 + 28 * 0.02 > 31 * 0.02
    simulator, system = bench([Clock([0], 0.02, 0.06), Clock([1], 0.02), Clock([2], 0.01, 0.01)])
    for k in range(200):
        simulator.AdvanceTo(0.02 * k + 0.003)
        late, now = max(k - 3, 0) * 0.02, 0.02 * k
        np.testing.assert_allclose(hold(simulator, system), [
            moving(late)[0], moving(now)[1], moving(max(now - 0.01, 0.0))[2]], atol=1e-12)


def test_a_faster_clock_samples_what_is_passed_on_at_its_instants_always_as_late():
    """0.02 k + 0.01 and 0.01 (2k + 1) are not the same number for every k."""
    late, late_by = [0.02 * k + 0.01 for k in range(400)], [0.01 * (2 * k + 1) for k in range(400)]
    assert late != late_by
    builder = DiagramBuilder()
    script = builder.AddSystem(Script(vector=moving))
    slow = SampledVector.AddToBuilder(
        builder, script.get_output_port().size(), [Clock(range(3), 0.02, 0.01)],
        vector=script.get_output_port())
    fast = SampledVector.AddToBuilder(
        builder, slow.get_output_port().size(), [Clock(range(3), 0.01)], name="fast",
        vector=slow.get_output_port())
    simulator = Simulator(builder.Build())
    simulator.Initialize()
    for k in range(1, 400):
        simulator.AdvanceTo(0.02 * k + 0.015)  # What was passed on at 0.02 k + 0.01 comes next.
        np.testing.assert_allclose(hold(simulator, fast), moving(0.02 * (k - 1)), atol=1e-12)


@pytest.mark.parametrize(("period", "delay", "event"), [
    (0.02, 0.0, None), (0.02, 0.04, None), (0.02, 0.01, (0.01, 0.0)), (0.03, 0.01, (0.01, 0.0)),
    (0.02, 0.03, (0.01, 0.0)), (0.02, 0.001, (0.02, 0.001)), (0.1, 0.07, (0.1, 0.07))])
def test_a_step_begins_where_a_sample_is_passed_on(period, delay, event):
    found = Clock(range(3), period, delay).passing_on
    assert found is None if event is None else found == pytest.approx(event)


def test_what_is_read_at_a_sample_is_what_was_held_before_it():
    simulator, system = bench([Clock(range(3), 0.25)])
    simulator.AdvanceTo(0.5)
    np.testing.assert_array_equal(hold(simulator, system), moving(0.25))
    simulator.AdvancePendingEvents()
    np.testing.assert_array_equal(hold(simulator, system), moving(0.5))


@pytest.mark.parametrize("delay", [0.0, 0.007, 0.05])
def test_ticks_at_any_time_are_samples_and_held_from_the_first_step_after_their_delay(delay):
    builder = DiagramBuilder()
    script = builder.AddSystem(Script(vector=moving))
    system = TickedVector.AddToBuilder(
        builder, 3, [Clock(range(3), 0.02, delay)], vector=script.get_output_port())
    builder.ExportInput(system.GetInputPort("tick"), "tick")
    simulator = Simulator(builder.Build())
    tick = simulator.get_system().GetInputPort("tick")
    tick.FixValue(simulator.get_mutable_context(), [0.0])
    simulator.Initialize()
    np.testing.assert_array_equal(hold(simulator, system), moving(0.0))  # As yet no sample.
    rng, now, ticks = np.random.default_rng(0), 0.0, [0.0]
    for count in range(1, 200):
        now += rng.uniform(0.002, 0.06)
        simulator.AdvanceTo(now)
        if rng.random() < 0.7:  # Else it is no tick.
            tick.FixValue(simulator.get_mutable_context(), [float(count)])
            ticks.append(now)
        simulator.AdvancePendingEvents()
        due = [t for t in ticks if t + delay <= now] or ticks[:1]
        np.testing.assert_array_equal(hold(simulator, system), moving(due[-1]))
        newest = system.GetOutputPort("newest").Eval(
            system.GetMyContextFromRoot(simulator.get_context()))
        np.testing.assert_array_equal(newest, moving(ticks[-1]))


def test_a_cloned_context_goes_on_alike():
    simulator, system = bench([Clock(range(3), 0.02, 0.05, lambda time: np.full(3, time))])
    simulator.AdvanceTo(0.213)
    clone = Simulator(simulator.get_system(), simulator.get_context().Clone())
    clone.Initialize()
    for time in (0.213, 0.219, 0.26, 0.5):
        for each in (simulator, clone):
            each.AdvanceTo(time)
        np.testing.assert_array_equal(hold(simulator, system), hold(clone, system))


CLOCKED = SampledCommand(0.02, 0.01)


def through(model, *parts) -> CommandPath:
    """Returns the path through parts."""
    return reduce(CommandPath.then, (part.command_path(model) for part in parts), IDEAL_PATH)


def test_a_plan_is_commanded_earlier_by_the_mean_delays_behind_thrusters_alone(model):
    """δ + h/2 for the joints, and h_t/2 + D + T more for the wrench."""
    thrusters = Thrusters(period=0.01, lag=0.1, dead_time=0.05)
    path = through(model, CLOCKED, thrusters)
    assert path.preview == path.mean_delays == (pytest.approx(0.02 + 0.155), 0.02)
    assert through(model, thrusters).mean_delays == (pytest.approx(0.155), 0.0)
    assert through(model, CLOCKED).mean_delays == (0.02, 0.02)
    assert through(model, CLOCKED).preview == (0.0, 0.0)


def test_an_ideal_part_before_or_behind_changes_nothing(model):
    assert through(model, IdealWrench(undriven=["roll"])) == IDEAL_PATH
    path = through(model, CLOCKED, Thrusters())
    assert path.then(IDEAL_PATH) == IDEAL_PATH.then(path) == path
