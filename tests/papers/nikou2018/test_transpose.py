"""The paper's law, its Lemma as printed and corrected, and its tube on random systems."""

import math

import numpy as np
import pytest
from support import dh
from support.laws import SIGMA, K, pairs, transpose_input
from support.random_systems import COUNT, integrate, norm, run_transpose
from support.tube_bounds import rise

from uvms_drake.papers.nikou2018.errata.proof import quadratic_form
from uvms_drake.papers.nikou2018.kinematic_certificate import kinematic_tubes
from uvms_drake.papers.nikou2018.transpose import LemmaConstants, transpose_tube


@pytest.mark.parametrize("joints", [False, True])
@pytest.mark.parametrize("where", ["free", "deep"])
def test_the_law_transpose_is_the_papers_as_its_proof_needs_it(model, states, where, joints):
    """That is, u = ū − k(ζ − ζ̄) − kσJ(𝔮̄)ᵀ(χ − χ̄); with joints of the task y = (χ, q)."""
    rows = slice(0, 10 if joints else 6)
    for state, nominal, nominal_input, _ in pairs(model, states, where):
        y, y_nominal = (np.append(dh.chi(x[:10]), x[6:10])[rows] for x in (state, nominal))
        J = model.task_jacobian(nominal[:10])[rows]
        expected = nominal_input - K * (state[10:] - nominal[10:]) - K * SIGMA * (
            J.T @ (y - y_nominal))
        u = transpose_input(model, state, nominal, nominal_input, K, SIGMA, joints=joints)
        np.testing.assert_allclose(u, expected, atol=1e-12)


CALM = LemmaConstants(J_min=1.0, J_max=1.0, J_dot=0.0, L_c=0.0, L_1=0.0, L_2=0.0)


def growth(constants, k, sigma, e, r, L_1=0.0, L_2=0.0):
    """Returns V̇ at (𝔢, 𝔯) for the scalar J = J̄, f = L₁χ + L₂ζ of either sign, and d = 0."""
    J = constants.J_max
    z = r - sigma * J * e
    e_dot, z_dot = J * z, L_1 * e + L_2 * z - k * r
    return e * e_dot + r * (z_dot + sigma * J * e_dot)


def claimed(form, Lambda_1, k, e, r):
    return -form.sigma_lower * e**2 + Lambda_1 * abs(e * r) - (k - form.Lambda_2) * r**2


def test_the_printed_inequality_fails_at_a_state_and_its_ball_is_left():
    """J = 1, f = 0: all printed conditions hold, and V grows far outside the printed radius."""
    k, sigma, d_bound = 10.0, 5.0, 0.1
    form = quadratic_form(CALM, sigma)
    radius = form.radius(k, d_bound, form.Lambda_1)
    assert radius < math.inf == form.radius(k, d_bound)
    e, r = -1.0, 1.5
    assert math.hypot(e, r) > 50.0 * radius
    assert (claimed(form, form.Lambda_1, k, e, r) < 0.0 < growth(CALM, k, sigma, e, r)
            <= claimed(form, form.corrected, k, e, r))
    # On the boundary of the printed ball, and with no disturbance at all, outward.
    on_it = radius * np.array([e, r]) / math.hypot(e, r)
    x = np.array([on_it[0], on_it[1] - sigma * on_it[0]])
    radii = [norm(np.array([x[0], x[1] + sigma * x[0]])) for _, x in integrate(
        lambda t, x: np.array([x[1], -k * (x[1] + sigma * x[0])]), x, 0.2, 1e-3)]
    assert max(radii) > 1.1 * radius


def test_no_state_breaks_the_corrected_inequality_and_it_needs_every_term():
    rng = np.random.default_rng(0)
    excess = np.zeros(2)
    for _ in range(2000):
        J, sigma, k = rng.uniform(0.3, 2.0), rng.uniform(0.1, 5.0), rng.uniform(1.0, 50.0)
        L = rng.uniform(0.0, 5.0)
        constants = CALM._replace(J_min=J**2, J_max=J, L_1=L, L_2=L)
        form, (e, r) = quadratic_form(constants, sigma), rng.normal(size=2)
        rate = growth(constants, k, sigma, e, r, *(L * rng.choice([-1.0, 1.0], size=2)))
        for i, Lambda_1 in enumerate((form.Lambda_1, form.corrected)):
            excess[i] = max(excess[i], rate - claimed(form, Lambda_1, k, e, r))
    assert excess[0] > 10.0
    assert excess[1] < 1e-9


def test_the_radius_is_that_of_the_best_split_of_the_mixed_term():
    """‖𝔢‖‖𝔯‖ ≤ ‖𝔢‖²/(4ρ) + ρ‖𝔯‖² leaves d̃/min(α₁, α₂), as the paper has it, for each ρ."""
    form = quadratic_form(CALM._replace(J_dot=0.3, L_c=0.2), 1.0)
    for k in (30.0, 60.0, 1e4):
        rho = np.geomspace(1e-3, 1e4, 20_000)
        alpha = np.minimum(form.sigma_lower - form.corrected / (4.0 * rho),
                           k - rho * form.corrected - form.Lambda_2)
        assert form.radius(k, 0.1) == pytest.approx(0.1 / np.max(alpha), rel=1e-3)
    assert form.radius(1e-3, 0.1) == math.inf


def test_with_corrected_numbers_the_kinematic_tube_is_reached_and_not_left():
    """J(χ) = (cos ωχ, sin ωχ) about χ̄ = 0, ζ̄ = (0, 1): 𝔟 = sin(ω𝔢) + …, and L_𝔠 = ω‖ζ‖."""
    sigma, L_c, w = 6.0, 2.0, 0.03
    tubes = kinematic_tubes(1.0, L_c, sigma, w)
    omega = L_c / math.hypot(1.0, sigma * tubes.corrected)  # the speed is that of the real ζ
    states = [x[0] for _, x in integrate(
        lambda t, x: -sigma * x * np.cos(omega * x) + np.sin(omega * x) + w, np.zeros(1), 4.0,
        0.01)]
    assert tubes.printed < max(states) <= tubes.corrected
    assert max(states) > 0.99 * tubes.corrected


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
        assert bounds[2, -1] <= tube.r + runs.sigma[i] * tube.g * tube.e
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
    k, sigma, constants = 10.0, 1.0, CALM._replace(L_1=4.0)
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
    assert not transpose_tube(CALM._replace(J_dot=omega), k, sigma, 0.1).holds


def test_a_tube_whose_condition_fails_is_infinite_and_says_which():
    constants = CALM._replace(L_c=2.0, J_dot=1.0)
    for k, sigma, failing in ((50.0, 1.0, "a = "), (2.0, 3.0, "b = "), (10.0, 3.0, "ab")):
        tube = transpose_tube(constants, k, sigma, 0.1)
        failed = [condition for condition in tube.conditions if not condition.holds]
        assert failed[0].name.startswith(failing)
        assert not tube.holds
        assert tube.e == tube.r == math.inf
        np.testing.assert_array_equal(rise(tube, np.array([0.0, 1.0]))[0], math.inf)
    both_negative = transpose_tube(CALM._replace(L_c=90.0, L_2=90.0), 1.0, 1.0, 0.1)
    assert not any(condition.holds for condition in both_negative.conditions)
