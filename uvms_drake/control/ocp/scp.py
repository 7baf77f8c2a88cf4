"""Solver of the FHOCP: its interface, and sequential convex programming with exact cones.

An iteration solves the convex program about the plan and takes the longest of the steps 1, ½, ¼,
... along which the true merit (cost and violation, nothing linearised) falls; in a strict problem,
only to a sound plan, or from one that is not to one that is no worse. A whole step to a cheaper
plan that violates limits by their curvature is corrected first (`correction`). Linearised limits
are softened by an exact penalty, so that the program has a solution whenever the linear limits can
be kept. One iteration a sample is enough for the closed loop: the plan is never worse than the last
one continued by the terminal controller (Scokaert, Mayne and Rawlings 1999).

Recursive feasibility does not depend on how a plan is found: `Ocp.evaluate` says whether it is
sound (`Ocp.is_sound`), and `mpc.planner` keeps the last plan, continued by the terminal controller,
wherever a new one is missing or not sound.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from uvms_drake.control.convex.correction import Correction
from uvms_drake.control.convex.staged_program import StagedProgram
from uvms_drake.control.convex.staged_solver import StagedSolution
from uvms_drake.control.convex.staged_solver import solve_staged as solve_staged
from uvms_drake.control.ocp.ocp import Evaluation, Ocp, PlanPoints
from uvms_drake.control.plan.plan import Plan

SHORTEST_STEP = 1.0 / 64.0
CORRECTIONS = 4
"""Largest number of second-order corrections of a step."""
SHRINKS = 0.3
"""Largest part of a violation after a correction that justifies another one."""


ConvexSolver = Callable[[StagedProgram], StagedSolution | None]
"""Solver of the convex programs; None is returned if there is no solution."""


@dataclass(frozen=True)
class Solution:
    """Result of a solve; `plan` is None if the solver failed."""

    plan: Plan | None
    evaluation: Evaluation | None
    iterations: int
    """Number of convex programs, or 1 of a nonlinear program."""
    converged: bool
    """Whether it ended because no step improved the merit by more than the tolerance."""
    rows: int = 0
    """Number of rows of limits in the last convex program; 0 where none was active."""


class Solver(ABC):
    """Solves an `Ocp` from a guess."""

    ocp: Ocp
    """The problem."""

    @abstractmethod
    def solve(self, guess: Plan, iterations: int, tolerance: float = 1e-6) -> Solution:
        """Returns the best plan found from `guess`, whose first knot is the initial state.

        Args:
            guess: Plan to start from; no solution is worse.
            iterations: Largest number of convex programs.
            tolerance: Converged when a step improves the merit by less than this fraction of it.
        """

    @abstractmethod
    def of(self, ocp: Ocp) -> Self:
        """Returns the same solver for another problem."""


class SequentialConvexSolver(Solver):
    """Solves an `Ocp` from a guess by convex programs.

    Args:
        ocp: The problem.
        convex: Solver of the convex programs; `solve_staged` if None.
    """

    def __init__(self, ocp: Ocp, convex: ConvexSolver | None = None):
        self.ocp = ocp
        self._convex = convex

    def of(self, ocp: Ocp) -> "SequentialConvexSolver":
        """Returns the same solver for another problem."""
        return SequentialConvexSolver(ocp, self._convex)

    def solve(self, guess: Plan, iterations: int, tolerance: float = 1e-6) -> Solution:
        """Returns the best plan found from `guess`, whose first knot is the initial state.

        Args:
            guess: Plan of the first convex program.
            iterations: Largest number of convex programs.
            tolerance: Converged when a step improves the merit by less than this fraction of it.
        """
        plan, points, rows, active = guess, self.ocp.points(guess), 0, None
        evaluation = self.ocp.evaluate(guess, points)
        for iteration in range(1, iterations + 1):
            program = replace(self.ocp.staged_program(plan, points), similar=active)
            change = (self._convex or solve_staged)(program)
            if change is None:
                if iteration == 1:
                    return Solution(None, None, iteration, converged=False)
                return Solution(plan, evaluation, iteration, converged=False, rows=rows)
            rows, active = change.rows, change.active
            step = self._line_search(plan, evaluation, program, change)
            if step is None:
                return Solution(plan, evaluation, iteration, converged=True, rows=rows)
            gain = evaluation.merit - step[1].merit
            plan, evaluation, points = step
            if gain <= tolerance * abs(evaluation.merit):
                return Solution(plan, evaluation, iteration, converged=True, rows=rows)
        return Solution(plan, evaluation, iterations, converged=False, rows=rows)

    def _line_search(self, plan: Plan, evaluation: Evaluation, program: StagedProgram,
                     change: StagedSolution) -> tuple[Plan, Evaluation, PlanPoints] | None:
        """Returns the plan after the longest step that is better, its value and its points."""
        step = 1.0
        while step >= SHORTEST_STEP:
            candidate = plan.redone(plan.start, plan.decision + step * change.w)
            points = self.ocp.points(candidate)
            value = self.ocp.evaluate(candidate, points)
            if self.ocp.improves(value, evaluation):
                return candidate, value, points
            if step == 1.0 and self.ocp.is_sound(evaluation) and value.cost < evaluation.cost:
                corrected = self._corrected(candidate, value, points, program, change)
                if self.ocp.improves(corrected[1], evaluation):
                    return corrected
            step *= 0.5
        return None

    def _corrected(self, plan: Plan, value: Evaluation, points: PlanPoints, program: StagedProgram,
                   change: StagedSolution) -> tuple[Plan, Evaluation, PlanPoints]:
        """Returns the plan after a step, moved back to within the limits, its value and points."""
        correction = Correction(program, change.regulator, change.w)
        for _ in range(CORRECTIONS):
            before = max(value.violation, value.terminal_slack)
            try:
                moved = correction.of(self.ocp.revalued(program, plan, points))
            except np.linalg.LinAlgError:
                break  # There is none.
            plan = plan.redone(plan.start, plan.decision + moved)
            points = self.ocp.points(plan)
            value = self.ocp.evaluate(plan, points)
            after = max(value.violation, value.terminal_slack)
            if self.ocp.is_sound(value) or after > SHRINKS * before:
                break  # It is within limits, or converges too slowly.
        return plan, value, points
