"""Tests of `uvms_drake.tube.row_gains`: on random systems, all pulses of a force, the dynamics."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from support.lagging import run
from support.random_systems import COUNT, integrate, run_resolved
from support.transfer import impulse
from support.tube_bounds import rise

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.control.laws import TipFirst
from uvms_drake.control.laws.tip_first import BlockGains
from uvms_drake.model.frames.euler import euler_angles, rotation_matrix
from uvms_drake.tube.row_gains import (
    Gains,
    attitude_radii,
    instant_gains,
    joint_rate_radius,
    lagged_gains,
    preimage_shift,
    resolved_tube,
)


def test_no_trajectory_leaves_the_tube_of_any_block_and_some_reach_it():
    """Reached to 2e-3: no bound would survive a factor or a term less."""
    runs = run_resolved(seed=1)
    worst = np.zeros((7, COUNT))
    for i in range(COUNT):
        gains = k, _, d_bound = runs.k[i], runs.sigma[i], runs.d_bound[i]
        tubes = [resolved_tube(*gains, gain[i]) for gain in runs.gains]
        bounds = np.array([rise(tubes[0], runs.time)[1],
                           *(rise(tube, runs.time)[0] for tube in tubes)])
        bounds = np.vstack([bounds, np.full_like(bounds[:2], 2.0 * d_bound / k)])
        bounds[5] *= runs.gains[0][i]
        bounds[6] = joint_rate_radius(*gains)
        assert bounds[6, 0] <= 2.0 * d_bound / k
        worst[:, i] = np.max(runs.norms[:, 1:, i] / bounds[:, 1:], axis=1)
    assert np.max(runs.norms[:, 0]) < 1e-12
    assert np.max(worst) < 1.0 + 2e-4  # the integration's error, on bounds that are reached
    assert np.all(np.max(worst[:5], axis=1) > 0.998)
    assert np.max(worst[6]) > 0.9


def test_the_tube_in_closed_form_solves_its_differential_equation():
    for k, sigma, gain in ((20.0, 5.0, 2.2), (3.0, 8.0, 1.0), (4.0, 4.0, 0.7),
                           (4.0, 4.0 + 1e-9, 0.7)):
        tube = resolved_tube(k, sigma, 0.3, gain)
        A = np.array([[-tube.a, tube.g], [tube.G, -tube.b]])
        steps = list(integrate(lambda t, x, A=A: A @ x + np.array([0.0, 0.3]),
                               np.zeros(2), 3.0, 1e-3))
        time = np.array([t for t, _ in steps])
        np.testing.assert_allclose(
            np.array(rise(tube, time)).T, [x for _, x in steps], atol=1e-10)
        assert tube.e == pytest.approx(gain * 0.3 / (k * sigma))
        assert tube.r == pytest.approx(0.3 / k)
        E, R = rise(tube, time)
        assert np.all(np.diff(E) >= -1e-15)
        np.testing.assert_allclose(R, 0.3 / k * (1.0 - np.exp(-k * time)), atol=1e-14)
        if k == sigma:
            decay = (1.0 + k * time) * np.exp(-k * time)
        else:
            decay = (k * np.exp(-sigma * time) - sigma * np.exp(-k * time)) / (k - sigma)
        np.testing.assert_allclose(E, tube.e * (1.0 - decay), atol=1e-8)


@pytest.mark.parametrize(("k", "sigma"), [(20.0, 5.0), (5.0, 20.0), (7.0, 7.0), (7.0, 7.0 + 1e-7)])
def test_the_joint_rate_bound_is_the_variation_of_the_impulse_response(k, sigma):
    time = np.linspace(0.0, 20.0 / min(k, sigma), 200_001)
    if abs(k - sigma) < 1e-3:
        response = time * np.exp(-k * time)
    else:
        response = (np.exp(-sigma * time) - np.exp(-k * time)) / (k - sigma)
    variation = np.sum(np.abs(np.diff(response)))
    assert joint_rate_radius(k, sigma, 0.3) == pytest.approx(0.3 * variation, rel=1e-6)


def test_the_preimage_is_shifted_by_its_bound_at_most_and_by_all_of_it_where_a_only_stretches():
    """Random A(t) = A₁ + A₂ sin t and bang-bang d of an ellipsoid; then A = −ω along one axis."""
    k, sigma, d_bound, weights = 20.0, 5.0, 0.3, np.array([0.1, 0.3, 1.0])
    rng = np.random.default_rng(0)
    reached = []
    for case in range(12):
        A = rng.normal(size=(2, 3, 3))
        d = weights * rng.normal(size=3)
        if case == 0:
            A, d = np.array([-np.diag([0.0, 0.0, 2.0]), np.zeros((3, 3))]), np.eye(3)[2]
        A *= 2.0 / np.sum(np.linalg.norm(A, 2, axis=(1, 2)))
        omega, alpha = (np.sum(np.linalg.norm(A @ scale, 2, axis=(1, 2)))
                        for scale in (np.eye(3), np.diag(weights)))
        d *= d_bound / np.linalg.norm(d / weights)
        r, p, p_0, largest, dt = np.zeros(3), np.zeros(3), np.zeros(3), 0.0, 2e-3
        for t in np.arange(0.0, 6.0, dt):
            sensor_effect = d if case == 0 or t < 3.0 else -d
            p, p_0 = (p + dt * (r - sigma * p - (A[0] + np.sin(t) * A[1]) @ p),
                      p_0 + dt * (r - sigma * p_0))
            r = r + dt * (sensor_effect - k * r)
            largest = max(largest, np.linalg.norm(p - p_0))
        reached.append(largest / preimage_shift(k, sigma, d_bound, omega, alpha))
    assert max(reached) <= 1.0 + 1e-9
    assert reached[0] > 0.999
    assert preimage_shift(k, 1.0, d_bound, 1.0, 0.5) == math.inf


@pytest.mark.parametrize(("arguments", "message"), [
    ((0.0, 5.0, 0.1, 1.0), "k = 0"), ((20.0, math.inf, 0.1, 1.0), "sigma = inf"),
    ((20.0, 5.0, -0.1, 1.0), "d_bound = -0.1"), ((20.0, 5.0, 0.1, math.nan), "gain = nan")])
def test_arguments_without_a_meaning_are_named(arguments, message):
    with pytest.raises(InvalidParameter, match=message):
        resolved_tube(*arguments)


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


VEHICLE, TIP = (4.0, 2.0), (20.0, 10.0)  # k, σ [1/s]
STEP = 0.025


def test_an_adversary_takes_every_row_to_its_bound_and_none_beyond(model):
    """All rows at once: d = J_y⁻¹δ, |δᵢ| the bound of each, of the signs that move it furthest."""
    end, bound = 3.0, np.repeat([0.03, 0.1], [6, 4])

    def adversary(time: float, J: np.ndarray) -> np.ndarray:
        left = np.array([max(end - time, 0.5 * STEP)])
        signs = [np.sign(impulse([1.0], np.poly([-k, -sigma]), left)[0])
                 for k, sigma in (VEHICLE, TIP)]
        return np.linalg.solve(J, np.repeat(signs, [6, 4]) * bound)

    motion = run(model, TipFirst(BlockGains(*VEHICLE), BlockGains(*TIP)), adversary, end, step=STEP)
    gains = np.repeat([instant_gains(*each).position for each in (VEHICLE, TIP)], [6, 4])
    reached = np.max(np.abs(motion.error), axis=0) / (gains * bound)
    assert np.all((reached > 0.95) & (reached <= 1.0 + 1e-4)), "exact, but for the steps"


@pytest.mark.parametrize(("frame", "factor"), [
    ((0.0, 0.0, 0.0), 1.0), ((0.0, 0.0, 0.9), 1.0),
    ((0.0, -0.5 * np.pi, 0.0), np.sqrt(1.0 + np.sin(1.2)))])
def test_a_turn_of_the_end_effector_turns_the_vehicle_by_no_more(frame, factor):
    """Small turns at all attitudes within the limits, the tip about a frame of its own."""
    limits, R_WT = SimpleNamespace(pitch=0.5, tip_pitch=1.2), rotation_matrix(np.array(frame))
    rng, nearest = np.random.default_rng(4), np.zeros(2)
    for _ in range(20000):
        tip = np.array([rng.uniform(-np.pi, np.pi), rng.uniform(-1.2, 1.2), rng.uniform(-3.0, 3.0)])
        vehicle = rotation_matrix(np.array([0.0, rng.uniform(-0.4, 0.4), rng.uniform(-3.0, 3.0)]))
        R_BE = vehicle.T @ R_WT @ rotation_matrix(tip)
        step = rng.normal(size=3)
        step *= 1e-6 / np.linalg.norm(step)
        moved = euler_angles(R_WT @ rotation_matrix(tip + step) @ R_BE.T) - euler_angles(vehicle)
        bounds = attitude_radii(limits, R_WT, 1e-6)
        nearest = np.maximum(nearest, np.abs(moved[:2]) / bounds)
    assert bounds[1] == pytest.approx(factor * 1e-6)
    assert np.all(nearest <= 1.0 + 1e-4)
    assert nearest[1] > 0.8
