"""Detected and undetected faults of a force sensor, and readings that a working one repeats."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput
from support.scripts import Script
from support.tiny_robots import drill

from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.end_effector import force_in_tip, force_of_tip
from uvms_drake.model.surface.law import check_surface
from uvms_drake.sensing import force_fault_detector as detector
from uvms_drake.sensing.force_sensor import ForceSensor
from uvms_drake.sensing.wrist_sensor import quantised

T = 0.1  # s


def noisy(time):
    """A force that is never the same at two looks."""
    return np.array([20.0, -3.0, 2.0, 0.1, 0.2, 0.3]) + np.sin(np.arange(1, 7) * 37.0 * time)


def turning(time):
    """Of the drill: it rolls, pitches and yaws; its tip is at the vehicle's origin."""
    return np.array([0.0, 0.0, 0.0, 0.3 * time, 0.2 * time, -0.1 * time, *np.zeros(8)])


def passed(force, state=turning, until=3.0, model=None, start=0.0, **options):
    """Returns instants and values of a reader with the period of the detector."""
    builder = DiagramBuilder()
    script = builder.AddSystem(Script(force=force, state=state))
    watch = detector.ForceFaultDetector.AddToBuilder(
        builder, model or drill(), T, **options, name="detector",
        state=script.GetOutputPort("state"), force_measured=script.GetOutputPort("force"))
    logs = [LogVectorOutput(watch.get_output_port(i), builder, T) for i in range(2)]
    simulator = Simulator(builder.Build())
    simulator.get_mutable_context().SetTime(start)
    simulator.AdvanceTo(start + until)
    found, reason = (log.FindLog(simulator.get_context()) for log in logs)
    valid = reason.data()[0] == detector.ForceStatus.VALID
    np.testing.assert_array_equal(valid, np.all(np.isfinite(found.data()), axis=0))
    return found.sample_times(), found.data().T, reason.data()[0]


def test_it_counts_how_often_in_a_row_all_components_are_the_same():
    """In each of the two frames; one component that differs is another reading."""
    looks = detector.RepeatCount(np.full((2, 2), np.nan), np.zeros(2))
    for wrench, times in (([[1, 2], [3, 4]], [1, 1]), ([[1, 2], [3, 5]], [2, 1]),
                          ([[np.nan, 2], [3, 5]], [2, 1]), ([[1, 2], [3, 5]], [3, 2]),
                          ([[1, 9], [4, 5]], [1, 1])):
        looks = detector.counted(looks, np.array(wrench, dtype=float))
        np.testing.assert_array_equal(looks.times, times)
    np.testing.assert_array_equal(looks.last, [[1, 9], [4, 5]])


@pytest.mark.parametrize("component", range(6))
@pytest.mark.parametrize("axes", ["world", "tip"])
def test_readings_that_repeat_one_component_or_five_are_readings(axes, component):
    """As an adversary within the bounds of the noise can make them, and a coarse sensor does."""
    for others in (False, True):
        def repeated(time, others=others):
            same = np.arange(6) == component
            wrench = np.where(same ^ others, noisy(0.0), noisy(time))
            return wrench if axes == "world" else force_of_tip(turning(time)[:6], wrench)

        _, _, reason = passed(repeated)
        assert np.all(reason == detector.ForceStatus.VALID)


def frozen_in(axes):
    """From 1 s to 2 s the wrench is that of 1 s, in Σ_I or in the axes of the tip."""
    def force(time):
        if not 1.0 <= time < 2.0:
            return noisy(time)
        if axes == "world":
            return noisy(1.0)
        return force_of_tip(turning(time)[:6], force_in_tip(turning(1.0)[:6], noisy(1.0)))

    return force


@pytest.mark.parametrize("repeats", [2, 3, 5])
@pytest.mark.parametrize("axes", ["world", "tip"])
def test_of_a_sensor_that_froze_as_many_readings_pass_as_is_said(axes, repeats):
    """m, at 1 s to 1 s + (m − 1)T; and when it works again, one period later it is valid."""
    times, found, reason = passed(frozen_in(axes), repeats=repeats)
    none = reason == detector.ForceStatus.FROZEN
    assert not np.any(np.isnan(found[~none]))
    np.testing.assert_array_equal(
        none, (times > 1.0 + (repeats - 0.5) * T) & (times < 2.0 + 0.5 * T))


def test_a_sensor_that_froze_is_seen_where_the_angles_are_about_a_task(uvms, plane):
    model = ContactModel(uvms, check_surface(plane), np.array([0.3, -0.9, 0.5]))

    def state(time):
        return np.concatenate([turning(time)[:6], np.zeros(14)])

    def frozen(time):
        """𝔉 with Aᵀ𝔉 constant; its angles are those of the task."""
        A_E = model.kinematics(state(time)[:10]).A_E
        return np.linalg.solve(A_E.T, noisy(1.0))

    _, found, _ = passed(frozen, state, 1.0, model, repeats=3)
    assert np.all(np.isnan(found[3:]))


def test_a_force_at_the_declared_end_is_none_at_once_whatever_its_axes():
    def rising(time):
        return 40.0 * time * np.array([0.0, 0.6, 0.8, 0.0, 0.0, 0.0]) + 1e-3 * noisy(time)

    times, _, reason = passed(rising, largest=60.0)
    too_large = np.linalg.norm([rising(time)[:3] for time in times], axis=1) >= 60.0
    np.testing.assert_array_equal(reason == detector.ForceStatus.SATURATED, too_large)
    assert 10 < np.count_nonzero(too_large) < 20


@pytest.mark.parametrize("start", [0.0, 10.0])
def test_zeros_during_the_tare_are_readings_and_later_ones_are_not(start):
    """The tare begins when the simulation does, as that of the sensor."""
    def tared(time):
        return noisy(time) if 1.0 < time - start < 2.0 else np.zeros(6)

    times, found, _ = passed(tared, tare=1.0, start=start)
    np.testing.assert_array_equal(np.isnan(found[:, 0]), times - start > 2.0 + 2.5 * T)


def test_a_tare_that_a_lost_state_prolongs_is_longer_for_the_detector_too():
    """The sensor takes no sample in the meantime, and reads zero for as much longer."""
    def tared(time):
        return np.zeros(6) if time < 1.4 else noisy(time)

    def lost(time):
        return turning(time) + np.where(0.5 < time < 0.9, np.nan, 0.0)

    _, _, reason = passed(tared, lost, tare=1.0)
    assert not np.any(reason == detector.ForceStatus.FROZEN)
    _, _, reason = passed(tared, tare=1.0)
    assert np.any(reason == detector.ForceStatus.FROZEN)


def test_a_clone_goes_on_as_the_run_does():
    builder = DiagramBuilder()
    script = builder.AddSystem(Script(force=frozen_in("world"), state=turning))
    watch = detector.ForceFaultDetector.AddToBuilder(
        builder, drill(), T, state=script.GetOutputPort("state"),
        force_measured=script.GetOutputPort("force"))
    diagram = builder.Build()
    simulator = Simulator(diagram)
    simulator.AdvanceTo(1.15)
    clone = Simulator(diagram, simulator.get_context().Clone())
    for time, none in ((1.18, False), (1.25, True), (1.95, True), (2.05, False)):
        for each in (simulator, clone):
            each.AdvanceTo(time)
            found = watch.GetOutputPort("force_valid").Eval(
                watch.GetMyContextFromRoot(each.get_context()))
            assert np.isnan(found[0]) == none


SIGMA = np.array([0.25, 0.25, 0.25, 0.005, 0.005, 0.005])


def repeats(sigma, multiple, resolution, force, count=20_000):
    """Returns whether each of `count` drawn readings of a constant force repeats the last one."""
    unit = np.random.default_rng(4).standard_normal((count, 6))
    noise = sigma * np.clip(unit, -multiple, multiple)
    readings = quantised(force + noise, resolution)
    return np.all(readings[1:] == readings[:-1], axis=1)


@pytest.mark.parametrize("share", [0.0, 0.3, 0.5])
@pytest.mark.parametrize(("multiple", "step"), [(3.0, 4.0), (3.0, 2.5), (1.5, 1.6), (1.0, 0.9)])
def test_no_force_makes_drawn_readings_repeat_more_often_than_computed(multiple, step, share):
    """Wherever the force is between two steps; σ and r of three components are as given."""
    r = step * SIGMA
    bound = detector.repeat_probability(SIGMA, multiple, r)
    found = np.mean(repeats(SIGMA, multiple, r, share * r))
    assert found <= bound + 4.0 * np.sqrt(bound / 20_000)


@pytest.mark.parametrize("force_step", [0.01, 0.0625, 0.2, 0.5])
def test_no_run_of_a_working_sensor_is_that_of_a_frozen_one(force_step):
    """Of the shipped noise, and steps of the torque alike: the longest drawn run is shorter."""
    r = force_step / 0.25 * SIGMA
    frozen = detector.run_of_frozen(detector.repeat_probability(SIGMA, 3.0, r))
    same = repeats(SIGMA, 3.0, r, 0.5 * r)
    ends = np.flatnonzero(np.append(~same, True))
    longest = np.max(np.diff(ends, prepend=-1))
    assert longest < frozen <= 11


def test_a_sensor_that_is_as_quiet_as_a_frozen_one_has_no_such_run():
    """Without noise, or with a resolution that hides all of it; one noisy component is enough."""
    assert detector.run_of_frozen(detector.repeat_probability(np.zeros(6), 3.0, np.zeros(6))) == 0
    assert detector.run_of_frozen(detector.repeat_probability(SIGMA, 3.0, 6.0 * SIGMA)) == 0
    one = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.005])
    assert detector.run_of_frozen(detector.repeat_probability(one, 3.0, np.zeros(6))) == 5
    quiet = ForceSensor(noise=np.zeros(6)).reading(30.0, 0.5)
    assert quiet.repeated == 1.0
