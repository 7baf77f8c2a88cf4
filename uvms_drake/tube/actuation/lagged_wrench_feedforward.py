"""Feedforward of the vehicle's rows under `tip first`, behind thrusters that lag.

The parts of τ_c in (2) of `lagged_wrench`, and their rates: on a plan, and by errors.
"""

from dataclasses import dataclass, field

import numpy as np

from uvms_drake.model.frames.spatial import times
from uvms_drake.model.uvms_model import configuration_rate
from uvms_drake.tube.actuation.zoh_command_rates import STEP, PlanProblem, ZohCommandProblem
from uvms_drake.tube.rows.remainders import configuration_of, output_bias, output_jacobian


@dataclass(frozen=True)
class LaggedWrenchProblem(ZohCommandProblem):
    """Feedforward of the vehicle's rows off the plan; errors are (x, ẋ, ẍ, w_q, F̂).

    x_q, its rates and w_q are the tip's rows in joint angles. Values are, by blocks of rows and
    less those on the plan: Aτ_J; Aτ̇ of τ_J and τ_w; and of τ_φ and J_EvᵀF̂, at constant ζ̄̇, w_s
    and F̂.
    """

    @property
    def errors(self) -> int:
        """Number of components of the errors."""
        return 4 * self.size

    @property
    def channels(self) -> list[slice]:
        """Channels of the blocks."""
        return [slice(i, i + 3) for i in range(0, 18, 3)]

    def values(self, x: np.ndarray, error: np.ndarray) -> np.ndarray:
        """Returns the values (..., 18)."""
        model, rows, size = self.model, self.rows, self.size
        config_bar, zeta_bar, rate_bar = self.plan(x)
        by_x, by_rate, by_acceleration, inputs = (
            error[..., i * size: (i + 1) * size] for i in range(4))
        w, wrench = inputs[..., : size - 6], inputs[..., size - 6:]

        def whole(J: np.ndarray, each: np.ndarray) -> np.ndarray:
            """Returns errors in joint angles, in rows."""
            each = np.broadcast_to(each, (*J.shape[:-2], size))
            return np.concatenate([each[..., :6], times(J[..., 6:, 6:], each[..., 6:])], axis=-1)

        # The real state, its acceleration and the feedback of the tip, from the errors.
        kinematics = model.kinematics(config_bar)
        config = configuration_of(model, rows, config_bar, kinematics, by_x)
        J_bar = output_jacobian(model, config_bar, kinematics, rows)
        bias_bar = output_bias(config_bar, kinematics, zeta_bar, rows)
        kinematics = model.kinematics(config)
        J = output_jacobian(model, config, kinematics, rows)
        zeta = _solved(J, times(J_bar, zeta_bar) + whole(J, by_rate))
        rate = _solved(J, times(J_bar, rate_bar) + bias_bar + whole(J, by_acceleration)
                       - output_bias(config, kinematics, zeta, rows))
        w_s = times(J[..., 6:, 6:], w)

        def of_plan(step: float) -> tuple[np.ndarray, ...]:
            """Returns Ā, τ̄_J and τ̄_φ, and J̄_yζ̄̇ and J̄̇_yζ̄ that the real ones follow from."""
            at = config_bar + step * configuration_rate(config_bar, zeta_bar)
            fast, kinematics = zeta_bar + step * rate_bar, model.kinematics(at)
            J, M = output_jacobian(model, at, kinematics, rows), model.mass_matrix(kinematics)
            return (_map(M, J), times(M, rate_bar)[..., :6],
                    model.inverse_dynamics(kinematics, fast, 0.0 * fast)[..., :6],
                    times(J, rate_bar), output_bias(at, kinematics, fast, rows))

        def of_robot(step: float, commanded: np.ndarray, bias_bar: np.ndarray
                     ) -> tuple[np.ndarray, ...]:
            """Returns A, τ_J, τ_J + τ_w, and τ_φ + J_EvᵀF̂."""
            at = config + step * configuration_rate(config, zeta)
            fast, kinematics = zeta + step * rate, model.kinematics(at)
            J, M = output_jacobian(model, at, kinematics, rows), model.mass_matrix(kinematics)

            def carried(of_rows: np.ndarray) -> np.ndarray:
                return times(M, _solved(J, of_rows))[..., :6]

            jump = carried(commanded)
            arm = carried(np.concatenate(
                [0.0 * commanded[..., :6] + 0.0 * w_s[..., :1], w_s], axis=-1))
            smooth = carried(bias_bar - output_bias(at, kinematics, fast, rows))
            smooth = smooth + model.inverse_dynamics(kinematics, fast, 0.0 * fast)[..., :6]
            J_E = kinematics.J_links[..., -1, :, :6]
            return (_map(M, J), jump, jump + arm,
                    smooth + times(J_E.swapaxes(-1, -2), wrench))

        # By central differences along both motions.
        planned = [of_plan(step) for step in (0.0, STEP, -STEP)]
        real = [of_robot(step, *each[3:]) for step, each in zip(
            (0.0, STEP, -STEP), planned, strict=True)]
        A_bar, A = planned[0][0], real[0][0]
        return np.concatenate([times(A, real[0][1]) - times(A_bar, planned[0][1]), *(
            (times(A, real[1][i] - real[2][i]) - times(A_bar, planned[1][j] - planned[2][j]))
            / (2.0 * STEP) for i, j in ((2, 1), (3, 2)))], axis=-1)


@dataclass(frozen=True)
class PostureMap(PlanProblem):
    """A matrix by the motion alone, times an error, in blocks of as many rows each."""

    each: int = field(kw_only=True)
    """Number of rows of a block."""
    count: int = field(kw_only=True)
    """Number of blocks."""

    @property
    def channels(self) -> list[slice]:
        """Channels of the blocks."""
        return [slice(i * self.each, (i + 1) * self.each) for i in range(self.count)]


def _solved(J: np.ndarray, right: np.ndarray) -> np.ndarray:
    out: np.ndarray = np.linalg.solve(J, right[..., None])[..., 0]
    return out


def _map(M: np.ndarray, J: np.ndarray) -> np.ndarray:
    """Returns A (..., 6, 6)."""
    carried = np.linalg.solve(J[..., 6:, 6:], J[..., 6:, :6])
    A: np.ndarray = J[..., :6, :6] @ np.linalg.inv(
        M[..., :6, :6] - M[..., :6, 6:] @ carried)
    return A


def planned_feedforward(problem: PlanProblem, x: np.ndarray) -> np.ndarray:
    """Returns Aτ_J, Aτ̇_J at a constant ζ̄̇, and Aτ̇_φ of a plan (..., 18, 1)."""
    config, zeta, rate = problem.plan(x)
    model = problem.model

    def forces(step: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        at = config + step * configuration_rate(config, zeta)
        kinematics, moved = model.kinematics(at), zeta + step * rate
        M = model.mass_matrix(kinematics)
        return (_map(M, output_jacobian(model, at, kinematics, problem.rows)),
                times(M, rate)[..., :6],
                model.inverse_dynamics(kinematics, moved, 0.0 * moved)[..., :6])

    A, jump, _ = forces(0.0)
    later, before = forces(STEP), forces(-STEP)
    return np.concatenate([times(A, jump), *(
        times(A, later[i] - before[i]) / (2.0 * STEP) for i in (1, 2))], axis=-1)[..., None]


def turning_map(problem: PlanProblem, x: np.ndarray) -> np.ndarray:
    """Returns ȦA⁻¹ (..., 6, 6) at any velocity of the declared set."""
    config, zeta, _ = problem.plan(x)
    model = problem.model

    def A(step: float) -> np.ndarray:
        at = config + step * configuration_rate(config, zeta)
        kinematics = model.kinematics(at)
        return _map(model.mass_matrix(kinematics),
                    output_jacobian(model, at, kinematics, problem.rows))

    rate: np.ndarray = (A(STEP) - A(-STEP)) / (2.0 * STEP)
    out: np.ndarray = rate @ np.linalg.inv(A(0.0))
    return out


def arm_and_wrench(problem: PlanProblem, x: np.ndarray) -> np.ndarray:
    """Returns A [M_vq, J_Evᵀ] (..., 6, n+6)."""
    config, _, _ = problem.plan(x)
    model = problem.model
    kinematics = model.kinematics(config)
    M = model.mass_matrix(kinematics)
    A = _map(M, output_jacobian(model, config, kinematics, problem.rows))
    J_E = kinematics.J_links[..., -1, :, :6].swapaxes(-1, -2)
    return np.concatenate([A @ M[..., :6, 6:], A @ J_E], axis=-1)


def turning_reading(problem: PlanProblem, x: np.ndarray) -> np.ndarray:
    """Returns A J̇_Evᵀ (..., 6, 6) at any velocity of the declared set."""
    config, zeta, _ = problem.plan(x)
    model = problem.model

    def J_E(step: float) -> np.ndarray:
        at = config + step * configuration_rate(config, zeta)
        return model.kinematics(at).J_links[..., -1, :, :6]

    kinematics = model.kinematics(config)
    A = _map(model.mass_matrix(kinematics),
             output_jacobian(model, config, kinematics, problem.rows))
    out: np.ndarray = A @ (J_E(STEP) - J_E(-STEP)).swapaxes(-1, -2) / (2.0 * STEP)
    return out


def joints_for_vehicle(problem: PlanProblem, x: np.ndarray) -> np.ndarray:
    """Returns the gain of u and τ by A(τ_v − τ_c), the joints holding the tip (..., 2(6+n), 6)."""
    config, _, _ = problem.plan(x)
    model = problem.model
    kinematics = model.kinematics(config)
    M, J = model.mass_matrix(kinematics), output_jacobian(model, config, kinematics, problem.rows)
    moved = np.linalg.solve(J[..., 6:, 6:], J[..., 6:, :6])
    tau = (M[..., 6:, :6] - M[..., 6:, 6:] @ moved) @ np.linalg.inv(J[..., :6, :6])
    tau = np.concatenate([np.zeros((*tau.shape[:-2], 6, 6)), tau], axis=-2)
    return np.concatenate([np.linalg.solve(M, tau), tau], axis=-2)
