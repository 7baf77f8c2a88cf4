"""Tests of `control.contact.stiffness_estimate`: its convergence and its bounds."""

import numpy as np
import pytest

import uvms_drake as uv
from uvms_drake.control.contact.press_target import target_depth
from uvms_drake.control.contact.stiffness_estimate import (
    NO_ESTIMATE,
    SCATTER,
    StiffnessEstimate,
    initial_estimate,
    predicted,
    stiffness_std,
    stiffness_used,
    surface_depth,
    tilt,
    with_reading,
)
from uvms_drake.model.surface.surface_class import SurfaceClass
from uvms_drake.sensing.wrist_sensor import quantised
from uvms_drake.station.contact.bounds import sensed_contact, sensing_of

MOST, NOISE, MEMORY, PERIOD = 1000.0, 4.2, 10.0, 0.01
SIGMA = 0.25  # N, of a reading; the bound has bias and much else in it
WALLS = SurfaceClass(np.array([0.0, 1.0, 0.0]), MOST, np.radians(5.0))
DEG_3 = np.tan(np.radians(3.0))
LATERAL = np.array([0.6, 0.0, 0.8])
"""Unit vector across n, down which the wall here runs off."""


def wall(kappa, tilted=0.0):
    """Returns the static force at places (..., 3) [N] of a wall through the origin."""
    return lambda tip: kappa * np.maximum(tip @ (WALLS.direction + tilted * LATERAL), 0.0)


def path(depth, lateral=0.0):
    """Returns places (m, 3) at depths and lengths along `LATERAL` (m,)."""
    return np.multiply.outer(depth, WALLS.direction) + np.multiply.outer(
        np.broadcast_to(lateral, np.shape(depth)), LATERAL)


def read(tips, forces, estimate=NO_ESTIMATE, *, walls=WALLS, memory=MEMORY, period=PERIOD):
    """Returns the estimates after each reading of a contact."""
    estimates = []
    for tip, force in zip(tips, forces, strict=True):
        estimate = with_reading(estimate, walls, tip, force, True, NOISE, memory, period)
        estimates.append(estimate)
    return estimates


def estimated(tips, force, seed=0, **options):
    noise = SIGMA * np.clip(np.random.default_rng(seed).standard_normal(len(tips)), -3.0, 3.0)
    return read(tips, force(tips) + noise, **options)


def pressed(kappa, force=20.0, tilted=0.0, count=150):
    """Returns the estimate after a press to a force, as fast at first as at the end slow."""
    depth = force / kappa * (1.0 - np.linspace(1.0, 0.0, count) ** 2)
    return estimated(path(depth), wall(kappa, tilted))[-1]


def test_it_is_the_least_squares_fit_of_a_wall_that_is_straight():
    """With its beginning as one more reading, and no step that is smaller than ν/κ₊."""
    straight = SurfaceClass(WALLS.direction, MOST)
    rng = np.random.default_rng(0)
    depth = np.cumsum(rng.uniform(1.0, 2.0, 12)) * NOISE / MOST
    forces = 300.0 * depth + rng.uniform(-1.0, 1.0, 12)
    last = read(path(depth), forces, walls=straight, memory=np.inf, period=0.0)[-1]
    weights = 1.0 / np.array([0.5 * MOST, NOISE, *[SCATTER * NOISE] * 11])
    rows = np.column_stack([np.append(0.0, np.ones(12)), np.append(1.0, depth - depth[-1])])
    fit, *_ = np.linalg.lstsq(weights[:, None] * rows, weights * np.append(0.5 * MOST, forces),
                              rcond=None)
    np.testing.assert_allclose(last.mean[:2], fit)
    np.testing.assert_allclose(last.covariance[:2, :2], np.linalg.inv(
        rows.T @ (weights[:, None] ** 2 * rows)))


def test_what_a_motion_does_to_what_is_not_known_is_its_derivative():
    estimate = initial_estimate(WALLS, np.zeros(3), np.array(9.0), NOISE)._replace(
        mean=np.array([9.0, 600.0, 0.03, -0.05]))
    tip = np.array([0.01, 0.03, -0.02])

    def after(mean):
        return predicted(estimate._replace(mean=mean), WALLS, tip, np.inf).mean

    steps = 1e-6 * np.array([1.0, 600.0, 1.0, 1.0])
    A = np.column_stack([(after(estimate.mean + h) - after(estimate.mean - h)) / (2.0 * np.max(h))
                         for h in np.diag(steps)])
    P, expected = predicted(estimate, WALLS, tip, np.inf).covariance, A @ estimate.covariance @ A.T
    apart = ~np.eye(4, dtype=bool)
    np.testing.assert_allclose(P[apart], expected[apart], rtol=1e-6, atol=1e-9)
    assert np.all(np.diag(P) >= np.diag(expected) * (1.0 - 1e-9))


def test_nothing_known_is_the_stiffest_wall():
    assert stiffness_used(NO_ESTIMATE, WALLS) == MOST
    assert np.isnan(surface_depth(NO_ESTIMATE, WALLS, np.zeros(3)))
    np.testing.assert_array_equal(tilt(NO_ESTIMATE, WALLS), np.zeros(3))
    once = read(path([0.3]), [10.0])[-1]
    assert stiffness_used(once, WALLS) == MOST
    assert surface_depth(once, WALLS, path(0.31)) == pytest.approx(0.3 - 10.0 / (0.5 * MOST))


@pytest.mark.parametrize("kappa", [100.0, 300.0, 950.0])
def test_a_press_teaches_the_slope(kappa):
    last = pressed(kappa)
    assert 0.95 * kappa <= stiffness_used(last, WALLS) <= min(1.4 * kappa, MOST)
    begins = surface_depth(last, WALLS, path(20.0 / kappa))
    assert begins == pytest.approx(0.0, abs=0.3 * 20.0 / kappa)


def test_a_tip_at_rest_neither_learns_nor_forgets():
    """Nor one whose position is measured with an error of 2 mm at most."""
    before, rng = pressed(300.0), np.random.default_rng(1)
    tips = before.at + 6.7e-4 * np.clip(rng.standard_normal((500, 3)), -2.0, 2.0)
    after = estimated(tips, lambda tips: np.full(500, 20.0), estimate=before)[-1]
    np.testing.assert_array_equal(after.mean, before.mean)
    np.testing.assert_array_equal(after.covariance[1:], before.covariance[1:])


@pytest.mark.parametrize("kappa", [100.0, 700.0])
def test_a_slide_on_a_wall_that_runs_off_teaches_how_it_is_inclined(kappa):
    """At one force, 0.6 m along the wall: the wall that recedes does not look soft."""
    before, lateral = pressed(kappa, tilted=DEG_3), np.linspace(0.0, 0.6, 200)
    estimates = estimated(
        path(20.0 / kappa - DEG_3 * lateral, lateral), wall(kappa, DEG_3), estimate=before)
    learned = np.array([stiffness_used(estimate, WALLS) for estimate in estimates])
    assert np.all(learned >= 0.9 * kappa)
    assert np.all(learned <= min(1.6 * kappa, MOST))
    np.testing.assert_allclose(tilt(estimates[-1], WALLS), DEG_3 * LATERAL, atol=0.15 * DEG_3)


@pytest.mark.parametrize("kappa", [300.0, 900.0])
def test_a_slide_along_which_the_position_is_wrong_teaches_no_stiffness(kappa):
    """Depths with errors of 2 mm at most, at 50 Hz, would make the wall look soft."""
    before, rng, count = pressed(kappa, 10.0, DEG_3), np.random.default_rng(2), 1500
    lateral = np.linspace(0.0, 0.6, count)
    tips = path(10.0 / kappa - DEG_3 * lateral, lateral)
    seen = tips + np.repeat(
        6.7e-4 * np.clip(rng.standard_normal((count // 2, 3)), -3.0, 3.0), 2, axis=0)
    last = read(seen, wall(kappa, DEG_3)(tips), estimate=before)[-1]
    assert 0.9 * kappa <= stiffness_used(last, WALLS) <= min(1.6 * kappa, MOST)
    np.testing.assert_allclose(tilt(last, WALLS), DEG_3 * LATERAL, atol=0.25 * DEG_3)


def test_hard_below_soft_and_soft_below_hard_are_noticed_within_a_few_noises():
    for first, second in ((100.0, MOST), (MOST, 100.0)):
        before, start = pressed(first), 20.0 / first
        deeper = start + np.linspace(0.0, 5.0 * NOISE / MOST, 60)
        last = estimated(path(deeper), lambda tips, at=start, k=second: 20.0 + k * (
            tips @ WALLS.direction - at), estimate=before)[-1]
        assert stiffness_used(last, WALLS) > 0.8 * MOST or second < first
        longer = start + np.linspace(0.0, 15.0 / second, 120)
        last = estimated(path(longer), lambda tips, at=start, k=second: 20.0 + k * (
            tips @ WALLS.direction - at), estimate=before)[-1]
        assert 0.9 * second <= stiffness_used(last, WALLS) <= max(2.0 * second, 0.3 * MOST)


def test_a_wall_that_hardens_is_followed():
    depth = np.linspace(0.0, 0.06, 300)
    estimates = estimated(path(depth), lambda tips: 5e3 * (tips @ WALLS.direction) ** 2)
    for i in (150, 299):
        assert 0.6 <= stiffness_used(estimates[i], WALLS) / (1e4 * depth[i]) <= 1.5


def test_a_wall_that_is_gone_is_forgotten_and_one_not_reached_is_not():
    before = pressed(500.0)
    for depth, forgotten in ((-0.05, False), (0.0, False), (0.04, True)):
        after = with_reading(before, WALLS, path(depth), 0.2, False, NOISE, MEMORY, PERIOD)
        assert np.isnan(after.mean[0]) == forgotten
        expected = MOST if forgotten else stiffness_used(before, WALLS)
        assert stiffness_used(after, WALLS) == expected


@pytest.mark.parametrize("kappa", [100.0, 400.0, MOST])
@pytest.mark.parametrize("delay", [0.0, 0.03, 0.14])
def test_a_fast_press_teaches_the_slope_too(kappa, delay):
    """For any delay of the readings: at 50 mm/s, and with a stop within 30 mm at 20 N."""
    window, speed = 0.14, 0.05
    time = np.arange(0.0, 2.0 + 20.0 / kappa / speed, PERIOD)
    depth = np.where(time * speed < 20.0 / kappa, time * speed, 20.0 / kappa)
    before = np.interp(time - window, time, depth, left=0.0)
    force = kappa * np.interp(time - delay, time, depth, left=0.0)
    estimate, rng = NO_ESTIMATE, np.random.default_rng(3)
    for tip, F, distance_moved in zip(path(depth), force, depth - before, strict=True):
        F += SIGMA * np.clip(rng.standard_normal(), -3.0, 3.0)
        estimate = with_reading(
            estimate, WALLS, tip, F, F > NOISE, NOISE, MEMORY, PERIOD, distance_moved)
        assert stiffness_used(estimate, WALLS) > 0.6 * kappa  # A press converges from half of κ on.
    assert stiffness_used(estimate, WALLS) < max(2.0 * kappa, 0.25 * MOST)


def test_a_reading_that_may_be_of_another_place_is_of_another_wall_only_beyond_that():
    before, distance_moved = pressed(500.0), 8.0 * NOISE / MOST
    expected = 20.0 + 500.0 * 0.02
    for off, forgotten in ((-0.9 * 500.0 * distance_moved, False),
                           (-NOISE - 2.0 * 500.0 * distance_moved, True)):
        after = with_reading(before, WALLS, path(20.0 / 500.0 + 0.02), expected + off, False,
                             NOISE, MEMORY, PERIOD, distance_moved)
        assert np.isnan(after.mean[0]) == forgotten


@pytest.mark.parametrize("known", [False, True])
def test_a_slide_leaves_no_force_error_once_the_inclination_is_known(known):
    """A tip that lags its target by T, along a wall that comes nearer; else κ̂Tv tan θ is."""
    kappa, speed, lag, desired = 700.0, 0.02, 0.6, 20.0
    estimate, force_at = pressed(kappa, tilted=DEG_3), wall(kappa, DEG_3)
    tip = path(desired / kappa)
    for time in np.arange(0.0, 20.0, 0.1):
        force, place = force_at(tip), path(0.0, speed * time)
        estimate = with_reading(estimate, WALLS, tip, force, True, NOISE, MEMORY, 0.1)
        kappa_hat = stiffness_used(estimate, WALLS) if known else kappa
        depth_offset = tilt(estimate, WALLS) @ (tip - place) if known else 0.0
        depth = target_depth(desired, np.array([WALLS.depth(tip), force]), True, kappa_hat, 0.0,
                             np.inf, depth_offset=depth_offset)
        tip = tip + 0.1 / lag * (place + depth * WALLS.direction - tip)
    left = 0.0 if known else kappa * lag * speed * DEG_3
    assert force - desired == pytest.approx(left, abs=0.05)


# Estimate of the stiffness after two presses: its mean and its deviation, for drawn walls ---------


SCENARIO = uv.load_scenario("girona500_contact")
WATCHED, DRAWN = sensing_of(SCENARIO).watched, sensed_contact(SCENARIO).walls
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


def presses(kappa, speed, rng):
    """Depths of the tip in walls of slopes `kappa` (n,), at its readings (m, n) [m].

    As fast as `speed` at most; in a stiff wall the way is shorter, and so is the motion slower.
    """
    first, second = (force / kappa for force in FORCES)
    counts = [int(1.875 * np.max(way) / speed / WATCHED.period) for way in (
        first + WAY, second - first)]
    approach, more = (smooth(count)[:, None] for count in counts)
    hold = np.ones((HOLD, 1))
    depth = np.concatenate([-WAY + approach * (first + WAY), hold * first,
                            first + more * (second - first), hold * second])
    time = WATCHED.period * np.arange(len(depth))[:, None]
    return depth + WOBBLE * np.sin(2.0 * np.pi * 0.3 * time + rng.uniform(0.0, 6.0, len(kappa)))


def readings(kappa, depth, rng):
    """Forces along n (m, n) [N] by the shipped sensor: lag, tare, bias, drift, noise, rounding."""
    rate = np.gradient(depth, WATCHED.period, axis=0)
    force = kappa * np.maximum(depth, 0.0) * np.maximum(1.0 + 0.8 * rate, 0.0)
    felt = np.zeros_like(force)
    for i in range(1, len(force)):
        left = np.exp(-WATCHED.period / SENSOR.lag)
        felt[i] = force[i - 1] + left * (felt[i - 1] - force[i - 1])
    tare = SENSOR.tare_samples
    felt = np.concatenate([np.zeros((tare, len(kappa))), felt])
    m = SENSOR.noise_multiple
    noise = SENSOR.noise[0] * np.clip(rng.standard_normal(felt.shape), -m, m)
    bias, drift = rng.uniform(-1.0, 1.0, (2, len(kappa)))
    time = WATCHED.period * np.arange(len(felt))[:, None]
    raw = quantised(felt + SENSOR.bias[0] * bias + SENSOR.drift[0] * drift * time + noise,
                    SENSOR.resolution[:1])
    return raw[tare:] - np.mean(raw[:tare], axis=0)


def estimates(kappa, speed, seed=0):
    """Means and deviations (n,) [N/m] of walls of slopes `kappa` (n,) after the two presses."""
    rng, n = np.random.default_rng(seed), len(kappa)
    depth = presses(kappa, speed, rng)
    force, nu = readings(kappa, depth, rng), WATCHED.noise
    estimate = StiffnessEstimate(*(np.broadcast_to(each, (n, *each.shape)) for each in NO_ESTIMATE))
    for i, read in enumerate(force):
        window = depth[i] - depth[max(i + 1 - WATCHED.readings, 0): i + 1]
        advance = np.where(np.max(-window, axis=0) <= nu / DRAWN.stiffness,
                           np.max(window, axis=0), np.inf)
        estimate = with_reading(
            estimate, DRAWN, depth[i][:, None] * DRAWN.direction, read, np.abs(read) > nu, nu,
            WATCHED.memory, WATCHED.period, advance)
    return estimate.mean[:, 1], stiffness_std(estimate)


@pytest.mark.parametrize("speed", [0.02, 0.06])
def test_of_a_hundred_drawn_walls_the_stiffness_is_within_two_deviations(speed):
    kappa = np.exp(np.random.default_rng(7).uniform(*np.log([100.0, 950.0]), 100))
    mean, std = estimates(kappa, speed)
    within = np.mean(np.abs(mean - kappa) <= 2.0 * std)
    assert within >= 0.95
    assert np.all(std < 0.3 * kappa), "and it is of use"
