"""Tests of `papers.nikou2018.errata.cost`: right by another way, correct values pass."""


import numpy as np
import pytest

from uvms_drake.model.uvms_model import configuration_rate_matrix
from uvms_drake.papers.nikou2018.errata import cost
from uvms_drake.papers.nikou2018.errata.paper import (
    CHI_DES,
    PITCH_LIMIT,
    best_posture,
    configuration,
    is_allowed,
    robot,
    smallest_eigenvalue,
)

pytestmark = pytest.mark.long


def test_e6_the_loop_rests_near_the_least_stage_cost_and_the_hold_input_is_not_flagged():
    """A long horizon rests where the stage cost of a rest is least; this one is 3 s."""
    ocp, surface = cost.spring_ocp()
    at = cost.rest_point(ocp, surface, np.zeros(10))
    assert at.speed < 1e-4
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
    assert at.tip == pytest.approx(np.linalg.norm((y - ocp.y_des)[:3]), rel=0.25)
    K = model.surface.stiffness
    assert at.force == pytest.approx(np.linalg.norm((K @ (y - ocp.y_des)[:6])[:3]), rel=0.25)
    assert not cost.hold_input(fraction=1.0).wrong


def test_e7_gains_exist_from_an_eigenvalue_of_one_on():
    c = np.linspace(0.0, 5.0, 50_001)[1:]
    for J_min in (0.2, 0.5095, 0.99, 1.01, 1.3, 2.0):
        fits = c[c >= 0.5 + 0.5 * c**2 / J_min]
        gains = cost.decrease_gains(J_min)
        assert (gains is None) == (len(fits) == 0)
        if gains is not None:
            np.testing.assert_allclose(gains, (fits[0], fits[-1]), atol=2e-4)
    assert not cost.terminal_penalty(J_min=1.2).wrong


def test_e7_no_velocity_does_better_than_the_least_increase():
    _, q = best_posture()
    J = robot().kinematics(configuration(CHI_DES, q)).J_chi
    least = cost.least_increase(J)
    assert least > 0.0
    e = np.linalg.eigh(J @ J.T).eigenvectors[:, 0]
    rng = np.random.default_rng(0)
    zeta = -J.T @ e + rng.normal(size=(1000, 10)) * rng.choice([0.0, 1e-2, 1.0], (1000, 1))
    rate = zeta @ J.T @ e + 0.5 + 0.5 * np.sum(zeta**2, axis=1)
    assert np.min(rate) == pytest.approx(least, rel=1e-9)


def test_e7_the_best_posture_is_allowed_and_no_random_one_is_better():
    best, q = best_posture()
    assert is_allowed(configuration(CHI_DES, q))
    rng = np.random.default_rng(7)
    others = configuration(CHI_DES, rng.uniform(robot().q_lower, robot().q_upper, (5000, 4)))
    others = others[np.abs(others[:, 4]) <= PITCH_LIMIT]
    assert np.max(smallest_eigenvalue(others)) < best < 1.0
