"""Solver of the FHOCP by a nonlinear solver of Drake's: the whole program at once.

It is slow and independent of `scp`: all limits at once and nonlinear, no convex program, no working
set, no line search of ours. Its first point is the guess, so the last plan is its warm start, or
the plan that `first` finds from there: a program has several optima, and from a guess that is not
near one SNOPT takes minutes.
"""

from collections.abc import Callable

import numpy as np
from pydrake.solvers import IpoptSolver, SnoptSolver, SolverInterface, SolverOptions

from uvms_drake.control.ocp.ocp import Ocp
from uvms_drake.control.ocp.ocp_program import OcpProgram
from uvms_drake.control.ocp.solver import Solution, Solver
from uvms_drake.control.plan.plan import P

FEASIBILITY, OPTIMALITY = 1e-8, 1e-7
"""Violation of the constraints at which SNOPT and IPOPT stop, and of the conditions of optimality:
IPOPT at ten times that, because it has no second derivatives."""
ITERATIONS = 200
"""Largest number of SNOPT's major iterations. Near some optima of an unknown wall it does not come
to its tolerance, while the cost changes by less than 1e-6 of itself."""


def tight_options() -> SolverOptions:
    """Returns options by which a plan keeps its limits to well within `Ocp.tolerance`."""
    options = SolverOptions()
    options.SetOption(SnoptSolver.id(), "Major feasibility tolerance", FEASIBILITY)
    options.SetOption(SnoptSolver.id(), "Major optimality tolerance", OPTIMALITY)
    options.SetOption(SnoptSolver.id(), "Major iterations limit", ITERATIONS)
    options.SetOption(IpoptSolver.id(), "constr_viol_tol", FEASIBILITY)
    options.SetOption(IpoptSolver.id(), "tol", 10.0 * OPTIMALITY)
    return options


class NonlinearSolver(Solver[P]):
    """Solves an `Ocp` from a guess with a general nonlinear solver.

    Args:
        ocp: The problem.
        solver: Such as `SnoptSolver` or `IpoptSolver`.
        options: The solver's own; `tight_options` if None.
        extend: Called with each program before it is solved, for costs and constraints of one's
            own. A plan that is continued need not keep these.
        first: Finds the plan to start from, with `extend` only where the guess is not sound: the
            last plan keeps the further constraints. None: the guess.
    """

    def __init__(self, ocp: Ocp[P], solver: SolverInterface,
                 options: SolverOptions | None = None,
                 extend: Callable[[OcpProgram[P]], object] | None = None,
                 first: Solver[P] | None = None):
        self.ocp = ocp
        self._solver, self._options, self._extend = solver, options or tight_options(), extend
        self._first = first

    def of(self, ocp: Ocp[P]) -> "NonlinearSolver[P]":
        """Returns the same solver for another problem."""
        first = None if self._first is None else self._first.of(ocp)
        return NonlinearSolver(ocp, self._solver, self._options, self._extend, first)

    def solve(self, guess: P, iterations: int = 1, tolerance: float = OPTIMALITY) -> Solution[P]:
        """Returns the solution of the program that starts at the guess's first knot.

        The guess, or the plan that `first` found from it, in its place if that is better; of a
        solver that stops early the last point if it is sound and better, else that plan of `first`.
        Neither if the program has more than the problem.

        Args:
            guess: Plan to start from.
            iterations: Of `first`; the program itself is solved to the end.
            tolerance: Not used: `options` have it.
        """
        if self._first is not None and (
                self._extend is None or not self.ocp.is_sound(self.ocp.evaluate(guess))):
            guess = self._first.solve(guess, iterations).plan or guess
        program = OcpProgram(self.ocp, guess)
        if self._extend is not None:
            self._extend(program)
        try:
            result = self._solver.Solve(program, program.initial_guess(), self._options)
            plan = program.plan(result)
            value = self.ocp.evaluate(plan)
        except np.linalg.LinAlgError:
            return Solution(None, None, 1, converged=False)
        converged, before = bool(result.is_success()), self.ocp.evaluate(guess)
        better = self._extend is None and self.ocp.improves(value, before)
        if not converged and not (better and self.ocp.is_sound(value)):
            if self._first is not None and self._extend is None and self.ocp.is_sound(before):
                return Solution(guess, before, 1, converged=False)
            return Solution(None, None, 1, converged=False)
        if not better and self._extend is None:
            return Solution(guess, before, 1, converged)
        return Solution(plan, value, 1, converged)
