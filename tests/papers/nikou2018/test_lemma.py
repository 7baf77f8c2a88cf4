"""The paper's Lemma as printed does not hold, corrected it does; its kinematic tube likewise."""

import math

import numpy as np
import pytest
from support.random_systems import integrate, norm

from uvms_drake.papers.nikou2018.errata.proof import quadratic_form
from uvms_drake.papers.nikou2018.kinematic_certificate import kinematic_tubes
from uvms_drake.papers.nikou2018.transpose import LemmaConstants

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
