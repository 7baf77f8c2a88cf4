"""Nominal finite-horizon optimal control problem (FHOCP): the base of its two forms.

With y = (χ, q) the extended task, ξ the error state and u the input of the model,

    min  Σ_{k<N} h (‖ξ_k‖²_Q + ‖ū_k − u_ref‖²_R + ...) + ‖ξ_N‖²_P + ρ s       (eq:mpc_cost_function)
    s.t. the model, from the state at the first knot                        (eq:diff_mpc)
         speeds, joints, roll and pitch of the vehicle, pitch of the end-effector, the static
         force on the surface and ū in limits                               (eq:mpc_constrained_set)
         ‖ξ_N‖_P ≤ ε + s,  s ≥ 0                                            (eq:mpc_terminal_set)

Limits and terms of the cost are objects, a user's own among them (`limits`, `costs`).
`DynamicOcp` has ξ = (y − y_des, ζ) and decides ζ̄̇, `KinematicOcp` has ξ = y − y_des and decides
ζ̄. y instead of 𝔮 as the state makes the cost, the joint limits and the terminal set exactly
quadratic, linear and conic. The terminal constraint is softened by an exact penalty: s is zero
whenever that is possible, and it is reported, never dropped.

A problem values a plan (`evaluate`) and makes the convex program about a plan (`staged_program`);
`mathematical_program` is the whole of it in Drake's form. `scp` and `nonlinear_solver` solve it.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Annotated, ClassVar, Generic, NamedTuple, Self

import numpy as np

from uvms_drake.common.constraints import AtLeast, NotNegative, OneOf, Positive
from uvms_drake.common.errors import require, vector, within
from uvms_drake.common.schema import check_values
from uvms_drake.control.convex.staged_program import RadiusBound, StagedProgram, TerminalLimit
from uvms_drake.control.costs.costs import CostTerm, TaskCost
from uvms_drake.control.limits import Limit
from uvms_drake.control.ocp.limit_stack import Inputs, LimitStack, Values
from uvms_drake.control.ocp.ocp_program import OcpProgram
from uvms_drake.control.plan.plan import P, advance_derivatives
from uvms_drake.control.plan.points import Points, Slopes, check_slopes
from uvms_drake.control.plan.terminal import Terminal
from uvms_drake.model.frames.euler import inverse_rate_matrix, wrap_angle
from uvms_drake.model.frames.spatial import block_diagonal
from uvms_drake.model.uvms_model import UvmsModel

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
    """Diagonal of Q for ζ; of R, where ζ is the input."""
    weight_u: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """Diagonal of R for ū − ū_eq; not read where ζ is the input."""
    terminal_set: bool = True
    """Whether plans must end in a terminal set; without it nothing is certified."""
    terminal_radius: Annotated[float, Positive] = 0.1
    """Radius ε of the terminal set ‖ξ‖_P ≤ ε; declared."""
    initial_state: Annotated[str, OneOf("nominal", "measured")] = "nominal"
    """Start of a plan: `nominal`, the state that the last plan predicted, as the tube requires; or
    `measured`, as in (eq:diff_mpc)."""
    input_reference: Annotated[str, OneOf("equilibrium", "zero")] = "equilibrium"
    """Input without cost: `equilibrium`, u_eq; or `zero`, as in (eq:mpc_cost_function)."""
    hover: Annotated[float, NotNegative] = 0.0
    """Time of the Context until which the robot keeps its place, so that its observers settle [s];
    it plans from the first sample not before it. A mission's clocks run meanwhile. Without a
    certificate the tube is monitored from then on."""
    deadline: Annotated[float, Positive] | None = None
    """Wall time after which a plan, other than the first, is discarded [s]; none if it is left out.
    A run that has one is not reproducible bit for bit."""
    terminal_weight: np.ndarray | None = None
    """Diagonal of P instead of a computed P, such as the paper's; no terminal controller then."""
    terms: list[CostTerm] = field(default_factory=list)
    """Further terms of the cost; a script may put any `CostTerm` here. With one there is no
    certificate: the proofs are about the task's cost alone."""


@dataclass(frozen=True)
class Transitions:
    """First-order model of the motion of a plan; index k is the knot or interval."""

    knots: Points
    """Points of the N+1 knots; Euler angles of y within π of the desired ones."""
    dy_dy: np.ndarray
    """∂ȳ_{k+1}/∂ȳ_k (N, 6+n, 6+n)."""
    dy_dzeta: np.ndarray
    """∂ȳ_{k+1}/∂ζ̄_k (N, 6+n, 6+n)."""
    dy_da: np.ndarray
    """∂ȳ_{k+1}/∂ζ̄̇_k (N, 6+n, 6+n)."""


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


class Ocp(ABC, Generic[P]):
    """FHOCP of one task for one model.

    Args:
        model: Kinematics and dynamics.
        mpc: Horizon and weights.
        y_des: Desired extended task (χ_des, q_des) (6+n,).
        limits: Tightened limits of the nominal trajectory, by name.
    """

    given_speed: ClassVar[int]
    """Knot at which ζ̄ is not decided."""
    has_accelerations: ClassVar[bool]
    """Whether a plan has accelerations ζ̄̇."""
    input_ends: ClassVar[int] = 2
    """Number of ends of an interval with different inputs."""
    strict: ClassVar[bool] = False
    """Whether every plan has to be sound, from the first on, for recursive feasibility."""
    tolerance: ClassVar[float] = FEASIBLE
    """Largest violation of a sound plan."""
    moved: np.ndarray = np.empty(0, dtype=int)
    """Components of y_des by which a plan moves its reference, by a (m,)."""
    terminal_penalty: ClassVar[float] = TERMINAL_PENALTY
    task_cost: TaskCost
    terminal: Terminal

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
        self.deadline = mpc.deadline
        # A plan about another equilibrium than the task's need not end in its terminal set.
        self.ends_at_task = mpc.input_reference == "equilibrium"
        self.y_des = y_des
        self.limits = limits
        self.own_terms: list[CostTerm] = list(mpc.terms)
        self._check_own()
        self._stacked = self._stack_of(limits)
        self._radius = mpc.terminal_radius if mpc.terminal_set else np.inf

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
                          self.state_size + self.model.size, self.given_speed, self.input_ends)

    def interval_stack(self) -> LimitStack:
        """Returns the limits in arrays, by the variables of intervals as `interval_inputs` has."""
        return LimitStack(self.limits, self._examples(), self.horizon + 1,
                          2 * self.state_size + self.model.size, self.given_speed, self.input_ends)

    def stack(self, plan: P) -> LimitStack:
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
    def u_ref(self) -> np.ndarray:
        """Input without cost (6+n,)."""
        return self.task_cost.u_ref

    @property
    @abstractmethod
    def state_size(self) -> int:
        """Size of the first state of a plan, and of ξ."""

    @abstractmethod
    def resting_plan(self, time: float, state: np.ndarray, coasting: int = 0) -> P:
        """Returns a first guess: coast for some intervals from `state`, then come to rest."""

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
    def move(self, xi: np.ndarray, decision: np.ndarray
             ) -> tuple[np.ndarray, np.ndarray, Points, Points]:
        """Returns ξ⁺ after one interval, ū − ū_eq, and both ends of it; also of complex numbers.

        Args:
            xi: ξ (..., its size).
            decision: The decision, constant on the interval (..., 6+n).
        """

    @abstractmethod
    def state_rows(self) -> Slopes:
        """Returns y − y_des and ζ̄ under the terminal controller as rows of ξ (6+n, its size)."""

    @abstractmethod
    def _inputs_at(self, plan: P, knots: Points) -> tuple[np.ndarray, np.ndarray]:
        """Returns the same as `inputs`, by the plan's knots."""

    @abstractmethod
    def staged_program(self, plan: P, points: PlanPoints | None = None) -> StagedProgram:
        """Returns the convex program about a plan, for the change of its decision.

        Args:
            plan: The plan.
            points: Its points, if they are known.
        """

    @abstractmethod
    def interval_inputs(self, plan: P, knots: Points) -> Inputs:
        """Returns ū of intervals that need not meet, and its derivatives by their variables.

        These are y and ζ at the beginning, ζ̄̇ if it has accelerations, and y and then ζ at the end.

        Args:
            plan: The plan; its knots need not be where its decision leads.
            knots: The knots.
        """

    @abstractmethod
    def velocities(self, plan: P) -> np.ndarray:
        """Returns ζ̄ at the knots (N+1, 6+n); of no meaning at the `given_speed` of the last."""

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

    def terminal_radius(self, plan: P) -> float:
        """Returns the radius of the terminal set that a plan has to end in."""
        return self.terminal.radius

    def stage_cost(self, plan: P) -> TaskCost:
        """Returns the task's cost of a plan."""
        return self.task_cost

    def offset_cost(self, plan: P) -> tuple[float, np.ndarray]:
        """Returns the cost of the plan's reference and its gradient by a (m,)."""
        return 0.0, np.zeros(len(self.moved))

    def radius_bound(self, plan: P) -> RadiusBound | None:
        """Returns bounds of the terminal radius other than ε, with gradients by a, if any."""
        return None

    def terminal_vector(self, plan: P, y: np.ndarray
                        ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Returns v (r,) with ‖v‖₂ = ‖ξ_N‖_P, and its derivatives by ξ_N + E a and by a.

        Args:
            plan: The plan.
            y: ȳ at the knots, unwrapped.
        """
        root = self.terminal.root
        return root @ self.errors(plan, y)[-1], root, -root[:, self.moved]

    def mathematical_program(self, start: np.ndarray, time: float = 0.0) -> OcpProgram[P]:
        """Returns the whole nonlinear problem as Drake's `MathematicalProgram`.

        Its initial guess is to come to rest.

        Args:
            start: State at the first knot: (𝔮, ζ), or 𝔮 where ζ is the input.
            time: Its instant [s].
        """
        return OcpProgram(self, self.resting_plan(time, start))

    def continued(self, plan: P) -> P:
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

    def evaluate(self, plan: P, points: PlanPoints | None = None) -> Evaluation:
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

    def excesses(self, plan: P) -> Iterator[tuple[Limit, np.ndarray, np.ndarray]]:
        """Yields the limits, times (T,) [s], and a plan's excesses there (T, m)."""
        times = plan.start_time + self.time_step * np.arange(len(plan.config))
        knots = self._knots(plan)
        first, last = slice(-1), slice(1, None)
        decided = {"pose": [last], "speed": [last if self.given_speed == 0 else first],
                   "input": [first, last]}
        inputs = self._inputs_at(plan, knots)
        for limit in self.limits.values():
            for which, u in zip(decided[limit.about], inputs, strict=False):
                at = knots.subset(which, u) if limit.about == "input" else knots.subset(which)
                yield limit, times[which], limit.excess(at)

    def points(self, plan: P) -> PlanPoints:
        """Returns the points of a plan at which it has limits and costs."""
        knots = self._knots(plan)
        ends, first = self._ends(plan, knots), slice(len(plan.config) - 1)
        return PlanPoints(knots, ends.subset(first, ends.u[first]),
                          self.stack(plan).values(knots, ends))

    def _ends(self, plan: P, knots: Points) -> Points:
        """Returns the beginnings of the intervals, then their ends if the input is another one."""
        inputs = self._inputs_at(plan, knots)[: self.input_ends]
        first = np.arange(len(plan.config) - 1)
        return knots.subset(np.concatenate([first, first + 1][: self.input_ends]),
                            np.concatenate(inputs))

    def _knots(self, plan: P) -> Points:
        """Returns the points of the knots of a plan."""
        return Points.known(
            self.model, plan.config, self.model.kinematics(plan.config), self.unwrapped,
            self.velocities(plan))

    def _transitions(self, knots: Points, zeta: np.ndarray, zeta_dot: np.ndarray) -> Transitions:
        """Returns the first-order model of a plan with ζ̄ and ζ̄̇ (N, 6+n) of its intervals."""
        config = knots.config
        y_config = self.model.extended(knots.kinematics.J_chi[1:])
        y_config[..., :6] = y_config[..., :6] @ block_diagonal(
            np.swapaxes(knots.kinematics.R_WB[1:], -1, -2), inverse_rate_matrix(config[1:, 3:6]))
        by_config, by_zeta, by_zeta_dot = (y_config @ rate for rate in advance_derivatives(
            config[:-1], zeta, zeta_dot, self.time_step))
        return Transitions(knots, by_config @ knots.config_y[:-1], by_zeta, by_zeta_dot)

    def _program(self, plan: P, A: np.ndarray, B: np.ndarray, points: PlanPoints, inputs: Inputs
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
            terminal=TerminalLimit(root, root @ xi[-1], self.terminal_radius(plan)),
            slack_penalty=TERMINAL_PENALTY, excess_penalty=EXCESS_PENALTY)

    def revalued(self, program: StagedProgram, plan: P, points: PlanPoints) -> StagedProgram:
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

    def _state_z(self, width: int) -> np.ndarray:
        """Returns ∂y/∂z and ∂ζ/∂z (2, 6+n, `width`) at a knot: z starts with them."""
        return np.eye(width)[: 2 * self.model.size].reshape(2, -1, width)


def weight(mpc: MpcConfig, key: str, size: int, *, zeros: bool = False) -> np.ndarray:
    """Returns a weight of an `MpcConfig`: `size` positive numbers, or `zeros` among them too."""
    values = vector(key, getattr(mpc, key), size)
    usual = (values >= SMALLEST_WEIGHT) & (values <= LARGEST_WEIGHT)
    require(bool(np.all(usual | (values == 0.0) if zeros else usual)), key, values,
            f"{size} positive numbers{' or zeros' if zeros else ''}, from {SMALLEST_WEIGHT:g} to "
            f"{LARGEST_WEIGHT:g}")
    return values
