"""Solvers of the FHOCP by name, `mpc.solver`.

`structured` is sequential convex programming with the solver that knows the stages of the convex
programs. The name of a convex solver of Drake's, such as `clarabel`, has it solve those programs in
its place; that of a nonlinear solver, such as `snopt`, has it solve the whole problem, from the
plan of `structured`, and so near the same one of its local optima.
"""

from collections.abc import Callable

import numpy as np
from pydrake import solvers

from uvms_drake.common.errors import require
from uvms_drake.control.convex.staged_solver import DrakeConvexSolver
from uvms_drake.control.ocp.ocp import SOLVERS, STRUCTURED, Ocp
from uvms_drake.control.ocp.ocp_program import OcpProgram
from uvms_drake.control.ocp.scp import SequentialConvexSolver, Solution, Solver
from uvms_drake.control.plan.plan import Plan

FEASIBILITY, OPTIMALITY = 1e-8, 1e-7
"""Violation of the constraints at which SNOPT and IPOPT stop, and of the conditions of optimality:
IPOPT at ten times that, because it has no second derivatives."""
ITERATIONS = 200
"""Largest number of SNOPT's major iterations. Near some optima of an unknown wall it does not come
to its tolerance, while the cost changes by less than 1e-6 of itself."""


def tight_options() -> solvers.SolverOptions:
    """Returns options by which a plan keeps its limits to well within `Ocp.tolerance`."""
    options = solvers.SolverOptions()
    options.SetOption(solvers.SnoptSolver.id(), "Major feasibility tolerance", FEASIBILITY)
    options.SetOption(solvers.SnoptSolver.id(), "Major optimality tolerance", OPTIMALITY)
    options.SetOption(solvers.SnoptSolver.id(), "Major iterations limit", ITERATIONS)
    options.SetOption(solvers.IpoptSolver.id(), "constr_viol_tol", FEASIBILITY)
    options.SetOption(solvers.IpoptSolver.id(), "tol", 10.0 * OPTIMALITY)
    return options


class NonlinearSolver(Solver):
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

    def __init__(self, ocp: Ocp, solver: solvers.SolverInterface,
                 options: solvers.SolverOptions | None = None,
                 extend: Callable[[OcpProgram], object] | None = None,
                 first: Solver | None = None):
        self.ocp = ocp
        self._solver, self._options, self._extend = solver, options or tight_options(), extend
        self._first = first

    def of(self, ocp: Ocp) -> "NonlinearSolver":
        """Returns the same solver for another problem."""
        first = None if self._first is None else self._first.of(ocp)
        return NonlinearSolver(ocp, self._solver, self._options, self._extend, first)

    def solve(self, guess: Plan, iterations: int = 1, tolerance: float = OPTIMALITY) -> Solution:
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


CONVEX = {"clarabel": solvers.ClarabelSolver, "gurobi": solvers.GurobiSolver,
          "mosek": solvers.MosekSolver, "osqp": solvers.OsqpSolver, "scs": solvers.ScsSolver}
NONLINEAR = {"ipopt": solvers.IpoptSolver, "nlopt": solvers.NloptSolver,
             "snopt": solvers.SnoptSolver}


def make_solver(ocp: Ocp, name: str | None = None,
                extend: Callable[[OcpProgram], object] | None = None) -> Solver:
    """Returns a solver of a problem.

    Args:
        ocp: The problem.
        name: One of `SOLVERS`; by default that of the problem's `MpcConfig`.
        extend: Function that adds costs and constraints to a program before it is solved, for a
            nonlinear solver; see `NonlinearSolver`.

    Raises:
        InvalidParameter: There is no such solver here, or none for the problem's constraints.
    """
    name = name or ocp.solver
    require(name in SOLVERS, "solver", name, f"one of {', '.join(SOLVERS)}")
    require(extend is None or name in NONLINEAR, "solver", name,
            f"one of {', '.join(NONLINEAR)}, with costs or constraints of one's own")
    if name == STRUCTURED:
        return SequentialConvexSolver(ocp)
    solver = (CONVEX | NONLINEAR)[name]()
    require(solver.available() and solver.enabled(), "solver", name,
            "in this build of Drake, and licensed; structured always is")
    if name in NONLINEAR:
        return NonlinearSolver(ocp, solver, extend=extend, first=SequentialConvexSolver(ocp))
    _require_suitable(ocp, name, solver)
    return SequentialConvexSolver(ocp, DrakeConvexSolver(solver))


def _require_suitable(ocp: Ocp, name: str, solver: solvers.SolverInterface) -> None:
    """Raises `InvalidParameter` unless a solver can solve the convex programs of a problem."""
    config = ocp.model.configuration(ocp.y_des)
    at_task = np.concatenate([config, np.zeros(ocp.state_size - len(config))])
    program = ocp.staged_program(ocp.resting_plan(0.0, at_task)).mathematical_program()
    require(solver.AreProgramAttributesSatisfied(program), "solver", name,
            "able to solve the problem, as structured and clarabel are: "
            f"{solver.ExplainUnsatisfiedProgramAttributes(program)}")
