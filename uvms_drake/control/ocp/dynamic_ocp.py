"""FHOCP of the dynamics: ξ = (y − y_des, ζ), with ζ̄̇ constant on N intervals of length h.

    ȳ_{k+1} = Φ(ȳ_k, ζ̄_k, ζ̄̇_k),  ζ̄_{k+1} = ζ̄_k + h ζ̄̇_k            (eq:diff_mpc)
    ū = ζ̄̇ − f(𝔮̄, ζ̄) in Ū, M(𝔮̄)ū too, at both ends of every interval   (eq:mpc_constrained_set)

The decision variable is ζ̄̇ instead of ū: the rollout is then kinematic, never stiff and exact,
whatever the surface's stiffness; f only enters through ū in cost and limits.

Speeds, attitude, joints and the static force are limited at the knots. In between, speeds are
convex combinations and stay within their limits; an angle (joints, roll, pitch, tip pitch), a depth
and ū can exceed theirs by h²/8 times their second derivative.
"""

from dataclasses import dataclass

import numpy as np

from uvms_drake.common.errors import require
from uvms_drake.control.convex.staged_program import StagedProgram
from uvms_drake.control.costs.costs import TaskCost
from uvms_drake.control.limits import Limit
from uvms_drake.control.ocp.limit_stack import Inputs
from uvms_drake.control.ocp.ocp import MpcConfig, Ocp, PlanPoints, Transitions, weight
from uvms_drake.control.plan.plan import DynamicPlan, advance
from uvms_drake.control.plan.points import Points, Slopes
from uvms_drake.control.plan.terminal import declared_terminal, terminal_ingredients
from uvms_drake.model.uvms_model import UvmsModel, configuration_rate_matrix


@dataclass(frozen=True)
class Linearisation(Transitions):
    """First-order model of motion and drift about a plan."""

    f: np.ndarray
    """Drift f at the knots (N+1, 6+n) [m/s², rad/s²]."""
    f_y: np.ndarray
    """∂f/∂ȳ at the knots (N+1, 6+n, 6+n)."""
    f_zeta: np.ndarray
    """∂f/∂ζ̄ at the knots (N+1, 6+n, 6+n)."""


class DynamicOcp(Ocp[DynamicPlan]):
    """FHOCP of one task for the dynamics of one model; see `Ocp` for the arguments."""

    given_speed = 0
    has_accelerations = True

    def __init__(self, model: UvmsModel, mpc: MpcConfig, y_des: np.ndarray,
                 limits: dict[str, Limit]):
        super().__init__(model, mpc, y_des, limits)
        size = model.size
        declared = mpc.terminal_weight is not None
        Q = np.diag(np.concatenate([weight(mpc, key, size, zeros=declared)
                                         for key in ("weight_y", "weight_zeta")]))
        R = np.diag(weight(mpc, "weight_u", size))
        require(bool(np.any(Q[:size] > 0.0)), "weight_y", mpc.weight_y, "not all zero")
        config_des = model.configuration(y_des)
        self.u_eq = model.equilibrium_input(config_des)
        self.task_cost = TaskCost(
            Q, R, y_des, np.zeros(size) if mpc.input_reference == "zero" else self.u_eq)
        if declared:
            self.terminal = declared_terminal(
                weight(mpc, "terminal_weight", 2 * size, zeros=True), size, self._radius)
            return
        _, f_config, f_zeta = model.drift_derivatives(config_des[None], np.zeros((1, size)))
        J_x = model.task_jacobian(config_des)
        f_y = f_config[0] @ configuration_rate_matrix(config_des) @ np.linalg.inv(J_x)
        self.terminal = terminal_ingredients(
            J_x, f_y, f_zeta[0], Q, R, mpc.time_step, self._radius)

    @property
    def state_size(self) -> int:
        """Size 2(6+n) of (𝔮, ζ)."""
        return 2 * self.model.size

    def resting_plan(self, time: float, state: np.ndarray, coasting: int = 0) -> DynamicPlan:
        """Returns a first guess: coast from (𝔮, ζ) (2(6+n),), come to rest over the horizon."""
        config, zeta = np.split(state, 2)
        duration = self.horizon * self.time_step
        zeta_dot = np.tile(-zeta / duration, (coasting + self.horizon, 1))
        zeta_dot[:coasting] = 0.0
        return DynamicPlan.from_accelerations(time, self.time_step, config, zeta, zeta_dot)

    def errors(self, plan: DynamicPlan, y: np.ndarray) -> np.ndarray:
        """Returns ξ = (y − y_des, ζ) at the knots (N+1, 2(6+n))."""
        return np.concatenate([y - self.y_des, plan.zeta], axis=1)

    def inputs(self, plan: DynamicPlan) -> tuple[np.ndarray, np.ndarray]:
        """Returns ū (N, 6+n) at the beginning and at the end of every interval."""
        return self._inputs_at(plan, self._knots(plan))

    def _inputs_at(self, plan: DynamicPlan, knots: Points) -> tuple[np.ndarray, np.ndarray]:
        f = knots.drift
        return plan.zeta_dot - f[:-1], plan.zeta_dot - f[1:]

    def nominal_input(self, at: tuple[np.ndarray, ...]) -> np.ndarray:
        """Returns ū = ζ̄̇ − f(𝔮̄, ζ̄) (6+n,)."""
        config, zeta, zeta_dot = at
        return zeta_dot - self.model.drift(config, zeta)

    def move(self, xi: np.ndarray, decision: np.ndarray
             ) -> tuple[np.ndarray, np.ndarray, Points, Points]:
        """Returns ξ⁺ (..., 2(6+n)), ū − ū_eq, and both ends; the decision is ζ̄̇."""
        model, h = self.model, self.time_step
        y, zeta = self.y_des + xi[..., : model.size], xi[..., model.size:]
        config = model.configuration(y)
        end, zeta_end = advance(config, zeta, decision, h), zeta + h * decision
        error = self._error(end)
        both = Points(model, np.stack([config, end]), np.stack([y, self.y_des + error]),
                      np.stack([zeta, zeta_end]))
        u, u_end = decision - model.drift(both.config, both.zeta)
        return (np.concatenate([error, zeta_end], axis=-1), u - self.u_eq,
                both.subset(0, u), both.subset(1, u_end))

    def state_rows(self) -> Slopes:
        """Returns the blocks of ξ."""
        return Slopes(*np.split(np.eye(self.state_size), 2))

    def velocities(self, plan: DynamicPlan) -> np.ndarray:
        """Returns ζ̄."""
        return plan.zeta

    def linearise(self, plan: DynamicPlan, knots: Points | None = None) -> Linearisation:
        """Returns the first-order model about a plan; `knots` are its points, if known."""
        knots = knots or self._knots(plan)
        motion = self._transitions(knots, plan.zeta[:-1], plan.zeta_dot)
        f_y, f_zeta = self._drift_slopes(plan, knots)
        return Linearisation(**vars(motion), f=knots.drift, f_y=f_y, f_zeta=f_zeta)

    def staged_program(self, plan: DynamicPlan, points: PlanPoints | None = None) -> StagedProgram:
        """Returns the convex program about a plan; its w is the change of ζ̄̇."""
        points = points or self.points(plan)
        model = self.linearise(plan, points.knots)
        N, size, h = self.horizon, self.model.size, self.time_step
        eye = np.eye(size)
        A, B = np.zeros((N, 2 * size, 2 * size)), np.zeros((N, 2 * size, size))
        A[:, :size] = np.concatenate([model.dy_dy, model.dy_dzeta], axis=2)
        A[:, size:, size:] = eye
        B[:, :size], B[:, size:] = model.dy_da, h * eye
        return self._program(
            plan, A, B, points, self.linearised_inputs(plan, model, A, B))

    def linearised_inputs(self, plan: DynamicPlan, model: Linearisation, A: np.ndarray,
                          B: np.ndarray) -> Inputs:
        """Returns ū at both ends of the intervals and its derivatives by (ξ, ζ̄̇) at the first.

        A and B are the derivatives of ξ at the last.
        """
        N, size = self.horizon, self.model.size
        xi_z = np.zeros((2 * N, 2 * size, 3 * size))
        xi_z[:N, :, : 2 * size] = np.eye(2 * size)
        xi_z[N:, :, : 2 * size], xi_z[N:, :, 2 * size:] = A, B
        return self._inputs_by(plan, model.knots, model.f_y, model.f_zeta, xi_z)

    def interval_inputs(self, plan: DynamicPlan, knots: Points) -> Inputs:
        """Returns ū at both ends of the intervals, which need not meet, and its derivatives.

        Those by (y, ζ) at the first, ζ̄̇, and (y, ζ) at the last.
        """
        N, size = len(plan.zeta_dot), self.model.size
        f_y, f_zeta = self._drift_slopes(plan, knots)
        xi_z = np.zeros((2 * N, 2 * size, 5 * size))
        xi_z[:N, :, : 2 * size] = xi_z[N:, :, 3 * size:] = np.eye(2 * size)
        return self._inputs_by(plan, knots, f_y, f_zeta, xi_z)

    def _drift_slopes(self, plan: DynamicPlan, knots: Points) -> tuple[np.ndarray, np.ndarray]:
        """Returns ∂f/∂ȳ and ∂f/∂ζ̄ at the knots (N+1, 6+n, 6+n)."""
        f_config, f_zeta = self.model.drift_gradients(
            plan.config, plan.zeta, knots.drift, knots.kinematics, knots.inverse_mass)
        return f_config @ knots.config_y, f_zeta

    def _inputs_by(self, plan: DynamicPlan, knots: Points, f_y: np.ndarray, f_zeta: np.ndarray,
                   xi_z: np.ndarray) -> Inputs:
        """Returns ū at both ends of the intervals and its derivatives by z, the third part ζ̄̇.

        Args:
            plan: The plan.
            knots: Its knots.
            f_y: ∂f/∂ȳ there.
            f_zeta: ∂f/∂ζ̄ there.
            xi_z: ∂ξ/∂z at the beginnings, then at the ends (2N, 2(6+n), size of z).
        """
        N, size = len(plan.zeta_dot), self.model.size
        f_xi = np.concatenate([f_y, f_zeta], axis=2)
        # ∂ū/∂z = ∂ζ̄̇/∂z − ∂f/∂ξ ∂ξ/∂z.
        u_z = np.concatenate([-f_xi[:-1] @ xi_z[:N], -f_xi[1:] @ xi_z[N:]])
        u_z[..., 2 * size: 3 * size] += np.eye(size)
        return Inputs(self._ends(plan, knots), xi_z[:, :size], xi_z[:, size:], u_z)
