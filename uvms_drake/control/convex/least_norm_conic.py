"""Least-norm r under active limits of a staged program, by a conic solver.

A stage depends on its own x_k and r_k, and the motion is a constraint. A row has no more entries
than a stage has variables, so the time grows with N as the number of rows.
"""

from typing import NamedTuple

import numpy as np
from pydrake.solvers import ClarabelSolver, MathematicalProgram

from uvms_drake.control.convex.regulator import Regulator
from uvms_drake.control.convex.staged_program import StagedProgram, WorkingSet


class Form(NamedTuple):
    """Variables y = (r_0, x_1, r_1, ..., x_N): z_k changes by Z_k y_k, where y_k is a part of y."""

    motion: np.ndarray
    """Equality rows (m, size of y), zero at y."""
    y: list[slice]
    """Position of y_k in y, of each stage."""
    Z: list[np.ndarray]
    """Derivatives ∂z_k/∂y_k (nx+nw, size of y_k)."""
    r: np.ndarray
    """Indices of r (N nw,) in y; the cost is half its square."""


class Rows(NamedTuple):
    """Rows A x ≤ b in all variables x of the conic program."""

    A: np.ndarray
    b: np.ndarray
    soft: np.ndarray
    """Whether v relaxes a row."""


class LeastNorm(NamedTuple):
    """Least-norm solution."""

    r: np.ndarray
    """Vector r (N, nw)."""
    slack: float
    """Slack s of the terminal set."""
    excess: float
    """Excess v of the softened limits."""
    multiplier: float
    """Sum of the multipliers of the soft rows: the cost saved by one unit of v."""


def least_norm(program: StagedProgram, regulator: Regulator, z: np.ndarray, kept: WorkingSet,
             *, softened: bool) -> LeastNorm | None:
    """Returns the least-norm r that keeps some limits.

    Args:
        program: The program.
        regulator: Its regulator.
        z: The motion for r = 0 (N+1, nx+nw).
        kept: Limits that are active.
        softened: Whether there is an excess v; without one, soft rows are hard.

    Returns:
        None if there is no solution.
    """
    N, _, nw = program.B.shape
    form = _form(program, regulator)
    # Variables (y, s), then v and t, if there are: t is the least of the terminal radii, less s.
    s = form.motion.shape[1]
    v, t = s + softened, s + softened + kept.terminal
    prog = MathematicalProgram()
    x = prog.NewContinuousVariables(t + 1)
    prog.AddQuadraticCost(np.eye(len(form.r)), np.zeros(len(form.r)), x[form.r], is_convex=True)
    prog.AddLinearCost([program.slack_penalty, program.excess_penalty][: 1 + softened], x[s: v + 1])
    prog.AddBoundingBoxConstraint(0.0, np.inf, x[s: v + 1])
    # In Fortran's order: of another one Drake's bindings make a copy, and import SciPy before.
    prog.AddLinearEqualityConstraint(
        np.asfortranarray(form.motion), np.zeros(len(form.motion)), x[:s])
    # Linear limits, all rows at once (a call costs as much as a hundred); v relaxes the soft ones.
    rows = linear_rows(form, program, z, kept, len(x))
    if softened:
        rows.A[rows.soft, v] = -1.0
    for limit, stages in zip(program.norms, kept.norms, strict=True):
        for k in np.flatnonzero(stages):
            # Norm limit ‖value + C z‖ ≤ bound, of the variables that enter it.
            by_y = limit.C @ form.Z[k]
            used = np.any(by_y, axis=0)
            prog.AddLorentzConeConstraint(
                np.pad(by_y[:, used], ((1, 0), (0, 0))),
                np.append(limit.bound[k], limit.value[k] + limit.C @ z[k]), x[form.y[k]][used])
    A, b = rows.A, rows.b
    if kept.terminal:
        # Terminal set ‖value + T x_N‖ ≤ t, t below each of the radii.
        end, Z_x = z[-1, : program.A.shape[-1]], form.Z[-1][: program.A.shape[-1]]
        terminal, radius_bound = program.terminal, program.terminal.radius_bounds(end)
        prog.AddLorentzConeConstraint(
            np.block([[np.zeros((1, Z_x.shape[1])), np.ones((1, 1))],
                      [terminal.T @ Z_x, np.zeros((len(terminal.T), 1))]]),
            np.append(0.0, terminal.value + terminal.T @ end), np.append(x[form.y[-1]], x[t]))
        bounds = np.zeros((len(radius_bound.size), len(x)))
        bounds[:, form.y[-1]], bounds[:, s], bounds[:, t] = -radius_bound.rows @ Z_x, -1.0, 1.0
        A, b = np.concatenate([A, bounds]), np.append(b, radius_bound.size)
    limits = prog.AddLinearConstraint(
        np.asfortranarray(A), np.full(len(b), -np.inf), b, x) if len(b) else None
    # Multipliers of the soft rows tell whether v = 0 is optimal.
    result = ClarabelSolver().Solve(prog)
    if not result.is_success():
        return None
    found = result.GetSolution(x)
    if not np.all(np.isfinite(found)):
        return None
    multipliers = np.zeros(0) if limits is None else -result.GetDualSolution(limits)
    return LeastNorm(
        found[form.r].reshape(N, nw), float(found[s]),
        float(found[v]) if softened else 0.0,
        float(np.sum(multipliers[: len(rows.soft)][rows.soft])))


def linear_rows(form: Form, program: StagedProgram, z: np.ndarray, kept: WorkingSet, width: int
                 ) -> Rows:
    """Returns ± (value + C z) ≤ ± bound of the linear limits, in `width` variables."""
    linear, A, b, soft = program.linear, [np.zeros((0, width))], [np.zeros(0)], [np.zeros(0, bool)]
    for k in np.flatnonzero(np.any(kept.upper | kept.lower, axis=1)):
        above, below = np.flatnonzero(kept.upper[k]), np.flatnonzero(kept.lower[k])
        each = np.concatenate([above, below])
        sign = np.repeat([1.0, -1.0], [len(above), len(below)])
        bound = np.concatenate([linear.upper[k, above], linear.lower[k, below]])
        C, rows = sign[:, None] * linear.C[k, each], np.zeros((len(each), width))
        rows[:, form.y[k]] = C @ form.Z[k]
        A.append(rows)
        b.append(sign * (bound - linear.value[k, each]) - C @ z[k])
        soft.append(linear.soft[each])
    return Rows(np.concatenate(A), np.concatenate(b), np.concatenate(soft))


def _form(program: StagedProgram, regulator: Regulator) -> Form:
    """Returns the variables of the conic program; x_0 does not change."""
    N, nx, nw = program.B.shape
    Z = np.zeros((N + 1, nx + nw, nx + nw))
    Z[:, :nx, :nx], Z[:-1, nx:, :nx], Z[:-1, nx:, nx:] = np.eye(nx), regulator.K, regulator.W
    next_state = np.concatenate([program.A, program.B], axis=2) @ Z[:-1]
    y = [slice(max(k * (nx + nw) - nx, 0), (k + 1) * (nx + nw) - nx) for k in range(N)]
    y.append(slice(y[-1].stop, y[-1].stop + nx))
    motion = np.zeros((N, nx, y[-1].stop))
    for k in range(N):
        now = y[k]
        motion[k, :, now] = next_state[k, :, now.start - now.stop:]
        motion[k, :, now.stop: now.stop + nx] = -np.eye(nx)
    r = np.concatenate([np.arange(now.stop - nw, now.stop) for now in y[:-1]])
    return Form(motion.reshape(N * nx, -1), y, [Z[0, :, nx:], *Z[1:-1], Z[N, :, :nx]], r)
