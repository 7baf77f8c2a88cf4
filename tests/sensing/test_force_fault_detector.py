"""Tests of `sensing.force_fault_detector`: detected and undetected faults."""

import numpy as np
import pytest
from pydrake.math import RollPitchYaw
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput
from support.scripts import Script
from support.tiny_robots import drill

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.surface.law import check_surface
from uvms_drake.sensing.force_fault_detector import ForceFaultDetector, RepeatCount, counted

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
    watch = ForceFaultDetector.AddToBuilder(
        builder, model or drill(), T, state=script.GetOutputPort("state"),
        force_measured=script.GetOutputPort("force"), **options)
    log = LogVectorOutput(watch.get_output_port(), builder, T)
    simulator = Simulator(builder.Build())
    simulator.get_mutable_context().SetTime(start)
    simulator.AdvanceTo(start + until)
    found = log.FindLog(simulator.get_context())
    return found.sample_times(), found.data().T


def test_it_counts_how_often_in_a_row_each_component_is_the_same():
    looks = RepeatCount(np.full(2, np.nan), np.zeros(2))
    for force, times in (([1.0, 2.0], [1, 1]), ([1.0, 3.0], [2, 1]), ([np.nan, 3.0], [2, 1]),
                         ([1.0, 4.0], [3, 1]), ([1.1, 4.0], [1, 2])):
        looks = counted(looks, np.array(force))
        np.testing.assert_array_equal(looks.times, times)
    np.testing.assert_array_equal(looks.last, [1.1, 4.0])


def test_a_force_with_noise_passes_as_it_is():
    times, found = passed(noisy)
    np.testing.assert_array_equal(found, [noisy(time) for time in times])


def frozen_in(axes):
    """From 1 s to 2 s the force is that of 1 s, in Σ_I or in the axes of the tip."""
    def force(time):
        if not 1.0 <= time < 2.0:
            return noisy(time)
        if axes == "world":
            return noisy(1.0)
        R_W1, R_WE = (RollPitchYaw(turning(t)[3:6]).ToRotationMatrix() for t in (1.0, time))
        return np.concatenate([R_WE @ (R_W1.inverse() @ noisy(1.0)[:3]), noisy(1.0)[3:]])

    return force


@pytest.mark.parametrize("repeats", [2, 3, 5])
@pytest.mark.parametrize("axes", ["world", "tip"])
def test_of_a_sensor_that_froze_as_many_readings_pass_as_is_said(axes, repeats):
    """m, at 1 s to 1 s + (m − 1)T; and when it works again, one period later it is valid."""
    times, found = passed(frozen_in(axes), repeats=repeats)
    none = np.all(np.isnan(found), axis=1)
    assert not np.any(np.isnan(found[~none]))
    np.testing.assert_array_equal(
        none, (times > 1.0 + (repeats - 0.5) * T) & (times < 2.0 + 0.5 * T))


def test_a_sensor_that_froze_is_seen_where_the_angles_are_about_a_task(uvms, plane):
    model = ContactModel(uvms, check_surface(plane), np.array([0.3, -0.9, 0.5]))
    attitude = model.kinematics(np.zeros(model.size)).A_E[:3, :3]  # The tip's in the vehicle.

    def state(time):
        return np.concatenate([turning(time)[:6], np.zeros(14)])

    def frozen(time):
        R_WE = RollPitchYaw(turning(time)[3:6]).ToRotationMatrix().matrix() @ attitude
        return np.concatenate([R_WE @ noisy(1.0)[:3], noisy(time)[3:]])

    _, found = passed(frozen, state, 1.0, model, repeats=3)
    assert np.all(np.isnan(found[3:]))


def test_a_component_at_the_end_of_an_undeclared_range_is_detected():
    def cut(time):
        return np.clip(noisy(time) + np.array([10.0 * (time > 1.0), *np.zeros(5)]), -25.0, 25.0)

    times, found = passed(cut)
    none = np.isnan(found[:, 0])
    assert not np.any(none[times < 1.05 + 2 * T])
    assert np.all(none[times > 1.05 + 3 * T])


def test_a_force_at_the_declared_end_is_none_at_once_whatever_its_axes():
    def rising(time):
        return 40.0 * time * np.array([0.0, 0.6, 0.8, 0.0, 0.0, 0.0]) + 1e-3 * noisy(time)

    times, found = passed(rising, largest=60.0)
    too_large = np.linalg.norm([rising(time)[:3] for time in times], axis=1) >= 60.0
    np.testing.assert_array_equal(np.isnan(found[:, 0]), too_large)
    assert 10 < np.count_nonzero(too_large) < 20


@pytest.mark.parametrize("start", [0.0, 10.0])
def test_zeros_during_the_tare_are_readings_and_later_ones_are_not(start):
    """The tare begins when the simulation does, as that of the sensor."""
    def tared(time):
        return noisy(time) if 1.0 < time - start < 2.0 else np.zeros(6)

    times, found = passed(tared, tare=1.0, start=start)
    np.testing.assert_array_equal(np.isnan(found[:, 0]), times - start > 2.0 + 2.5 * T)


def test_without_a_declared_number_nothing_is_detected():
    _, found = passed(lambda time: np.ones(6), repeats=0)
    np.testing.assert_array_equal(found, 1.0)


@pytest.mark.parametrize("lost", ["force", "state"])
def test_a_gap_is_no_look(lost):
    """A frozen sensor that is not seen in between is the same afterwards."""
    def gap(time, of):
        return np.full_like(of, np.nan) if 0.35 < time < 0.75 else of

    times, found = passed(
        (lambda time: gap(time, np.ones(6))) if lost == "force" else (lambda time: np.ones(6)),
        (lambda time: gap(time, turning(time))) if lost == "state" else turning, until=1.5,
        repeats=5)
    none = np.isnan(found[:, 0])
    if lost == "force":
        assert np.all(none[(times > 0.35) & (times < 0.75)])
    assert np.all(none[times > 0.85])
    assert not np.any(none[times < 0.35])


def test_a_clone_goes_on_as_the_run_does():
    builder = DiagramBuilder()
    script = builder.AddSystem(Script(force=frozen_in("world"), state=turning))
    watch = ForceFaultDetector.AddToBuilder(
        builder, drill(), T, state=script.GetOutputPort("state"),
        force_measured=script.GetOutputPort("force"))
    diagram = builder.Build()
    simulator = Simulator(diagram)
    simulator.AdvanceTo(1.15)
    clone = Simulator(diagram, simulator.get_context().Clone())
    for time, none in ((1.18, False), (1.25, True), (1.95, True), (2.05, False)):
        for each in (simulator, clone):
            each.AdvanceTo(time)
            found = watch.get_output_port().Eval(watch.GetMyContextFromRoot(each.get_context()))
            assert np.isnan(found[0]) == none


@pytest.mark.parametrize("bad", [{"repeats": 1}, {"period": 0.0}])
def test_what_has_no_meaning_is_refused(bad):
    with pytest.raises(InvalidParameter, match=next(iter(bad))):
        ForceFaultDetector(drill(), **{"period": T, **bad})
