"""Interface of a solver of the FHOCP, and its result.

Recursive feasibility does not depend on how a plan is found: `Ocp.evaluate` says whether it is
sound (`Ocp.is_sound`), and `mpc.planner` keeps the last plan, continued by the terminal controller,
wherever a new one is missing or not sound.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Generic, Self

from uvms_drake.control.ocp.ocp import Evaluation, Ocp
from uvms_drake.control.plan.plan import P


@dataclass(frozen=True)
class Solution(Generic[P]):
    """Result of a solve; `plan` is None if the solver failed."""

    plan: P | None
    evaluation: Evaluation | None
    iterations: int
    """Number of convex programs, or 1 of a nonlinear program."""
    converged: bool
    """Whether it ended because no step improved the merit by more than the tolerance."""
    rows: int = 0
    """Number of rows of limits in the last convex program; 0 where none was active."""


class Solver(ABC, Generic[P]):
    """Solves an `Ocp` from a guess."""

    ocp: Ocp[P]
    """The problem."""

    @abstractmethod
    def solve(self, guess: P, iterations: int, tolerance: float = 1e-6) -> Solution[P]:
        """Returns the best plan found from `guess`, whose first knot is the initial state.

        Args:
            guess: Plan to start from; no solution is worse.
            iterations: Largest number of convex programs.
            tolerance: Converged when a step improves the merit by less than this fraction of it.
        """

    @abstractmethod
    def of(self, ocp: Ocp[P]) -> Self:
        """Returns the same solver for another problem."""
