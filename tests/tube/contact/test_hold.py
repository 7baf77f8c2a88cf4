"""The tube in a hold, against the integral inequality itself and against kernels by hand."""

from dataclasses import replace

import numpy as np
import pytest
from support.force_reading import reading_off

from uvms_drake.tube.contact.hold import SETTLED, HoldLaw, TipBounds, growth_of, settled
from uvms_drake.tube.contact.sensor_error import MeasuredForceBounds
from uvms_drake.tube.row_gains import grown_gains

K, LAG, PERIOD, KAPPA, GAIN = 45.0, 0.02, 0.01, 900.0, 0.2
APPROACH = MeasuredForceBounds(
    size=50.0, rate=KAPPA * 0.15, ripple=0.0, tangential_rate=30.0, tangential_ripple=0.0,
    reading=reading_off(1.5, 0.0, LAG, PERIOD), tool_angle=0.2)
LIMITS, STANDING = np.array([0.15, 0.1, 0.3]), np.array([0.002, 0.001, 0.004])
STEP = 5e-4


def kernels() -> tuple[np.ndarray, np.ndarray]:
    """Returns |g| of e and of ė of a row with k = σ at multiples of STEP, to 1 s."""
    t = np.arange(0.0, 1.0, STEP)
    return t * np.exp(-K * t), np.abs((1.0 - K * t) * np.exp(-K * t))


def bounds(force: MeasuredForceBounds, nu2: float, qdot: float) -> TipBounds:
    """Returns the radii of one row that only delayed forces move, and speeds without contact."""
    position, velocity = (float(np.sum(g)) * STEP for g in kernels())
    error = GAIN * (force.error + (force.rate + force.tangential_rate) * force.age)
    return TipBounds(position * error, position * error, velocity * error, velocity * error,
                     0.01, 0.05)


LAW = HoldLaw(bounds, K, K)


def force(advance: float) -> MeasuredForceBounds:
    return replace(APPROACH, rate=KAPPA * advance, tangential_rate=5.0)


def test_the_worst_speeds_of_the_inequality_decay_as_stated():
    """w(t) = v̄ + ∫|g|GAIN(ε + age of κw + ρ′), with equality, w = w₀ before the plan stands."""
    found = settled(LAW, APPROACH, LIMITS, force, STANDING, tilt=0.0)
    before = 3000
    count = before + int((found.time + 1.0) / STEP)
    w, rate = np.full(count, LIMITS[0]), np.full(count, 5.0)
    rate[:before] = APPROACH.tangential_rate
    depth = np.zeros(count)
    # Ages of a reading: a lag, and a sample that is as old as one may be.
    ages = np.arange(0.0, 0.4, STEP)
    weights = np.where(ages < PERIOD, 1.0, np.exp(-(ages - PERIOD) / LAG)) * STEP
    delta, (g, g_dot) = np.zeros(count), kernels()
    for i in range(before - len(g), count):
        past = slice(i - len(ages), i)
        delta[i] = GAIN * (APPROACH.error + weights[::-1] @ (KAPPA * w[past] + rate[past]))
        if i >= before:
            window = delta[i - len(g) + 1: i + 1][::-1]
            w[i] = STANDING[0] + STEP * (g_dot @ window)
            depth[i] = STEP * (g @ window)
    settled_from = before + round(found.time / STEP)
    assert w[-1] == pytest.approx(found.speeds[0], rel=SETTLED)
    assert np.all(w[settled_from:] <= found.speeds[0] * (1.0 + 1e-3))
    assert np.all(depth[settled_from:] <= found.bounds.depth * (1.0 + 1e-3))
    assert np.max(w[before: before + 20]) > 1.5 * found.speeds[0]  # And not at once.
    assert found.ratio < 1.0 and 0.1 < found.time < 3.0


def test_the_fixed_point_is_that_of_the_linear_equation():
    _, velocity = (float(np.sum(g)) * STEP for g in kernels())
    age = LAG + PERIOD
    slope = velocity * GAIN * KAPPA * age
    start = STANDING[0] + velocity * GAIN * (1.5 + 5.0 * age)
    found = settled(LAW, APPROACH, LIMITS, force, STANDING, tilt=0.0)
    assert 0.01 < slope < 0.5
    assert found.speeds[0] == pytest.approx(start / (1.0 - slope), rel=2.0 * SETTLED)
    assert found.speeds[1:] == pytest.approx([0.011, 0.054], rel=SETTLED)


def test_a_wall_so_stiff_that_speeds_do_not_decay_has_no_hold():
    stiff = replace(APPROACH, rate=2e5 * 0.15)
    found = settled(LAW, stiff, LIMITS, lambda advance: replace(stiff, rate=2e5 * advance),
                    STANDING, tilt=0.0)
    assert found.ratio >= 1.0 and np.isinf(found.time) and np.isinf(found.bounds.depth)


def test_a_kernel_grows_as_its_integral_with_the_weight_does():
    rate, t = 12.0, np.arange(0.0, 2.0, 1e-5)
    first = (np.exp(-40.0 * t) - np.exp(-50.0 * t)) / 10.0
    second = (50.0 * np.exp(-50.0 * t) - 40.0 * np.exp(-40.0 * t)) / 10.0
    expected = [np.sum(np.exp(rate * t) * np.abs(g)) / np.sum(np.abs(g)) for g in (first, second)]
    grown, usual = (grown_gains(50.0, 40.0, each)[:2] for each in (rate, 0.0))
    assert grown / usual == pytest.approx(expected, rel=5e-3)
    # The mean age of a reading: its survival function, integrated with the weight.
    ages = np.arange(0.0, 2.0, 1e-5)
    older = np.where(ages < 0.01, 1.0, np.exp(-(ages - 0.01) / 0.02))
    delayed = np.sum(np.exp(rate * ages) * older) / np.sum(older)
    law = HoldLaw(bounds, 50.0, 40.0)
    growth = growth_of(law, 0.02, 0.01, rate)
    assert growth >= delayed**2 * max(expected) * 50.0 / 38.0 * (1.0 - 5e-3)
    assert growth_of(law, 0.02, 0.01, 1e-6) == pytest.approx(1.0, abs=1e-3)
