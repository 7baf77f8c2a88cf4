"""Tests of `control.contact.contact_estimator`: its state, in and between Contexts."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from support.scripts import Script
from support.tiny_robots import drill

from uvms_drake.common.wiring import outputs, wire
from uvms_drake.control.contact.contact_estimator import ContactEstimator
from uvms_drake.control.contact.contact_state import (
    APART,
    EstimatorSettings,
    initial_contact_state,
    updated_contact_state,
)
from uvms_drake.control.contact.press_target import SEARCH_DEPTH, PressTarget
from uvms_drake.control.contact.stiffness_estimate import (
    NO_ESTIMATE,
    StiffnessEstimate,
    stiffness_used,
)
from uvms_drake.model.surface.surface_class import SurfaceClass

SURFACE = SurfaceClass(np.array([0.0, 1.0, 0.0]), 2000.0)
SENSING = EstimatorSettings(force_max=45.0, noise=1.0, period=0.1)
HERE = np.zeros((2, 2))
"""Extent of the plans: the first place, across n."""
MARGIN = 1e-3
PLACE = np.array([0.03, -5.0, 0.02])
OUTPUTS = ("safe_depth", "apex", "touched", "reading", "stiffness_used", "contact_depth",
           "force_lost")


def depth(time):
    """In, with 5 mm/s, until 4 s; then back as slowly."""
    return 5e-3 * (4.0 - abs(time - 4.0))


def wall(time, kappa=1000.0):
    return kappa * max(depth(time) - 0.01, 0.0)


def state(time, at=depth):
    """Model of the drill, whose tip is at the vehicle's origin; its axes are those of Σ_I."""
    rate = (at(time + 1e-6) - at(time - 1e-6)) / 2e-6
    return np.array([0.0, at(time), *np.zeros(6), rate, *np.zeros(5)])


def force(time, load=wall):
    return np.array([0.0, load(time), 0.0, 0.0, 0.0, 0.0])


def pressing(measured=force, true=state, sensing=SENSING):
    builder = DiagramBuilder()
    script = builder.AddSystem(Script(state=true, force=measured, desired=lambda time: [20.0]))
    estimator = ContactEstimator.AddToBuilder(
        builder, drill(), SURFACE, sensing, margin=MARGIN, state=script.GetOutputPort("state"),
        force_measured=script.GetOutputPort("force"))
    target = PressTarget.AddToBuilder(
        builder, SURFACE.direction, PLACE, desired_force=script.GetOutputPort("desired"))
    wire(builder, target, outputs(estimator))
    return Simulator(builder.Build()), estimator, target


def values(simulator, system, *names):
    context = system.GetMyContextFromRoot(simulator.get_context())
    return [system.GetOutputPort(name).Eval(context) for name in names]


def test_it_keeps_the_deepest_safe_place_and_never_less():
    simulator, estimator, _ = pressing()
    before = -np.inf
    for time in np.arange(1, 78) * 0.1 + 0.05:
        simulator.AdvanceTo(time)
        (safe,), _, (touched,), (_, x, _, load), *_ = values(simulator, estimator, *OUTPUTS)
        assert safe >= before
        sampled = np.floor(time * 10.0 + 1e-6) / 10.0
        assert (x, load) == pytest.approx((depth(sampled), wall(sampled)))
        assert touched == (load > 1.0)
        before = safe
    # The reading at 20 mm, 10 N, allows for 34 N more; one before did no better.
    assert before == pytest.approx(0.02 + 34.0 / 2000.0 - MARGIN)


def test_it_finds_where_the_wall_is_and_how_steep():
    simulator, estimator, target = pressing()
    simulator.AdvanceTo(3.95)
    (slope,), (begins,), (_, x, _, load) = values(
        simulator, estimator, "stiffness_used", "contact_depth", "mean_reading")
    assert 1000.0 <= slope <= 1300.0
    assert begins == pytest.approx(0.01, abs=3e-3)
    assert values(simulator, target, "target")[0] == pytest.approx(
        [0.03, x + (20.0 - load) / slope, 0.02])


def test_before_the_first_update_it_knows_what_it_sees():
    simulator, estimator, target = pressing()
    safe, apex, touched, reading, slope, begins, lost = values(simulator, estimator, *OUTPUTS)
    assert safe == pytest.approx((45.0 - 1.0) / 2000.0 - MARGIN)
    np.testing.assert_allclose(apex, [0.0, 0.022, 0.0])
    assert (touched, *reading, slope, lost) == (*np.zeros(5), 2000.0, 0.0)
    assert np.isnan(begins)
    assert values(simulator, target, "target")[0][1] == pytest.approx(safe + SEARCH_DEPTH)
    target.GetInputPort("place").FixValue(
        target.GetMyMutableContextFromRoot(simulator.get_mutable_context()), [0.03, 7.0, 0.05])
    np.testing.assert_allclose(values(simulator, target, "target")[0], [0.03, 0.0, 0.05])
    np.testing.assert_array_equal(
        estimator.GetMyContextFromRoot(simulator.get_context()).get_discrete_state(2).value(),
        NO_ESTIMATE.state)


def test_a_clone_goes_on_as_the_run_does():
    simulator, estimator, _ = pressing()
    simulator.AdvanceTo(3.0)
    other = Simulator(simulator.get_system(), simulator.get_context().Clone())
    for each in (simulator, other):
        each.AdvanceTo(5.0)
    for one, two in zip(values(simulator, estimator, *OUTPUTS), values(other, estimator, *OUTPUTS),
                        strict=True):
        np.testing.assert_array_equal(one, two)


def test_a_reading_that_is_none_teaches_nothing():
    lost = partial(force, load=lambda time: np.nan if 1.95 < time < 3.95 else wall(time))
    simulator, estimator, target = pressing(lost)
    simulator.AdvanceTo(1.95)
    before = values(simulator, estimator, *OUTPUTS)
    for time, is_lost in ((2.85, 0.0), (2.95, 1.0), (3.5, 1.0)):  # Ten looks from 2.0 s on.
        simulator.AdvanceTo(time)
        *known, (found,) = values(simulator, estimator, *OUTPUTS)
        assert found == is_lost
        for one, two in zip(before, known, strict=False):
            np.testing.assert_array_equal(one, two)
    begins, (_, x, _, _) = values(simulator, estimator, "contact_depth", "reading")
    assert np.isnan(begins)
    np.testing.assert_allclose(values(simulator, target, "target")[0], [0.03, x - 0.05, 0.02])
    simulator.AdvanceTo(4.05)
    assert values(simulator, estimator, "reading")[0] == pytest.approx([0.0, 0.02, 0.0, 10.0])
    assert values(simulator, estimator, "force_lost")[0] == 0.0
    assert values(simulator, target, "target")[0][1] > 0.02


def test_a_wall_that_went_away_is_searched_for_again():
    """Touched, left, and not found where it was: the safe region stays, the stiffness does not."""
    gone = partial(force, load=lambda time: wall(time) if time < 3.0 else 0.0)
    simulator, estimator, target = pressing(gone)
    simulator.AdvanceTo(2.95)
    assert np.isfinite(values(simulator, estimator, "contact_depth")[0])
    simulator.AdvanceTo(4.05)
    safe, begins = values(simulator, estimator, "safe_depth", "contact_depth")
    assert np.isnan(begins)
    assert safe == pytest.approx(0.02 + 44.0 / 2000.0 - MARGIN)
    assert values(simulator, target, "target")[0][1] == pytest.approx(safe + SEARCH_DEPTH)


OLD_READINGS = EstimatorSettings(force_max=45.0, noise=1.0, period=0.1, window=0.3)


def out_and_in(time):
    """25 mm deep, but for 10 mm from 1 s to 1.35 s."""
    return 0.01 if 1.0 < time < 1.35 else 0.025


@pytest.mark.parametrize("lost", ["state", "force"])
def test_what_was_not_measured_is_not_taken_for_a_place_without_force(lost):
    """A reading delayed by 0.3 s belongs to a place at which the tip was in a gap."""
    def delayed(time):
        gap = lost == "force" and 1.05 < time < 1.35
        return force(time, lambda t: np.nan if gap else 2000.0 * (out_and_in(t - 0.3) - 0.01))

    def seen(time):
        gap = lost == "state" and 1.05 < time < 1.35
        return np.full(14, np.nan) if gap else np.array([0.0, out_and_in(time), *np.zeros(12)])

    simulator, estimator, _ = pressing(delayed, seen, OLD_READINGS)
    for time in np.arange(1, 20) * 0.1 + 0.05:
        simulator.AdvanceTo(time)
        apex, = values(simulator, estimator, "apex")
        assert 2000.0 * (apex[1] - 0.01) <= 45.0 + 1e-9
    # Of the latest readings only ν is given away.
    assert 2000.0 * (apex[1] - 0.01) == pytest.approx(44.0)


@pytest.mark.parametrize(("kernel", "reached"), [
    ([1.0, 0.0, 0.0, 0.0], 44.0), ([0.25, 0.25, 0.25, 0.25], 35.0)])
def test_an_old_reading_is_not_taken_for_a_new_one(kernel, reached):
    """At a run into the stiffest wall, with a sensor that delays by 0.3 s, or averages over them.

    By the last reading alone, the force there is F_max less ν, and less the 9 N by which the mean
    is above the first of four forces that are 6 N apart.
    """
    speed, known = 0.03, initial_contact_state(OLD_READINGS)
    true = np.maximum(2000.0 * speed * 0.1 * np.arange(-3, 8), 0.0)
    for i in range(8):
        load = np.dot(kernel, true[i: i + 4])
        tip = np.array([0.0, speed * 0.1 * i, 0.0, 0.0, speed, 0.0])
        known = updated_contact_state(
            SURFACE, OLD_READINGS, HERE, known, tip, np.array([0.0, load, 0.0]))
        assert 2000.0 * known.apex[1] <= 45.0 + 1e-9
        if i == 6:
            known = known._replace(apex=np.full(3, np.nan))
    assert 2000.0 * known.apex[1] == pytest.approx(reached)


def test_a_delayed_sensor_makes_no_wall_look_much_softer():
    """A tip that goes in and out, and a force delayed by 0.3 s: a press would converge."""
    known, lowest = initial_contact_state(OLD_READINGS), np.inf
    for time in np.arange(0.0, 30.0, 0.1):
        x, old = 0.02 + 0.01 * np.sin(2.0 * np.array([time, time - 0.3]))
        tip = np.array([0.0, x, 0.0, 0.0, 0.02 * np.cos(2.0 * time), 0.0])
        known = updated_contact_state(
            SURFACE, OLD_READINGS, HERE, known, tip, np.array([0.0, 1000.0 * old, 0.0]))
        lowest = min(lowest, stiffness_used(StiffnessEstimate.of(known.stiffness), SURFACE))
    assert lowest > 600.0


def test_a_tip_that_retreats_too_fast_feels_nothing():
    surface = SurfaceClass(SURFACE.direction, 2000.0, dissipation=2.0)
    tip = np.array([0.0, 0.3, 0.0, 0.0, -0.6, 0.0])
    known = updated_contact_state(
        surface, SENSING, HERE, initial_contact_state(SENSING), tip, np.zeros(3))
    assert np.all(np.isnan(known.apex))
    np.testing.assert_array_equal(known.stiffness, NO_ESTIMATE.state)


def test_a_mean_reading_is_of_the_touches_at_the_place_of_the_last_one():
    """Noise that alternates is gone from it, and so are gaps, other places and older readings."""
    sensing = replace(SENSING, period=0.02)
    count, known = round(sensing.mean / sensing.period), initial_contact_state(sensing)

    def read(known, place, force):
        tip = np.append(place, np.zeros(3))
        return updated_contact_state(
            SURFACE, sensing, HERE, known, tip, np.array([0.0, force, 0.0]))

    near, far = np.array([0.0, 0.03, 0.0]), np.array([0.0, 0.03, 1.1 * APART])
    known = read(known, near, 0.5)
    assert known.mean_reading == pytest.approx([*near, 0.5]), "no touch: the reading itself"
    for i in range(count):
        place, force = (near, 20.0 + (-1.0)**i) if i % 10 < 8 else (far, 9.0)
        known = read(known, place, np.nan if i % 10 == 4 else force)
    known = read(read(known, near, 20.5), near, 19.5)
    recent = known.recent.reshape(-1, 4)
    taken = recent[np.abs(recent[:, 3] - 20.0) < 1.5]
    assert 0.5 * count < len(taken) < count
    assert known.mean_reading == pytest.approx(np.mean(taken, axis=0))
    assert known.mean_reading == pytest.approx([*near, 20.0], abs=0.2), "a tenth of the noise"
    left = near - [0.0, 0.002, 0.0]
    assert read(known, left, 0.3).mean_reading == pytest.approx([*left, 0.3])
    for _ in range(count):
        known = read(known, near, 12.0)
    assert known.mean_reading == pytest.approx([*near, 12.0])
