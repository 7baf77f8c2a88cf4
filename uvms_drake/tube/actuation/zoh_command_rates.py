"""Rates of the rows of `tip first` under zero-order hold.

With forces F of the contact apart, the rows of outputs y = (η, s) obey ÿ = a(𝔮, ζ; τ) + δ,

    a(𝔮, ζ; τ) = J_y M⁻¹(τ − b) + J̇_yζ.                                                       (1)

While a torque τ_c is constant, and with it in thought a wrench F̂ on the tip in its own axes, a
leaves ÿ̄ at

    ρ = d/dt a(𝔮, ζ; τ_c − J_Eᵀ F̂) − d/dt ÿ̄,    τ_c and F̂ constant,                            (2)

a function of the nominal motion, of the errors x, ẋ, ẍ of outputs, the tip's in joint angles, of
α = a(𝔮, ζ; τ_c − J_EᵀF̂) − ÿ̄, likewise, and of F̂. On the plan it is −J_yM⁻¹τ̄˙. See
tube/actuation/theory.md#rates-under-zero-order-hold.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.frames.spatial import times
from uvms_drake.model.uvms_model import configuration_rate
from uvms_drake.tube.resolved.remainders import jacobian_rate_times
from uvms_drake.tube.rows.remainders import (
    configuration_of,
    output_bias,
    output_jacobian,
)
from uvms_drake.tube.search.search_problem import SearchProblem, input_within

STEP = 1e-4
"""Step of a finite difference along a motion [s]."""


def zoh_command_rates(model: ContactModel, rows: np.ndarray, config: np.ndarray, zeta: np.ndarray,
                      zeta_dot: np.ndarray, off: np.ndarray, wrench: np.ndarray) -> np.ndarray:
    """Returns the first term of (2) (..., 6+n), of real or complex arguments.

    Args:
        model: The robot, without contact.
        rows: The tip's task in (χ, q) (n,).
        config: 𝔮 (..., 6+n).
        zeta: ζ (..., 6+n).
        zeta_dot: ζ̇ (..., 6+n).
        off: Present a(𝔮, ζ; τ_c − J_EᵀF̂) (..., 6+n), which determines τ_c.
        wrench: F̂ (..., 6).
    """
    J, bias, M, b, J_E = _dynamics(model, rows, config, zeta)
    tau = times(M, np.linalg.solve(J, (off - bias)[..., None])[..., 0]) + b
    tau = tau + times(J_E.swapaxes(-1, -2), wrench)

    def later(step: float) -> np.ndarray:
        J, bias, M, b, J_E = _dynamics(model, rows, config + step * configuration_rate(
            config, zeta), zeta + step * zeta_dot)
        left = tau - times(J_E.swapaxes(-1, -2), wrench) - b
        return times(J, np.linalg.solve(M, left[..., None])[..., 0]) + bias

    out: np.ndarray = (later(STEP) - later(-STEP)) / (2.0 * STEP)
    return out


def _dynamics(model: ContactModel, rows: np.ndarray, config: np.ndarray, zeta: np.ndarray
              ) -> tuple[np.ndarray, ...]:
    """Returns J_y, J̇_yζ, M, b and J_E at states."""
    kinematics = model.kinematics(config)
    return (output_jacobian(model, config, kinematics, rows),
            output_bias(config, kinematics, zeta, rows), model.mass_matrix(kinematics),
            model.inverse_dynamics(kinematics, zeta, np.zeros_like(zeta)),
            kinematics.J_links[..., -1, :, :])


def plan_rates(model: ContactModel, rows: np.ndarray, config: np.ndarray, zeta: np.ndarray,
               zeta_dot: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns ÿ̄, its rate at a constant ζ̄̇, and J̄_y (..., 6+n, 6+n)."""
    def acceleration(step: float) -> tuple[np.ndarray, np.ndarray]:
        at = config + step * configuration_rate(config, zeta)
        moved, kinematics = zeta + step * zeta_dot, model.kinematics(at)
        J = output_jacobian(model, at, kinematics, rows)
        return times(J, zeta_dot) + output_bias(at, kinematics, moved, rows), J

    now, J = acceleration(0.0)
    return now, (acceleration(STEP)[0] - acceleration(-STEP)[0]) / (2.0 * STEP), J


@dataclass(frozen=True)
class ZohCommandProblem(SearchProblem):
    """ρ less that of the plan; errors are (x, ẋ, ẍ, α, F̂).

    Values are by blocks of rows: the vehicle's position and attitude, the tip's position, and
    J_sq⁻¹ρ_s, its task in joint angles.
    """

    rows: np.ndarray
    """The tip's task in (χ, q) (n,)."""
    u_limits: np.ndarray
    """|ūᵢ| (6+n,)."""
    largest_rate: np.ndarray | float = field(default=np.inf)
    """|ζ̄̇ᵢ| (6+n,), in addition to the bound by |ūᵢ|."""
    drags: tuple[float, float] = (0.0, 0.0)
    """κ of the tip's rows, see `RowLoop`, and in joint angles: ρ + κë counts in place of ρ [1/s].
    """

    @property
    def errors(self) -> int:
        """Number of components of the errors."""
        return 4 * self.size + 6

    @property
    def channels(self) -> list[slice]:
        """Channels of the blocks."""
        n = self.size - 6
        tip = 6 + int(np.sum(self.rows < 3))
        return [slice(0, 3), slice(3, 6), slice(6, tip), slice(6 + n, 6 + 2 * n)]

    def plan(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Returns 𝔮̄, ζ̄ and ζ̄̇ of motions."""
        pose, zeta, share = np.split(x, 3, axis=-1)
        config = self.config(pose)
        f = self.model.drift(config, zeta)
        return config, zeta, f + input_within(f, share, self.u_limits, self.largest_rate)

    def values(self, x: np.ndarray, error: np.ndarray) -> np.ndarray:
        """Returns the values (..., 6 + 2n)."""
        # ρ of the plan.
        model, rows, size = self.model, self.rows, self.size
        config_bar, zeta_bar, zeta_dot = self.plan(x)
        y_ddot, jerk, J_bar = plan_rates(model, rows, config_bar, zeta_bar, zeta_dot)
        planned_rate = zoh_command_rates(
            model, rows, config_bar, zeta_bar, zeta_dot, y_ddot, np.zeros(6)) - jerk

        # The real state and its acceleration, from the errors.
        by_y, wrench = np.split(error, [4 * size], axis=-1)
        by_x, by_rate, by_acceleration, by_off = np.split(by_y, 4, axis=-1)
        config = configuration_of(model, rows, config_bar, model.kinematics(config_bar), by_x)
        kinematics = model.kinematics(config)
        J = output_jacobian(model, config, kinematics, rows)

        def of_outputs(each: np.ndarray) -> np.ndarray:
            each = np.broadcast_to(each, config.shape)
            return np.concatenate([each[..., :6], times(J[..., 6:, 6:], each[..., 6:])], axis=-1)

        def solved(right: np.ndarray) -> np.ndarray:
            out: np.ndarray = np.linalg.solve(J, right[..., None])[..., 0]
            return out

        zeta = solved(times(J_bar, zeta_bar) + of_outputs(by_rate))
        bias = output_bias(config, kinematics, zeta, rows)
        moving = solved(y_ddot + of_outputs(by_acceleration) - bias)

        # ρ of the robot, less that of the plan, and with κë where the loop knows a drag.
        real = zoh_command_rates(
            model, rows, config, zeta, moving, y_ddot + of_outputs(by_off), wrench) - jerk
        out = self.by_block(real, J) - self.by_block(planned_rate, J_bar)
        both = of_outputs(by_acceleration)[..., 6:], by_acceleration[..., 6:]
        for of, kappa, each in zip((slice(6, size), slice(size, None)), self.drags, both,
                                   strict=True):
            out[..., of] += kappa * each
        return out

    def by_block(self, of_rows: np.ndarray, J: np.ndarray) -> np.ndarray:
        """Returns rows (..., 6+n), and the tip's in joint angles (..., 6+2n)."""
        in_joints = np.linalg.solve(J[..., 6:, 6:], of_rows[..., 6:, None])[..., 0]
        return np.concatenate([of_rows, in_joints], axis=-1)


@dataclass(frozen=True)
class PlanProblem(ZohCommandProblem):
    """Function of the plan alone by blocks of rows, times an error of some components."""

    of: Callable[["PlanProblem", np.ndarray], np.ndarray] = field(kw_only=True)
    """Function: values (..., 6+2n, errors) of motions (..., 3(6+n))."""

    @property
    def errors(self) -> int:
        """Number of components in the parts."""
        return len(self.parts[0][0])

    def values(self, x: np.ndarray, error: np.ndarray) -> np.ndarray:
        """Returns the function, times the errors."""
        out: np.ndarray = (self.of(self, x) @ error[..., None])[..., 0]
        return out


def zoh_plan_rate(problem: PlanProblem, x: np.ndarray) -> np.ndarray:
    """Returns ρ of a plan at a constant ζ̄̇ (..., 6+2n, 1)."""
    config, zeta, zeta_dot = problem.plan(x)
    y_ddot, jerk, J = plan_rates(problem.model, problem.rows, config, zeta, zeta_dot)
    return problem.by_block(zoh_command_rates(
        problem.model, problem.rows, config, zeta, zeta_dot, y_ddot, np.zeros(6)) - jerk, J)[
            ..., None]


def jumping_plan(problem: PlanProblem, x: np.ndarray) -> np.ndarray:
    """Returns J̄_yζ̄̇, half of the largest jump of ÿ̄ at a knot (..., 6+2n, 1).

    The rows of the tip's task take the place of those in joint angles.
    """
    config, _, zeta_dot = problem.plan(x)
    J = output_jacobian(problem.model, config, problem.model.kinematics(config), problem.rows)
    rows = times(J, zeta_dot)
    return np.concatenate([rows, rows[..., 6:]], axis=-1)[..., None]


def turning_task(problem: PlanProblem, x: np.ndarray) -> np.ndarray:
    """Returns J_sq⁻¹J̇_sq in the place of the joints (..., 6+2n, n)."""
    config, zeta, _ = problem.plan(x)
    kinematics, n = problem.model.kinematics(config), problem.size - 6
    J = output_jacobian(problem.model, config, kinematics, problem.rows)
    rate = np.stack([jacobian_rate_times(kinematics, zeta, zeta * 0.0 + unit)[..., problem.rows]
                     for unit in np.eye(problem.size)[6:]], axis=-1)
    inner: np.ndarray = np.linalg.solve(J[..., 6:, 6:], rate)
    return np.concatenate([np.zeros((*inner.shape[:-2], 6 + n, n)), inner], axis=-2)
