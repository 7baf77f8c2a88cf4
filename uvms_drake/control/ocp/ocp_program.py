"""The whole FHOCP as Drake's `MathematicalProgram`, by direct multiple shooting.

Variables are all knots and decisions of a plan, which must meet: `y[k]`, `zeta[k]` and
`zeta_dot[k]`; the translation `a` of an artificial reference if there is one; and the slack `s` of
the terminal set. Each cost and constraint is a binding of its own, and its evaluator's description
is its name:

    stage_costs, terms[i], terminal_cost, offset_cost, slack_penalty     costs
    start, start_speed                                                   the given state
    motion[k], speed[k]                                                  from knot k to k + 1
    limits.NAME[k]                                                       at knot k, or in interval k
    terminal_set, radius_bound[i], slack                                 ‖ξ_N‖_P ≤ ε + s, s ≥ 0

Linear and quadratic functions and second-order cones are such for Drake, too: norms of velocities,
the terminal set, its penalty. All others are functions of `Stages`, with the model's own
derivatives for all stages at once, because a call costs far more than a stage. The costs of the
stages, which solvers ask for first, depend on all variables; all else about the same point is
remembered.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from pydrake.solvers import MathematicalProgram, MathematicalProgramResult

from uvms_drake.common.bindings import named
from uvms_drake.common.differentiable import differentiable
from uvms_drake.control.convex.staged_program import LinearLimits, NormLimit
from uvms_drake.control.ocp.limit_stack import Entry, LimitStack
from uvms_drake.control.ocp.ocp import TERMINAL_PENALTY, Ocp
from uvms_drake.control.plan.plan import Plan, advance, advance_derivatives
from uvms_drake.control.plan.points import Points, Slopes
from uvms_drake.model.frames.euler import wrap_angle

Values = tuple[np.ndarray, np.ndarray]
"""Values (m,) and their Jacobian by the variables of a binding."""


@dataclass(frozen=True)
class Intervals:
    """All stages of a plan whose intervals need not meet."""

    plan: Plan
    """The plan; its knots need not be where its decision leads."""
    y: np.ndarray
    """ȳ at the knots (N+1, 6+n)."""
    begin: Points
    """Points of the N beginnings of the intervals, with ū."""
    chain: Slopes
    """Derivatives of y, ζ and u there by the variables of the interval."""
    gap: np.ndarray
    """𝔮 at the end of an interval less that where its decision leads (N, 6+n)."""
    gap_slopes: np.ndarray
    """Derivatives of the gap by the variables of the interval, but for ζ at the end."""
    linear: LinearLimits
    """Limits that are rows, by the variables of the interval."""
    norms: tuple[NormLimit, ...]
    """Limits that are norms, likewise."""


class Stages:
    """Functions of the program: of the values of all its variables but s, in their order.

    It remembers the last point; a function of some of the variables takes the others from there.

    Args:
        ocp: The problem.
        guess: Plan with the start and the first point.
    """

    def __init__(self, ocp: Ocp, guess: Plan):
        self.ocp, self.guess = ocp, guess
        size, N, m = ocp.model.size, ocp.horizon, len(ocp.moved)
        counts = {"y": N + 1, "zeta": N + 1, "zeta_dot": N}
        ends = np.cumsum([each * size for each in counts.values()])
        self.places = {name: np.arange(end - count * size, end).reshape(count, size)
                       for (name, count), end in zip(counts.items(), ends, strict=True)}
        """Indices of the variables in the point, by name (stages, 6+n)."""
        self.a = np.arange(ends[-1], ends[-1] + m)
        """Indices of a."""
        self.size = int(ends[-1]) + m
        """Number of variables but for s."""
        self._stack: LimitStack = ocp.interval_stack()
        self.first = self._x = self.point(guess)
        """Values of the guess."""
        self._known: Intervals | None = None

    @property
    def row_limits(self) -> tuple[Entry, ...]:
        """Limits that are rows."""
        return self._stack.row_limits

    def point(self, plan: Plan) -> np.ndarray:
        """Returns the values of a plan."""
        ocp, x = self.ocp, np.zeros(self.size)
        x[self.places["y"]] = ocp.unwrapped(ocp.model.task_pose(plan.config))
        x[self.places["zeta"]], x[self.places["zeta_dot"]] = plan.zeta, plan.zeta_dot
        if len(self.a):
            x[self.a] = vars(plan)["a"]
        return x

    def plan(self, x: np.ndarray) -> Plan:
        """Returns the plan of a point, its knots as they are there."""
        fields: dict[str, Any] = {name: x[place] for name, place in self.places.items()}
        if len(self.a):
            fields["a"] = x[self.a]
        return replace(self.guess, config=self.ocp.model.configuration(fields.pop("y")), **fields)

    def interval(self, k: int) -> np.ndarray:
        """Returns the indices of the variables of an interval."""
        y, zeta, zeta_dot = self.places.values()
        return np.concatenate([y[k], zeta[k], zeta_dot[k], y[k + 1], zeta[k + 1]])

    def knot(self, k: int) -> np.ndarray:
        """Returns the indices of y and ζ of a knot."""
        return np.concatenate([self.places["y"][k], self.places["zeta"][k]])

    def at(self, which: np.ndarray, values: np.ndarray) -> Intervals:
        """Returns all stages at a point with these values of some variables."""
        if self._known is None or not np.array_equal(self._x[which], values):
            self._x = self._x.copy()
            self._x[which] = values
            self._known = self._computed(self._x)
        return self._known

    def _computed(self, x: np.ndarray) -> Intervals:
        """Returns all stages at a point."""
        ocp, plan, y = self.ocp, self.plan(x), x[self.places["y"]]
        model, N, h = ocp.model, ocp.horizon, ocp.time_step
        knots = Points(model, plan.config, y, plan.zeta)
        inputs = ocp.interval_inputs(plan, knots)
        begin, chain = inputs.points.subset(slice(N), inputs.points.u[:N]), Slopes(
            *(each[:N] for each in inputs[1:]))
        # The gap by y and ζ at the beginning, ζ̇, and y at the end.
        motion = plan.zeta[:N], plan.zeta_dot
        gap = plan.config[1:] - advance(plan.config[:N], *motion, h)
        gap[:, 3:6] = wrap_angle(gap[:, 3:6])
        by_config, by_zeta, by_zeta_dot = advance_derivatives(plan.config[:N], *motion, h)
        gap_slopes = np.concatenate(
            [-by_config @ knots.config_y[:N], -by_zeta, -by_zeta_dot, knots.config_y[1:]], axis=2)
        values = self._stack.values(knots, inputs.points)
        return Intervals(plan, y, begin, chain, gap, gap_slopes,
                         self._stack.linear(knots, values, inputs), self._stack.norms(values))

    # Functions of the bindings --------------------------------------------------------------------

    def stage_costs(self, x: np.ndarray) -> Values:
        """Returns the task's cost of all stages, of all variables."""
        now = self.at(np.arange(self.size), x)
        cost, h = self.ocp.stage_cost(now.plan), self.ocp.time_step
        gradient = self._gathered(cost.quadratic(now.begin, now.chain, h)[1])
        by_y_des = -2.0 * h * np.sum(cost.error(now.begin) @ cost.Q, axis=0)
        gradient[self.a] = by_y_des[self.ocp.moved]
        return np.array([h * cost.value(now.begin)]), gradient[None]

    def term(self, i: int, x: np.ndarray) -> Values:
        """Returns a further term of the cost of all stages."""
        now, term, h = self.at(np.arange(self.size), x), self.ocp.own_terms[i], self.ocp.time_step
        return (np.array([h * term.value(now.begin)]),
                self._gathered(term.quadratic(now.begin, now.chain, h)[1])[None])

    def _gathered(self, by_interval: np.ndarray) -> np.ndarray:
        """Returns a gradient by all variables from those by the variables of intervals (N, ·)."""
        out = np.zeros(self.size)
        for k, row in enumerate(by_interval):
            out[self.interval(k)] += row
        return out

    def motion(self, k: int, which: np.ndarray, z: np.ndarray) -> Values:
        """Returns the gap of interval k."""
        now = self.at(which, z)
        return now.gap[k], now.gap_slopes[k]

    def rows(self, k: int, limit: Entry, which: np.ndarray, z: np.ndarray) -> Values:
        """Returns the rows of a limit at stage k, by the variables `which`."""
        linear = self.at(which, z).linear
        return linear.value[k, limit.columns], linear.C[k, limit.columns, : len(which)]

    @property
    def end(self) -> np.ndarray:
        """Indices of the variables of ξ_N and of a."""
        return np.concatenate([self.knot(-1), self.a])

    def terminal_vector(self, end: np.ndarray) -> Values:
        """Returns v (r,) with ‖v‖₂ = ‖ξ_N‖_P."""
        x = self._x.copy()
        x[self.end] = end
        value, by_xi, by_a = self.ocp.terminal_vector(self.plan(x), x[self.places["y"]])
        return value, np.concatenate([by_xi, by_a], axis=1)

    def offset_cost(self, a: np.ndarray) -> Values:
        """Returns the offset cost."""
        value, gradient = self.ocp.offset_cost(self._moved_to(a))
        return np.array([value]), gradient[None]

    def radii(self, a: np.ndarray) -> Values:
        """Returns ε and further bounds of the terminal radius, affine in a."""
        radius, more = self.ocp.terminal.radius, self.ocp.radius_bound(self._moved_to(a))
        sizes, rows = np.array([radius]), np.zeros((1, len(a)))
        if more is None:
            return sizes, rows
        return np.append(sizes, more.size), np.concatenate([rows, more.rows])

    def _moved_to(self, a: np.ndarray) -> Plan:
        """Returns the guess with another reference."""
        fields: dict[str, Any] = {"a": a} if len(a) else {}
        return replace(self.guess, **fields)


class OcpProgram(MathematicalProgram):
    """FHOCP from one start; see the module for the names of variables and bindings.

    Args:
        ocp: The problem.
        guess: Plan from that start, the initial guess.
    """

    def __init__(self, ocp: Ocp, guess: Plan):
        super().__init__()
        stages = Stages(ocp, guess)
        named_rows = {name: [self.NewContinuousVariables(place.shape[1], f"{name}[{k}]")
                             for k in range(len(place))] for name, place in stages.places.items()}
        self.y = np.array(named_rows["y"])
        """ȳ at the knots (N+1, 6+n): pose of the end-effector, joints."""
        self.zeta = np.array(named_rows["zeta"])
        """ζ̄ at the knots (N+1, 6+n)."""
        self.zeta_dot = np.array(named_rows["zeta_dot"])
        """ζ̄̇ on the intervals (N, 6+n)."""
        m = len(ocp.moved)
        self.a = self.NewContinuousVariables(m, "a") if m else np.empty(0, dtype=object)
        """Translation of the reference (m,)."""
        self.s = self.NewContinuousVariables(1, "s")
        """Slack of the terminal set (1,)."""
        # Functions of the bindings must not refer to the program, or neither would ever be freed.
        self._stages, self._all = stages, self.decision_variables()[: stages.size]
        self._add_motion()
        for k in range(ocp.horizon + 1):
            self._add_limits(k)
        self._add_stage_costs()
        self._add_end()
        self._scale_variables()
        self.set_guess(guess)

    @staticmethod
    def at(ocp: Ocp, start: np.ndarray, time: float = 0.0) -> "OcpProgram":
        """Returns the program from (𝔮, ζ) (2(6+n),) at a `time` [s]; its guess comes to rest."""
        return OcpProgram(ocp, ocp.resting_plan(time, start))

    def set_guess(self, plan: Plan) -> None:
        """Makes a plan from the same start the initial guess."""
        self.SetInitialGuess(self._all, self._stages.point(plan))
        self.SetInitialGuess(self.s, [self._stages.ocp.evaluate(plan).terminal_slack])

    def plan(self, result: MathematicalProgramResult) -> Plan:
        """Returns the plan of a result: from the start, with the decisions found."""
        guess, found = self._stages.guess, self._stages.plan(result.GetSolution(self._all))
        return guess.redone(guess.start, found.decision)

    def _scale_variables(self) -> None:
        """Scales each variable so that the task's cost has the curvature 1 by it.

        SNOPT begins with that curvature; without, it takes hundreds of iterations to learn it.
        """
        ocp = self._stages.ocp
        weights = 2.0 * ocp.time_step * np.concatenate([np.diag(ocp.Q), np.diag(ocp.R)])
        by_kind = weights.reshape(3, -1)  # Of y, ζ and ζ̇.
        for rows, own in zip((self.y, self.zeta, self.zeta_dot), by_kind, strict=True):
            for row in rows:
                for variable, weight in zip(row, own, strict=True):
                    if weight > 0.0:
                        self.SetVariableScaling(variable, 1.0 / float(np.sqrt(weight)))

    def _add(self, name: str, function: Callable[[np.ndarray], Values], which: np.ndarray,
             lower: np.ndarray, upper: np.ndarray) -> None:
        """Adds a constraint on a function with derivatives of its own."""
        self.AddConstraint(differentiable(function), lb=lower, ub=upper,
                           vars=self._all[which], description=name)

    def _add_cost(self, name: str, function: Callable[[np.ndarray], Values], which: np.ndarray
                  ) -> None:
        """Adds a cost likewise."""
        cost = differentiable(function)
        self.AddCost(lambda x: cost(x)[0], vars=self._all[which], description=name)

    def _add_stage_costs(self) -> None:
        """Adds the costs of all stages, the task's and further terms."""
        stages = self._stages
        everything = np.arange(stages.size)
        self._add_cost("stage_costs", stages.stage_costs, everything)
        for i in range(len(stages.ocp.own_terms)):
            self._add_cost(f"terms[{i}]", partial(stages.term, i), everything)

    def _add_motion(self) -> None:
        """Adds the given start and the motion from knot to knot."""
        stages, h = self._stages, self._stages.ocp.time_step
        first = stages.first
        start = first[stages.places["y"][0]]
        named(self.AddBoundingBoxConstraint(start, start, self.y[0]), "start")
        speed, size = first[stages.places["zeta"][0]], len(start)
        named(self.AddBoundingBoxConstraint(speed, speed, self.zeta[0]), "start_speed")
        none, eye = np.zeros(size), np.eye(size)
        for k, zeta_dot in enumerate(self.zeta_dot):
            which = stages.interval(k)[: 4 * size]
            self._add(f"motion[{k}]", partial(stages.motion, k, which), which, none, none)
            named(self.AddLinearEqualityConstraint(
                np.hstack([eye, h * eye, -eye]), none,
                np.concatenate([self.zeta[k], zeta_dot, self.zeta[k + 1]])), f"speed[{k}]")

    def _add_limits(self, k: int) -> None:
        """Adds the limits of a stage; those that are linear or norms as such."""
        stages, x = self._stages, self._stages.first
        now, knot = stages.at(np.arange(stages.size), x), stages.knot(k)
        for entry in stages.row_limits:
            lower, upper = (bound[k, entry.columns] for bound in (
                now.linear.lower, now.linear.upper))
            if not np.any(np.isfinite(lower) | np.isfinite(upper)):
                continue
            which = (stages.interval(k) if entry.limit.about == "input" else
                     stages.places["y"][k] if entry.limit.about == "pose" else knot)
            if not entry.constant:
                self._add(f"{entry.name}[{k}]", partial(stages.rows, k, entry, which), which,
                          lower, upper)
                continue
            value, C = stages.rows(k, entry, which, x[which])
            off = value - C @ x[which]
            named(self.AddLinearConstraint(C, lower - off, upper - off, self._all[which]),
                  f"{entry.name}[{k}]")
        for limit in now.norms:
            if np.isfinite(limit.bound[k]):
                C = limit.C[:, : len(knot)]
                self._add_cone(f"{limit.name}[{k}]", limit.value[k], C, limit.bound[k],
                               np.zeros(len(knot)), knot)

    def _add_cone(self, name: str, value: np.ndarray, C: np.ndarray, size: float,
                  by_size: np.ndarray, which: np.ndarray, *more: np.ndarray) -> None:
        """Adds ‖value‖₂ ≤ size, where value and size change by C and by_size at the first point."""
        x = self._stages.first[which]
        A = np.concatenate([by_size[None], np.pad(C, ((0, 0), (0, sum(map(len, more)))))])
        off = np.append(size, value) - A[:, : len(which)] @ x
        named(self.AddLorentzConeConstraint(
            A, off, np.concatenate([self._all[which], *more])), name)

    def _add_end(self) -> None:
        """Adds terminal cost, terminal set and its slack, and the offset cost."""
        stages, end = self._stages, self._stages.end
        x, m = stages.first[end], len(stages.a)
        named(self.AddLinearCost([TERMINAL_PENALTY], 0.0, self.s), "slack_penalty")
        named(self.AddBoundingBoxConstraint(0.0, np.inf, self.s), "slack")
        if m:
            self._add_cost("offset_cost", stages.offset_cost, stages.a)
        value, C = stages.terminal_vector(x)
        off = value - C @ x
        named(self.AddQuadraticCost(2.0 * C.T @ C, 2.0 * C.T @ off, off @ off, self._all[end],
                                    is_convex=True), "terminal_cost")
        radii, rows = stages.radii(stages.first[stages.a])
        for i in map(int, np.flatnonzero(np.isfinite(radii))):
            name = f"radius_bound[{i - 1}]" if i else "terminal_set"
            by_size = np.concatenate([np.zeros(len(end) - m), rows[i], [1.0]])
            self._add_cone(name, value, C, radii[i], by_size, end, self.s)
