"""Tests of `uvms_drake.tube.row_gains`, against a simulation of all pulses of a force."""

import numpy as np
import pytest

from uvms_drake.tube.row_gains import Gains, instant_gains, lagged_gains

STEPS = 20
"""Pulses in a period."""


def simulated(k: float, sigma: float, lag: float, period: float, steps: int = STEPS) -> Gains:
    """Returns the sums of the sizes of the responses to a unit force in each of short intervals.

    What the force of signs of these responses does, which no other force of that size exceeds; the
    largest over instants in a period.
    """
    h, time = period / steps, 12.0 / min(k, sigma)
    count = round(time / h)
    fade, slow, kept = np.exp(-k * h), np.exp(-sigma * h), np.exp(-h / lag)
    seen, held, r, e = np.zeros((4, count))
    best = np.zeros(4)
    for i in range(count):
        if i % steps == 0:
            held = seen.copy()
        delta = held.copy()
        delta[i] -= 1.0
        r_next = delta / k + (r - delta / k) * fade
        e = e * slow + (1.0 - slow) / sigma * 0.5 * (r + r_next)
        r, u = r_next, None
        seen *= kept
        seen[i] += 1.0 - kept
        if i >= count - steps:
            u = (k + sigma) * r - sigma**2 * e
            best = np.maximum(best, [np.abs(each).sum() for each in (e, r - sigma * e, u, r)])
    return Gains(*best)


@pytest.mark.parametrize(("k", "sigma", "lag", "period"), [
    (20.0, 5.0, 0.02, 0.01), (50.0, 50.0, 0.02, 0.01), (30.0, 60.0, 0.005, 0.02)])
def test_what_a_sensor_misses_is_what_the_worst_force_does(k, sigma, lag, period):
    found, expected = lagged_gains(k, sigma, lag, period), simulated(k, sigma, lag, period)
    np.testing.assert_allclose(found, expected, rtol=0.03)


@pytest.mark.parametrize(("k", "sigma", "lag", "period"), [
    (50.0, 50.0, 0.005, 0.1), (100.0, 99.0, 0.002, 0.02), (50.0, 50.0, 0.02, 0.01)])
def test_they_are_not_less_at_any_instant_of_a_period(k, sigma, lag, period):
    """Where a sensor is read seldom, the worst instant is between any few that are looked at."""
    found = np.array(lagged_gains(k, sigma, lag, period))
    expected = np.array(simulated(k, sigma, lag, period, steps=160))
    assert np.all(found >= expected * (1.0 - 1e-4))
    assert np.all(found <= 1.25 * expected)


def test_they_are_symmetric_and_in_units_of_time():
    one = lagged_gains(40.0, 10.0, 0.02, 0.01)
    np.testing.assert_allclose(lagged_gains(10.0, 40.0, 0.02, 0.01)[:3], one[:3], rtol=1e-6)
    slower = lagged_gains(20.0, 5.0, 0.04, 0.02)
    np.testing.assert_allclose(slower, np.array(one) * [4.0, 2.0, 1.0, 2.0], rtol=1e-6)


def test_a_late_sensor_misses_all_of_it_and_a_fast_one_little():
    instant = instant_gains(40.0, 10.0)
    late = lagged_gains(40.0, 10.0, 5.0, 0.2)  # It may still say the opposite,
    assert late.position == pytest.approx(2.0 * instant.position, rel=0.1)
    assert late.velocity == pytest.approx(instant.velocity, rel=0.15)  # which does not move it.
    fast = lagged_gains(40.0, 40.0, 2.5e-3, 2.5e-4)
    peak = 2.0 / 40.0 * np.exp(-1.0)  # the variation of the impulse response
    assert fast.position == pytest.approx(2.625e-3 * peak, rel=0.1)
    np.testing.assert_allclose(
        lagged_gains(40.0, 10.0, 0.0, 0.01), 2.0 * np.array(instant), rtol=1e-12)


def test_instant_gains_are_the_norms_of_the_impulse_responses():
    k, sigma, t = 30.0, 7.0, np.linspace(0.0, 3.0, 300_001)
    g = (np.exp(-sigma * t) - np.exp(-k * t)) / (k - sigma)
    rate = (k * np.exp(-k * t) - sigma * np.exp(-sigma * t)) / (k - sigma)
    u = (k**2 * np.exp(-k * t) - sigma**2 * np.exp(-sigma * t)) / (k - sigma)
    for found, response in zip(instant_gains(k, sigma), (g, rate, u, np.exp(-k * t)), strict=True):
        assert found == pytest.approx(np.trapezoid(np.abs(response), t), rel=1e-5)
