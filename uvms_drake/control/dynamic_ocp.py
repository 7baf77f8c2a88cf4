"""The FHOCP of the dynamics: ξ = (y − y_des, ζ), with ζ̄̇ constant on N intervals of length h.

    ȳ_{k+1} = Φ(ȳ_k, ζ̄_k, ζ̄̇_k),  ζ̄_{k+1} = ζ̄_k + h ζ̄̇_k            (eq:diff_mpc)
    ū = ζ̄̇ − f(𝔮̄, ζ̄) in Ū, M(𝔮̄)ū too, at both ends of every interval   (eq:mpc_constrained_set)

The decision variable is ζ̄̇ instead of ū: the rollout is then kinematic, never stiff and exact,
whatever the surface's stiffness; f only enters through ū in cost and limits.

Speeds, attitude, joints and the static force are limited at the knots. In between, speeds are
convex combinations and stay within their limits; an angle (joints, roll, pitch, tip pitch) and a
depth can bulge out by h²/8 times their second derivative, and ū between its ends by as little.
"""

from dataclasses import dataclass

import numpy as np

from uvms_drake.common.errors import require
from uvms_drake.control.limits import NominalLimits
from uvms_drake.control.ocp import Motion, MpcConfig, Ocp, input_limits, weight
from uvms_drake.control.plan import DynamicPlan
from uvms_drake.control.staged_program import StagedProgram, stacked
from uvms_drake.control.terminal import declared_terminal, terminal_ingredients
from uvms_drake.model.uvms_model import COMPLEX_STEP, UvmsModel, configuration_rate_matrix


@dataclass(frozen=True)
class Linearisation(Motion):
    """First-order model of motion, drift and forces about a plan."""

    f: np.ndarray
    """(N+1, 6+n) drift at the knots."""
    f_y: np.ndarray
    """(N+1, 6+n, 6+n) ∂f/∂ȳ."""
    f_zeta: np.ndarray
    """(N+1, 6+n, 6+n) ∂f/∂ζ̄."""
    M: np.ndarray
    """(N+1, 6+n, 6+n) mass matrix; with limits on τ only, else (0, ...)."""
    tau_y: np.ndarray
    """(2, N, 6+n, 6+n) ∂(M ū)/∂ȳ at ū of the plan, at the beginning and at the end of the
    intervals; with limits on τ only, else (2, 0, ...)."""


class DynamicOcp(Ocp[DynamicPlan]):
    """The FHOCP of one task for the dynamics of one model; arguments as those of `Ocp`."""

    def __init__(self, model: UvmsModel, config: MpcConfig, y_des: np.ndarray,
                 limits: NominalLimits):
        super().__init__(model, config, y_des, limits)
        size = model.size
        declared = config.terminal_weight is not None
        self.Q = np.diag(np.concatenate([weight(config, key, size, zeros=declared)
                                         for key in ("weight_y", "weight_zeta")]))
        self.R = np.diag(weight(config, "weight_u", size))
        require(bool(np.any(self.Q[:size] > 0.0)), "weight_y", config.weight_y, "not all zero")
        config_des = model.configuration(y_des)
        self.u_eq = model.equilibrium_input(config_des)
        self.u_ref = np.zeros(size) if config.input_reference == "zero" else self.u_eq
        if declared:
            self.terminal = declared_terminal(
                weight(config, "terminal_weight", 2 * size, zeros=True), size, self._radius)
            return
        _, f_config, f_zeta = model.drift_derivatives(config_des[None], np.zeros((1, size)))
        J_x = model.task_jacobian(config_des)
        f_y = f_config[0] @ configuration_rate_matrix(config_des) @ np.linalg.inv(J_x)
        self.terminal = terminal_ingredients(
            J_x, f_y, f_zeta[0], self.Q, self.R, config.time_step, self._radius)

    @property
    def state_size(self) -> int:
        """2(6+n), of (𝔮, ζ)."""
        return 2 * self.model.size

    def resting_plan(self, time: float, state: np.ndarray) -> DynamicPlan:
        """Returns a first guess: come to rest over the horizon from (𝔮, ζ) (2(6+n),)."""
        config, zeta = np.split(state, 2)
        duration = self.horizon * self.time_step
        return DynamicPlan.from_accelerations(
            time, self.time_step, config, zeta, np.tile(-zeta / duration, (self.horizon, 1)))

    def errors(self, plan: DynamicPlan, y: np.ndarray) -> np.ndarray:
        """Returns ξ = (y − y_des, ζ) at the knots (N+1, 2(6+n))."""
        return np.concatenate([y - self.y_des, plan.zeta], axis=1)

    def inputs(self, plan: DynamicPlan) -> tuple[np.ndarray, np.ndarray]:
        """Returns ū (N, 6+n) at the beginning and at the end of every interval."""
        f = self.model.drift(plan.config, plan.zeta)
        return plan.zeta_dot - f[:-1], plan.zeta_dot - f[1:]

    def nominal_input(self, at: tuple[np.ndarray, ...]) -> np.ndarray:
        """Returns ū = ζ̄̇ − f(𝔮̄, ζ̄) (6+n,)."""
        config, zeta, zeta_dot = at
        return zeta_dot - self.model.drift(config, zeta)

    def _excess(self, plan: DynamicPlan, begin: np.ndarray, end: np.ndarray) -> list[np.ndarray]:
        limits, zeta = self.limits, plan.zeta[1:]
        amounts = [
            np.linalg.norm(zeta[:, :3], axis=1) - limits.nu1,
            np.linalg.norm(zeta[:, 3:6], axis=1) - limits.nu2,
            np.linalg.norm(zeta[:, 6:], axis=1) - limits.qdot,
            np.abs(begin) - limits.u,
            np.abs(end) - limits.u,
        ]
        if limits.tau is not None:
            M = self.model.mass_matrix(self.model.kinematics(plan.config))
            amounts += [np.abs((m @ u[..., None])[..., 0]) - limits.tau
                        for m, u in ((M[:-1], begin), (M[1:], end))]
        return amounts

    def linearise(self, plan: DynamicPlan) -> Linearisation:
        """Returns the first-order model about a plan."""
        motion = self._motion(plan.config, plan.zeta[:-1], plan.zeta_dot)
        f, f_config, f_zeta = self.model.drift_derivatives(plan.config, plan.zeta)
        M, tau_y = self._force_model(plan, f, motion.config_y)
        return Linearisation(
            **vars(motion), f=f, f_y=f_config @ motion.config_y, f_zeta=f_zeta, M=M, tau_y=tau_y)

    def _force_model(self, plan: DynamicPlan, f: np.ndarray, config_y: np.ndarray
                     ) -> tuple[np.ndarray, np.ndarray]:
        """Returns M and ∂(M ū)/∂ȳ, by a complex step of M."""
        size = self.model.size
        if self.limits.tau is None:
            return np.empty((0, size, size)), np.empty((2, 0, size, size))
        moved = plan.config[:, None, :] + 1j * COMPLEX_STEP * np.eye(size)
        M = self.model.mass_matrix(self.model.kinematics(moved))
        rates = np.moveaxis(M.imag / COMPLEX_STEP, 1, -1)  # (N+1, row, column, coordinate)
        begin = np.einsum("krcj,kc->krj", rates[:-1], plan.zeta_dot - f[:-1])
        end = np.einsum("krcj,kc->krj", rates[1:], plan.zeta_dot - f[1:])
        return M[:, 0].real, np.stack([begin @ config_y[:-1], end @ config_y[1:]])

    def staged_program(self, plan: DynamicPlan) -> StagedProgram:
        """Returns the convex program about a plan; its w is the change of ζ̄̇."""
        model = self.linearise(plan)
        N, size, h = self.horizon, self.model.size, self.time_step
        eye = np.eye(size)
        A, B = np.zeros((N, 2 * size, 2 * size)), np.zeros((N, 2 * size, size))
        A[:, :size] = np.concatenate([model.dy_dy, model.dy_dzeta], axis=2)
        A[:, size:, size:] = eye
        B[:, :size], B[:, size:] = model.dy_da, h * eye
        inputs = self._limited_inputs(plan, model, A, B)
        u, u_z, _ = inputs[0]
        linear = stacked([*(input_limits(*rows) for rows in inputs),
                          self._configuration_limits(model, 3 * size),
                          *self._depth_limits(model.y, 3 * size)])
        return self._program(A, B, u, u_z, self.errors(plan, model.y), linear,
                             self._norm_limits(model.y, plan.zeta, 3 * size, free_knot=0))

    def _limited_inputs(self, plan: DynamicPlan, model: Linearisation, A: np.ndarray, B: np.ndarray
                        ) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """Returns what is limited on every interval: value (N, 6+n), its derivative, its limit.

        The derivative (N, 6+n, 3(6+n)) is by (ξ, ζ̄̇) at the beginning of the interval; A and B give
        it for what is limited at the end. The first is the ū of the cost.
        """
        N, size, eye = self.horizon, self.model.size, np.eye(self.model.size)
        f_xi = np.concatenate([model.f_y, model.f_zeta], axis=2)
        begin_z = np.concatenate([-f_xi[:-1], np.tile(eye, (N, 1, 1))], axis=2)
        end_z = np.concatenate([-f_xi[1:] @ A, eye - f_xi[1:] @ B], axis=2)
        begin, end = plan.zeta_dot - model.f[:-1], plan.zeta_dot - model.f[1:]
        inputs = [(begin, begin_z, self.limits.u), (end, end_z, self.limits.u)]
        if self.limits.tau is not None:  # d(M ū) = M dū + ∂(M ū)/∂ȳ dȳ
            at_begin = np.concatenate([model.tau_y[0], np.zeros((N, size, 2 * size))], axis=2)
            at_end = model.tau_y[1] @ np.concatenate([A, B], axis=2)[:, :size]
            inputs += [((M @ u[..., None])[..., 0], M @ u_z + tau_z, self.limits.tau)
                       for M, u, u_z, tau_z in ((model.M[:-1], begin, begin_z, at_begin),
                                                (model.M[1:], end, end_z, at_end))]
        return inputs
