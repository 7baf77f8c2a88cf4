"""Functions of the FHOCP in direct multiple shooting: knots and decisions are free, and must meet.

They have the model's own derivatives, `LimitStack.linear` of the limits among them, for all stages
of a plan at once, because a call costs far more than a stage. The costs of the stages, which
solvers ask for first, depend on all variables; all else about the same point is remembered.
"""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Generic

import numpy as np

from uvms_drake.control.convex.staged_program import LinearLimits, NormLimit
from uvms_drake.control.ocp.limit_stack import LimitStack, RowGroup
from uvms_drake.control.plan.plan import P, advance, advance_derivatives
from uvms_drake.control.plan.points import Points, Slopes
from uvms_drake.model.frames.euler import wrap_angle

if TYPE_CHECKING:
    from uvms_drake.control.ocp.ocp import Ocp

Values = tuple[np.ndarray, np.ndarray]
"""Values (m,) and their Jacobian by the variables of a binding."""


@dataclass(frozen=True)
class Intervals(Generic[P]):
    """All stages of a plan whose intervals need not meet."""

    plan: P
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


class Stages(Generic[P]):
    """Functions of the program: of the values of all its variables but s, in their order.

    It remembers the last point; a function of some of the variables takes the others from there.

    Args:
        ocp: The problem.
        guess: Plan with the start and the first point.
    """

    def __init__(self, ocp: "Ocp[P]", guess: P):
        self.ocp, self.guess = ocp, guess
        size, N, m = ocp.model.size, ocp.horizon, len(ocp.moved)
        counts = {"y": N + 1, "zeta": N + ocp.has_accelerations,
                  "zeta_dot": N * ocp.has_accelerations}
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
        self._known: Intervals[P] | None = None

    @property
    def groups(self) -> list[RowGroup]:
        """Limits that are rows."""
        return self._stack.groups

    def point(self, plan: P) -> np.ndarray:
        """Returns the values of a plan."""
        ocp, x = self.ocp, np.zeros(self.size)
        x[self.places["y"]] = ocp.unwrapped(ocp.model.task_pose(plan.config))
        for name in ("zeta", "zeta_dot", "a"):
            place = self.a if name == "a" else self.places[name]
            if place.size:
                x[place] = getattr(plan, name)
        return x

    def plan(self, x: np.ndarray) -> P:
        """Returns the plan of a point, its knots as they are there."""
        fields: dict[str, Any] = {
            name: x[place] for name, place in self.places.items() if place.size}
        if len(self.a):
            fields["a"] = x[self.a]
        return replace(self.guess, config=self.ocp.model.configuration(fields.pop("y")), **fields)

    def interval(self, k: int) -> np.ndarray:
        """Returns the indices of the variables of an interval."""
        y, zeta, zeta_dot = self.places.values()
        return np.concatenate([y[k], zeta[k], *zeta_dot[k: k + 1], y[k + 1],
                               *(zeta[k + 1: k + 2] if len(zeta_dot) else [])])

    def knot(self, k: int) -> np.ndarray:
        """Returns the indices of y and, where there is one, ζ of a knot."""
        return np.concatenate([self.places["y"][k], *self.places["zeta"][k: k + 1]])

    def at(self, which: np.ndarray, values: np.ndarray) -> Intervals[P]:
        """Returns all stages at a point with these values of some variables."""
        if self._known is None or not np.array_equal(self._x[which], values):
            self._x = self._x.copy()
            self._x[which] = values
            self._known = self._computed(self._x)
        return self._known

    def _computed(self, x: np.ndarray) -> Intervals[P]:
        """Returns all stages at a point."""
        ocp, plan, y = self.ocp, self.plan(x), x[self.places["y"]]
        model, N, h = ocp.model, ocp.horizon, ocp.time_step
        knots = Points(model, plan.config, y, ocp.velocities(plan))
        inputs = ocp.interval_inputs(plan, knots)
        begin, chain = inputs.points.subset(slice(N), inputs.points.u[:N]), Slopes(
            *(each[:N] for each in inputs[1:]))
        # The gap by y and ζ at the beginning, ζ̇, and y at the end.
        zeta_dot = x[self.places["zeta_dot"]]
        motion = knots.zeta[:N], zeta_dot if len(zeta_dot) else np.zeros((N, model.size))
        gap = plan.config[1:] - advance(plan.config[:N], *motion, h)
        gap[:, 3:6] = wrap_angle(gap[:, 3:6])
        by_config, by_zeta, by_zeta_dot = advance_derivatives(plan.config[:N], *motion, h)
        gap_slopes = np.concatenate(
            [-by_config @ knots.config_y[:N], -by_zeta,
             *([-by_zeta_dot] if len(zeta_dot) else []), knots.config_y[1:]], axis=2)
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

    def rows(self, k: int, group: RowGroup, which: np.ndarray, z: np.ndarray) -> Values:
        """Returns the rows of a limit at stage k, by the variables `which`."""
        linear = self.at(which, z).linear
        return linear.value[k, group.columns], linear.C[k, group.columns, : len(which)]

    @property
    def end(self) -> np.ndarray:
        """Indices of the variables of ξ_N and of a."""
        last = [place[-1] for name, place in self.places.items() if name != "zeta_dot"]
        return np.concatenate([*last[: 1 + self.ocp.has_accelerations], self.a])

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

    def _moved_to(self, a: np.ndarray) -> P:
        """Returns the guess with another reference."""
        fields: dict[str, Any] = {"a": a} if len(a) else {}
        return replace(self.guess, **fields)
