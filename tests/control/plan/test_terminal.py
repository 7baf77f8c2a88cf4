"""Tests of `control.plan.terminal`, at the task of the ideal scenario: 20 N on a wall."""

from typing import NamedTuple

import numpy as np
import pytest

from uvms_drake.control.plan.plan import advance
from uvms_drake.control.plan.terminal import INFLATION, LARGEST_GROWTH, terminal_ingredients
from uvms_drake.model.uvms_model import configuration_rate_matrix
from uvms_drake.station.scenario.scenario import load_scenario


class Loop(NamedTuple):
    """ξ⁺ = Aξ + Bζ̇ and ū − ū_eq = ζ̇ − Fξ, typed again from the documentation."""

    A: np.ndarray
    B: np.ndarray
    F: np.ndarray
    Q: np.ndarray
    R: np.ndarray
    P: np.ndarray
    gain: np.ndarray

    @property
    def closed(self) -> np.ndarray:
        return self.A + self.B @ self.gain

    def stage(self, xi: np.ndarray) -> np.ndarray:
        """Returns the stage cost under the terminal controller at states (..., 20)."""
        w = xi @ (self.gain - self.F).T
        return np.sum((xi @ self.Q) * xi, axis=-1) + np.sum((w @ self.R) * w, axis=-1)

    def value(self, xi: np.ndarray) -> np.ndarray:
        return np.sum((xi @ self.P) * xi, axis=-1)


@pytest.fixture(scope="module")
def loop(ocp) -> Loop:
    config = ocp.model.configuration(ocp.y_des)
    h, eye, zero = ocp.time_step, np.eye(10), np.zeros((10, 10))
    J = ocp.model.task_jacobian(config)
    _, f_config, f_zeta = ocp.model.drift_derivatives(config[None], np.zeros((1, 10)))
    f_y = f_config[0] @ configuration_rate_matrix(config) @ np.linalg.inv(J)
    terminal = terminal_ingredients(
        J, f_y, f_zeta[0], ocp.Q, ocp.R, h, radius=0.3, inflation=0.0)
    assert terminal.radius == 0.3
    return Loop(np.block([[eye, h * J], [zero, eye]]), np.vstack([0.5 * h**2 * J, h * eye]),
                np.hstack([f_y, f_zeta[0]]), h * ocp.Q, h * ocp.R, terminal.P, terminal.gain)


def test_the_problem_has_these_ingredients_with_an_inflated_penalty(ocp, loop):
    np.testing.assert_allclose(ocp.terminal.P, (1.0 + INFLATION) * loop.P, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(ocp.terminal.gain, loop.gain, rtol=1e-9, atol=1e-9)
    assert ocp.terminal.radius == load_scenario("girona500_ideal").mpc.terminal_radius


def test_without_inflation_the_penalty_solves_the_riccati_equation(loop):
    """P = A'ᵀPA' − A'ᵀPB(R + BᵀPB)⁻¹BᵀPA' + Q with A' = A + BF."""
    A, B, P = loop.A + loop.B @ loop.F, loop.B, loop.P
    gain = np.linalg.solve(loop.R + B.T @ P @ B, B.T @ P @ A)
    residual = A.T @ P @ A - A.T @ P @ B @ gain + loop.Q - P
    assert np.max(np.abs(residual)) < 1e-9 * np.max(np.abs(P))
    np.testing.assert_allclose(loop.gain, loop.F - gain, rtol=1e-7, atol=1e-7)
    np.testing.assert_array_equal(P, P.T)
    assert np.linalg.eigvalsh(P)[0] > 0.0


def test_the_terminal_controller_stabilises(loop):
    assert np.max(np.abs(np.linalg.eigvals(loop.closed))) < 1.0
    assert np.max(np.abs(np.linalg.eigvals(loop.A))) >= 1.0, "it has something to do"


def test_without_inflation_the_penalty_falls_by_the_stage_cost(loop):
    xi = np.random.default_rng(0).normal(size=(200, 20))
    fall = loop.value(xi) - loop.value(xi @ loop.closed.T)
    np.testing.assert_allclose(fall, loop.stage(xi), rtol=1e-7)
    assert np.all(fall > 0.0)


def test_without_inflation_the_penalty_is_the_cost_of_going_on_for_ever(loop):
    xi = np.random.default_rng(1).normal(size=(20, 20))
    expected, total = loop.value(xi), np.zeros(20)
    for _ in range(2000):
        total += loop.stage(xi)
        xi = xi @ loop.closed.T
    np.testing.assert_allclose(total, expected, rtol=1e-6)


def robot_step(ocp, gain: np.ndarray, xi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns ξ⁺ and ū − ū_eq of the robot itself under the terminal controller."""
    model, h = ocp.model, ocp.time_step
    config, zeta, a = model.configuration(ocp.y_des + xi[:10]), xi[10:], gain @ xi
    y = model.task_pose(advance(config, zeta, a, h))
    after = np.concatenate([y - ocp.y_des, zeta + h * a])
    return after, a - model.drift(config, zeta) - ocp.u_eq


def test_the_linear_loop_is_that_of_the_robot_to_first_order(ocp, loop):
    """The error of ξ⁺ and of ū falls with the square of ξ."""
    direction = np.random.default_rng(2).uniform(-1.0, 1.0, size=20)
    errors = []
    for size in (1e-3, 1e-4):
        xi = size * direction
        after, u = robot_step(ocp, loop.gain, xi)
        errors.append([np.linalg.norm(after - loop.closed @ xi),
                       np.linalg.norm(u - (loop.gain - loop.F) @ xi)])
    ratio = np.array(errors[0]) / np.array(errors[1])
    np.testing.assert_allclose(ratio, 100.0, rtol=0.2)


def test_the_inflated_penalty_falls_by_more_than_the_stage_cost_of_the_robot(ocp, loop):
    """Near the equilibrium, third-order terms included, in 200 random directions."""
    P, worst_bare = ocp.terminal.P, -np.inf
    for direction in np.random.default_rng(3).normal(size=(200, 20)):
        xi = 1e-3 * direction / np.sqrt(direction @ P @ direction)
        after, u = robot_step(ocp, loop.gain, xi)
        stage = xi @ loop.Q @ xi + u @ loop.R @ u
        assert after @ P @ after - xi @ P @ xi <= -stage
        bare = loop.value(after) - loop.value(xi) + stage
        worst_bare = max(worst_bare, bare / stage)
    assert worst_bare > 0.0, "without inflation it does not"


def test_a_loop_is_stabilised_whatever_it_would_grow_by(ocp, loop):
    """A + BF is about h·f_ζ in all coordinates: unstable, by 50 to 20 000 times a step."""
    J, h = loop.A[:10, 10:] / ocp.time_step, ocp.time_step
    for growth in (0.5 * LARGEST_GROWTH, 2.0 * LARGEST_GROWTH, 200.0 * LARGEST_GROWTH):
        f_zeta = growth / h * np.eye(10)
        found = terminal_ingredients(J, np.zeros((10, 10)), f_zeta, ocp.Q, ocp.R, h, 0.3, 0.0)
        closed = loop.A + loop.B @ found.gain
        assert np.max(np.abs(np.linalg.eigvals(closed))) < 1.0
        w = found.gain - np.hstack([np.zeros((10, 10)), f_zeta])
        residual = closed.T @ found.P @ closed + loop.Q + w.T @ loop.R @ w - found.P
        assert np.max(np.abs(residual)) < 1e-8 * np.max(np.abs(found.P))
