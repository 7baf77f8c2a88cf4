"""Tests of `papers.nikou2018.errata.simulation`: right by another computation."""

import math

import numpy as np
import pytest
from support import dh

from uvms_drake.model.uvms_model import configuration_rate_matrix
from uvms_drake.papers.nikou2018.errata import simulation
from uvms_drake.papers.nikou2018.errata.paper import (
    CHI_DES,
    CHI_START,
    PITCH_LIMIT,
    Q_DES,
    Q_START,
    Q_START_OTHER,
    best_posture,
    configuration,
    estimated_J_min,
    is_allowed,
    robot,
    smallest_eigenvalue,
)
from uvms_drake.station.problem import make_ocp
from uvms_drake.station.scenario.scenario import load_scenario

pytestmark = pytest.mark.long


def test_e8_the_printed_numbers():
    text = simulation.simulation_numbers().computed
    assert "reaches 0.49" in text  # 0.2√6
    assert "σ > 5.55" in text  # 2√2/0.5095
    assert "gives 0.0455" in text  # 0.2/(3.084·0.5095 + 2√2)
    assert "makes the tube infinite" in text
    assert 0.2 * math.sqrt(6.0) == pytest.approx(0.4899, abs=1e-4)
    assert 0.2 / (3.084 * 0.5095 + 2.0 * math.sqrt(2.0)) == pytest.approx(0.0455, abs=5e-5)


def test_e8_consistent_numbers_are_not_flagged_and_each_wrong_one_is():
    good = simulation.TubeNumbers(amplitude=0.2 / math.sqrt(6.0), w_bound=0.2, sigma=5.0,
                                  J_min=0.41, L_c=1.0, radius=0.2 / (5.0 * 0.41 - 1.0))
    assert not simulation.simulation_numbers(good).wrong
    for change in ({"amplitude": 0.2}, {"sigma": 2.0}, {"radius": 0.0656}, {"J_min": 0.5095}):
        assert simulation.simulation_numbers(good._replace(**change)).wrong


def test_e8_the_smallest_eigenvalue_by_the_papers_table():
    """No sample is below the estimate, and J there is that of finite differences of the table."""
    found = estimated_J_min()
    assert found == pytest.approx(0.411, abs=2e-3)
    rng = np.random.default_rng(5)
    edge = np.array([np.pi, PITCH_LIMIT])
    config = np.zeros((5000, 10))
    config[:, 3:5] = rng.uniform(-edge, edge, (5000, 2))
    config[:, 6:] = rng.uniform(dh.LOWER, dh.UPPER, (5000, 4))
    values = smallest_eigenvalue(config)
    assert found < np.min(values) < 0.5095
    worst = config[np.argmin(values)]
    Gamma = configuration_rate_matrix(worst)
    J = np.array([(dh.chi(worst + 1e-6 * step) - dh.chi(worst - 1e-6 * step)) / 2e-6
                  for step in Gamma.T]).T
    assert np.linalg.eigvalsh(J @ J.T)[0] == pytest.approx(np.min(values), rel=1e-5)


def test_e8_the_jacobian_grows_as_the_end_effector_points_up_or_down():
    grown = simulation.norm_at_tip_pitch(-1.56) / simulation.norm_at_tip_pitch(-1.4)
    assert grown == pytest.approx(math.cos(1.4) / math.cos(1.56), rel=0.02)


def test_e10_the_papers_poses_by_the_papers_table():
    assert dh.chi(np.zeros(10))[4] == pytest.approx(-np.pi / 2)
    level = [([-2.057, 1.017, -1.184, 0.0, 0.0, np.pi / 12], Q_START, CHI_START),
             ([-0.972, 0.0, 0.058, 0.0, 0.0, 0.0], Q_DES, CHI_DES)]
    for eta, q, chi in level:
        np.testing.assert_allclose(dh.chi(np.concatenate([eta, q])), chi, atol=1e-3)
    assert not simulation.initial_configuration(Q_START, Q_START).wrong
    assert not simulation.initial_configuration(Q_START, Q_START + [2.0, 0.0, 0.0, 0.0]).wrong


def test_e9_the_deviation_of_one_sample_is_the_jump():
    sigma, w = 3.084, 0.2
    (jump, off), (own_jump, own_off) = simulation.hold(True), simulation.hold(False)
    assert jump == pytest.approx(w / sigma * (1.0 - math.exp(-0.1 * sigma)), rel=1e-9)
    assert own_jump == 0.0
    assert own_off == pytest.approx(
        w / sigma * (1.0 - math.exp(-sigma * 0.1 * simulation.HOLDING)), rel=1e-6)
    assert off > 2.0 * w / sigma
    assert not simulation.initial_state(measured=False).wrong


def test_e11_plans_from_elsewhere_end_no_closer():
    """The smallest ε from the level vehicle is a local optimum; four random starts find it too."""
    mpc = simulation.printed_mpc(1e-3)
    radius, _, violation = simulation.reach(Q_START, simulation.TINY)
    assert violation < 1e-6
    start = configuration(CHI_START, Q_START)
    rng = np.random.default_rng(0)
    for _ in range(4):
        plan = mpc.solve(mpc.plan(start, 0.5 * rng.normal(size=(7, 10))), 40)
        end = dh.chi(plan.config[-1]) - CHI_DES
        assert math.sqrt(0.5) * np.linalg.norm(end) == pytest.approx(radius, rel=0.02)


def test_e11_the_other_configuration_arrives_within_the_printed_limits():
    mpc = simulation.printed_mpc(simulation.TINY)
    plan = mpc.solve(mpc.resting(configuration(CHI_START, Q_START_OTHER)), 50)
    np.testing.assert_allclose(dh.chi(plan.config[0]), CHI_START, atol=1e-9)
    assert np.linalg.norm(dh.chi(plan.config[-1]) - CHI_DES) < 1e-3
    assert len(plan.zeta) == 7
    for part in (slice(0, 3), slice(3, 6), slice(6, 10)):
        assert np.max(np.linalg.norm(plan.zeta[:, part], axis=1)) < 2.0 + 1e-6
    assert all(is_allowed(config) for config in plan.config)
    # It is farther than a point that moves at 2 m/s gets.
    assert np.linalg.norm(CHI_START[:3] - CHI_DES[:3]) > 2.0 * 0.7
    assert not simulation.first_horizon(Q_START, Q_START).wrong
    assert not simulation.first_horizon(Q_START_OTHER, Q_START_OTHER).wrong


def test_e6_the_loop_rests_near_the_least_stage_cost_and_the_hold_input_is_not_flagged():
    """A long horizon settled where the stage cost of a rest is least; this one is 3 s."""
    errors, force, _, speed = simulation.settled(0.0)
    assert speed < 1e-4
    ocp = make_ocp(load_scenario("girona500_bilateral"))
    model, size, y = ocp.model, 10, ocp.y_des.copy()
    weight_y, weight_u = np.sqrt(np.diag(ocp.Q)[:size]), np.sqrt(np.diag(ocp.R))
    for _ in range(20):  # Gauss and Newton
        config = model.configuration(y)
        f, by_config, _ = model.drift_derivatives(config[None], np.zeros((1, size)))
        f_y = by_config[0] @ configuration_rate_matrix(config) @ np.linalg.inv(
            model.task_jacobian(config))
        A = np.concatenate([np.diag(weight_y), weight_u[:, None] * f_y])
        b = np.concatenate([weight_y * (y - ocp.y_des), weight_u * f[0]])
        y = y - np.linalg.lstsq(A, b, rcond=None)[0]
    assert np.linalg.norm(errors[-1, :3]) == pytest.approx(
        np.linalg.norm((y - ocp.y_des)[:3]), rel=0.25)
    K = model.surface.stiffness
    assert np.linalg.norm(force) == pytest.approx(
        np.linalg.norm((K @ (y - ocp.y_des)[:6])[:3]), rel=0.25)
    assert not simulation.hold_input(fraction=1.0).wrong


def test_e7_gains_exist_from_an_eigenvalue_of_one_on():
    c = np.linspace(0.0, 5.0, 50_001)[1:]
    for J_min in (0.2, 0.5095, 0.99, 1.01, 1.3, 2.0):
        fits = c[c >= 0.5 + 0.5 * c**2 / J_min]
        gains = simulation.decrease_gains(J_min)
        assert (gains is None) == (len(fits) == 0)
        if gains is not None:
            np.testing.assert_allclose(gains, (fits[0], fits[-1]), atol=2e-4)
    assert not simulation.terminal_penalty(J_min=1.2).wrong


def test_e7_no_velocity_does_better_and_no_allowed_posture():
    best, q = best_posture()
    assert is_allowed(configuration(CHI_DES, q))
    rng = np.random.default_rng(7)
    others = configuration(CHI_DES, rng.uniform(robot().q_lower, robot().q_upper, (5000, 4)))
    others = others[np.abs(others[:, 4]) <= PITCH_LIMIT]
    assert np.max(smallest_eigenvalue(others)) < best < 1.0
    J = robot().kinematics(configuration(CHI_DES, q)).J_chi
    e = np.linalg.eigh(J @ J.T).eigenvectors[:, 0]
    zeta = -J.T @ e + rng.normal(size=(1000, 10)) * rng.choice([0.0, 1e-2, 1.0], (1000, 1))
    rate = zeta @ J.T @ e + 0.5 + 0.5 * np.sum(zeta**2, axis=1)
    assert np.min(rate) == pytest.approx(simulation.least_increase(J), rel=1e-9)
    assert simulation.least_increase(J) > 0.0
