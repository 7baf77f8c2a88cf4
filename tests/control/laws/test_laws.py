"""Tests of `uvms_drake.control.laws.law`: properties of all laws."""

from dataclasses import replace

import numpy as np
import pytest
from support import dh
from support.laws import (
    SIGMA,
    K,
    not_asked,
    pairs,
    resolved_input,
    tip_first_input,
    transpose_input,
)
from support.tiny_robots import tiny_robot, turret

import uvms_drake as uv
from uvms_drake.common.errors import RunFailed
from uvms_drake.control.laws.law import pair_of
from uvms_drake.control.laws.outputs import outputs_of, tip_rows
from uvms_drake.control.laws.tip_first import BlockGains
from uvms_drake.control.plan.plan import Plan
from uvms_drake.model.surface.law import check_surface


@pytest.mark.parametrize("where", ["free", "deep"])
def test_without_an_error_the_nominal_input_is_passed_on(model, states, where):
    acceleration = np.linspace(-0.3, 0.3, 10)
    for state in states[where]:
        nominal_input = acceleration - model.drift(state[:10], state[10:])
        for law in (resolved_input, tip_first_input):
            np.testing.assert_allclose(
                law(model, state, state, acceleration, K, SIGMA), nominal_input,
                rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(
            transpose_input(model, state, state, nominal_input, K, SIGMA), nominal_input,
            atol=1e-12)


def turned(state: np.ndarray, angle: float) -> np.ndarray:
    """Returns the state seen after a turn of the whole world about the vertical, ψ in (−π, π]."""
    out = state.copy()
    out[:3] = dh.rotation("z", angle)[:3, :3] @ state[:3]
    out[5] = np.arctan2(np.sin(state[5] + angle), np.cos(state[5] + angle))
    return out


@pytest.mark.parametrize("law", [resolved_input, transpose_input, tip_first_input])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_errors_across_the_jump_of_the_yaw_angle_are_small(uvms, states, law, sign):
    """Real yaw π − ε against nominal −π + ε gives the input of −ε against ε, across π."""
    floor = uv.UnilateralPlane(point=np.array([0.0, 0.0, 50.0]), normal=np.array([0.0, 0.0, -1.0]))
    model = uv.ContactModel(uvms, check_surface(floor))  # The same seen from north and from south.
    for real, ideal, nominal, _ in pairs(model, states, "free"):
        real, ideal = real.copy(), ideal.copy()
        real[5] += -0.02 * sign - dh.chi(real[:10])[5]
        ideal[5] += 0.02 * sign - dh.chi(ideal[:10])[5]
        wrapped = turned(real, np.pi), turned(ideal, np.pi)
        assert abs(dh.chi(wrapped[0][:10])[5] - dh.chi(wrapped[1][:10])[5]) > 6.0
        np.testing.assert_allclose(law(model, *wrapped, nominal, K, SIGMA),
                                   law(model, real, ideal, nominal, K, SIGMA), atol=1e-9)


# The error dynamics that it promises --------------------------------------------------------------


def flow(state: np.ndarray, acceleration: np.ndarray, s: float) -> np.ndarray:
    """Returns (𝔮, ζ) to first order in the time s."""
    config, zeta = np.split(state, 2)
    rate = uv.configuration_rate(config, zeta)
    return np.concatenate([config + s * rate, zeta + s * acceleration])


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
        return np.concatenate([uv.configuration_rate(state[:10], state[10:]), zeta_dot])

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
            uv.Resolved(K, SIGMA).command(
                model, now.given(contact=contact), lambda a=acceleration: a, not_asked).u
            + model.drift(state[:10], state[10:], contact if contact is None else true)
            for contact in (None, true, true + off))
        np.testing.assert_allclose(exact, known, rtol=1e-9, atol=1e-9)
        kinematics = model.kinematics(state[:10])
        np.testing.assert_allclose(wrong - exact, np.linalg.solve(
            model.mass_matrix(kinematics), kinematics.J_chi.T @ off), rtol=1e-8, atol=1e-9)


# Its closed loop, whatever thrusters do -----------------------------------------------------------


LAW = uv.laws.TipFirst(BlockGains(1.5, 0.4), BlockGains(20.0, 10.0))
ROWS = np.array([0, 1, 2, 9])  # x, y, z, q4
RATES, SIGMAS = np.repeat([1.5, 20.0], [6, 4]), np.repeat([0.4, 10.0], [6, 4])
WRENCH = np.array([30.0, -20.0, 5.0, 2.0, -8.0, 10.0])  # nothing that the law would ask for


def output(model, state: np.ndarray) -> np.ndarray:
    """Returns (y, ẏ), typed again."""
    config, zeta = np.split(state, 2)
    rate = model.task_jacobian(config) @ zeta
    return np.concatenate([
        config[:6], dh.chi(config)[:3], config[9:], uv.configuration_rate(config, zeta)[:6],
        rate[:3], zeta[9:]])


def left(model, derivative, state, nominal, nominal_zeta_dot, tau, d=0.0, contact=None
         ) -> np.ndarray:
    """Returns ë + (k + σ)ė + kσe (10,) under τ and d, by differences along the flow."""
    zeta_dot = model.drift(state[:10], state[10:], contact) + np.linalg.solve(
        model.mass_matrix(model.kinematics(state[:10])), tau) + d

    def deviation(s):
        return output(model, flow(state, zeta_dot, s)) - output(
            model, flow(nominal, nominal_zeta_dot, s))

    e, e_dot = np.split(deviation(0.0), 2)
    assert np.linalg.norm(e) > 0.01
    return derivative(deviation)[10:] + (RATES + SIGMAS) * e_dot + RATES * SIGMAS * e


def command(model, state, nominal, acceleration, law=LAW, **known) -> np.ndarray:
    """Returns τ."""
    now = pair_of(model, state, nominal).given(**known)
    return law.command(model, now, lambda: acceleration, not_asked).tau


def jacobian(model, state: np.ndarray) -> np.ndarray:
    """Returns J_y by complex steps of y along unit velocities."""
    return outputs_of(pair_of(model, state, state), ROWS).J[0]


@pytest.mark.parametrize("where", ["free", "skin", "deep"])
def test_every_row_is_a_loop_of_its_own_where_the_actuators_give_what_is_asked_for(
        model, states, derivative, where):
    for state, nominal, acceleration, d in pairs(model, states, where):
        tau = command(model, state, nominal, acceleration)
        np.testing.assert_allclose(
            left(model, derivative, state, nominal, acceleration, tau, d),
            jacobian(model, state) @ d, atol=1e-6)


@pytest.mark.parametrize("where", ["free", "deep"])
def test_the_tip_obeys_its_rows_whatever_the_thrusters_give(model, states, derivative, where):
    """Also where one of them is dead: the wrench is independent of the commanded one."""
    for state, nominal, acceleration, d in pairs(model, states, where):
        asked = command(model, state, nominal, acceleration)
        tau = command(model, state, nominal, acceleration, wrench=WRENCH)
        np.testing.assert_allclose(tau[:6], asked[:6], rtol=1e-9)
        assert np.linalg.norm(tau[6:] - asked[6:]) > 0.1
        rows = left(model, derivative, state, nominal, acceleration,
                    np.concatenate([WRENCH, tau[6:]]), d)
        expected = jacobian(model, state) @ d
        np.testing.assert_allclose(rows[6:], expected[6:], atol=1e-6)
        assert np.linalg.norm(rows[:6] - expected[:6]) > 0.1


@pytest.mark.parametrize("wrench", [None, WRENCH])
def test_without_a_roll_thruster_all_other_rows_are_as_before(model, states, derivative, wrench):
    law = replace(LAW, undriven=["roll"])
    state, nominal, acceleration, d = next(pairs(model, states, "free"))
    tau = command(model, state, nominal, acceleration, law, wrench=wrench)
    assert tau[3] == 0.0
    real = tau if wrench is None else np.concatenate([wrench, tau[6:]])
    rows = left(model, derivative, state, nominal, acceleration, real, d)
    loops = [0, 1, 2, 4, 5, 6, 7, 8, 9] if wrench is None else [6, 7, 8, 9]
    np.testing.assert_allclose(rows[loops], (jacobian(model, state) @ d)[loops], atol=1e-6)
    assert abs(rows[3] - (jacobian(model, state) @ d)[3]) > 0.01


def test_an_error_of_the_measured_force_or_of_the_wrench_is_a_disturbance(
        model, states, derivative):
    """By M⁻¹Jᵀ(𝔉_s − 𝔉) and M⁻¹(ε, 0), and no other way."""
    rng = np.random.default_rng(3)
    state, nominal, acceleration, _ = next(pairs(model, states, "deep"))
    off, epsilon = rng.normal(size=6), rng.normal(size=6)
    kinematics = model.kinematics(state[:10])
    M = model.mass_matrix(kinematics)
    true = rng.normal(size=6) * [30.0, 30.0, 30.0, 1.0, 1.0, 1.0]
    tau = command(model, state, nominal, acceleration, contact=true + off, wrench=WRENCH)
    real = np.concatenate([WRENCH + epsilon, tau[6:]])
    d = np.linalg.solve(M, kinematics.J_chi.T @ off + np.concatenate([epsilon, np.zeros(4)]))
    rows = left(model, derivative, state, nominal, acceleration, real, contact=true)
    np.testing.assert_allclose(rows[6:], (jacobian(model, state) @ d)[6:], atol=1e-6)


def test_the_estimate_is_taken_from_each_row(model, states, derivative):
    state, nominal, acceleration, _ = next(pairs(model, states, "free"))
    estimate = np.linspace(-0.2, 0.3, 10)
    tau = command(model, state, nominal, acceleration, estimate=estimate)
    np.testing.assert_allclose(left(model, derivative, state, nominal, acceleration, tau),
                               -estimate, atol=1e-6)


def test_at_a_singular_posture_it_refuses():
    """A stretched arm cannot pull its tip away."""
    axes, anchors = [[0, 0, 1], [0, 1, 0], [0, 1, 0]], [[0.5, 0, 0], [0.1, 0, 0], [0.3, 0, 0]]
    arm = tiny_robot(axes, anchors, (0.3, 0.0, 0.0))
    bent = np.zeros(18)
    bent[7:9] = 0.3, 0.5
    assert np.isfinite(command(arm, bent, bent, np.zeros(9))).all()
    with pytest.raises(RunFailed, match=r"singular posture of its rows \(ancillary.rows\)"):
        command(arm, 0.0 * bent, 0.0 * bent, np.ones(9))


def test_the_rows_are_the_position_and_what_the_arm_holds_best(model):
    np.testing.assert_array_equal(tip_rows(model), ROWS)
    np.testing.assert_array_equal(tip_rows(model, ("q4", "y", "z", "roll")), [1, 2, 3, 9])
    np.testing.assert_array_equal(tip_rows(turret(1.0)), [6])
    axes = [[0, 0, 1], [0, 1, 0], [0, 1, 0], [1, 0, 0], [0, 1, 0], [1, 0, 0], [0, 1, 0]]
    for n, count in ((3, 3), (5, 3), (6, 6), (7, 6)):
        rows = tip_rows(tiny_robot(axes[:n], [[0.3, 0.0, 0.0]] * n, (0.3, 0.0, 0.1)))
        np.testing.assert_array_equal(rows[:count], np.arange(count))
        assert len(set(rows)) == n
