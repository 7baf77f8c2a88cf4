"""The shortest r that keeps some limits of a staged program, by a conic solver.

There are two forms of the conic program, with the same solution; y is what it is in:

* condensed, for few limits: r is a combination of their gradients. With a basis of these,
  r = basis · y, and all stages are in the same few y.
* sparse, for many: a stage is in its own x_k and r_k, and the motion is a constraint. A row has no
  more entries than a stage has variables, so the time grows with N as the number of rows.
"""

from typing import NamedTuple

import numpy as np
from pydrake.solvers import Binding, ClarabelSolver, MathematicalProgram, MathematicalProgramResult

from uvms_drake.control.regulator import Regulator, responses
from uvms_drake.control.staged_program import StagedProgram
from uvms_drake.control.working_set import WorkingSet


class Form(NamedTuple):
    """A conic program with the cost ½‖r‖², and what the motion is in it: z_k changes by Z_k y_k."""

    prog: MathematicalProgram
    """With what else its variables have to fulfil."""
    y: list[np.ndarray]
    """The variables y_k of each stage."""
    Z: list[np.ndarray]
    """∂z_k/∂y_k (nx+nw, size of y_k)."""
    r: np.ndarray
    """The variables that r is in."""
    r_y: np.ndarray
    """r (N nw,) is this matrix times them."""

    def solution(self, result: MathematicalProgramResult) -> np.ndarray:
        """Returns r (N nw,)."""
        return np.asarray(self.r_y @ result.GetSolution(self.r))


class Shortest(NamedTuple):
    """The solution."""

    r: np.ndarray
    """r (N, nw)."""
    slack: float
    """Slack s of the terminal set."""
    excess: float
    """Excess v of the softened limits."""
    price: float
    """Sum of the multipliers of the soft rows: what one unit of v would save."""


def shortest(program: StagedProgram, regulator: Regulator, z: np.ndarray, kept: WorkingSet,
             *, sparse: bool, softened: bool) -> Shortest | None:
    """Returns the r of least cost that keeps some limits.

    Args:
        program: The program.
        regulator: Its regulator.
        z: The motion for r = 0 (N+1, nx+nw).
        kept: The limits.
        sparse: Which form of the conic program is solved.
        softened: Whether there is a v; without one, soft rows are as the others.

    Returns:
        None if there is no solution.
    """
    N, _, nw = program.B.shape
    form = (_sparse(program, regulator) if sparse
            else _condensed(program, responses(program, regulator), kept))
    prog = form.prog
    s, v = prog.NewContinuousVariables(1, "s"), prog.NewContinuousVariables(int(softened), "v")
    prog.AddLinearCost(
        [program.slack_penalty, program.excess_penalty][: 1 + len(v)], np.concatenate([s, v]))
    prog.AddBoundingBoxConstraint(0.0, np.inf, np.concatenate([s, v]))
    soft = _add_linear_limits(form, program, z, kept, v)
    for limit, stages in zip(program.norms, kept.norms, strict=True):
        for k in np.flatnonzero(stages):
            # ‖value + C z‖ ≤ bound
            by_y = limit.C @ form.Z[k]
            used = np.any(by_y, axis=0)
            prog.AddLorentzConeConstraint(
                np.pad(by_y[:, used], ((1, 0), (0, 0))),
                np.append(limit.bound[k], limit.value[k] + limit.C @ z[k]), form.y[k][used])
    if kept.terminal:
        _add_terminal_limit(form, program, z, s)
    result = ClarabelSolver().Solve(prog)
    if not result.is_success():
        return None
    r = form.solution(result)
    if not np.all(np.isfinite(r)):
        return None
    price = -sum(float(np.sum(result.GetDualSolution(row)[mask])) for row, mask in soft)
    return Shortest(r.reshape(N, nw), float(result.GetSolution(s)[0]),
                    float(np.sum(result.GetSolution(v))), price)


def _add_linear_limits(form: Form, program: StagedProgram, z: np.ndarray, kept: WorkingSet,
                       v: np.ndarray) -> list[tuple[Binding, np.ndarray]]:
    """Adds ± (value + C z) − v ≤ ± bound, v in the soft rows only, if there is one.

    Returns:
        What is added, and which of its rows are soft.
    """
    linear, out = program.linear, []
    for k in np.flatnonzero(np.any(kept.upper | kept.lower, axis=1)):
        above, below = np.flatnonzero(kept.upper[k]), np.flatnonzero(kept.lower[k])
        rows = np.concatenate([above, below])
        sign = np.repeat([1.0, -1.0], [len(above), len(below)])
        bound = np.concatenate([linear.upper[k, above], linear.lower[k, below]])
        C = linear.C[k, rows]
        soft = linear.soft[rows]
        by_y = np.hstack([sign[:, None] * (C @ form.Z[k]), -1.0 * soft[:, None][:, : len(v)]])
        out.append((form.prog.AddLinearConstraint(
            by_y, np.full(len(rows), -np.inf),
            sign * (bound - linear.value[k, rows] - C @ z[k]), np.concatenate([form.y[k], v])),
            soft))
    return out


def _add_terminal_limit(form: Form, program: StagedProgram, z: np.ndarray, s: np.ndarray) -> None:
    """Adds ‖value + T x_N‖ ≤ t, where t is at most each of the bounds, radius and rooms, + s."""
    terminal, x = program.terminal, z[-1, : program.A.shape[-1]]
    x_y = form.Z[-1][: len(x)]
    t = form.prog.NewContinuousVariables(1, "t")
    A = np.zeros((1 + len(terminal.T), 1 + x_y.shape[1]))
    A[0, 0], A[1:, 1:] = 1.0, terminal.T @ x_y
    form.prog.AddLorentzConeConstraint(
        A, np.append(0.0, terminal.value + terminal.T @ x), np.concatenate([t, form.y[-1]]))
    most, rows = np.array([terminal.radius]), np.zeros((1, len(x)))
    if terminal.room is not None:
        most = np.append(most, terminal.room.size + terminal.room.rows @ x)
        rows = np.concatenate([rows, terminal.room.rows])
    bounded = np.isfinite(most)
    ones = np.ones((np.count_nonzero(bounded), 1))
    form.prog.AddLinearConstraint(
        np.hstack([ones, -ones, -rows[bounded] @ x_y]), np.full(len(ones), -np.inf),
        most[bounded], np.concatenate([t, s, form.y[-1]]))


def _condensed(program: StagedProgram, response: np.ndarray, kept: WorkingSet) -> Form:
    """Returns the condensed form, by the responses ∂z/∂r (N+1, nx+nw, N nw)."""
    linear, nx = program.linear, program.A.shape[-1]
    gradients = [(linear.C @ response)[kept.upper | kept.lower]]
    gradients += [(limit.C @ response[stages]).reshape(-1, response.shape[-1])
                  for limit, stages in zip(program.norms, kept.norms, strict=True)]
    if kept.terminal:
        ends = program.terminal.T
        if program.terminal.room is not None:
            ends = np.concatenate([ends, program.terminal.room.rows])
        gradients.append(ends @ response[-1, :nx])
    basis = np.linalg.qr(np.concatenate(gradients).T)[0]
    prog = MathematicalProgram()
    y = prog.NewContinuousVariables(basis.shape[1], "y")
    prog.AddQuadraticCost(np.eye(len(y)), np.zeros(len(y)), y, is_convex=True)
    return Form(prog, [y] * len(response), list(response @ basis), y, basis)


def _sparse(program: StagedProgram, regulator: Regulator) -> Form:
    """Returns the sparse form; x_0 does not change."""
    N, nx, nw = program.B.shape
    Z = np.zeros((N + 1, nx + nw, nx + nw))
    Z[:, :nx, :nx], Z[:-1, nx:, :nx], Z[:-1, nx:, nx:] = np.eye(nx), regulator.K, regulator.W
    ahead = np.concatenate([program.A, program.B], axis=2) @ Z[:-1]
    prog = MathematicalProgram()
    x = [np.empty(0), *prog.NewContinuousVariables(N, nx, "x")]
    r = prog.NewContinuousVariables(N, nw, "r")
    prog.AddQuadraticCost(np.eye(r.size), np.zeros(r.size), r.ravel(), is_convex=True)
    y = [*(np.concatenate([x[k], r[k]]) for k in range(N)), x[N]]
    by_y = [Z[0, :, nx:], *Z[1:-1], Z[N, :, :nx]]
    for k in range(N):
        by_now = ahead[k, :, -len(y[k]):]
        prog.AddLinearEqualityConstraint(
            np.hstack([by_now, -np.eye(nx)]), np.zeros(nx), np.concatenate([y[k], x[k + 1]]))
    return Form(prog, y, by_y, r.ravel(), np.eye(r.size))
