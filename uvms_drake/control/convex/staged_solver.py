"""Solution of the convex program of one iteration: Riccati, then a working set of limits.

Without limits it is a linear-quadratic problem that one pass of Riccati's recursion solves. The
pass also completes the square: with w_k = K_k x_k + k_k + W_k r_k the cost is a constant + ½ Σ
‖r_k‖², whatever the limits. So the solution is the least-norm r that keeps the limits, and few are
active. The program for r has the limits that are violated without it or nearly reached by the plan;
limits that its solution violates are added and it is solved again. A solution that keeps all limits
while having some of them is the solution with all.

Where every active limit can be a row, a dual active set is fastest (`least_norm_active_set`);
otherwise a conic program is solved (`least_norm`). There a limit that is active at one stage is
added at all of them, and so are those that are less nearly reached: a row costs little, and solving
again costs as much as before.

A plan that keeps its soft limits is solved without v first: a third of the conic solver's
iterations served to bring a v to zero. A solution without v whose multipliers of soft rows sum up
to at most ρ_v is one with v = 0; otherwise v comes back.
"""

from typing import NamedTuple

import numpy as np
from pydrake.solvers import OsqpSolver, SolverInterface, SolverOptions

from uvms_drake.control.convex.least_norm_active_set import least_norm_active_set
from uvms_drake.control.convex.least_norm_conic import least_norm
from uvms_drake.control.convex.regulator import Regulator, motion, riccati
from uvms_drake.control.convex.staged_program import ActiveLimits, StagedProgram, WorkingSet

NEAR, LESS_NEAR = 0.03, 0.1
"""Distance to a bound, over the limit's range, below which it counts as nearly reached, and as less
nearly."""


class StagedSolution(NamedTuple):
    """Optimal change of the plan."""

    w: np.ndarray
    """Decisions w (N, nw)."""
    slack: float
    """Slack s of the terminal set."""
    excess: float
    """Excess v of the softened limits."""
    cone_programs: int
    """Number of conic programs solved; 0 where no limit was active, or rows were enough."""
    rows: int
    """Number of rows of the last working set."""
    regulator: Regulator
    """The program's regulator."""
    active: ActiveLimits | None = None
    """Active limits, if they are known."""


def solve_staged(program: StagedProgram) -> StagedSolution | None:
    """Returns the solution, or None if there is none: infeasible, ill-conditioned or not finite."""
    if not _is_finite(program):
        return None
    # The unconstrained optimum, which is the solution where it violates no limit.
    try:
        regulator = riccati(program)
    except np.linalg.LinAlgError:
        return None
    z, nx = motion(program, regulator), program.A.shape[-1]
    if not np.isfinite(z).all():
        return None
    kept = WorkingSet.broken(program, z, 0.0)
    if not kept.any():
        return StagedSolution(z[:-1, nx:], 0.0, 0.0, 0, 0, regulator)
    # The fast solver, for limits that are rows; its failure proves nothing.
    kept |= WorkingSet.near(program, NEAR)
    softened, cone_programs = WorkingSet.broken(program, 0.0 * z, 0.0).soft(program), 0
    by_active_set = least_norm_active_set(program, regulator, z, kept)
    if by_active_set is not None:
        least, kept, active = by_active_set
        return StagedSolution((z + regulator.moved(least.r))[:-1, nx:], 0.0, 0.0, 0,
                              kept.rows(program), regulator, active)
    # The conic solver, until its solution violates no limit outside of the working set.
    while True:
        kept = (kept | WorkingSet.near(program, LESS_NEAR)).at_all_stages(program)
        found = least_norm(program, regulator, z, kept, softened=softened)
        cone_programs += 1
        if not softened and (found is None or found.multiplier > program.excess_penalty):
            softened = True
            continue
        if found is None:
            return None
        best = z + regulator.moved(found.r)
        broken = WorkingSet.broken(program, best, found.excess).without(kept)
        if not broken.any():
            return StagedSolution(
                best[:-1, nx:], found.slack, found.excess, cone_programs, kept.rows(program),
                regulator)
        kept |= broken


def _is_finite(program: StagedProgram) -> bool:
    """Returns whether all numbers other than bounds are finite."""
    numbers = [program.A, program.B, program.H, program.g, program.H_end, program.g_end,
               program.linear.C, program.linear.value, program.terminal.T, program.terminal.value,
               *(limit.value for limit in program.norms)]
    return all(np.isfinite(each).all() for each in numbers)


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
