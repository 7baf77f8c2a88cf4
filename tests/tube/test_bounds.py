"""`tube.row_gains` on random systems whose constants are known."""

import math

import numpy as np
import pytest
from support.random_systems import COUNT, integrate, norm, run_resolved
from support.tube_bounds import resolved_preimage_tube, resolved_velocity_radius, rise

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.tube.row_gains import (
    joint_rate_radius,
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


def test_the_time_may_be_long_and_an_array_of_any_shape():
    E, R = rise(resolved_tube(40.0, 5.0, 0.1, 2.0), np.array([[0.0, 1e3], [1e6, 1e9]]))
    np.testing.assert_allclose(E, [[0.0, 1e-3], [1e-3, 1e-3]], rtol=1e-12)
    np.testing.assert_allclose(R, [[0.0, 2.5e-3], [2.5e-3, 2.5e-3]], rtol=1e-12)


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


def test_the_velocity_bound_does_not_know_how_well_j_is_conditioned():
    """On ẏ = J(t)ζ with ζ̄ = 0: L_w = 0. J turns at μ = N = 0.5, with a condition number of 100."""
    k, sigma, d_bound, turn = 20.0, 5.0, 0.1, 0.5
    S, X = np.diag([10.0, 0.1]), np.array([[0.0, 1.0], [1.0, 0.0]])

    def J(t):  # J⁻¹J̇ = −turn · X, whose largest eigenvalue is turn
        return S @ (np.cosh(turn * t) * np.eye(2) - np.sinh(turn * t) * X)

    def rate(t, x, direction):
        w, r = x[:2], x[2:]
        return np.concatenate([-sigma * w + turn * X @ w + r,
                               -k * r + d_bound * direction(t, w, r)])

    tube = resolved_preimage_tube(k, sigma, d_bound, turn)
    bound = resolved_velocity_radius(k, sigma, d_bound, turn, turn, 0.0)
    derivative = (J(1e-6) - J(-1e-6)) / 2e-6
    np.testing.assert_allclose(np.linalg.solve(J(0.0), derivative), -turn * X, atol=1e-8)
    one = np.ones(2) / np.sqrt(2.0)
    switch = 4.0 - math.log(k / sigma) / (k - sigma)
    w_worst = z_worst = 0.0
    for direction in (lambda t, w, r: one, lambda t, w, r: one * (1.0 if t < switch else -1.0)):
        for t, x in integrate(lambda t, x, law=direction: rate(t, x, law), np.zeros(4), 4.0, 2e-3):
            w, z = norm(x[:2]), norm(x[2:] - sigma * x[:2])
            assert w <= rise(tube, t)[0] + 1e-9
            w_worst, z_worst = max(w_worst, w / tube.e), max(z_worst, z / bound)
    assert w_worst > 0.999
    assert 0.85 < z_worst < 1.0
    through_j = d_bound / k + 10.0 * sigma * resolved_tube(k, sigma, d_bound, 10.0).e
    assert bound < 0.02 * through_j
    assert resolved_velocity_radius(k, 0.4, d_bound, turn, turn, 0.0) == math.inf


@pytest.mark.parametrize(("arguments", "message"), [
    ((0.0, 5.0, 0.1, 1.0), "k = 0"), ((20.0, math.inf, 0.1, 1.0), "sigma = inf"),
    ((20.0, 5.0, -0.1, 1.0), "d_bound = -0.1"), ((20.0, 5.0, 0.1, math.nan), "gain = nan")])
def test_arguments_without_a_meaning_are_named(arguments, message):
    with pytest.raises(InvalidParameter, match=message):
        resolved_tube(*arguments)
