"""Least-norm r under active limits of a staged program, by a dual active set: without cones.

Linear limits are rows of a dual active set. A norm limit ‖value + C z‖ ≤ bound is replaced by
tangents: the row of its direction in the plan, and where r violates it, that of its direction
there, until it does not turn any more. In three dimensions a few of them are enough.

The terminal set has a kink where its radius is zero, and at the boundary of an unexplored region a
plan ends there nearly always: value + T x_N = 0, which is as many equalities. With their
multipliers μ, and ν_i of the rows 0 ≤ radius_i + row_iᵀx_N, this is the solution with the cone if

    ‖μ‖ ≤ Σ ν_i ≤ ρ_s,

and for independent rows only if: the first since (Σ ν_i, μ) has to be in the cone, which is its own
dual, at the tip of ‖·‖ ≤ t; the second since a slack would else be cheaper. Otherwise, or where the
terminal set is active in another form, the conic solver is used (`least_norm`); likewise where
there is no solution without an excess v: with Σ of the multipliers of soft rows ≤ ρ_v, v = 0 is
optimal.
"""

import numpy as np

from uvms_drake.control.convex.dual_active_set import DualActiveSet
from uvms_drake.control.convex.least_norm_conic import Form, LeastNorm, linear_rows
from uvms_drake.control.convex.regulator import Regulator, motion, responses
from uvms_drake.control.convex.staged_program import StagedProgram
from uvms_drake.control.convex.working_set import KEPT, WorkingSet

ROUNDS = 12
"""Largest number of times that rows are added."""
DUAL = 1e-6
"""Relative and absolute rounding of ‖μ‖ that is accepted."""
AT_THE_END = 1e-3
"""‖value‖ of a plan, over that at the edge of an ordinary terminal set, up to which the next plan
is expected to end at the tip too; above it the search for r mostly fails."""
SMALLEST = 1e-12
"""Norm below which a vector has no direction."""


def least_norm_active_set(
    program: StagedProgram, regulator: Regulator, z: np.ndarray, kept: WorkingSet,
) -> tuple[LeastNorm, WorkingSet] | None:
    """Returns the least-norm r that keeps all limits, and the limits that were added.

    Args:
        program: The program.
        regulator: Its regulator.
        z: The motion for r = 0 (N+1, nx+nw).
        kept: First working set.

    Returns:
        None if the method does not apply or fails; that proves nothing.
    """
    response = responses(program, regulator)
    size, nx, terminal = response.shape[-1], program.A.shape[-1], program.terminal
    form = Form(np.zeros((0, size)), [slice(size)] * len(z), list(response), np.arange(size),
                np.eye(size))
    # A terminal set at the tip of its cone: equalities of the end, and rows of its radii.
    ends, num_bounds, polyhedron = 0, 0, DualActiveSet(np.zeros((0, size)), np.zeros(0))
    if kept.terminal:
        if terminal.radius_bound is None or np.linalg.norm(terminal.value) > AT_THE_END:
            return None
        end, end_r = z[-1, :nx], response[-1, :nx]
        ends, num_bounds = len(terminal.T), len(terminal.radius_bound.size)
        polyhedron = DualActiveSet(terminal.T @ end_r, -terminal.value - terminal.T @ end)
        radius = terminal.radius_bound
        polyhedron.add(-radius.rows @ end_r, radius.size + radius.rows @ end)
    # Limits that r violates are added, norm limits by their tangents there, until there are none.
    soft = np.zeros(ends + num_bounds, dtype=bool)
    new = kept
    tangents, levels = _tangents(program, response, z, kept, 0.0 * z)
    for _ in range(ROUNDS):
        rows = linear_rows(form, program, z, new, size)
        A, b = np.concatenate([rows.A, *tangents]), np.concatenate([rows.b, *levels])
        is_soft = np.append(rows.soft, np.zeros(len(b) - len(rows.b), dtype=bool))
        moves = np.any(A != 0.0, axis=1)
        if np.any(b[~moves] < -KEPT):
            return None
        polyhedron.add(A[moves], b[moves])
        soft = np.append(soft, is_soft[moves])
        found = polyhedron.least_norm()
        if found is None:
            return None
        r, multipliers = found[0].reshape(regulator.k.shape), found[1]
        best = motion(program, regulator, r)
        broken = WorkingSet.broken(program, best, 0.0)
        new = broken.without(kept)
        if new.terminal:
            return None
        kept = kept | new
        tangents, levels = _tangents(program, response, z, broken, best)
        if not (tangents or new.any()):
            break
    else:
        return None
    # The multipliers decide whether neither slack nor excess would be cheaper.
    multiplier = float(np.sum(multipliers[soft]))
    slack_multiplier = float(np.sum(multipliers[ends: ends + num_bounds]))
    holds = not (broken.any() or multiplier > program.excess_penalty
                 or slack_multiplier > program.slack_penalty
                 or np.linalg.norm(multipliers[:ends]) > (1.0 + DUAL) * slack_multiplier + DUAL)
    return (LeastNorm(r, 0.0, 0.0, multiplier), kept) if holds else None


def _tangents(program: StagedProgram, response: np.ndarray, z: np.ndarray, which: WorkingSet,
              at: np.ndarray) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Returns tangents of norm limits and their bounds, in the directions after a motion."""
    rows, bounds = [], []
    for limit, stages in zip(program.norms, which.norms, strict=True):
        value = limit.value + at @ limit.C.T
        for k in np.flatnonzero(stages):
            direction = value[k] / max(np.linalg.norm(value[k]), SMALLEST)
            rows.append((direction @ limit.C @ response[k])[None])
            bounds.append(limit.bound[k: k + 1] - direction @ (limit.value[k] + limit.C @ z[k]))
    return rows, bounds
