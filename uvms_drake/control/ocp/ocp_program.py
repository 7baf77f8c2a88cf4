"""The whole FHOCP as Drake's `MathematicalProgram`, by direct multiple shooting.

Variables are all knots and decisions of a plan: `y[k]`, `zeta[k]` and, where accelerations are
decided, `zeta_dot[k]`; the translation `a` of an artificial reference if there is one; and the
slack `s` of the terminal set. Each cost and constraint is a binding of its own, and its evaluator's
description is its name:

    stage_costs, terms[i], terminal_cost, offset_cost, slack_penalty     costs
    start, start_speed                                                   the given state
    motion[k], speed[k]                                                  from knot k to k + 1
    limits.NAME[k]                                                       at knot k, or in interval k
    terminal_set, radius_bound[i], slack                                 ‖ξ_N‖_P ≤ ε + s, s ≥ 0

Linear and quadratic functions and second-order cones are such for Drake, too: norms of velocities,
the terminal set, its penalty. All others are functions of `multiple_shooting`, with exact slopes.
"""

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Generic

import numpy as np
from pydrake.solvers import MathematicalProgram, MathematicalProgramResult

from uvms_drake.common.bindings import named
from uvms_drake.common.differentiable import differentiable
from uvms_drake.control.ocp.multiple_shooting import Stages, Values
from uvms_drake.control.plan.plan import P

if TYPE_CHECKING:
    from uvms_drake.control.ocp.ocp import Ocp

class OcpProgram(MathematicalProgram, Generic[P]):
    """FHOCP from one start; see the module for the names of variables and bindings.

    Args:
        ocp: The problem.
        guess: Plan from that start, the initial guess.
    """

    def __init__(self, ocp: "Ocp[P]", guess: P):
        super().__init__()
        stages = Stages(ocp, guess)
        named_rows = {name: [self.NewContinuousVariables(place.shape[1], f"{name}[{k}]")
                             for k in range(len(place))] for name, place in stages.places.items()}
        self.y = np.array(named_rows["y"])
        """ȳ at the knots (N+1, 6+n): pose of the end-effector, joints."""
        self.zeta = np.array(named_rows["zeta"])
        """ζ̄ at the knots (N+1, 6+n), or on the intervals (N, 6+n) where it is decided."""
        self.zeta_dot = np.array(named_rows["zeta_dot"])
        """ζ̄̇ on the intervals (N, 6+n); empty where ζ̄ is decided."""
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

    def set_guess(self, plan: P) -> None:
        """Makes a plan from the same start the initial guess."""
        self.SetInitialGuess(self._all, self._stages.point(plan))
        self.SetInitialGuess(self.s, [self._stages.ocp.evaluate(plan).terminal_slack])

    def plan(self, result: MathematicalProgramResult) -> P:
        """Returns the plan of a result: from the start, with the decisions found."""
        guess, found = self._stages.guess, self._stages.plan(result.GetSolution(self._all))
        return guess.redone(guess.start, found.decision)

    def _scale_variables(self) -> None:
        """Scales each variable so that the task's cost has the curvature 1 by it.

        SNOPT begins with that curvature; without, it takes hundreds of iterations to learn it.
        """
        ocp = self._stages.ocp
        weights = 2.0 * ocp.time_step * np.concatenate([np.diag(ocp.Q), np.diag(ocp.R)])
        by_kind = weights.reshape(-1, self.y.shape[1])  # Of y, ζ and, where it is decided, ζ̇.
        for rows, own in zip((self.y, self.zeta, self.zeta_dot), by_kind, strict=False):
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
        size = len(start)
        for k in range(stages.ocp.horizon):
            which = stages.interval(k)[: (3 + len(self.zeta_dot[k: k + 1])) * size]
            self._add(f"motion[{k}]", partial(stages.motion, k, which), which,
                      np.zeros(size), np.zeros(size))
        if len(self.zeta_dot):
            speed, eye = first[stages.places["zeta"][0]], np.eye(size)
            named(self.AddBoundingBoxConstraint(speed, speed, self.zeta[0]), "start_speed")
            for k, zeta_dot in enumerate(self.zeta_dot):
                named(self.AddLinearEqualityConstraint(
                    np.hstack([eye, h * eye, -eye]), np.zeros(size),
                    np.concatenate([self.zeta[k], zeta_dot, self.zeta[k + 1]])), f"speed[{k}]")

    def _add_limits(self, k: int) -> None:
        """Adds the limits of a stage; those that are linear or norms as such."""
        stages, x = self._stages, self._stages.first
        now, knot = stages.at(np.arange(stages.size), x), stages.knot(k)
        for group in stages.groups:
            lower, upper = (bound[k, group.columns] for bound in (now.linear.lower,
                                                                 now.linear.upper))
            if not np.any(np.isfinite(lower) | np.isfinite(upper)):
                continue
            which = (stages.interval(k) if group.about == "input" else
                     stages.places["y"][k] if group.about == "pose" else knot)
            if not group.linear:
                self._add(f"{group.name}[{k}]", partial(stages.rows, k, group, which), which,
                          lower, upper)
                continue
            value, C = stages.rows(k, group, which, x[which])
            off = value - C @ x[which]
            named(self.AddLinearConstraint(C, lower - off, upper - off, self._all[which]),
                  f"{group.name}[{k}]")
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
        ocp, x, m = stages.ocp, stages.first[end], len(stages.a)
        named(self.AddLinearCost([ocp.terminal_penalty], 0.0, self.s), "slack_penalty")
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
