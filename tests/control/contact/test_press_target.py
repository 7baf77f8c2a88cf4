"""Tests of `control.contact.press_target`: the law alone, and with safe region and stiffness."""

import numpy as np
import pytest
from support.pressing import (
    FORCE_MAX,
    NOISE,
    Walls,
    pressed,
    random_errors,
    random_walls_in_line,
)

from uvms_drake.control.contact.contact_state import EstimatorSettings
from uvms_drake.control.contact.press_target import (
    SEARCH_DEPTH,
    PressTarget,
    retreat_depth,
    search_speed,
    target_depth,
    touch_to_plan,
)

NOWHERE = np.nan
SENSING = EstimatorSettings(force_max=45.0, noise=4.2, window=0.11)


def aimed(force, slope, *, x=0.5, desired=20.0):
    return target_depth(desired, np.array([x, force]), True, slope, 0.49, 0.6)


@pytest.mark.parametrize("ratio", [0.1, 0.5, 1.0, 1.5, 1.9])
@pytest.mark.parametrize("step", [np.inf, 1e-3])
def test_the_error_shrinks_by_one_minus_the_ratio_of_the_slopes(ratio, step):
    estimate, kappa, x = 2000.0, 2000.0 * ratio, 0.0
    for _ in range(150):
        error = 20.0 - kappa * x
        x_next = x + np.clip(aimed(kappa * x, estimate, x=x) - x, -step, step)
        after = 20.0 - kappa * x_next
        if abs(error) / estimate <= step:
            assert after == pytest.approx((1.0 - ratio) * error, abs=1e-9)
        assert abs(after) <= abs(error) + 1e-9
        assert ratio > 1.0 or after * error >= -1e-9
        x = x_next
    assert abs(20.0 - kappa * x) < 0.1


def test_a_reading_that_is_too_large_leaves_an_error():
    """One that is off by n, and a tip that is off by ε: one step on a straight wall."""
    estimate, kappa, n, off, x = 2000.0, 1500.0, 0.7, 2e-4, 3e-3
    error = 20.0 - kappa * x
    reached = aimed(kappa * x + n, estimate, x=x) + off
    assert 20.0 - kappa * reached == pytest.approx(
        (1.0 - kappa / estimate) * error + kappa / estimate * n - kappa * off)


def test_from_twice_the_estimate_on_it_does_not_shrink():
    x = 0.001
    for _ in range(10):
        x = aimed(4000.0 * x, 2000.0, x=x)
    assert abs(20.0 - 4000.0 * x) == pytest.approx(20.0 - 4.0)


@pytest.mark.parametrize(("ratio", "claimed"), [(1.0, True), (0.5, True), (1.0 / 0.6, False)])
def test_what_remains_of_noise_and_tube(ratio, claimed):
    """The worst of both at each step. Where κ̂ is below κ, ν + κE_n is left, and far."""
    estimate, kappa, nu, E = 1000.0, 1000.0 * ratio, 1.0, 1e-3
    error, side = 0.0, 1.0
    for _ in range(400):
        side = np.sign(1.0 - ratio) * side if ratio != 1.0 else 1.0
        error = (1.0 - ratio) * error + side * (ratio * nu + kappa * E)
    bound = (ratio * nu + kappa * E) / (1.0 - abs(1.0 - ratio))
    assert abs(error) == pytest.approx(bound)
    assert (bound <= nu + estimate * E + 1e-9) == claimed
    assert claimed or bound == pytest.approx(5.0 * nu + 3.0 * kappa * E)


def test_it_searches_beyond_the_safe_region_until_there_is_a_wall():
    found = target_depth(20.0, np.array([0.2, 0.0]), False, 2000.0, NOWHERE, 0.25)
    assert found == pytest.approx(0.25 + SEARCH_DEPTH)


def test_off_its_place_it_searches_no_deeper():
    """After a touch it presses as anywhere else."""
    for lateral_error, begins, expected in (
            (0.06, NOWHERE, 0.2), (0.04, NOWHERE, 0.35), (0.06, 0.5, 0.51)):
        found = target_depth(
            20.0, np.array([0.2, 0.0]), False, 2000.0, begins, 0.25, lateral_error=lateral_error)
        assert found == pytest.approx(expected)


def test_a_small_force_searches_with_a_limited_lead():
    """At that speed the stiffest wall is pressed with twice the force until a plan knows of it."""
    delay, stiffness, lag = touch_to_plan(0.2, 0, SENSING), 1000.0, 0.4
    assert delay == pytest.approx(0.2 + 0.11 + 3 * 0.01)
    assert touch_to_plan(0.2, 2, SENSING) == pytest.approx(delay + 0.4)
    speed = search_speed(6.0, stiffness, delay)
    assert stiffness * speed * delay == pytest.approx(2.0 * 6.0)
    for force, search_lead, expected in (
            (6.0, lag * speed / 6.0, 0.2 + lag * speed), (6.0, 1.0, 0.25 + SEARCH_DEPTH),
            (0.0, 1e-4, 0.25 + SEARCH_DEPTH)):
        found = target_depth(
            force, np.array([0.2, 0.0]), False, stiffness, NOWHERE, 0.25, search_lead=search_lead)
        assert found == pytest.approx(expected)


def test_it_comes_back_to_a_wall_that_it_has_left_and_follows_one_that_yields():
    for x, expected in ((0.3, 0.51), (0.505, 0.515)):
        found = target_depth(20.0, np.array([x, 0.3]), False, 2000.0, 0.5, 0.6)
        assert found == pytest.approx(expected)


@pytest.mark.parametrize(("deepest", "depth"), [
    (np.inf, 0.6), (-np.inf, 0.6), (np.nan, 0.6), (-1e12, -1e12), (0.55, 0.55), (0.7, 0.6)])
def test_a_largest_depth_that_is_not_finite_is_none(deepest, depth):
    target = PressTarget(np.array([1.0, 0.0, 0.0]), np.zeros(3))
    context = target.CreateDefaultContext()
    for name, value in (("desired_force", [20.0]), ("reading", [0.5, 0.0, 0.0, 10.0]),
                        ("touched", [1.0]), ("stiffness_used", [100.0]), ("tilt", np.zeros(3)),
                        ("contact_depth", [0.4]), ("safe_depth", [0.9]), ("force_lost", [0.0]),
                        ("deepest", [deepest])):
        target.GetInputPort(name).FixValue(context, value)
    found = target.GetOutputPort("target").Eval(context)
    np.testing.assert_allclose(found, [depth, 0.0, 0.0])


def test_without_readings_it_retreats_from_the_wall_or_from_the_last_reading():
    for x, begins, expected in ((0.5, 0.49, 0.44), (0.3, 0.49, 0.25), (0.5, NOWHERE, 0.45)):
        found = retreat_depth(np.array([x, 20.0]), begins)
        assert found == pytest.approx(expected)


@pytest.mark.parametrize(("stiffness", "furthest", "duration"), [
    (800.0, 0.4, 12.0), pytest.param(2000.0, 0.25, 13.0, marks=pytest.mark.slow),
    pytest.param(6000.0, 0.08, 14.0, marks=pytest.mark.slow), (20000.0, 0.04, 14.0)])
def test_it_presses_on_any_wall_without_ever_pressing_too_hard(stiffness, furthest, duration):
    """Fifty walls each: place, slopes, damping, noise, error of the tip, desired force, all random.

    Every plan can stop within the safe region, the static force never exceeds its limit, and 5 s
    after the touch it is within ν + κ₊E of the desired one for good, but for a twentieth.
    """
    rng, count = np.random.default_rng(int(stiffness)), 50
    margin = 0.1 * FORCE_MAX / stiffness
    result = pressed(stiffness, random_walls_in_line(stiffness, count, rng, furthest),
                     rng.uniform(10.0, 25.0, count), random_errors(margin, count, rng),
                     lambda time: rng.uniform(-NOISE, NOISE, count),
                     duration=duration, margin=margin)
    assert np.min(result["slack"]) > -1e-9
    assert np.max(result["share"]) <= 1.0
    assert np.max(result["first"]) < duration - 5.0
    assert np.max(result["settled"]) < 5.0


def stiffest(stiffness, count):
    """Walls of the largest slope, a tenth of the motion in a period apart."""
    kappa = np.full(count, stiffness)
    return Walls(0.1 + 2e-4 * np.arange(count), kappa, kappa, np.zeros(count), np.zeros(count))


def test_the_limit_of_the_force_is_reached_by_an_adversary():
    """The stiffest wall, a sensor that shows too little, and a tip that leaps forward at the end.

    The desired force is above the limit, so the safe region alone stops the tip.
    """
    stiffness, count, margin = 2000.0, 20, 2.4e-3
    result = pressed(
        stiffness, stiffest(stiffness, count), FORCE_MAX + 20.0,
        lambda time, touched: (np.where(time < 14.0, -margin, margin) + 0.0 * touched, 0.0),
        lambda time: -NOISE, duration=15.0, margin=margin)
    assert 0.97 < np.max(result["share"]) <= 1.0 + 1e-9
    assert np.min(result["slack"]) > -1e-9
