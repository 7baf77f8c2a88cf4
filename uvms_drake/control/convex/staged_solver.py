"""How the convex program of one iteration is solved.

Without limits it is a linear-quadratic problem, and one pass of Riccati's recursion solves it. It
also completes the square: with w_k = K_k x_k + k_k + L_k⁻ᵀ r_k the cost is a constant + ½ Σ ‖r_k‖²,
whatever the limits. So the limits ask for the shortest r that keeps them, and the few that matter
decide. The program for that holds only the limits that are broken without them or nearly
reached by the plan; if its solution breaks another one, that one is put in and the program is
solved again. A solution that keeps all limits while carrying some is the solution with all of them.

Where every limit that matters can be held by rows, a dual active set is quickest
(`least_norm_active_set`); otherwise a conic program is solved (`least_norm`). Where so many matter that
this is made in its sparse form, a limit that matters at one stage is put in at all of them, and so
are those that are less nearly reached: there a row costs little, and to solve again costs as much
as before.

Where the plan keeps its soft limits, so does a solution nearly always, and v is left out at first:
a third of the conic solver's iterations went into bringing a v to zero that costs far more than all
else. A solution without v whose multipliers of soft rows sum up to at most ρ_v is one with v = 0;
where it is not, or there is none, v comes back.
"""

import numpy as np

from uvms_drake.control.convex.least_norm_active_set import least_norm_active_set
from uvms_drake.control.convex.least_norm_conic import least_norm
from uvms_drake.control.convex.regulator import motion, riccati
from uvms_drake.control.convex.staged_program import StagedProgram, StagedSolution
from uvms_drake.control.convex.working_set import WorkingSet

MANY = 0.75
"""Rows of limits, as a part of the number of decisions, from which on the sparse form is taken."""
NEAR, LESS_NEAR = 0.03, 0.1
"""Part of a limit's range of which less is left where the limit counts as nearly reached, and as
less nearly."""


def solve_staged(program: StagedProgram) -> StagedSolution | None:
    """Returns the solution, or None if there is none: infeasible, ill-conditioned or not finite."""
    if not _is_finite(program):
        return None
    try:
        regulator = riccati(program)
    except np.linalg.LinAlgError:
        return None
    N, nx, nw = program.B.shape
    z = motion(program, regulator)
    if not np.isfinite(z).all():
        return None
    kept = WorkingSet.broken(program, z, 0.0)
    if not kept.any():
        return StagedSolution(z[:-1, nx:], 0.0, 0.0, 0, 0)
    kept |= WorkingSet.near(program, NEAR)
    softened, cone_programs = WorkingSet.broken(program, 0.0 * z, 0.0).soft(program), 0
    by_active_set = least_norm_active_set(program, regulator, z, kept)
    if by_active_set is not None:
        return StagedSolution(motion(program, regulator, by_active_set[0].r)[:-1, nx:], 0.0, 0.0, 0,
                              by_active_set[1].rows(program))
    while True:
        sparse = kept.rows(program) > MANY * N * nw
        if sparse:
            kept = (kept | WorkingSet.near(program, LESS_NEAR)).at_all_stages(program)
        found = least_norm(program, regulator, z, kept, sparse=sparse, softened=softened)
        cone_programs += 1
        if not softened and (found is None or found.multiplier > program.excess_penalty):
            softened = True
            continue
        if found is None:
            return None
        best = motion(program, regulator, found.r)
        broken = WorkingSet.broken(program, best, found.excess).without(kept)
        if not broken.any():
            return StagedSolution(
                best[:-1, nx:], found.slack, found.excess, cone_programs, kept.rows(program))
        kept |= broken


def _is_finite(program: StagedProgram) -> bool:
    """Returns whether no number is NaN, and none infinite that is no bound."""
    numbers = [program.A, program.B, program.H, program.g, program.H_end, program.g_end,
               program.linear.C, program.linear.value, program.terminal.T, program.terminal.value,
               *(limit.value for limit in program.norms)]
    return all(bool(np.all(np.isfinite(each))) for each in numbers)
