"""Solvers of the FHOCP by name, `mpc.solver`.

`structured` is sequential convex programming with the solver that knows the stages of the convex
programs. The name of a convex solver of Drake's, such as `clarabel`, has it solve those programs in
its place; that of a nonlinear solver, such as `snopt`, has it solve the whole problem, the first
time from the plan of `structured`, and so near the same one of its local optima.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from pydrake.solvers import (
    ClarabelSolver,
    GurobiSolver,
    IpoptSolver,
    MosekSolver,
    NloptSolver,
    OsqpSolver,
    ScsSolver,
    SnoptSolver,
    SolverInterface,
)

from uvms_drake.common.errors import require
from uvms_drake.control.convex.staged_solver import DrakeConvexSolver
from uvms_drake.control.ocp.nonlinear_solver import NonlinearSolver
from uvms_drake.control.ocp.ocp import SOLVERS, STRUCTURED, Ocp
from uvms_drake.control.ocp.ocp_program import OcpProgram
from uvms_drake.control.ocp.scp import SequentialConvexSolver
from uvms_drake.control.ocp.solver import Solver

CONVEX = {"clarabel": ClarabelSolver, "gurobi": GurobiSolver, "mosek": MosekSolver,
          "osqp": OsqpSolver, "scs": ScsSolver}
NONLINEAR = {"ipopt": IpoptSolver, "nlopt": NloptSolver, "snopt": SnoptSolver}


def make_solver(ocp: Ocp[Any], name: str | None = None,
                extend: Callable[[OcpProgram[Any]], object] | None = None) -> Solver[Any]:
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


def _require_suitable(ocp: Ocp[Any], name: str, solver: SolverInterface) -> None:
    """Raises `InvalidParameter` unless a solver can solve the convex programs of a problem."""
    config = ocp.model.configuration(ocp.y_des)
    at_task = np.concatenate([config, np.zeros(ocp.state_size - len(config))])
    program = ocp.staged_program(ocp.resting_plan(0.0, at_task)).mathematical_program()
    require(solver.AreProgramAttributesSatisfied(program), "solver", name,
            "able to solve the problem, as structured and clarabel are: "
            f"{solver.ExplainUnsatisfiedProgramAttributes(program)}")
