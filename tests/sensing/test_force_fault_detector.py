"""Tests of `sensing.force_fault_detector`: detected and undetected faults."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput
from support.scripts import Script
from support.tiny_robots import drill

from uvms_drake.common.wiring import added
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.end_effector import force_in_tip, force_of_tip
from uvms_drake.model.surface.law import check_surface
from uvms_drake.sensing.force_fault_detector import (
    ForceFaultDetector,
    ForceStatus,
    RepeatCount,
    counted,
)

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
    watch = added(
        builder, "force_fault_detector", ForceFaultDetector(model or drill(), T, **options),
        state=script.GetOutputPort("state"), force_measured=script.GetOutputPort("force"))
    logs = [LogVectorOutput(watch.get_output_port(i), builder, T) for i in range(2)]
    simulator = Simulator(builder.Build())
    simulator.get_mutable_context().SetTime(start)
    simulator.AdvanceTo(start + until)
    found, reason = (log.FindLog(simulator.get_context()) for log in logs)
    valid = reason.data()[0] == ForceStatus.VALID
    np.testing.assert_array_equal(valid, np.all(np.isfinite(found.data()), axis=0))
    return found.sample_times(), found.data().T, reason.data()[0]


def test_it_counts_how_often_in_a_row_all_components_are_the_same():
    """In each of the two frames; one component that differs is another reading."""
    looks = RepeatCount(np.full((2, 2), np.nan), np.zeros(2))
    for wrench, times in (([[1, 2], [3, 4]], [1, 1]), ([[1, 2], [3, 5]], [2, 1]),
                          ([[np.nan, 2], [3, 5]], [2, 1]), ([[1, 2], [3, 5]], [3, 2]),
                          ([[1, 9], [4, 5]], [1, 1])):
        looks = counted(looks, np.array(wrench, dtype=float))
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
        assert np.all(reason == ForceStatus.VALID)


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
    none = reason == ForceStatus.FROZEN
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
    np.testing.assert_array_equal(reason == ForceStatus.SATURATED, too_large)
    assert 10 < np.count_nonzero(too_large) < 20


@pytest.mark.parametrize("start", [0.0, 10.0])
def test_zeros_during_the_tare_are_readings_and_later_ones_are_not(start):
    """The tare begins when the simulation does, as that of the sensor."""
    def tared(time):
        return noisy(time) if 1.0 < time - start < 2.0 else np.zeros(6)

    times, found, _ = passed(tared, tare=1.0, start=start)
    np.testing.assert_array_equal(np.isnan(found[:, 0]), times - start > 2.0 + 2.5 * T)


def test_a_clone_goes_on_as_the_run_does():
    builder = DiagramBuilder()
    script = builder.AddSystem(Script(force=frozen_in("world"), state=turning))
    watch = added(
        builder, "force_fault_detector", ForceFaultDetector(drill(), T),
        state=script.GetOutputPort("state"), force_measured=script.GetOutputPort("force"))
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
