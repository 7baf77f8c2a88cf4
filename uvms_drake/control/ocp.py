"""The nominal finite-horizon optimal control problem (FHOCP): what its two forms share.

With y = (χ, q) the extended task, ξ the error state and u the input of the model,

    min  Σ_{k<N} h (‖ξ_k‖²_Q + ‖ū_k − u_ref‖²_R) + ‖ξ_N‖²_P + ρ s             (eq:mpc_cost_function)
    s.t. the model, from the state at the first knot                        (eq:diff_mpc)
         speeds, joints, roll and pitch of the vehicle, pitch of the end-effector, the static
         force on the surface and ū in limits                               (eq:mpc_constrained_set)
         ‖ξ_N‖_P ≤ ε + s,  s ≥ 0                                            (eq:mpc_terminal_set)

`DynamicOcp` has ξ = (y − y_des, ζ) and decides ζ̄̇, `KinematicOcp` has ξ = y − y_des and decides ζ̄. y
instead of 𝔮 as the state makes the cost, the joint limits and the terminal set exactly quadratic,
linear and conic. The terminal constraint is softened by an exact penalty: s is zero whenever that
is possible, and it is reported, never dropped.

A problem values a plan (`evaluate`) and makes the convex program about a plan (`staged_program`);
`scp` solves it fast, `nlp` is the reference.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Generic

import numpy as np

from uvms_drake.common.errors import require, vector
from uvms_drake.control.limits import NominalLimits
from uvms_drake.control.plan import P, advance_derivatives
from uvms_drake.control.staged_program import (
    LinearLimits,
    NormLimit,
    StagedProgram,
    TerminalLimit,
)
from uvms_drake.control.terminal import Terminal
from uvms_drake.model.euler import wrap_angle
from uvms_drake.model.surface.law import PlaneLaw, SpringLaw, static_force
from uvms_drake.model.uvms_model import UvmsModel, configuration_rate_matrix

INITIAL_STATES = ("nominal", "measured")
INPUT_REFERENCES = ("equilibrium", "zero")


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
    """Diagonal of Q for ζ; of R, where ζ is the input."""
    weight_u: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """Diagonal of R for ū − ū_eq; of no meaning where ζ is the input."""
    terminal_set: bool = True
    """Whether there is one; without it nothing is certified."""
    terminal_radius: float = 0.1
    """ε of the terminal set ‖ξ‖_P ≤ ε; declared."""
    initial_state: str = "nominal"
    """Where a plan starts: `nominal`, at what the last plan predicted, as the tube needs it; or
    `measured`, as (eq:diff_mpc) has it."""
    input_reference: str = "equilibrium"
    """ū that costs nothing: `equilibrium`, u_eq; or `zero`, as (eq:mpc_cost_function) has it."""
    deadline: float | None = None
    """Wall time after which a plan, other than the first, is too late and thrown away [s]; none if
    it is left out. A run that has one is not reproducible bit for bit."""
    terminal_weight: np.ndarray | None = None
    """Diagonal of P instead of a computed P, such as the paper's; no terminal controller then."""


@dataclass(frozen=True)
class Motion:
    """First-order model of the motion of a plan; index k is the knot or interval."""

    y: np.ndarray
    """(N+1, 6+n) ȳ at the knots, Euler angles within π of the desired ones."""
    dy_dy: np.ndarray
    """(N, 6+n, 6+n) ∂ȳ_{k+1}/∂ȳ_k."""
    dy_dzeta: np.ndarray
    """(N, 6+n, 6+n) ∂ȳ_{k+1}/∂ζ̄_k."""
    dy_da: np.ndarray
    """(N, 6+n, 6+n) ∂ȳ_{k+1}/∂ζ̄̇_k."""
    config_y: np.ndarray
    """(N+1, 6+n, 6+n) ∂𝔮̄/∂ȳ."""
    attitude: np.ndarray
    """(N+1, 2) (φ̄, θ̄) of the vehicle."""

    @property
    def attitude_y(self) -> np.ndarray:
        """(N+1, 2, 6+n) ∂(φ̄, θ̄)/∂ȳ."""
        return self.config_y[:, 3:5]


@dataclass(frozen=True)
class Evaluation:
    """What a plan is worth."""

    cost: float
    """The objective, with the terminal penalty ρ s."""
    terminal_slack: float
    """s = max(0, ‖ξ_N‖_P − ε)."""
    violation: float
    """Largest violation of a limit, in the limit's own unit, of the static force as a depth [m];
    zero for a feasible plan."""
    total_violation: float
    """Sum of all violations."""

    @property
    def merit(self) -> float:
        """Returns what a solver makes small: the cost with an exact penalty of the violations."""
        return self.cost + VIOLATION_PENALTY * self.total_violation


TERMINAL_PENALTY = 100.0
"""ρ: cost of leaving the terminal set by one unit of ‖ξ‖_P; far above the multipliers seen.

This and the next two are made for weights of the order of 1 to 1000: an exact penalty has to be
above the multipliers, which grow with the weights.
"""
SMALLEST_WEIGHT, LARGEST_WEIGHT = 1e-6, 1e6
"""Of every weight that is not zero; beyond, the penalties mean nothing, nor does P."""
VIOLATION_PENALTY = 1e3
"""Cost of one unit of violation; above every multiplier of a limit."""
EXCESS_PENALTY = 1e5
"""In a convex program, cost of relaxing all softened limits by one unit; above the sum of their
multipliers."""


class Ocp(ABC, Generic[P]):
    """The FHOCP of one task for one model.

    Args:
        model: Kinematics and dynamics.
        config: Horizon and weights.
        y_des: The extended task (χ_des, q_des) (6+n,).
        limits: Those that are left to the nominal trajectory.
    """

    Q: np.ndarray
    """Weight of ξ."""
    R: np.ndarray
    """Weight of ū − u_ref."""
    u_ref: np.ndarray
    """Input that costs nothing (6+n,)."""
    terminal: Terminal

    def __init__(self, model: UvmsModel, config: MpcConfig, y_des: np.ndarray,
                 limits: NominalLimits):
        require(config.horizon >= 1, "horizon", config.horizon, "a positive integer")
        require(0.0 < config.time_step < np.inf, "time_step", config.time_step, "positive")
        require(config.iterations >= 1, "iterations", config.iterations, "a positive integer")
        require(config.terminal_radius > 0.0, "terminal_radius", config.terminal_radius, "positive")
        require(config.deadline is None or 0.0 < config.deadline < np.inf, "deadline",
                config.deadline, "positive")
        for key, choices in (("initial_state", INITIAL_STATES),
                             ("input_reference", INPUT_REFERENCES)):
            require(getattr(config, key) in choices, key, getattr(config, key),
                    f"one of {', '.join(choices)}")
        self.model = model
        self.starts_at_measured = config.initial_state == "measured"
        self.horizon = config.horizon
        self.time_step = config.time_step
        self.iterations = config.iterations
        self.deadline = config.deadline
        # A plan about another equilibrium than the task's is not held back at its terminal set.
        self.ends_at_task = config.input_reference == "equilibrium"
        self.y_des = y_des
        self.limits = limits
        self._radius = config.terminal_radius if config.terminal_set else np.inf
        if limits.static_force is not None and not isinstance(model.surface, PlaneLaw | SpringLaw):
            raise TypeError(f"no limit on the force of a {type(model.surface).__name__}")
        self._stiffness = float(np.linalg.norm(model.surface.force_jacobian()[:, :3], 2))

    @property
    @abstractmethod
    def state_size(self) -> int:
        """Length of the state that a plan starts at."""

    @abstractmethod
    def resting_plan(self, time: float, state: np.ndarray) -> P:
        """Returns a first guess: come to rest from `state`."""

    @abstractmethod
    def errors(self, plan: P, y: np.ndarray) -> np.ndarray:
        """Returns ξ at the knots (N+1, size of ξ); `y` is ȳ there, unwrapped."""

    @abstractmethod
    def inputs(self, plan: P) -> tuple[np.ndarray, np.ndarray]:
        """Returns ū (N, 6+n) at the beginning and at the end of every interval."""

    @abstractmethod
    def nominal_input(self, at: tuple[np.ndarray, ...]) -> np.ndarray:
        """Returns ū (6+n,) where a plan is `at`, see `Plan.at`."""

    @abstractmethod
    def staged_program(self, plan: P) -> StagedProgram:
        """Returns the convex program about a plan, for the change of its decision."""

    @abstractmethod
    def _excess(self, plan: P, begin: np.ndarray, end: np.ndarray) -> list[np.ndarray]:
        """Returns by how much speeds and inputs are beyond their limits; negative within."""

    def unwrapped(self, y: np.ndarray) -> np.ndarray:
        """Returns y (..., 6+n) with the Euler angles within π of the desired ones."""
        y = y.copy()
        y[..., 3:6] = self.y_des[3:6] + wrap_angle(y[..., 3:6] - self.y_des[3:6])
        return y

    def continued(self, plan: P) -> P:
        """Returns the plan one interval later, its end continued by the terminal controller."""
        y = self.unwrapped(self.model.task_pose(plan.config))
        return plan.shifted(self.terminal.gain @ self.errors(plan, y)[-1])

    def evaluate(self, plan: P) -> Evaluation:
        """Returns the objective and the violations of a plan, nothing linearised."""
        y = self.unwrapped(self.model.task_pose(plan.config))
        xi = self.errors(plan, y)
        begin, end = self.inputs(plan)
        du = begin - self.u_ref
        stages = np.sum((xi[:-1] @ self.Q) * xi[:-1]) + np.sum((du @ self.R) * du)
        terminal = float(xi[-1] @ self.terminal.P @ xi[-1])
        slack = max(0.0, np.sqrt(terminal) - self.terminal.radius)
        amounts = [self.configuration_excess(plan.config[1:], y[1:]),
                   *self._excess(plan, begin, end)]
        excess = np.maximum(np.concatenate([amount.ravel() for amount in amounts]), 0.0)
        return Evaluation(
            cost=float(self.time_step * stages + terminal + TERMINAL_PENALTY * slack),
            terminal_slack=float(slack),
            violation=float(np.max(excess, initial=0.0)),
            total_violation=float(np.sum(excess)),
        )

    def configuration_excess(self, config: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Returns by how much 𝔮 and y (m, 6+n) are beyond their limits (m, ...); negative within.

        Angles [rad], and the static force over the stiffness of the surface [m].
        """
        limits = self.limits
        excess = [np.abs(config[:, 3:4]) - limits.roll, np.abs(config[:, 4:5]) - limits.pitch,
                  np.abs(y[:, 4:5]) - limits.tip_pitch,
                  y[:, 6:] - limits.q_upper, limits.q_lower - y[:, 6:]]
        if limits.static_force is not None:
            beyond = static_force(self.model.surface, y[:, :6]) - limits.static_force
            excess.append(beyond[:, None] / self._stiffness)
        return np.concatenate(excess, axis=1)

    def _motion(self, config: np.ndarray, zeta: np.ndarray, zeta_dot: np.ndarray) -> Motion:
        """Returns the first-order model of 𝔮̄ (N+1, 6+n) with ζ̄ and ζ̄̇ (N, 6+n) of the intervals."""
        y, J_x, _ = self.model.task_motion(config, np.zeros_like(config))
        Gamma = configuration_rate_matrix(config)
        config_y = Gamma @ np.linalg.inv(J_x)
        y_config = J_x[1:] @ np.linalg.inv(Gamma[1:])
        by_config, by_zeta, by_zeta_dot = (y_config @ rate for rate in advance_derivatives(
            config[:-1], zeta, zeta_dot, self.time_step))
        return Motion(y=self.unwrapped(y), dy_dy=by_config @ config_y[:-1], dy_dzeta=by_zeta,
                      dy_da=by_zeta_dot, config_y=config_y, attitude=config[:, 3:5])

    def _program(self, A: np.ndarray, B: np.ndarray, u: np.ndarray, u_z: np.ndarray,
                 xi: np.ndarray, linear: LinearLimits, norms: tuple[NormLimit, ...]
                 ) -> StagedProgram:
        """Returns the program of a model ξ⁺ = Aξ + Bw whose input is `u` + `u_z` (ξ, w)."""
        h, nx = self.time_step, xi.shape[1]
        weighted = 2.0 * h * self.R @ u_z
        H = np.swapaxes(u_z, 1, 2) @ weighted
        H[:, :nx, :nx] += 2.0 * h * self.Q
        g = ((u - self.u_ref)[:, None, :] @ weighted)[:, 0]
        g[:, :nx] += 2.0 * h * xi[:-1] @ self.Q
        penalty, root = self.terminal.P, self.terminal.root
        return StagedProgram(
            A=A, B=B, H=H, g=g, H_end=2.0 * penalty, g_end=2.0 * penalty @ xi[-1],
            linear=linear, norms=norms,
            terminal=TerminalLimit(root, root @ xi[-1], self.terminal.radius),
            slack_penalty=TERMINAL_PENALTY, excess_penalty=EXCESS_PENALTY)

    def _configuration_limits(self, motion: Motion, width: int) -> LinearLimits:
        """Returns the limits on attitude and joints, as rows of z (`width`,) that starts with y."""
        limits, (knots, size) = self.limits, motion.y.shape
        C = np.zeros((knots, size - 3, width))
        C[:, :2, :size] = motion.attitude_y
        C[:, range(2, size - 3), [4, *range(6, size)]] = 1.0
        value = np.concatenate([motion.attitude, motion.y[:, 4:5], motion.y[:, 6:]], axis=1)
        angles = [limits.roll, limits.pitch, limits.tip_pitch]
        upper = np.tile(np.concatenate([angles, limits.q_upper]), (knots, 1))
        lower = np.tile(np.concatenate([np.negative(angles), limits.q_lower]), (knots, 1))
        upper[0], lower[0] = np.inf, -np.inf  # The first knot is given.
        soft = np.arange(size - 3) < 2
        return LinearLimits(C, value, lower, upper, soft)

    def _depth_limits(self, y: np.ndarray, width: int) -> list[LinearLimits]:
        """Returns the limit on the static force of a plane, or none; a spring has a `NormLimit`.

        Args:
            y: ȳ (N+1, 6+n), with which z starts.
            width: Length of z.
        """
        force, surface, knots = self.limits.static_force, self.model.surface, len(y)
        if force is None or not isinstance(surface, PlaneLaw):
            return []
        C = np.zeros((knots, 1, width))
        C[:, 0, :3] = -surface.normal
        upper = np.full((knots, 1), surface.depth_for(force))
        upper[0] = np.inf
        return [LinearLimits(C, surface.depth(y[:, :3])[:, None], np.full((knots, 1), -np.inf),
                             upper, np.zeros(1, dtype=bool))]

    def _norm_limits(self, y: np.ndarray, zeta: np.ndarray, width: int, free_knot: int
                     ) -> tuple[NormLimit, ...]:
        """Returns the limits on ‖ν̄₁‖, ‖ν̄₂‖ and ‖q̄̇‖, and on the static force of a spring.

        Args:
            y: ȳ (N+1, 6+n), with which z starts.
            zeta: ζ̄ (N+1, 6+n), which follows in z.
            width: Length of z.
            free_knot: The one at which ζ̄ is given, or of no meaning.
        """
        limits, size, surface = self.limits, self.model.size, self.model.surface
        out, eye = [], np.eye(width)
        for first, last, bound in ((0, 3, limits.nu1), (3, 6, limits.nu2), (6, size, limits.qdot)):
            bounds = np.full(len(zeta), bound)
            bounds[free_knot] = np.inf
            out.append(NormLimit(eye[size + first: size + last], zeta[:, first:last], bounds))
        if limits.static_force is not None and isinstance(surface, SpringLaw):
            # In metres, for scale: everything else here is of about that size.
            stretch = surface.force(y[:, :6], np.zeros_like(y[:, :6]))[:, :3] / self._stiffness
            bounds = np.full(len(y), limits.static_force / self._stiffness)
            bounds[0] = np.inf
            out.append(NormLimit(
                surface.force_jacobian() @ eye[:6] / self._stiffness, stretch, bounds))
        return tuple(out)


def input_limits(value: np.ndarray, by_z: np.ndarray, bound: np.ndarray) -> LinearLimits:
    """Returns the soft limits |value + by_z z| ≤ bound of the N intervals; the last knot has none.

    Args:
        value: (N, m).
        by_z: (N, m, size of z).
        bound: (m,).
    """
    C = np.concatenate([by_z, np.zeros((1, *by_z.shape[1:]))])
    upper = np.concatenate([np.tile(bound, (len(value), 1)), np.full((1, len(bound)), np.inf)])
    return LinearLimits(C, np.concatenate([value, np.zeros((1, len(bound)))]), -upper, upper,
                        np.ones(len(bound), dtype=bool))


def weight(config: MpcConfig, key: str, size: int, *, zeros: bool = False) -> np.ndarray:
    """Returns a weight of an `MpcConfig`: `size` positive numbers, or `zeros` among them too."""
    values = vector(key, getattr(config, key), size)
    usual = (values >= SMALLEST_WEIGHT) & (values <= LARGEST_WEIGHT)
    require(bool(np.all(usual | (values == 0.0) if zeros else usual)), key, values,
            f"{size} positive numbers{' or zeros' if zeros else ''}, from {SMALLEST_WEIGHT:g} to "
            f"{LARGEST_WEIGHT:g}")
    return values
