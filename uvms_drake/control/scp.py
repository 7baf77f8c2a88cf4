"""The fast solver of the FHOCP: sequential convex programming with exact cones.

An iteration makes the convex program about the plan, solves it, and takes the longest of the steps
1, ½, ¼, ... along which the true merit (cost and violation, nothing linearised) falls; in a strict
problem, only to a sound plan from one that is sound. The limits
on what is linearised are softened by an exact penalty, so that the program has a solution whenever
the linear limits can be kept. One iteration a sample is enough for what the closed loop needs: the
plan is never worse than the last one continued by the terminal controller (Scokaert, Mayne and
Rawlings 1999).
"""

from dataclasses import dataclass
from typing import Generic

import numpy as np

from uvms_drake.control.ocp import Evaluation, Ocp
from uvms_drake.control.plan import P
from uvms_drake.control.staged_solver import solve_staged

SHORTEST_STEP = 1.0 / 64.0


@dataclass(frozen=True)
class Solution(Generic[P]):
    """The result of a solve; `plan` is None if the solver failed."""

    plan: P | None
    evaluation: Evaluation | None
    iterations: int
    converged: bool
    """Whether it ended because no step improved the merit by more than the tolerance."""


class SequentialConvexSolver(Generic[P]):
    """Solves an `Ocp` from a guess."""

    def __init__(self, ocp: Ocp[P]):
        self.ocp = ocp

    def solve(self, guess: P, iterations: int, tolerance: float = 1e-6) -> Solution[P]:
        """Returns the best plan found from `guess`, whose first knot is the initial state.

        Args:
            guess: Where the first convex program is made.
            iterations: At most so many convex programs are solved.
            tolerance: Converged when a step improves the merit by less than this fraction of it.
        """
        plan, evaluation = guess, self.ocp.evaluate(guess)
        for iteration in range(1, iterations + 1):
            change = solve_staged(self.ocp.staged_program(plan))
            if change is None:
                if iteration == 1:
                    return Solution(None, None, iteration, converged=False)
                return Solution(plan, evaluation, iteration, converged=False)
            step = self._line_search(plan, evaluation, change.w)
            if step is None:
                return Solution(plan, evaluation, iteration, converged=True)
            gain = evaluation.merit - step[1].merit
            plan, evaluation = step
            if gain <= tolerance * abs(evaluation.merit):
                return Solution(plan, evaluation, iteration, converged=True)
        return Solution(plan, evaluation, iterations, converged=False)

    def _line_search(self, plan: P, evaluation: Evaluation, change: np.ndarray
                     ) -> tuple[P, Evaluation] | None:
        sound, step = self.ocp.strict and self.ocp.is_sound(evaluation), 1.0
        while step >= SHORTEST_STEP:
            candidate = plan.redone(plan.start, plan.decision + step * change)
            value = self.ocp.evaluate(candidate)
            if value.merit < evaluation.merit and (
                    not sound or self.ocp.is_sound(value)):
                return candidate, value
            step *= 0.5
        return None
