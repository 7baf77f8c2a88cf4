"""Tests of `control.contact.press_target`: the law alone, and with safe region and stiffness."""

from dataclasses import dataclass

import numpy as np
import pytest

from uvms_drake.control.contact.contact_state import EstimatorSettings
from uvms_drake.control.contact.press_target import (
    SEARCH_DEPTH,
    PressTarget,
    retreat_depth,
    search_speed,
    target_depth,
    touch_to_plan,
)
from uvms_drake.control.contact.safe_region import apex, dominates, safe_depth
from uvms_drake.control.contact.stiffness_estimate import (
    NO_ESTIMATE,
    StiffnessEstimate,
    stiffness_used,
    surface_depth,
    with_reading,
)
from uvms_drake.model.surface.surface_class import SurfaceClass

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


@pytest.mark.parametrize(("tip", "begins", "safe", "lateral", "expected"), [
    ((0.2, 0.0), NOWHERE, 0.25, 0.0, 0.25 + SEARCH_DEPTH),  # It searches beyond the safe region;
    ((0.2, 0.0), NOWHERE, 0.25, 0.06, 0.2),  # off its place no deeper;
    ((0.2, 0.0), NOWHERE, 0.25, 0.04, 0.35),
    ((0.2, 0.0), 0.5, 0.25, 0.06, 0.51),  # and after a touch it presses as anywhere else.
    ((0.3, 0.3), 0.5, 0.6, 0.0, 0.51),  # It comes back to a wall that it has left,
    ((0.505, 0.3), 0.5, 0.6, 0.0, 0.515)])  # and follows one that yields.
def test_where_it_aims_without_touch(tip, begins, safe, lateral, expected):
    assert target_depth(20.0, np.array(tip), False, 2000.0, begins, safe,
                        lateral_error=lateral) == pytest.approx(expected)


def test_a_small_force_searches_with_a_limited_lead():
    """At that speed the stiffest wall is pressed with twice the force until a plan knows of it."""
    delay, stiffness, lag = touch_to_plan(0.2, 0, SENSING), 1000.0, 0.4
    assert delay == pytest.approx(0.2 + 0.11 + 3 * 0.01)
    assert touch_to_plan(0.2, 2, SENSING) == pytest.approx(delay + 0.4)
    speed = search_speed(6.0, stiffness, delay)
    assert stiffness * speed * delay == pytest.approx(2.0 * 6.0)
    for force, search_lead, expected in (
            (6.0, lag * speed / 6.0, 0.2 + lag * speed), (6.0, 1.0, 0.25 + SEARCH_DEPTH),
            (0.0, 1e-4, 0.2), (np.nan, 1e-4, 0.2), (0.0, np.inf, 0.25 + SEARCH_DEPTH)):
        found = target_depth(
            force, np.array([0.2, 0.0]), False, stiffness, NOWHERE, 0.25, search_lead=search_lead)
        assert found == pytest.approx(expected)


@pytest.mark.parametrize(("deepest", "depth"), [
    (np.inf, 0.6), (-np.inf, 0.6), (np.nan, 0.6), (-1e12, -1e12), (0.55, 0.55), (0.7, 0.6)])
def test_a_largest_depth_that_is_not_finite_is_none(deepest, depth):
    target = PressTarget(np.array([1.0, 0.0, 0.0]), np.zeros(3))
    context = target.CreateDefaultContext()
    for name, value in (("desired_force", [20.0]), ("reading", [0.5, 0.0, 0.0, 0.0]),
                        ("mean_reading", [0.5, 0.0, 0.0, 10.0]), ("touched", [1.0]),
                        ("stiffness_used", [100.0]), ("tilt", np.zeros(3)),
                        ("contact_depth", [0.4]), ("safe_depth", [0.9]), ("force_lost", [0.0]),
                        ("deepest", [deepest])):
        target.GetInputPort(name).FixValue(context, value)
    for port, expected in (
            ("target", depth), ("unclipped_target", 0.6), ("target_of_reading", 0.7)):
        found = target.GetOutputPort(port).Eval(context)
        np.testing.assert_allclose(found, [expected, 0.0, 0.0])


def test_without_readings_it_retreats_from_the_wall_or_from_the_last_reading():
    for x, begins, expected in ((0.5, 0.49, 0.44), (0.3, 0.49, 0.25), (0.5, NOWHERE, 0.45)):
        found = retreat_depth(np.array([x, 20.0]), begins)
        assert found == pytest.approx(expected)


@pytest.mark.parametrize(("stiffness", "furthest", "duration"), [
    (800.0, 0.4, 12.0), pytest.param(2000.0, 0.25, 13.0, marks=pytest.mark.long),
    pytest.param(6000.0, 0.08, 14.0, marks=pytest.mark.long), (20000.0, 0.04, 14.0)])
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


# Simulated presses on many one-dimensional walls at once, with a planner of three lines -----------


STEP, ACCELERATION, CRUISE = 0.2, 0.2, 0.3
"""h [s], a [m/s²], and the largest speed [m/s]."""
FORCE_MAX, NOISE, MEMORY = 45.0, 0.5, 10.0
"""F_max, ν and the slope's memory [N]."""
SLACK = 1.05
"""Largest final error over ν + κ₊E, above 1 as the slope may be estimated too low."""
PERIOD = 0.02
"""Period of the sensor, and of the simulation [s]."""
ALONG = np.array([1.0, 0.0, 0.0])


@dataclass
class Walls:
    """Walls at `place` [m]: slope `soft` to the depth `knee` and `stiff` from there on, damped."""

    place: np.ndarray
    soft: np.ndarray
    stiff: np.ndarray
    knee: np.ndarray
    damping: np.ndarray

    def static(self, x):
        deep = x - self.place
        return (self.soft * np.clip(deep, 0.0, self.knee)
                + self.stiff * np.maximum(deep - self.knee, 0.0))


def random_walls_in_line(stiffness, count, rng, furthest, dissipation=2.5):
    """Half of them straight, half of two slopes; each at 0.1 to 1 times the largest."""
    share = rng.uniform(0.1, 1.0, (2, count))
    share[1] = np.where(np.arange(count) % 2, share[1], share[0])
    soft, stiff = stiffness * share
    return Walls(rng.uniform(0.02, furthest, count), soft, stiff,
                 rng.uniform(3.0, 20.0, count) / soft, rng.uniform(0.0, dissipation, count))


def stop(speed):
    """Returns the stopping distance from a speed at a knot: v²/(2a), interpolated between ah."""
    quanta = np.arange(12) * ACCELERATION * STEP
    return np.interp(speed, quanta, quanta**2 / (2.0 * ACCELERATION))


def end(x, v, w):
    """Returns the end of a plan with the speeds v and w at its first knots that then stops."""
    return x + 0.5 * STEP * (v + w) + np.sign(w) * stop(np.abs(w))


def next_speed(x, v, bound, cap):
    """Returns the largest next speed from which a plan ends at the bound, by bisection."""
    change = ACCELERATION * STEP
    low, high = v - change, np.clip(cap, v - change, v + change)
    least = low
    for _ in range(40):
        middle = 0.5 * (low + high)
        fits = end(x, v, middle) <= bound
        low, high = np.where(fits, middle, low), np.where(fits, high, middle)
    return np.where(end(x, v, high) <= bound, high, np.maximum(low, least))


def pressed(stiffness, walls, desired, error, noise, *, duration, margin):
    """Returns the metrics of a press, one entry for each wall.

    Args:
        stiffness: κ₊ [N/m].
        walls: The walls.
        desired: F_des [N].
        error: Function of the time and of whether the wall was touched yet: e and its rate.
        noise: Function of the time: error of the reading [N].
        duration: Of the simulation [s].
        margin: E [m].
    """
    surface = SurfaceClass(ALONG, stiffness, dissipation=2.5)
    count = len(walls.place)
    x, v, a, begun = np.zeros((4, count))
    tip = np.full((count, 3), np.nan)
    belief = StiffnessEstimate(*(
        np.broadcast_to(part, (count, *part.shape)) for part in NO_ESTIMATE))
    first, late, largest = np.full(count, np.nan), np.zeros(count), np.zeros(count)
    slack, was_touched = np.full(count, np.inf), np.zeros(count, dtype=bool)
    for time in PERIOD * np.arange(round(duration / PERIOD)):
        # The world.
        t = time - begun
        x_now, v_now = x + v * t + 0.5 * a * t**2, v + a * t
        e, e_rate = error(time, ~np.isnan(first))
        real, rate = x_now + e, v_now + e_rate
        static = walls.static(real)
        force = static * np.maximum(1.0 + walls.damping * rate, 0.0) + noise(time)
        # The contact estimator.
        at, moving = real[:, None, None] * ALONG, rate[:, None, None] * ALONG
        new = apex(surface, at, moving, force[:, None] * ALONG, FORCE_MAX, NOISE)
        tip = np.where(dominates(surface, new, tip, np.zeros((2, 2)))[:, None], new, tip)
        safe = safe_depth(surface, tip, at[:, 0], margin)
        touched = np.abs(force) > NOISE
        belief = with_reading(
            belief, surface, at[:, 0], force, touched, NOISE, MEMORY, PERIOD)
        kappa = stiffness_used(belief, surface)
        target = target_depth(desired, np.array([real, force]), touched, kappa,
                              surface_depth(belief, surface, at[:, 0]), safe)
        # The plan: at its own instants, and when a wall is touched.
        again = (t >= STEP - 1e-9) | (touched & ~was_touched) | (time == 0.0)
        first = np.where(touched & np.isnan(first), time, first)
        was_touched = touched
        w = next_speed(x_now, v_now, np.minimum(target, safe), CRUISE)
        left = safe - end(x_now, v_now, w)
        slack = np.where(again & (w > 0.0), np.minimum(slack, left), slack)
        x, v = np.where(again, x_now, x), np.where(again, v_now, v)
        a, begun = np.where(again, (w - v_now) / STEP, a), np.where(again, time, begun)
        # The metrics.
        largest = np.maximum(largest, static)
        off = np.abs(static - desired) > SLACK * (NOISE + stiffness * margin)
        late = np.where(off, time, late)
    return {"share": largest / FORCE_MAX, "slack": slack, "first": first, "settled": late - first,
            "stiffness_used": kappa}


def random_errors(margin, count, rng):
    """Errors within ± E: sines, and sines cut off hard; of 2 to 20 s."""
    rate, phase = rng.uniform(0.3, 3.0, count), rng.uniform(0.0, 2.0 * np.pi, count)
    gain = np.where(rng.random(count) < 0.3, 3.0, 1.0)

    def error(time, touched):
        wave = gain * np.sin(rate * time + phase)
        slope = np.where(np.abs(wave) < 1.0, gain * rate * np.cos(rate * time + phase), 0.0)
        return margin * np.clip(wave, -1.0, 1.0), margin * slope

    return error
