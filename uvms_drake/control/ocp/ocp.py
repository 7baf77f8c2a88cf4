"""Nominal finite-horizon optimal control problem (FHOCP) of a task.

With y = (χ, q) the extended task, ξ = (y − y_des, ζ) and ζ̄̇ constant on N intervals of length h,

    min  Σ_{k<N} h (‖ξ_k‖²_Q + ‖ū_k − u_eq‖²_R + ...) + ‖ξ_N‖²_P + ρ s       (eq:mpc_cost_function)
    s.t. ȳ_{k+1} = Φ(ȳ_k, ζ̄_k, ζ̄̇_k),  ζ̄_{k+1} = ζ̄_k + h ζ̄̇_k                         (eq:diff_mpc)
         speeds, joints, roll and pitch of the vehicle, pitch of the end-effector, the static force
         on the surface; ū = ζ̄̇ − f(𝔮̄, ζ̄) and M(𝔮̄)ū at both ends       (eq:mpc_constrained_set)
         ‖ξ_N‖_P ≤ ε + s,  s ≥ 0                                            (eq:mpc_terminal_set)

ζ̄̇ is decided instead of ū: the rollout is then kinematic, never stiff and exact, whatever the
surface's stiffness. y instead of 𝔮 as the state makes the cost, the joint limits and the terminal
set exactly quadratic, linear and conic. The terminal constraint is softened by an exact penalty: s
is zero whenever that is possible, and it is reported. Limits and terms of the cost are objects.

Between the knots speeds are convex combinations and stay within their limits; an angle, a depth
and ū can exceed theirs by h²/8 times their second derivative. `scp`, `ocp_program` solve it.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Annotated, ClassVar, NamedTuple, Self

import numpy as np

from uvms_drake.common.constraints import AtLeast, NotNegative, OneOf, Positive
from uvms_drake.common.errors import require, vector, within
from uvms_drake.common.schema import check_values
from uvms_drake.control.convex.staged_program import RadiusBound, StagedProgram, TerminalLimit
from uvms_drake.control.costs.costs import CostTerm, TaskCost
from uvms_drake.control.limits import Limit
from uvms_drake.control.ocp.limit_stack import Inputs, LimitStack, Values
from uvms_drake.control.plan.plan import Plan, advance, advance_derivatives
from uvms_drake.control.plan.points import Points, Slopes, check_slopes
from uvms_drake.control.plan.terminal import declared_terminal, terminal_ingredients
from uvms_drake.model.frames.euler import inverse_rate_matrix, wrap_angle
from uvms_drake.model.frames.spatial import block_diagonal
from uvms_drake.model.uvms_model import UvmsModel, configuration_rate_matrix

STRUCTURED = "structured"
SOLVERS = (STRUCTURED, "clarabel", "gurobi", "ipopt", "mosek", "nlopt", "osqp", "scs", "snopt")
"""Names of solvers, see `solvers`."""


@dataclass
class MpcConfig:
    """Horizon, weights and solver settings of the nominal MPC."""

    horizon: Annotated[int, AtLeast(1)] = 20
    """Number N of intervals."""
    time_step: Annotated[float, Positive] = 0.2
    """Length h of an interval and sampling period [s]; T = N h."""
    iterations: Annotated[int, AtLeast(1)] = 1
    """Sequential convex iterations per sample; the first solve iterates to convergence."""
    solver: Annotated[str, OneOf(*SOLVERS)] = STRUCTURED
    """Solver: `structured`, which knows the stages of the program; or one of Drake's: of the convex
    programs (`clarabel`, `gurobi`, `mosek`, `osqp`, `scs`), with the same plans; or of the whole
    nonlinear program (`ipopt`, `nlopt`, `snopt`), to its optimum, whatever `iterations` is."""
    weight_y: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """Diagonal of Q for y − y_des, y = (𝔭, 𝔬, q)."""
    weight_zeta: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """Diagonal of Q for ζ."""
    weight_u: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """Diagonal of R for ū − ū_eq."""
    terminal_set: bool = True
    """Whether plans must end in a terminal set; without it nothing is certified."""
    terminal_radius: Annotated[float, Positive] = 0.1
    """Radius ε of the terminal set ‖ξ‖_P ≤ ε; declared."""
    initial_state: Annotated[str, OneOf("nominal", "measured")] = "nominal"
    """Start of a plan: `nominal`, the state that the last plan predicted, as the tube requires; or
    `measured`, as in (eq:diff_mpc)."""
    hover: Annotated[float, NotNegative] = 0.0
    """Time of the Context until which the robot keeps its place, so that its observers settle [s];
    it plans from the first sample not before it. A mission's clocks run meanwhile. Without a
    certificate the tube is monitored from then on."""
    deadline: Annotated[float, Positive] | None = None
    """Wall time after which a plan, other than the first, is discarded [s]; none if it is left out.
    A run that has one is not reproducible bit for bit."""
    in_advance: bool = False
    """Whether a plan is computed in advance: the plan of a sample comes at the next one, and
    one more interval of each is committed. So a computer may take a sampling period for it."""
    terminal_weight: np.ndarray | None = None
    """Diagonal of P instead of a computed P, such as the paper's; no terminal controller then."""
    terms: list[CostTerm] = field(default_factory=list)
    """Further terms of the cost; a script may put any `CostTerm` here. With one there is no
    certificate: the proofs are about the task's cost alone."""


class PlanPoints(NamedTuple):
    """Points of a plan at which it has limits and costs."""

    knots: Points
    """Points of the N+1 knots."""
    begin: Points
    """Points of the N beginnings of the intervals, with ū."""
    values: Values
    """Limited values."""


@dataclass(frozen=True)
class Evaluation:
    """Cost and violations of a plan."""

    cost: float
    """Objective, with the terminal penalty ρ s."""
    terminal_slack: float
    """Slack s = max(0, ‖ξ_N‖_P − ε)."""
    violation: float
    """Largest violation of a limit, in the limit's own unit, of the static force as a depth [m];
    zero for a feasible plan."""
    total_violation: float
    """Sum of all violations."""

    @property
    def merit(self) -> float:
        """Merit function: cost with an exact penalty of the violations."""
        return self.cost + VIOLATION_PENALTY * self.total_violation


TERMINAL_PENALTY = 100.0
"""Cost ρ of leaving the terminal set by one unit of ‖ξ‖_P; far above the multipliers seen.

This and the next two suit weights of the order of 1 to 1000: an exact penalty has to be above the
multipliers, which grow with the weights.
"""
SMALLEST_WEIGHT, LARGEST_WEIGHT = 1e-6, 1e6
"""Range of every weight that is not zero, for the penalties and for P."""
VIOLATION_PENALTY = 1e3
"""Cost of one unit of violation; above every multiplier of a limit."""
EXCESS_PENALTY = 1e5
"""Cost in a convex program of relaxing all softened limits by one unit; above the sum of their
multipliers."""
FEASIBLE = 1e-4
"""Largest violation that a plan may have if there is another, in the unit of the limit that it
violates; of the terminal set, in ‖ξ‖_P."""


class Ocp:
    """FHOCP of one task for one model.

    Args:
        model: Kinematics and dynamics.
        mpc: Horizon and weights.
        y_des: Desired extended task (χ_des, q_des) (6+n,).
        limits: Tightened limits of the nominal trajectory, by name.
    """

    strict: ClassVar[bool] = False
    """Whether every plan has to be sound, from the first on, for recursive feasibility."""
    tolerance: ClassVar[float] = FEASIBLE
    """Largest violation of a sound plan."""
    moved: np.ndarray = np.empty(0, dtype=int)
    """Components of y_des by which a plan moves its reference, by a (m,)."""

    def __init__(self, model: UvmsModel, mpc: MpcConfig, y_des: np.ndarray,
                 limits: dict[str, Limit]):
        check_values(mpc)
        self.model = model
        self.starts_at_measured = mpc.initial_state == "measured"
        self.horizon = mpc.horizon
        self.time_step = mpc.time_step
        self.iterations = mpc.iterations
        self.solver = mpc.solver
        self.hover = mpc.hover
        self.deadline, self.in_advance = mpc.deadline, mpc.in_advance
        self.y_des = y_des
        self.limits = limits
        self.own_terms: list[CostTerm] = list(mpc.terms)
        self._check_own()
        self._stacked = self._stack_of(limits)
        # Cost about the equilibrium, and the terminal set.
        size, radius = model.size, mpc.terminal_radius if mpc.terminal_set else np.inf
        declared = mpc.terminal_weight is not None
        Q = np.diag(np.concatenate([weight(mpc, key, size, zeros=declared)
                                    for key in ("weight_y", "weight_zeta")]))
        R = np.diag(weight(mpc, "weight_u", size))
        require(bool(np.any(Q[:size] > 0.0)), "weight_y", mpc.weight_y, "not all zero")
        config_des = model.configuration(y_des)
        self.u_eq = model.equilibrium_input(config_des)
        self.task_cost = TaskCost(Q, R, y_des, self.u_eq)
        if declared:
            self.terminal = declared_terminal(
                weight(mpc, "terminal_weight", 2 * size, zeros=True), size, radius)
            return
        _, f_config, f_zeta = model.drift_derivatives(config_des[None], np.zeros((1, size)))
        J_x = model.task_jacobian(config_des)
        f_y = f_config[0] @ configuration_rate_matrix(config_des) @ np.linalg.inv(J_x)
        self.terminal = terminal_ingredients(J_x, f_y, f_zeta[0], Q, R, mpc.time_step, radius)

    def _check_own(self) -> None:
        """Raises `TypeError` for a limit or a term with wrong derivatives."""
        at = self._examples()
        for limit in self.limits.values():
            if type(limit).slopes is Limit.slopes and type(limit).cone is Limit.cone:
                check_slopes(f"limits.{limit.name}", limit.values, at, limit.about)
        for i, term in enumerate(self.own_terms):
            with within(f"terms[{i}]"):
                check_slopes(f"mpc.terms[{i}]", term.residual, at, term.about)

    def _examples(self) -> Points:
        """Returns two points near the task, of ordinary size."""
        size = self.model.size
        zeta, u = 0.1 * np.sin(np.arange(4 * size)).reshape(2, 2, size)
        y = self.y_des + 0.1 * zeta
        return Points(self.model, self.model.configuration(y), y, zeta, u)

    def _stack_of(self, limits: dict[str, Limit], stages: int | None = None) -> LimitStack:
        """Returns limits in arrays, for the states and decisions of this problem."""
        return LimitStack(limits, self._examples(), stages or self.horizon + 1,
                          self.state_size + self.model.size)

    def interval_stack(self) -> LimitStack:
        """Returns the limits in arrays, by the variables of intervals as `interval_inputs` has."""
        return LimitStack(self.limits, self._examples(), self.horizon + 1,
                          2 * self.state_size + self.model.size)

    def stack(self, plan: Plan) -> LimitStack:
        """Returns the limits in arrays, for a plan of usually N intervals."""
        if len(plan.config) != self.horizon + 1:
            return self._stack_of(self.limits, len(plan.config))
        if not self._stacked.is_of(self.limits, self.horizon + 1):
            self._stacked = self._stack_of(self.limits)
        return self._stacked

    @property
    def Q(self) -> np.ndarray:
        """Weight of ξ."""
        return self.task_cost.Q

    @property
    def R(self) -> np.ndarray:
        """Weight of ū − u_ref."""
        return self.task_cost.R

    @property
    def state_size(self) -> int:
        """Size 2(6+n) of (𝔮, ζ)."""
        return 2 * self.model.size

    def resting_plan(self, time: float, state: np.ndarray, coasting: int = 0) -> Plan:
        """Returns a first guess: coast from (𝔮, ζ) (2(6+n),), come to rest over the horizon."""
        config, zeta = np.split(state, 2)
        duration = self.horizon * self.time_step
        zeta_dot = np.tile(-zeta / duration, (coasting + self.horizon, 1))
        zeta_dot[:coasting] = 0.0
        return Plan.from_accelerations(time, self.time_step, config, zeta, zeta_dot)

    def errors(self, plan: Plan, y: np.ndarray) -> np.ndarray:
        """Returns ξ = (y − y_des, ζ) at the knots (N+1, 2(6+n))."""
        return np.concatenate([y - self.y_des, plan.zeta], axis=1)

    def inputs(self, plan: Plan) -> tuple[np.ndarray, np.ndarray]:
        """Returns ū (N, 6+n) at the beginning and at the end of every interval."""
        return self._inputs_at(plan, self._knots(plan))

    def _inputs_at(self, plan: Plan, knots: Points) -> tuple[np.ndarray, np.ndarray]:
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

    def staged_program(self, plan: Plan, points: PlanPoints | None = None) -> StagedProgram:
        """Returns the convex program about a plan; its w is the change of ζ̄̇."""
        points = points or self.points(plan)
        knots, N, size = points.knots, self.horizon, self.model.size
        # The next (ȳ, ζ̄) by ȳ and ζ̄, and by ζ̄̇.
        y_config = self.model.extended(knots.kinematics.J_chi[1:])
        y_config[..., :6] = y_config[..., :6] @ block_diagonal(
            np.swapaxes(knots.kinematics.R_WB[1:], -1, -2),
            inverse_rate_matrix(knots.config[1:, 3:6]))
        by_config, by_zeta, by_zeta_dot = (y_config @ rate for rate in advance_derivatives(
            knots.config[:-1], plan.zeta[:-1], plan.zeta_dot, self.time_step))
        A, B = np.zeros((N, 2 * size, 2 * size)), np.zeros((N, 2 * size, size))
        A[:, :size] = np.concatenate([by_config @ knots.config_y[:-1], by_zeta], axis=2)
        A[:, size:, size:] = np.eye(size)
        B[:, :size], B[:, size:] = by_zeta_dot, self.time_step * np.eye(size)
        return self._program(plan, A, B, points, self.linearised_inputs(plan, knots, A, B))

    def linearised_inputs(self, plan: Plan, knots: Points, A: np.ndarray, B: np.ndarray) -> Inputs:
        """Returns ū at both ends of the intervals and its derivatives by (ξ, ζ̄̇) at the first.

        A and B are the derivatives of ξ at the last.
        """
        N, size = self.horizon, self.model.size
        xi_z = np.zeros((2 * N, 2 * size, 3 * size))
        xi_z[:N, :, : 2 * size] = np.eye(2 * size)
        xi_z[N:, :, : 2 * size], xi_z[N:, :, 2 * size:] = A, B
        return self._inputs_by(plan, knots, xi_z)

    def interval_inputs(self, plan: Plan, knots: Points) -> Inputs:
        """Returns ū at both ends of the intervals, which need not meet, and its derivatives.

        Those by (y, ζ) at the first, ζ̄̇, and (y, ζ) at the last.
        """
        N, size = len(plan.zeta_dot), self.model.size
        xi_z = np.zeros((2 * N, 2 * size, 5 * size))
        xi_z[:N, :, : 2 * size] = xi_z[N:, :, 3 * size:] = np.eye(2 * size)
        return self._inputs_by(plan, knots, xi_z)

    def _drift_slopes(self, plan: Plan, knots: Points) -> tuple[np.ndarray, np.ndarray]:
        """Returns ∂f/∂ȳ and ∂f/∂ζ̄ at the knots (N+1, 6+n, 6+n)."""
        f_config, f_zeta = self.model.drift_gradients(
            plan.config, plan.zeta, knots.drift, knots.kinematics, knots.inverse_mass)
        return f_config @ knots.config_y, f_zeta

    def _inputs_by(self, plan: Plan, knots: Points, xi_z: np.ndarray) -> Inputs:
        """Returns ū at both ends of the intervals and its derivatives by z, the third part ζ̄̇.

        Args:
            plan: The plan.
            knots: Its knots.
            xi_z: ∂ξ/∂z at the beginnings, then at the ends (2N, 2(6+n), size of z).
        """
        N, size = len(plan.zeta_dot), self.model.size
        f_xi = np.concatenate(self._drift_slopes(plan, knots), axis=2)
        # ∂ū/∂z = ∂ζ̄̇/∂z − ∂f/∂ξ ∂ξ/∂z.
        u_z = np.concatenate([-f_xi[:-1] @ xi_z[:N], -f_xi[1:] @ xi_z[N:]])
        u_z[..., 2 * size: 3 * size] += np.eye(size)
        return Inputs(self._ends(plan, knots), xi_z[:, :size], xi_z[:, size:], u_z)

    def is_sound(self, value: Evaluation | None, slack: float | None = None) -> bool:
        """Returns whether a plan keeps its limits and ends within `slack` of the terminal set.

        Where `slack` is left out, it is the `tolerance`.
        """
        return (value is not None and value.violation <= self.tolerance
                and value.terminal_slack <= (self.tolerance if slack is None else slack))

    def keeps(self, value: Evaluation, other: Evaluation) -> bool:
        """Returns whether a plan is sound, or no worse than another one that is not."""
        beyond, before = (max(each.violation, each.terminal_slack) for each in (value, other))
        return self.is_sound(value) or (not self.is_sound(other) and beyond <= before)

    def improves(self, new: Evaluation, old: Evaluation) -> bool:
        """Returns whether a plan may take another's place: it is better and, if strict, `keeps`."""
        return new.merit < old.merit and (not self.strict or self.keeps(new, old))

    @property
    def inputs_given(self) -> dict[str, int]:
        """Sizes of the problem's inputs at run time, by the names of ports."""
        return {}

    @property
    def reach_names(self) -> tuple[str, ...]:
        """Names of the values that `reached` returns."""
        return ()

    def given(self, values: dict[str, np.ndarray]) -> Self:
        """Returns the problem for values of `inputs_given`, by name; some may be missing."""
        return self

    def unwrapped(self, y: np.ndarray) -> np.ndarray:
        """Returns y (..., 6+n) with the Euler angles within π of the desired ones."""
        y = y.copy()
        y[..., 3:6] = self.y_des[3:6] + wrap_angle(y[..., 3:6] - self.y_des[3:6])
        return y

    def _error(self, config: np.ndarray) -> np.ndarray:
        """Returns y − y_des (..., 6+n) at 𝔮, angles wrapped; also complex."""
        error = self.model.task_pose(config) - self.y_des
        error[..., 3:6] -= 2.0 * np.pi * np.round(error[..., 3:6].real / (2.0 * np.pi))
        return error

    @property
    def lasting_limits(self) -> dict[str, Limit]:
        """Constant limits, which a terminal set has to keep."""
        return self.limits

    def reached(self, at: Points) -> tuple[np.ndarray, np.ndarray]:
        """Returns m values (..., m), zero at ξ = 0, and their largest multiples (m,) of ‖ξ‖_P.

        Unlike limits, these bounds have to hold for every radius of the terminal set.
        """
        return np.empty((*at.config.shape[:-1], 0)), np.empty(0)

    def terminal_radius(self, plan: Plan) -> float:
        """Returns the radius of the terminal set that a plan has to end in."""
        return self.terminal.radius

    def stage_cost(self, plan: Plan) -> TaskCost:
        """Returns the task's cost of a plan."""
        return self.task_cost

    def offset_cost(self, plan: Plan) -> tuple[float, np.ndarray]:
        """Returns the cost of the plan's reference and its gradient by a (m,)."""
        return 0.0, np.zeros(len(self.moved))

    def radius_bound(self, plan: Plan) -> RadiusBound | None:
        """Returns bounds of the terminal radius other than ε, with gradients by a, if any."""
        return None

    def terminal_vector(self, plan: Plan, y: np.ndarray
                        ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Returns v (r,) with ‖v‖₂ = ‖ξ_N‖_P, and its derivatives by ξ_N + E a and by a.

        Args:
            plan: The plan.
            y: ȳ at the knots, unwrapped.
        """
        root = self.terminal.root
        return root @ self.errors(plan, y)[-1], root, -root[:, self.moved]

    def continued(self, plan: Plan) -> Plan:
        """Returns the plan one interval later, its end continued by the terminal controller.

        Outside of the terminal set the controller gets ξ_N scaled to the set's boundary, since far
        away nothing keeps its input within limits.
        """
        end = plan.after(len(plan.config) - 1)
        xi = self.errors(end, self.unwrapped(self.model.task_pose(end.config)))[0]
        size, radius = np.linalg.norm(self.terminal.root @ xi), self.terminal_radius(plan)
        if size > radius + FEASIBLE:
            xi = max(radius, 0.0) / size * xi
        return plan.shifted(self.terminal.gain @ xi)

    def evaluate(self, plan: Plan, points: PlanPoints | None = None) -> Evaluation:
        """Returns the objective and the violations of a plan, nothing linearised.

        Args:
            plan: The plan.
            points: Its points, if they are known.
        """
        points = points or self.points(plan)
        xi = self.errors(plan, points.knots.y)
        stages = sum(term.value(points.begin)
                     for term in (self.stage_cost(plan), *self.own_terms))
        terminal = float(xi[-1] @ self.terminal.P @ xi[-1])
        slack = max(0.0, np.sqrt(terminal) - self.terminal_radius(plan))
        excess = np.maximum(self.stack(plan).excess(points.values, points.knots), 0.0)
        return Evaluation(
            cost=float(self.time_step * stages + terminal + TERMINAL_PENALTY * slack),
            terminal_slack=float(slack),
            violation=float(np.max(excess, initial=0.0)),
            total_violation=float(np.sum(excess)),
        )

    def excesses(self, plan: Plan) -> Iterator[tuple[Limit, np.ndarray, np.ndarray]]:
        """Yields the limits, times (T,) [s], and a plan's excesses there (T, m)."""
        times = plan.start_time + self.time_step * np.arange(len(plan.config))
        knots = self._knots(plan)
        first, last = slice(-1), slice(1, None)
        begin, end = self._inputs_at(plan, knots)
        for limit in self.limits.values():
            if limit.about == "input":
                yield limit, times[first], limit.excess(knots.subset(first, begin))
                yield limit, times[last], limit.excess(knots.subset(last, end))
            else:
                yield limit, times[last], limit.excess(knots.subset(last))

    def points(self, plan: Plan) -> PlanPoints:
        """Returns the points of a plan at which it has limits and costs."""
        knots = self._knots(plan)
        ends, first = self._ends(plan, knots), slice(len(plan.config) - 1)
        return PlanPoints(knots, ends.subset(first, ends.u[first]),
                          self.stack(plan).values(knots, ends))

    def _ends(self, plan: Plan, knots: Points) -> Points:
        """Returns the beginnings of the intervals, then their ends, where the input is another."""
        first = np.arange(len(plan.config) - 1)
        return knots.subset(np.concatenate([first, first + 1]),
                            np.concatenate(self._inputs_at(plan, knots)))

    def _knots(self, plan: Plan) -> Points:
        """Returns the points of the knots of a plan."""
        return Points.known(
            self.model, plan.config, self.model.kinematics(plan.config), self.unwrapped,
            plan.zeta)

    def _program(self, plan: Plan, A: np.ndarray, B: np.ndarray, points: PlanPoints, inputs: Inputs
                 ) -> StagedProgram:
        """Returns the program about a plan, of a model ξ⁺ = Aξ + Bw.

        Args:
            plan: The plan.
            A: Derivatives by ξ (N, nx, nx).
            B: Derivatives by w (N, nx, nw).
            points: Points of the plan.
            inputs: Its inputs and their derivatives.
        """
        knots, begin = points.knots, points.begin
        by_z = [each[: len(A)] for each in inputs[1:]]
        xi = self.errors(plan, knots.y)
        H, g = self.stage_cost(plan).quadratic(begin, Slopes(*by_z), self.time_step)
        for term in self.own_terms:
            more_H, more_g = term.quadratic(begin, Slopes(*by_z), self.time_step)
            H, g = H + more_H, g + more_g
        penalty, root = self.terminal.P, self.terminal.root
        return StagedProgram(
            A=A, B=B, H=H, g=g, H_end=2.0 * penalty, g_end=2.0 * penalty @ xi[-1],
            linear=self.stack(plan).linear(knots, points.values, inputs),
            norms=self.stack(plan).norms(points.values),
            terminal=TerminalLimit(root, root @ xi[-1], self.terminal.radius),
            slack_penalty=TERMINAL_PENALTY, excess_penalty=EXCESS_PENALTY)

    def revalued(self, program: StagedProgram, plan: Plan, points: PlanPoints) -> StagedProgram:
        """Returns a program with its own slopes and the limited values at another plan.

        Args:
            program: The program.
            plan: The plan.
            points: Points of the plan.
        """
        rows, cones = points.values
        first = len(program.linear.value) - len(rows)  # A stage before the plan has no limits.

        def after_first(values: np.ndarray) -> np.ndarray:
            out = np.zeros((first + len(values), values.shape[1]))
            out[first:] = values
            return out

        return replace(
            program, linear=program.linear._replace(value=after_first(rows)),
            norms=tuple(norm._replace(value=after_first(cone))
                        for norm, cone in zip(program.norms, cones, strict=True)),
            terminal=program.terminal._replace(
                value=self.terminal.root @ self.errors(plan, points.knots.y)[-1]))


def weight(mpc: MpcConfig, key: str, size: int, *, zeros: bool = False) -> np.ndarray:
    """Returns a weight of an `MpcConfig`: `size` positive numbers, or `zeros` among them too."""
    values = vector(key, getattr(mpc, key), size)
    usual = (values >= SMALLEST_WEIGHT) & (values <= LARGEST_WEIGHT)
    require(bool(np.all(usual | (values == 0.0) if zeros else usual)), key, values,
            f"{size} positive numbers{' or zeros' if zeros else ''}, from {SMALLEST_WEIGHT:g} to "
            f"{LARGEST_WEIGHT:g}")
    return values
