"""Tests of `uvms_drake.control.laws.resolved`: the error dynamics that it promises."""

import numpy as np
import pytest
from support import dh
from support.laws import SIGMA, K, not_asked, pairs, resolved_input

from uvms_drake.control.laws import Resolved
from uvms_drake.control.laws.law import pair_of
from uvms_drake.control.plan.plan import Plan
from uvms_drake.model.uvms_model import configuration_rate


def flow(state: np.ndarray, acceleration: np.ndarray, s: float) -> np.ndarray:
    """Returns (𝔮, ζ) to first order in the time s."""
    config, zeta = np.split(state, 2)
    return np.concatenate([config + s * configuration_rate(config, zeta), zeta + s * acceleration])


def errors(model, state: np.ndarray, nominal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns 𝔢_y = y − ȳ and 𝔯 = ζ − J_x(𝔮)⁻¹[J_x(𝔮̄)ζ̄ − σ𝔢_y], typed again."""
    (config, zeta), (nominal_config, nominal_zeta) = np.split(state, 2), np.split(nominal, 2)
    error = np.concatenate([dh.chi(config), config[6:]])
    error -= np.concatenate([dh.chi(nominal_config), nominal_config[6:]])
    reference = model.task_jacobian(nominal_config) @ nominal_zeta - SIGMA * error
    return error, zeta - np.linalg.solve(model.task_jacobian(config), reference)


@pytest.mark.parametrize("where", ["free", "skin", "deep"])
def test_the_law_resolved_leaves_exactly_its_cascade(model, states, derivative, where):
    """𝔢̇_y = −σ𝔢_y + J_x𝔯 and 𝔯̇ = −k𝔯 + d under ζ̇ = f + u + d, by differences along the flow."""
    for state, nominal, acceleration, d in pairs(model, states, where):
        u = resolved_input(model, state, nominal, acceleration, K, SIGMA)
        zeta_dot = model.drift(state[:10], state[10:]) + u + d
        error, deviation = errors(model, state, nominal)
        assert np.linalg.norm(error) > 0.01

        def along(s, state=state, nominal=nominal, zeta_dot=zeta_dot, a=acceleration):
            return np.concatenate(errors(model, flow(state, zeta_dot, s), flow(nominal, a, s)))

        error_rate, deviation_rate = np.split(derivative(along), 2)
        np.testing.assert_allclose(
            error_rate, -SIGMA * error + model.task_jacobian(state[:10]) @ deviation, atol=1e-7)
        np.testing.assert_allclose(deviation_rate, -K * deviation + d, atol=1e-6)


def test_the_law_resolved_keeps_a_closed_loop_within_its_bound(model):
    """‖𝔯‖ ≤ d̃/k and ‖𝔢_y‖ ≤ J̄d̃/(kσ) over 3 s from zero error, pressing into the wall."""
    y = np.array([0.0, 0.2, 0.1, 0.0, 0.0, 0.1, 0.0, 1.1, 0.47, 0.0])
    zeta = np.array([0.05, 0.02, 0.0, 0.0, 0.0, 0.05, 0.1, -0.05, 0.05, 0.1])
    plan = Plan.from_accelerations(
        0.0, 3.0, model.configuration(y), zeta, -zeta[None] / 3.0)
    bound, dt = 0.1, 0.003
    direction = np.linspace(1.0, -0.5, 10)
    direction *= bound / np.linalg.norm(direction)

    def rate(time: float, state: np.ndarray) -> np.ndarray:
        config, nominal_zeta, nominal_zeta_dot = plan.at(time)
        u = resolved_input(model, state, np.concatenate([config, nominal_zeta]),
                           nominal_zeta_dot, K, SIGMA)
        zeta_dot = model.drift(state[:10], state[10:]) + u + direction
        return np.concatenate([configuration_rate(state[:10], state[10:]), zeta_dot])

    state, worst, norms = np.concatenate([plan.config[0], zeta]), [], []
    for i in range(1000):
        middle = state + 0.5 * dt * rate(i * dt, state)
        state = state + dt * rate((i + 0.5) * dt, middle)
        nominal = np.concatenate(plan.at((i + 1) * dt)[:2])
        worst.append([np.linalg.norm(each) for each in errors(model, state, nominal)])
        norms.append(np.linalg.norm(model.task_jacobian(state[:10]), 2))
    worst_e, worst_r = np.max(worst, axis=0)
    assert 0.99 * bound / K < worst_r <= bound / K * (1.0 + 1e-3)
    assert worst_e <= np.max(norms) * bound / (K * SIGMA)
    assert worst_e > 0.2 * bound / (K * SIGMA), "the disturbance does something"


@pytest.mark.parametrize("where", ["free", "skin", "deep"])
def test_with_a_measured_force_the_law_resolved_asks_nothing_of_the_surface(model, states, where):
    """Only M⁻¹Jᵀ(𝔉_s − 𝔉) is added to the command of a perfect model, whatever the true 𝔉 is."""
    rng = np.random.default_rng(5)
    for state, nominal, acceleration, _ in pairs(model, states, where):
        true, off = rng.normal(size=6) * [30.0, 30.0, 30.0, 1.0, 1.0, 1.0], rng.normal(size=6)
        now = pair_of(model, state, nominal)
        known, exact, wrong = (
            Resolved(K, SIGMA).command(
                model, now.given(contact=contact), lambda a=acceleration: a, not_asked).u
            + model.drift(state[:10], state[10:], contact if contact is None else true)
            for contact in (None, true, true + off))
        np.testing.assert_allclose(exact, known, rtol=1e-9, atol=1e-9)
        kinematics = model.kinematics(state[:10])
        np.testing.assert_allclose(wrong - exact, np.linalg.solve(
            model.mass_matrix(kinematics), kinematics.J_chi.T @ off), rtol=1e-8, atol=1e-9)
