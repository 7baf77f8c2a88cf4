"""Convex program of one iteration, solved in full by a convex solver of Drake's."""

import numpy as np
from pydrake.solvers import OsqpSolver, SolverInterface, SolverOptions

from uvms_drake.control.convex.regulator import riccati
from uvms_drake.control.convex.staged_program import StagedProgram
from uvms_drake.control.convex.staged_solver import StagedSolution

OSQP_ITERATIONS = 50_000
"""Largest number of iterations of OSQP, for which the penalties of the slacks are badly scaled."""


class DrakeConvexSolver:
    """Solves staged programs like `solve_staged`, without knowing their stages.

    Args:
        solver: Such as `ClarabelSolver`.
    """

    def __init__(self, solver: SolverInterface):
        self._solver, self._options = solver, SolverOptions()
        self._options.SetOption(OsqpSolver.id(), "max_iter", OSQP_ITERATIONS)

    def __call__(self, program: StagedProgram) -> StagedSolution | None:
        """Returns the solution, or None if there is none or it is not finite."""
        try:
            regulator = riccati(program)
        except np.linalg.LinAlgError:
            return None
        prog = program.mathematical_program()
        result = self._solver.Solve(prog, None, self._options)
        found = result.GetSolution(prog.decision_variables())
        if not result.is_success() or not np.all(np.isfinite(found)):
            return None
        linear = program.linear
        rows = sum(int(np.count_nonzero(np.isfinite(bound)))
                   for bound in (linear.lower, linear.upper)) + sum(
            len(limit.C) * int(np.count_nonzero(np.isfinite(limit.bound)))
            for limit in program.norms)
        return StagedSolution(
            result.GetSolution(prog.w), float(result.GetSolution(prog.s)[0]),
            float(result.GetSolution(prog.v)[0]), 1, rows, regulator)
