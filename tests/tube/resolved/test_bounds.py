"""`tube.resolved.bounds` and `tube.conditions` on random systems whose constants are known."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.random_systems import COUNT, integrate, norm, run_resolved, run_transpose
from support.tube_bounds import resolved_preimage_tube, resolved_velocity_radius, rise

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.tube.conditions import LemmaConstants, paper_conditions
from uvms_drake.tube.resolved.bounds import (
    joint_rate_radius,
    preimage_shift,
    resolved_tube,
    smallest_k,
    transpose_tube,
    transpose_velocity_radius,
)

CALM = LemmaConstants(J_min=1.0, J_max=1.0, J_dot=0.0, L_c=0.0, L_1=0.0, L_2=0.0)


# The law `resolved` ------------------------------------------------------------------------------


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
    with pytest.raises(InvalidParameter, match="L_c = -1"):
        replace(CALM, L_c=-1.0)


# The law `transpose` -----------------------------------------------------------------------------


def test_no_trajectory_leaves_the_tube_of_the_comparison_system_and_some_come_close():
    runs = run_transpose(seed=2)
    worst = np.zeros((3, COUNT))
    for i in range(COUNT):
        tube = transpose_tube(runs.constants[i], runs.k[i], runs.sigma[i], runs.d_bound[i])
        assert tube.holds
        E, R = rise(tube, runs.time)
        assert np.max(E) <= tube.e
        assert np.max(R) <= tube.r
        bounds = np.array([E, R, R + runs.sigma[i] * tube.g * E])
        worst[:, i] = np.max(runs.norms[:, 1:, i] / bounds[:, 1:], axis=1)
        assert bounds[2, -1] <= transpose_velocity_radius(tube, runs.sigma[i])
    assert np.max(worst) < 1.0
    assert np.all(np.max(worst, axis=1) > 0.99)


WORST = LemmaConstants(J_min=1.44, J_max=1.2, J_dot=0.7, L_c=0.9, L_1=1.1, L_2=0.8)
"""Of the system below: J = J̄(1 − t J̃/J̄)(cos ωχ, sin ωχ), f = (−L₁χ, 0) + L₂ζ."""


def growth_of_r(e: float, r: float, k: float, sigma: float, d_bound: float) -> float:
    """Returns D⁺‖𝔯‖ at t = 0, χ̄ = 0, by differences, where everything drives 𝔯 outward.

    ζ̄ = (0, −1), so that L_𝔠 = J̄ω and 𝔟 = −L_𝔠𝔢; 𝔯 points along −Jᵀ𝔢.
    """
    c = WORST

    def J(t, chi):
        angle = c.L_c / c.J_max * chi
        return (c.J_max - c.J_dot * t) * np.array([np.cos(angle), np.sin(angle)])

    def f(chi, zeta):
        return np.array([-c.L_1 * chi, 0.0]) + c.L_2 * zeta

    def r_of(t, x):
        nominal = J(t, x[3])
        return x[1:3] - x[4:6] + sigma * nominal * (x[0] - x[3]), nominal

    def rate(t, x):
        error, nominal = r_of(t, x)
        u = -f(x[3], x[4:6])  # ζ̄ is constant
        d = d_bound * error / norm(error)
        return np.concatenate([[J(t, x[0]) @ x[1:3]], f(x[0], x[1:3]) + u - k * error + d,
                               [nominal @ x[4:6]], np.zeros(2)])

    x = np.array([e, -r - sigma * c.J_max * e, -1.0, 0.0, 0.0, -1.0])
    assert norm(r_of(0.0, x)[0]) == pytest.approx(r)
    step = 1e-6
    after = x + step * rate(0.0, x) + 0.5 * step * (
        rate(step, x + step * rate(0.0, x)) - rate(0.0, x))
    return (norm(r_of(step, after)[0]) - r) / step


def test_one_state_attains_every_term_of_the_comparison_inequality():
    """So that none can be left out: each is a visible part of D⁺R there."""
    k, sigma, d_bound, e, r = 30.0, 1.7, 1e-4, 2e-4, 1e-4
    growth = growth_of_r(e, r, k, sigma, d_bound)
    tube = transpose_tube(WORST, k, sigma, d_bound)
    assert growth == pytest.approx(tube.G * e - tube.b * r + d_bound, rel=1e-3)
    J, c = WORST.J_max, WORST
    in_G = {"L₁": c.L_1, "L₂σJ̄": c.L_2 * sigma * J, "σL_cJ̄": sigma * c.L_c * J,
            "σJ̃": sigma * c.J_dot, "σ²J̄³": sigma**2 * J**3}
    assert sum(in_G.values()) == pytest.approx(tube.G)
    for term in (*(value * e for value in in_G.values()), c.L_2 * r, sigma * J**2 * r, d_bound):
        assert growth > tube.G * e - tube.b * r + d_bound - 0.5 * term


def reached(rate, size: int, duration: float) -> float:
    """Returns the largest ‖𝔢‖, 𝔢 the first half of the state, from zero on."""
    return max(norm(x[: size // 2]) for _, x in integrate(rate, np.zeros(size), duration, 0.01))


def test_without_l_1_the_tube_would_be_left():
    """J = 1, f = L₁χ: 𝔷̇ = L₁𝔢 − k𝔯 + d."""
    k, sigma, constants = 10.0, 1.0, replace(CALM, L_1=4.0)
    largest = reached(lambda t, x: np.array(
        [x[1], constants.L_1 * x[0] - k * (x[1] + sigma * x[0]) + 0.1]), 2, 20.0)
    assert transpose_tube(CALM, k, sigma, 0.1).e < largest
    assert largest < transpose_tube(constants, k, sigma, 0.1).e


def test_without_the_rate_of_j_the_tube_would_be_left():
    """J turns at ω, and d turns slowly the other way: 𝔢̇ = J𝔷, 𝔷̇ = −k𝔯 + Jᵀd'."""
    k, sigma, omega = 10.0, 1.0, 40.0
    slow = 0.5 * (math.sqrt(omega**2 + 4.0 * sigma * k) - omega)

    def rate(t, x):
        s, c, S, C = (f(w * t) for w in (omega, -slow) for f in (np.sin, np.cos))
        J = np.array([[c, -s], [s, c]])
        r = x[2:] + sigma * J.T @ x[:2]
        return np.concatenate([J @ x[2:], -k * r + J.T @ np.array([C, S]) * 0.1])

    assert reached(rate, 4, 30.0) > 2.0 * transpose_tube(CALM, k, sigma, 0.1).e
    assert not transpose_tube(replace(CALM, J_dot=omega), k, sigma, 0.1).holds


def test_a_tube_whose_condition_fails_is_infinite_and_says_which():
    constants = replace(CALM, L_c=2.0, J_dot=1.0)
    for k, sigma, failing in ((50.0, 1.0, "a = "), (2.0, 3.0, "b = "), (10.0, 3.0, "ab")):
        tube = transpose_tube(constants, k, sigma, 0.1)
        failed = [condition for condition in tube.conditions if not condition.holds]
        assert failed[0].name.startswith(failing)
        assert not tube.holds
        assert tube.e == tube.r == transpose_velocity_radius(tube, sigma) == math.inf
        np.testing.assert_array_equal(rise(tube, np.array([0.0, 1.0]))[0], math.inf)
    both_negative = transpose_tube(replace(CALM, L_c=90.0, L_2=90.0), 1.0, 1.0, 0.1)
    assert not any(condition.holds for condition in both_negative.conditions)


def test_the_smallest_k_is_the_edge_of_the_conditions_and_the_best_sigma_the_best():
    rng = np.random.default_rng(3)
    for _ in range(50):
        constants = LemmaConstants(*rng.uniform(0.1, 3.0, 6))
        k, sigma = smallest_k(constants)
        assert transpose_tube(constants, 1.0001 * k, sigma, 0.1).holds
        assert not transpose_tube(constants, 0.9999 * k, sigma, 0.1).holds
        others = [smallest_k(constants, factor * sigma).k for factor in (0.5, 0.99, 1.01, 2.0)]
        assert min(others) > k
    assert smallest_k(constants, 0.5 * constants.L_c / constants.J_min).k == math.inf
    assert smallest_k(replace(CALM, J_min=0.0)).k == math.inf
    assert smallest_k(replace(CALM, J_dot=0.5, L_2=0.25)) == (1.0, 0.0)  # L₁ = L_c = 0


def test_the_gains_that_girona_needs_are_those_that_were_measured():
    """For J̄, J̲, J̃, L_c at three speeds and f = 0; k of one quadratic at the same σ beside it."""
    for J_max, J_min, J_dot, L_c, expected, quadratic in (
            (2.99, 0.54, 2.56, 2.34, 2770, 480_000), (3.06, 0.54, 1.69, 1.37, 1780, 112_000),
            (2.97, 0.54, 0.29, 0.30, 350, 1200)):
        constants = LemmaConstants(J_min, J_max, J_dot, L_c, 0.0, 0.0)
        k, sigma = smallest_k(constants)
        assert k == pytest.approx(expected, rel=0.03)
        corrected = paper_conditions(constants, 2.0 * quadratic, sigma, 0.1).corrected
        needed = corrected.Lambda_1**2 / (4.0 * corrected.sigma_lower) + corrected.Lambda_2
        assert needed == pytest.approx(quadratic, rel=0.2)
