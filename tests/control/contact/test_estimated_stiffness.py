"""Estimate of the stiffness after two presses: its mean and its deviation, for drawn walls."""

import numpy as np
import pytest

from uvms_drake.control.contact.stiffness_estimate import (
    NO_ESTIMATE,
    StiffnessEstimate,
    stiffness_std,
    with_reading,
)
from uvms_drake.sensing.wrist_sensor import quantised
from uvms_drake.station.contact.bounds import sensed_contact, sensing_of
from uvms_drake.station.scenario.scenario import load_scenario

SCENARIO = load_scenario("girona500_contact")
SENSING, WALLS = sensing_of(SCENARIO).watched, sensed_contact(SCENARIO).walls
SENSOR, = SCENARIO.sensing
HOLD, WAY = 200, 20e-3
"""Readings of a hold, and the way to the wall [m]."""
FORCES = 10.0, 20.0
"""Forces of the two presses [N]."""
WOBBLE = 3e-4
"""Amplitude of the tip's deviation from its plan, at 0.3 Hz [m]."""


def smooth(count):
    """A motion from 0 to 1 of least jerk, at the readings (count,)."""
    t = np.linspace(0.0, 1.0, count + 1)[1:]
    return t**3 * (10.0 - 15.0 * t + 6.0 * t**2)


def path(kappa, speed, rng):
    """Depths of the tip in walls of slopes `kappa` (n,), at its readings (m, n) [m].

    As fast as `speed` at most; in a stiff wall the way is shorter, and so is the motion slower.
    """
    first, second = (force / kappa for force in FORCES)
    counts = [int(1.875 * np.max(way) / speed / SENSING.period) for way in (
        first + WAY, second - first)]
    approach, more = (smooth(count)[:, None] for count in counts)
    hold = np.ones((HOLD, 1))
    depth = np.concatenate([-WAY + approach * (first + WAY), hold * first,
                            first + more * (second - first), hold * second])
    time = SENSING.period * np.arange(len(depth))[:, None]
    return depth + WOBBLE * np.sin(2.0 * np.pi * 0.3 * time + rng.uniform(0.0, 6.0, len(kappa)))


def readings(kappa, depth, rng):
    """Forces along n (m, n) [N] by the shipped sensor: lag, tare, bias, drift, noise, rounding."""
    rate = np.gradient(depth, SENSING.period, axis=0)
    force = kappa * np.maximum(depth, 0.0) * np.maximum(1.0 + 0.8 * rate, 0.0)
    felt = np.zeros_like(force)
    for i in range(1, len(force)):
        left = np.exp(-SENSING.period / SENSOR.lag)
        felt[i] = force[i - 1] + left * (felt[i - 1] - force[i - 1])
    tare = SENSOR.tare_samples
    felt = np.concatenate([np.zeros((tare, len(kappa))), felt])
    m = SENSOR.noise_multiple
    noise = SENSOR.noise[0] * np.clip(rng.standard_normal(felt.shape), -m, m)
    bias, drift = rng.uniform(-1.0, 1.0, (2, len(kappa)))
    time = SENSING.period * np.arange(len(felt))[:, None]
    raw = quantised(felt + SENSOR.bias[0] * bias + SENSOR.drift[0] * drift * time + noise,
                    SENSOR.resolution[:1])
    return raw[tare:] - np.mean(raw[:tare], axis=0)


def estimates(kappa, speed, seed=0):
    """Means and deviations (n,) [N/m] of walls of slopes `kappa` (n,) after the two presses."""
    rng, n = np.random.default_rng(seed), len(kappa)
    depth = path(kappa, speed, rng)
    force, nu = readings(kappa, depth, rng), SENSING.noise
    estimate = StiffnessEstimate(*(np.broadcast_to(each, (n, *each.shape)) for each in NO_ESTIMATE))
    for i, read in enumerate(force):
        window = depth[i] - depth[max(i + 1 - SENSING.readings, 0): i + 1]
        advance = np.where(np.max(-window, axis=0) <= nu / WALLS.stiffness,
                           np.max(window, axis=0), np.inf)
        estimate = with_reading(
            estimate, WALLS, depth[i][:, None] * WALLS.direction, read, np.abs(read) > nu, nu,
            SENSING.memory, SENSING.period, advance)
    return estimate.mean[:, 1], stiffness_std(estimate)


@pytest.mark.parametrize("kappa", [200.0, 300.0, 700.0])
def test_after_two_presses_of_different_depth_the_mean_is_near_the_walls_stiffness(kappa):
    """Over twenty sensors, whose deviation from the mean is that of their noise."""
    mean, _ = estimates(np.full(20, kappa), 0.02)
    assert np.mean(mean) == pytest.approx(kappa, rel=0.05)
    assert np.median(np.abs(mean / kappa - 1.0)) < 0.05


@pytest.mark.parametrize("speed", [0.02, 0.06])
def test_of_a_hundred_drawn_walls_the_stiffness_is_within_two_deviations(speed):
    kappa = np.exp(np.random.default_rng(7).uniform(*np.log([100.0, 950.0]), 100))
    mean, std = estimates(kappa, speed)
    within = np.mean(np.abs(mean - kappa) <= 2.0 * std)
    assert within >= 0.95
    assert np.all(std < 0.3 * kappa), "and it is of use"
