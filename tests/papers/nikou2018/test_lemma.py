"""Tests of `papers.nikou2018.lemma`: as printed the Lemma does not hold, corrected it does."""

import math

import numpy as np
import pytest
from support.random_systems import integrate, norm

from uvms_drake.papers.nikou2018.kinematic_certificate import kinematic_tubes
from uvms_drake.papers.nikou2018.lemma import paper_conditions
from uvms_drake.papers.nikou2018.transpose import LemmaConstants

CALM = LemmaConstants(J_min=1.0, J_max=1.0, J_dot=0.0, L_c=0.0, L_1=0.0, L_2=0.0)


# A system with constant J ------------------------------------------------------------------------


def quadratic_rate(constants, k, sigma, e, r, L_1=0.0, L_2=0.0):
    """Returns V̇ at (𝔢, 𝔯) for the scalar J = J̄, f = L₁χ + L₂ζ of either sign, and d = 0."""
    J = constants.J_max

    def rate(x):
        error = x[1] + sigma * J * x[0]
        return np.array([J * x[1], L_1 * x[0] + L_2 * x[1] - k * error])

    x = np.array([e, r - sigma * J * e])
    e_dot, z_dot = rate(x)
    return e * e_dot + r * (z_dot + sigma * J * e_dot)


def test_the_printed_inequality_fails_at_a_state_and_its_ball_is_left():
    """J = 1, f = 0: all printed conditions hold, and V grows far outside the printed radius."""
    k, sigma, d_bound = 10.0, 5.0, 0.1
    printed, corrected = paper_conditions(CALM, k, sigma, d_bound)
    assert all(condition.holds for condition in printed.conditions)
    assert not all(condition.holds for condition in corrected.conditions)
    assert corrected.e == corrected.z == math.inf
    e, r = -1.0, 1.5
    assert math.hypot(e, r) > 50.0 * printed.e
    growth = quadratic_rate(CALM, k, sigma, e, r)
    claimed = [-q.sigma_lower * e**2 + q.Lambda_1 * abs(e * r) - (k - q.Lambda_2) * r**2
               for q in (printed, corrected)]
    assert claimed[0] < 0.0 < growth <= claimed[1]
    # On the boundary of the printed ball, and with no disturbance at all, outward.
    on_it = printed.e * np.array([e, r]) / math.hypot(e, r)
    x = np.array([on_it[0], on_it[1] - sigma * on_it[0]])
    radii = [norm(np.array([x[0], x[1] + sigma * x[0]])) for _, x in integrate(
        lambda t, x: np.array([x[1], -k * (x[1] + sigma * x[0])]), x, 0.2, 1e-3)]
    assert max(radii) > 1.1 * printed.e


def test_no_state_breaks_the_corrected_inequality_and_it_needs_every_term():
    rng = np.random.default_rng(0)
    excess = np.zeros(2)
    for _ in range(2000):
        J, sigma, k = rng.uniform(0.3, 2.0), rng.uniform(0.1, 5.0), rng.uniform(1.0, 50.0)
        L = rng.uniform(0.0, 5.0)
        constants = CALM._replace(J_min=J**2, J_max=J, L_1=L, L_2=L)
        e, r = rng.normal(size=2)
        growth = quadratic_rate(
            constants, k, sigma, e, r, *(L * rng.choice([-1.0, 1.0], size=2)))
        for i, form in enumerate(paper_conditions(constants, k, sigma, 0.0)):
            claimed = (-form.sigma_lower * e**2 + form.Lambda_1 * abs(e * r)
                       - (k - form.Lambda_2) * r**2)
            excess[i] = max(excess[i], growth - claimed)
    assert excess[0] > 10.0
    assert excess[1] < 1e-9


def test_the_terms_are_those_of_the_errata():
    c = LemmaConstants(J_min=0.5, J_max=1.3, J_dot=0.7, L_c=0.4, L_1=0.2, L_2=0.9)
    printed, corrected = paper_conditions(c, 80.0, 2.0, 0.1, rho=3.0)
    assert printed.Lambda_1 == pytest.approx(0.9 + 1.3 + 2.0 * (0.4 + 0.7))
    assert corrected.Lambda_1 - printed.Lambda_1 == pytest.approx(
        0.9 * 2.0 * 1.3 + 2.0 * 0.4 * (1.3 - 1.0) + 4.0 * 1.3**3)
    for form in (printed, corrected):
        assert form.Lambda_2 == pytest.approx(0.9 + 2.0 * 1.69)
        assert form.sigma_lower == pytest.approx(0.6)
        assert form.rho == 3.0
        assert form.alpha_1 == pytest.approx(0.6 - form.Lambda_1 / 12.0)
        assert form.alpha_2 == pytest.approx(80.0 - 3.0 * form.Lambda_1 - form.Lambda_2)
    assert printed.e == pytest.approx(0.1 / min(printed.alpha_1, printed.alpha_2))
    assert printed.z == pytest.approx(2.0 * printed.e / 1.3)
    assert [item.holds for item in corrected.conditions] == [True, False, True]


def test_rho_is_the_one_with_the_smallest_tube():
    c = CALM._replace(J_dot=0.3, L_c=0.2)
    for k in (30.0, 60.0, 1e4):
        best = paper_conditions(c, k, 1.0, 0.1).corrected
        assert best.alpha_1 == pytest.approx(best.alpha_2)
        form = np.array([[best.sigma_lower, -0.5 * best.Lambda_1],
                         [-0.5 * best.Lambda_1, k - best.Lambda_2]])
        assert best.alpha_1 == pytest.approx(np.linalg.eigvalsh(form)[0])
        for factor in (0.9, 1.1):
            other = paper_conditions(c, k, 1.0, 0.1, rho=factor * best.rho).corrected
            assert other.e > best.e
    small_k = paper_conditions(c, 1e-3, 1.0, 0.1).corrected
    assert small_k.rho > 0.0
    assert small_k.e == math.inf


def test_the_printed_tube_of_the_velocity_is_left_and_the_corrected_one_is_not():
    """J̄ = 10, f = 0, and d changes its sign once. The printed Ω₂ has no σ, and 1/J̄."""
    k, sigma, d_bound = 25.0, 0.1, 0.1
    c = CALM._replace(J_min=100.0, J_max=10.0)
    printed = paper_conditions(c, k, sigma, d_bound).printed
    assert all(condition.holds for condition in printed.conditions)
    peaks = []
    for switch in np.linspace(1.85, 1.99, 15):
        states = integrate(lambda t, x, s=switch: np.array(
            [10.0 * x[1], -k * (x[1] + sigma * 10.0 * x[0]) + d_bound * (1.0 if t < s else -1.0)]),
            np.zeros(2), 2.2, 2e-3)
        peaks.append(max(abs(x[1]) for _, x in states))
    assert max(peaks) > 1.5 * printed.z
    k = 300.0
    corrected = paper_conditions(c, k, sigma, d_bound).corrected
    assert corrected.z == pytest.approx(corrected.e * math.sqrt(2.0))
    assert max(peaks) * 25.0 / k < corrected.z < math.inf


# The paper's simulation --------------------------------------------------------------------------


def test_the_printed_numbers_of_the_simulation_have_no_tube():
    J_min, L_c, sigma = 0.5095, 2.0 * math.sqrt(2.0), 3.084
    tubes = kinematic_tubes(J_min, L_c, sigma, 0.2)
    assert tubes.printed == pytest.approx(0.0455, abs=5e-5)  # printed: 0.3
    assert tubes.corrected == math.inf
    assert not tubes.condition.holds
    assert tubes.condition.margin == pytest.approx(-1.257, abs=1e-3)
    assert L_c / J_min == pytest.approx(5.55, abs=2e-3)
    w = 0.2 * np.sin(np.linspace(0.0, 7.0, 2000))[:, None] * np.ones(6)
    assert np.max(norm(w)) == pytest.approx(0.49, abs=1e-3)  # printed: 0.2


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
    exact = [x[0] for _, x in integrate(lambda t, x: -sigma * x + w, np.zeros(1), 4.0, 0.01)]
    assert max(exact) == pytest.approx(w / sigma)
