"""Tests of `uvms_drake.control.laws.tip_first`: its closed loop, whatever thrusters do."""

from dataclasses import replace

import numpy as np
import pytest
from support import dh
from support.laws import not_asked, pairs
from support.tiny_robots import tiny_robot, turret

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.control.laws import TipFirst
from uvms_drake.control.laws.law import pair_of
from uvms_drake.control.laws.outputs import outputs_of, tip_rows
from uvms_drake.control.laws.tip_first import BlockGains
from uvms_drake.model.uvms_model import configuration_rate

LAW = TipFirst(BlockGains(1.5, 0.4), BlockGains(20.0, 10.0))
ROWS = np.array([0, 1, 2, 9])  # x, y, z, q4
K, SIGMA = np.repeat([1.5, 20.0], [6, 4]), np.repeat([0.4, 10.0], [6, 4])
WRENCH = np.array([30.0, -20.0, 5.0, 2.0, -8.0, 10.0])  # nothing that the law would ask for


def flow(state: np.ndarray, acceleration: np.ndarray, s: float) -> np.ndarray:
    """Returns (𝔮, ζ) to first order in the time s."""
    config, zeta = np.split(state, 2)
    return np.concatenate([config + s * configuration_rate(config, zeta), zeta + s * acceleration])


def output(model, state: np.ndarray) -> np.ndarray:
    """Returns (y, ẏ), typed again."""
    config, zeta = np.split(state, 2)
    rate = model.task_jacobian(config) @ zeta
    return np.concatenate([
        config[:6], dh.chi(config)[:3], config[9:], configuration_rate(config, zeta)[:6],
        rate[:3], zeta[9:]])


def left(model, derivative, state, nominal, zeta_dot, nominal_zeta_dot) -> np.ndarray:
    """Returns ë + (k + σ)ė + kσe (10,), by differences along the flow."""
    def deviation(s):
        return output(model, flow(state, zeta_dot, s)) - output(
            model, flow(nominal, nominal_zeta_dot, s))

    e, e_dot = np.split(deviation(0.0), 2)
    assert np.linalg.norm(e) > 0.01
    return derivative(deviation)[10:] + (K + SIGMA) * e_dot + K * SIGMA * e


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
        zeta_dot = model.drift(state[:10], state[10:]) + np.linalg.solve(
            model.mass_matrix(model.kinematics(state[:10])), tau) + d
        np.testing.assert_allclose(
            left(model, derivative, state, nominal, zeta_dot, acceleration),
            jacobian(model, state) @ d, atol=1e-6)


@pytest.mark.parametrize("where", ["free", "deep"])
def test_the_tip_obeys_its_rows_whatever_the_thrusters_give(model, states, derivative, where):
    """Also where one of them is dead: the wrench is independent of the commanded one."""
    for state, nominal, acceleration, d in pairs(model, states, where):
        asked = command(model, state, nominal, acceleration)
        tau = command(model, state, nominal, acceleration, wrench=WRENCH)
        np.testing.assert_allclose(tau[:6], asked[:6], rtol=1e-9)
        assert np.linalg.norm(tau[6:] - asked[6:]) > 0.1
        real = np.concatenate([WRENCH, tau[6:]])
        zeta_dot = model.drift(state[:10], state[10:]) + np.linalg.solve(
            model.mass_matrix(model.kinematics(state[:10])), real) + d
        rows = left(model, derivative, state, nominal, zeta_dot, acceleration)
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
    zeta_dot = model.drift(state[:10], state[10:]) + np.linalg.solve(
        model.mass_matrix(model.kinematics(state[:10])), real) + d
    rows = left(model, derivative, state, nominal, zeta_dot, acceleration)
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
    zeta_dot = model.drift(state[:10], state[10:], true) + np.linalg.solve(M, real)
    d = np.linalg.solve(M, kinematics.J_chi.T @ off + np.concatenate([epsilon, np.zeros(4)]))
    rows = left(model, derivative, state, nominal, zeta_dot, acceleration)
    np.testing.assert_allclose(rows[6:], (jacobian(model, state) @ d)[6:], atol=1e-6)


def test_the_estimate_is_taken_from_each_row(model, states, derivative):
    state, nominal, acceleration, _ = next(pairs(model, states, "free"))
    estimate = np.linspace(-0.2, 0.3, 10)
    tau = command(model, state, nominal, acceleration, estimate=estimate)
    zeta_dot = model.drift(state[:10], state[10:]) + np.linalg.solve(
        model.mass_matrix(model.kinematics(state[:10])), tau)
    np.testing.assert_allclose(left(model, derivative, state, nominal, zeta_dot, acceleration),
                               -estimate, atol=1e-6)


def test_the_generalised_jacobian_is_how_the_tip_moves_from_a_free_vehicle(model, states):
    """J_g = J_sq − J_sv M_vv⁻¹ M_vq, by joint torques alone, from rest: J_s ζ̇ = J_g q̈.

    Its determinant decides (A).
    """
    for state in states["free"]:
        kinematics = model.kinematics(state[:10])
        M, J_s = model.mass_matrix(kinematics), jacobian(model, state)[6:]
        J_g = J_s[:, 6:] - J_s[:, :6] @ np.linalg.solve(M[:6, :6], M[:6, 6:])
        zeta_dot = np.linalg.solve(M, np.eye(10)[:, 6:])
        np.testing.assert_allclose(J_s @ zeta_dot, J_g @ zeta_dot[6:], rtol=1e-9, atol=1e-12)
        whole = np.linalg.det(np.concatenate([M[:6], J_s]))
        assert whole == pytest.approx(np.linalg.det(M[:6, :6]) * np.linalg.det(J_g), rel=1e-9)


def test_at_a_singular_posture_it_refuses():
    """A stretched arm cannot pull its tip away."""
    axes, anchors = [[0, 0, 1], [0, 1, 0], [0, 1, 0]], [[0.5, 0, 0], [0.1, 0, 0], [0.3, 0, 0]]
    arm = tiny_robot(axes, anchors, (0.3, 0.0, 0.0))
    bent = np.zeros(18)
    bent[7:9] = 0.3, 0.5
    assert np.isfinite(command(arm, bent, bent, np.zeros(9))).all()
    with pytest.raises(InvalidParameter, match=r"rows = 'at the joint angles .* singular postures"):
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
