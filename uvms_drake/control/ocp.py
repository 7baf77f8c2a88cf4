"""The nominal finite-horizon optimal control problem (FHOCP).

With y = (χ, q) the extended task, ξ = (y − y_des, ζ), and ζ̇ constant on N intervals of length h,

    min  Σ_{k<N} h (‖ξ_k‖²_Q + ‖ū_k − ū_eq‖²_R) + ‖ξ_N‖²_P + ρ s             (eq:mpc_cost_function)
    s.t. ȳ_{k+1} = Φ(ȳ_k, ζ̄_k, ζ̄̇_k),  ζ̄_{k+1} = ζ̄_k + h ζ̄̇_k                      (eq:diff_mpc)
         ū = ζ̄̇ − f(𝔮̄, ζ̄) in Ū, M(𝔮̄)ū too, at both ends of every interval (eq:mpc_constrained_set)
         ‖ν̄₁‖, ‖ν̄₂‖, ‖q̄̇‖, joints, roll and pitch of the vehicle, pitch of the end-effector in limits
         ‖ξ_N‖_P ≤ ε + s,  s ≥ 0                                         (eq:mpc_terminal_set)

The decision variable is ζ̄̇ instead of ū: the rollout is then kinematic, never stiff and exact,
whatever the surface's stiffness; f only enters through ū in cost and limits. y instead of 𝔮 as
the state makes the cost, the joint limits and the terminal set exactly quadratic, linear and
conic; only Φ, the vehicle's attitude, f and M are nonlinear. The terminal constraint is softened
by an exact penalty: s is zero whenever that is possible, and it is reported, never dropped.

Limits are kept at the knots and at both ends of every interval. In between, speeds are convex
combinations and stay within theirs; a joint can bulge out by h² |q̈|/8.

This file is the problem and its first-order model; `scp` solves it fast, `nlp` is the reference.
"""

from dataclasses import dataclass, field

import numpy as np

from uvms_drake.control.limits import NominalLimits
from uvms_drake.control.plan import Plan, advance
from uvms_drake.control.terminal import terminal_ingredients
from uvms_drake.errors import require, vector
from uvms_drake.model.euler import wrap_angle
from uvms_drake.model.uvms_model import COMPLEX_STEP, UvmsModel, configuration_rate_matrix


@dataclass
class MpcConfig:
    """Horizon, weights and solver settings of the nominal MPC."""

    horizon: int = 20
    """N, number of intervals."""
    time_step: float = 0.2
    """h [s], length of an interval and the sampling period; T = N h."""
    iterations: int = 1
    """Sequential convex iterations per sample; the first solve iterates to convergence."""
    weight_y: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """Diagonal of Q for y − y_des, y = (𝔭, 𝔬, q)."""
    weight_zeta: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """Diagonal of Q for ζ."""
    weight_u: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """Diagonal of R for ū − ū_eq."""
    terminal_radius: float = 0.1
    """ε of the terminal set ‖(y − y_des, ζ)‖_P ≤ ε; declared."""


@dataclass(frozen=True)
class Linearisation:
    """First-order model of the problem about a plan; index k is the knot or interval."""

    y: np.ndarray
    """(N+1, 6+n) ȳ at the knots, Euler angles within π of the desired ones."""
    dy_dy: np.ndarray
    """(N, 6+n, 6+n) ∂ȳ_{k+1}/∂ȳ_k."""
    dy_dzeta: np.ndarray
    """(N, 6+n, 6+n) ∂ȳ_{k+1}/∂ζ̄_k."""
    dy_da: np.ndarray
    """(N, 6+n, 6+n) ∂ȳ_{k+1}/∂ζ̄̇_k."""
    attitude: np.ndarray
    """(N+1, 2) (φ̄, θ̄) of the vehicle."""
    attitude_y: np.ndarray
    """(N+1, 2, 6+n) ∂(φ̄, θ̄)/∂ȳ."""
    f: np.ndarray
    """(N+1, 6+n) drift at the knots."""
    f_y: np.ndarray
    """(N+1, 6+n, 6+n) ∂f/∂ȳ."""
    f_zeta: np.ndarray
    """(N+1, 6+n, 6+n) ∂f/∂ζ̄."""
    M: np.ndarray
    """(N+1, 6+n, 6+n) mass matrix; with force limits only, else (0, ...)."""
    tau_y: np.ndarray
    """(2, N, 6+n, 6+n) ∂(M ū)/∂ȳ at ū of the plan, at the beginning and at the end of the
    intervals; with force limits only, else (2, 0, ...)."""


@dataclass(frozen=True)
class Evaluation:
    """What a plan is worth."""

    cost: float
    """The objective, with the terminal penalty ρ s."""
    terminal_slack: float
    """s = max(0, ‖ξ_N‖_P − ε)."""
    violation: float
    """Largest violation of a limit, in the limit's own unit; zero for a feasible plan."""
    total_violation: float
    """Sum of all violations."""

    @property
    def merit(self) -> float:
        """Returns what a solver makes small: the cost with an exact penalty of the violations."""
        return self.cost + VIOLATION_PENALTY * self.total_violation


TERMINAL_PENALTY = 100.0
"""ρ: cost of leaving the terminal set by one unit of ‖ξ‖_P; far above the multipliers seen."""
VIOLATION_PENALTY = 1e3
"""Cost of one unit of violation; above every multiplier of a limit."""


class Ocp:
    """The FHOCP of one task for one model."""

    def __init__(self, model: UvmsModel, config: MpcConfig, y_des: np.ndarray,
                 limits: NominalLimits):
        size = model.size
        require(config.horizon >= 1, "horizon", config.horizon, "a positive integer")
        require(0.0 < config.time_step < np.inf, "time_step", config.time_step, "positive")
        require(config.iterations >= 1, "iterations", config.iterations, "a positive integer")
        require(config.terminal_radius > 0.0, "terminal_radius", config.terminal_radius, "positive")
        weights = {key: vector(key, getattr(config, key), size)
                   for key in ("weight_y", "weight_zeta", "weight_u")}
        for key, weight in weights.items():
            positive = bool(np.all(weight > 0.0))
            require(positive, key, weight, f"{size} positive numbers")
        self.model = model
        self.horizon = config.horizon
        self.time_step = config.time_step
        self.iterations = config.iterations
        self.y_des = y_des
        self.limits = limits
        self.Q = np.diag(np.concatenate([weights["weight_y"], weights["weight_zeta"]]))
        self.R = np.diag(weights["weight_u"])
        config_des = model.configuration(y_des)
        self.u_eq = model.equilibrium_input(config_des)
        _, f_config, f_zeta = model.drift_derivatives(config_des[None], np.zeros((1, size)))
        J_x = model.task_jacobian(config_des)
        f_y = f_config[0] @ configuration_rate_matrix(config_des) @ np.linalg.inv(J_x)
        self.terminal = terminal_ingredients(
            J_x, f_y, f_zeta[0], self.Q, self.R, config.time_step, config.terminal_radius)

    def unwrapped(self, y: np.ndarray) -> np.ndarray:
        """Returns y (..., 6+n) with the Euler angles within π of the desired ones."""
        y = y.copy()
        y[..., 3:6] = self.y_des[3:6] + wrap_angle(y[..., 3:6] - self.y_des[3:6])
        return y

    def resting_plan(self, time: float, config: np.ndarray, zeta: np.ndarray) -> Plan:
        """Returns a first guess: come to rest over the horizon from (𝔮, ζ) (6+n,)."""
        duration = self.horizon * self.time_step
        return Plan.from_accelerations(
            time, self.time_step, config, zeta, np.tile(-zeta / duration, (self.horizon, 1)))

    def continued(self, plan: Plan) -> Plan:
        """Returns the plan one interval later, its end continued by the terminal controller."""
        y = self.unwrapped(self.model.task_pose(plan.config[-1]))
        xi = np.concatenate([y - self.y_des, plan.zeta[-1]])
        return plan.shifted(self.terminal.gain @ xi)

    def linearise(self, plan: Plan) -> Linearisation:
        """Returns the first-order model about a plan."""
        size, h = self.model.size, self.time_step
        y, J_x, _ = self.model.task_motion(plan.config, np.zeros_like(plan.zeta))
        Gamma = configuration_rate_matrix(plan.config)
        config_y = Gamma @ np.linalg.inv(J_x)  # ∂𝔮/∂y
        y_config = J_x[1:] @ np.linalg.inv(Gamma[1:])  # ∂y/∂𝔮
        steps = 1j * COMPLEX_STEP * np.eye(3 * size)
        moved = advance(
            plan.config[:-1, None, :] + steps[:, :size],
            plan.zeta[:-1, None, :] + steps[:, size: 2 * size],
            plan.zeta_dot[:, None, :] + steps[:, 2 * size:], h)
        rates = y_config @ np.swapaxes(moved.imag / COMPLEX_STEP, -1, -2)
        f, f_config, f_zeta = self.model.drift_derivatives(plan.config, plan.zeta)
        return Linearisation(
            y=self.unwrapped(y),
            dy_dy=rates[..., :size] @ config_y[:-1],
            dy_dzeta=rates[..., size: 2 * size],
            dy_da=rates[..., 2 * size:],
            attitude=plan.config[:, 3:5],
            attitude_y=config_y[:, 3:5, :],
            f=f,
            f_y=f_config @ config_y,
            f_zeta=f_zeta,
            **self._force_model(plan, f, config_y),
        )

    def _force_model(self, plan: Plan, f: np.ndarray, config_y: np.ndarray
                     ) -> dict[str, np.ndarray]:
        """Returns M and ∂(M ū)/∂ȳ, by a complex step of M."""
        size = self.model.size
        if self.limits.tau is None:
            return {"M": np.empty((0, size, size)), "tau_y": np.empty((2, 0, size, size))}
        moved = plan.config[:, None, :] + 1j * COMPLEX_STEP * np.eye(size)
        M = self.model.mass_matrix(self.model.kinematics(moved))
        rates = np.moveaxis(M.imag / COMPLEX_STEP, 1, -1)  # (N+1, row, column, coordinate)
        begin = np.einsum("krcj,kc->krj", rates[:-1], plan.zeta_dot - f[:-1])
        end = np.einsum("krcj,kc->krj", rates[1:], plan.zeta_dot - f[1:])
        return {"M": M[:, 0].real, "tau_y": np.stack([begin @ config_y[:-1], end @ config_y[1:]])}

    def inputs(self, plan: Plan) -> tuple[np.ndarray, np.ndarray]:
        """Returns ū (N, 6+n) at the beginning and at the end of every interval."""
        f = self.model.drift(plan.config, plan.zeta)
        return plan.zeta_dot - f[:-1], plan.zeta_dot - f[1:]

    def evaluate(self, plan: Plan) -> Evaluation:
        """Returns the objective and the violations of a plan, nothing linearised."""
        y = self.unwrapped(self.model.task_pose(plan.config))
        xi = np.concatenate([y - self.y_des, plan.zeta], axis=1)
        begin, end = self.inputs(plan)
        du = begin - self.u_eq
        stages = np.sum((xi[:-1] @ self.Q) * xi[:-1]) + np.sum((du @ self.R) * du)
        terminal = float(xi[-1] @ self.terminal.P @ xi[-1])
        slack = max(0.0, np.sqrt(terminal) - self.terminal.radius)
        excess = self._excess(plan, y, begin, end)
        return Evaluation(
            cost=float(self.time_step * stages + terminal + TERMINAL_PENALTY * slack),
            terminal_slack=float(slack),
            violation=float(np.max(excess, initial=0.0)),
            total_violation=float(np.sum(excess)),
        )

    def _excess(self, plan: Plan, y: np.ndarray, begin: np.ndarray, end: np.ndarray
                ) -> np.ndarray:
        limits, zeta = self.limits, plan.zeta[1:]
        amounts = [
            np.linalg.norm(zeta[:, :3], axis=1) - limits.nu1,
            np.linalg.norm(zeta[:, 3:6], axis=1) - limits.nu2,
            np.linalg.norm(zeta[:, 6:], axis=1) - limits.qdot,
            np.abs(plan.config[1:, 3]) - limits.roll,
            np.abs(plan.config[1:, 4]) - limits.pitch,
            np.abs(y[1:, 4]) - limits.tip_pitch,
            y[1:, 6:] - limits.q_upper,
            limits.q_lower - y[1:, 6:],
            np.abs(begin) - limits.u,
            np.abs(end) - limits.u,
        ]
        if limits.tau is not None:
            M = self.model.mass_matrix(self.model.kinematics(plan.config))
            amounts += [np.abs((m @ u[..., None])[..., 0]) - limits.tau
                        for m, u in ((M[:-1], begin), (M[1:], end))]
        return np.maximum(np.concatenate([amount.ravel() for amount in amounts]), 0.0)
