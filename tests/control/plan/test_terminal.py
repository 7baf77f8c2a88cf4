"""Tests of `control.plan.terminal`, at the task of the ideal scenario: 20 N on a wall."""

from typing import NamedTuple

import numpy as np
import pytest
from support.robots import copied

import uvms_drake as uv
from uvms_drake.command.main import main
from uvms_drake.control.plan.plan import advance
from uvms_drake.control.plan.terminal import (
    INFLATION,
    LARGEST_GROWTH,
    linear_regulator,
    terminal_ingredients,
)
from uvms_drake.model.uvms_model import configuration_rate_matrix


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
    assert ocp.terminal.radius == uv.load_scenario("girona500_ideal").mpc.terminal_radius


def test_without_inflation_the_penalty_solves_the_riccati_equation(loop):
    """P = A'ᵀPA' − A'ᵀPB(R + BᵀPB)⁻¹BᵀPA' + Q with A' = A + BF."""
    A, B, P = loop.A + loop.B @ loop.F, loop.B, loop.P
    gain = np.linalg.solve(loop.R + B.T @ P @ B, B.T @ P @ A)
    residual = A.T @ P @ A - A.T @ P @ B @ gain + loop.Q - P
    assert np.max(np.abs(residual)) < 1e-9 * np.max(np.abs(P))
    np.testing.assert_allclose(loop.gain, loop.F - gain, rtol=1e-7, atol=1e-7)
    np.testing.assert_array_equal(P, P.T)
    assert np.linalg.eigvalsh(P)[0] > 0.0


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


# The regulator of a cost about Fξ, against brute force and a higher precision ---------------------


H = 0.2
"""Length of a step [s]."""
CASE = "damping_called_stiffness/stiff_elbow"


def chain(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Returns A and B of n double integrators."""
    eye = np.eye(n)
    return (np.block([[eye, H * eye], [np.zeros((n, n)), eye]]),
            np.concatenate([0.5 * H**2 * eye, H * eye]))


def exact(A, B, F, Q, R, steps: int) -> np.ndarray:
    """Returns P of a horizon of many steps, by the Riccati recursion in extended precision.

    P⁺ = Q + FᵀRF + AᵀPA − (AᵀPB − FᵀR)(R + BᵀPB)⁻¹(BᵀPA − RF), of one input, so that the inverse
    is a division.
    """
    A, B, F, Q, R = (np.asarray(each, dtype=np.longdouble) for each in (A, B, F, Q, R))
    P = np.zeros_like(Q)
    for _ in range(steps):
        cross = B.T @ P @ A - R @ F
        P = Q + F.T @ R @ F + A.T @ P @ A - cross.T @ cross / (R + B.T @ P @ B)[0, 0]
        P = 0.5 * (P + P.T)
    return P.astype(float)


@pytest.mark.parametrize(("spring", "damping"), [
    (0.0, 5.0), (0.0, 600.0), (0.0, 2333.65), (2e4, 0.0), (5e4, 300.0), (0.0, -900.0)])
def test_it_is_the_limit_of_long_horizons(spring, damping):
    """Of one joint, ζ̇ = u − k y − D ζ, on both sides of the largest growth; one is unstable."""
    (A, B), F = chain(1), np.array([[-spring, -damping]])
    Q, R = np.diag([4.0, 2.0]), np.array([[0.05]])
    found = linear_regulator(A, B, F, Q, R)
    P = exact(A, B, F, Q, R, 20_000)
    assert np.max(np.abs(found.P - P)) < 1e-7 * np.max(np.abs(P))
    gain = -np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A - R @ F)
    np.testing.assert_allclose(found.gain, gain, rtol=1e-5, atol=1e-8)


def test_below_and_above_the_largest_growth_it_is_one_function():
    """The cost of one joint changes smoothly with its damping where the method changes."""
    (A, B), Q, R = chain(1), np.diag([4.0, 2.0]), np.array([[0.05]])
    edge = (LARGEST_GROWTH + 1.0) / H  # |1 − hD| = the largest growth.
    below, above = (linear_regulator(A, B, np.array([[0.0, -edge * (1.0 + step)]]), Q, R).P
                    for step in (-1e-9, 1e-9))
    np.testing.assert_allclose(below, above, rtol=1e-7)


def test_nothing_is_told_that_floating_point_cannot_tell():
    A, B = chain(3)
    rough = np.random.default_rng(0).normal(size=(3, 3))
    F = np.concatenate([-1e12 * rough @ rough.T, np.zeros((3, 3))], axis=1)
    assert linear_regulator(A, B, F, np.eye(6), np.eye(3)) is None


def test_a_refusal_names_the_mode_and_its_cause():
    """Of a spring in sway, and of one joint's damping beside it: the faster one."""
    eye, stiff = np.eye(8), np.zeros((8, 8))
    stiff[1, :2] = stiff[0, :2] = -1e14
    for f_y, f_zeta, expected in (
            (stiff, np.zeros((8, 8)), "stiffness there, of the surface or of weight"),
            (stiff, np.diag([0.0] * 7 + [-1e9]), r"1e\+09 1/s, which moves q2 most, by the damping "
             "there, viscous")):
        with pytest.raises(uv.InvalidParameter, match=expected):
            terminal_ingredients(eye, f_y, f_zeta, np.eye(16), np.eye(8), H, 0.3)


# A joint of much damping and little inertia -------------------------------------------------------


@pytest.fixture
def pressing(tmp_path):
    """Returns the file of the first scenario of the robot with the stiff elbow."""
    copied(CASE, tmp_path)
    file = tmp_path / "press.yaml"
    assert main(["scenario", "--uncertified", "--new", str(file), "--robot",
                 str(tmp_path / "stiff_elbow"), "--force", "10"]) == 0
    return file


@pytest.mark.parametrize("stiffness", [1000, 10])
def test_what_is_written_for_a_joint_of_much_damping_runs(stiffness, pressing, tmp_path):
    """The loop decays by exp(−hD/M), whatever the surface, and |1 − hD/M| is large."""
    scenario = uv.load_scenario(str(pressing), [f"surface.stiffness={stiffness}"])
    ocp = uv.make_ocp(scenario)
    config, rest = ocp.model.configuration(ocp.y_des), np.zeros(8)
    rate = -ocp.model.drift_derivatives(config[None], rest[None])[2][0][7, 7]
    M = uv.UvmsModel(uv.read_uvms(scenario.model)).mass_matrix(ocp.model.kinematics(config))
    assert rate == pytest.approx(300.0 * np.linalg.inv(M)[7, 7], rel=1e-6)
    assert H * rate - 1.0 > 400.0
    assert main(["run", str(pressing), "--uncertified", "--duration", "0.5", "--no-figures",
                 "--no-replay", "--quiet", "--set", f"surface.stiffness={stiffness}",
                 "--output", str(tmp_path / "out")]) == 0


def test_it_presses_with_its_force_and_within_its_tolerance(pressing, tmp_path):
    assert main(["run", str(pressing), "--uncertified", "--duration", "6", "--no-figures",
                 "--no-replay", "--quiet", "--output", str(tmp_path / "out")]) == 0
    with np.load(tmp_path / "out" / "log.npz") as log:
        late = log["time"] > 4.0
        assert np.max(np.abs(log["force"][late, 0] - 10.0)) < 1.0
