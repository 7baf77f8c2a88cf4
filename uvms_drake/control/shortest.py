"""The shortest r that keeps some limits of a staged program, by a conic solver.

There are two forms of the conic program, with the same solution; y is what it is in:

* condensed, for few limits: r is a combination of their gradients, the rows of a matrix F. With a
  QR decomposition Fᵀ = basis · Gᵀ, r = basis · y, and the limits are rows of F r = G y: a small
  program with a lower triangular matrix.
* sparse, for many: y = (x_1, ..., x_N, r_0, ..., r_{N−1}), and the motion is a constraint. A row
  has no more entries than a stage has variables, so the time grows with N as the number of rows.
"""

from typing import NamedTuple

import numpy as np
from pydrake.solvers import ClarabelSolver, MathematicalProgram

from uvms_drake.control.regulator import Regulator, responses
from uvms_drake.control.staged_program import StagedProgram
from uvms_drake.control.working_set import WorkingSet


class Rows(NamedTuple):
    """Rows C z_k at some stages k."""

    stage: np.ndarray
    """Stages (m,)."""
    C: np.ndarray
    """Rows (m, nx+nw)."""

    def at(self, z: np.ndarray) -> np.ndarray:
        """Returns C z_k (m,) for z (N+1, nx+nw)."""
        return np.sum(self.C * z[self.stage], axis=1)


class Form(NamedTuple):
    """What a conic program is in."""

    prog: MathematicalProgram
    """With the cost ½‖r‖², and with what else y has to fulfil."""
    y: np.ndarray
    """Variables y (l,)."""
    G: np.ndarray
    """The rows of the limits change by G y (m, l)."""
    r: np.ndarray
    """r (N nw,) is this matrix times y."""


def shortest(program: StagedProgram, regulator: Regulator, z: np.ndarray, kept: WorkingSet,
             *, sparse: bool) -> tuple[np.ndarray, float, float] | None:
    """Returns the r (N, nw) of least cost that keeps some limits, with its s and v.

    Args:
        program: The program.
        regulator: Its regulator.
        z: The motion for r = 0 (N+1, nx+nw).
        kept: The limits.
        sparse: Which form of the conic program is solved.

    Returns:
        None if there is no solution.
    """
    linear, terminal = program.linear, program.terminal
    (N, nx, nw), width = program.B.shape, z.shape[1]

    # The rows: of the linear limits, each as an upper bound; of the norms; of the terminal set.
    rows, room, soft = [], [], []
    for sign, mask, bound in ((1.0, kept.upper, linear.upper), (-1.0, kept.lower, -linear.lower)):
        stage, row = np.nonzero(mask)
        part = Rows(stage, sign * linear.C[stage, row])
        rows.append(part)
        room.append(bound[stage, row] - sign * linear.value[stage, row] - part.at(z))
        soft.append(linear.soft[row])
    norms = [(limit, k) for limit, mask in zip(program.norms, kept.norms, strict=True)
             for k in np.flatnonzero(mask)]
    rows += [Rows(np.full(len(limit.C), k), limit.C) for limit, k in norms]
    if kept.terminal:
        ends = terminal.T if terminal.room is None else np.concatenate(
            [terminal.T, terminal.room.rows])
        rows.append(Rows(np.full(len(ends), N), np.pad(ends, ((0, 0), (0, width - nx)))))
    make = _sparse if sparse else _condensed
    prog, y, G, r_y = make(program, regulator, Rows(
        np.concatenate([each.stage for each in rows]), np.concatenate([each.C for each in rows])))
    s, v = prog.NewContinuousVariables(1, "s"), prog.NewContinuousVariables(1, "v")
    prog.AddLinearCost([program.slack_penalty, program.excess_penalty], np.concatenate([s, v]))
    prog.AddBoundingBoxConstraint(0.0, np.inf, np.concatenate([s, v]))

    # linear: G y − v ≤ room, v in the soft rows only
    first = sum(map(len, room))
    if first:
        prog.AddLinearConstraint(
            np.hstack([G[:first], -np.concatenate(soft)[:, None].astype(float)]),
            np.full(first, -np.inf), np.concatenate(room), np.concatenate([y, v]))
    # norms: ‖value + G y‖ ≤ bound
    for limit, k in norms:
        last = first + len(limit.C)
        used = np.any(G[first:last], axis=0)
        prog.AddLorentzConeConstraint(
            np.vstack([np.zeros((1, np.count_nonzero(used))), G[first:last, used]]),
            np.concatenate([limit.bound[k: k + 1], limit.value[k] + limit.C @ z[k]]), y[used])
        first = last
    # terminal set: ‖value + G y‖ ≤ t, where t is at most each of the bounds: radius and rooms, + s
    if kept.terminal:
        last = first + len(terminal.T)
        t = prog.NewContinuousVariables(1, "t")
        used = np.any(G[first:], axis=0)
        A = np.zeros((1 + len(terminal.T), np.count_nonzero(used) + 1))
        A[0, -1], A[1:, :-1] = 1.0, G[first:last, used]
        prog.AddLorentzConeConstraint(
            A, np.append(0.0, terminal.value + terminal.T @ z[-1, :nx]),
            np.concatenate([y[used], t]))
        most, by_y = np.array([terminal.radius]), np.zeros((1, np.count_nonzero(used)))
        if terminal.room is not None:
            most = np.append(terminal.room.size + terminal.room.rows @ z[-1, :nx], most)
            by_y = np.concatenate([-G[last:, used], by_y])
        bounded = np.isfinite(most)
        ones = np.ones((np.count_nonzero(bounded), 1))
        prog.AddLinearConstraint(
            np.hstack([by_y[bounded], ones, -ones]), np.full(len(ones), -np.inf), most[bounded],
            np.concatenate([y[used], t, s]))

    result = ClarabelSolver().Solve(prog)
    if not result.is_success():
        return None
    r = r_y @ result.GetSolution(y)
    if not np.all(np.isfinite(r)):
        return None
    return r.reshape(N, nw), float(result.GetSolution(s)[0]), float(result.GetSolution(v)[0])


def _condensed(program: StagedProgram, regulator: Regulator, rows: Rows) -> Form:
    """Returns the condensed form."""
    response = responses(program, regulator)
    F = np.empty((len(rows.C), response.shape[-1]))
    for k in np.unique(rows.stage):
        here = rows.stage == k
        F[here] = rows.C[here] @ response[k]
    basis, triangle = np.linalg.qr(F.T)
    prog = MathematicalProgram()
    y = prog.NewContinuousVariables(basis.shape[1], "y")
    prog.AddQuadraticCost(np.eye(len(y)), np.zeros(len(y)), y, is_convex=True)
    return Form(prog, y, np.ascontiguousarray(triangle.T), basis)


def _sparse(program: StagedProgram, regulator: Regulator, rows: Rows) -> Form:
    """Returns the sparse form."""
    N, nx, nw = program.B.shape
    states, size = N * nx, N * (nx + nw)
    x_y, r_y = (np.eye(size)[part].reshape(N, -1, size)
                for part in (slice(states), slice(states, None)))
    z_y = np.zeros((N + 1, nx + nw, size))  # ∂z/∂y
    z_y[1:, :nx] = x_y
    z_y[:-1, nx:] = regulator.K @ z_y[:-1, :nx] + regulator.W @ r_y
    prog = MathematicalProgram()
    y = prog.NewContinuousVariables(size, "y")
    prog.AddQuadraticCost(np.eye(N * nw), np.zeros(N * nw), y[states:], is_convex=True)
    motion = np.concatenate([program.A, program.B], axis=2) @ z_y[:-1] - x_y
    prog.AddLinearEqualityConstraint(motion.reshape(states, size), np.zeros(states), y)
    G = np.empty((len(rows.C), size))
    for k in np.unique(rows.stage):
        here = rows.stage == k
        G[here] = rows.C[here] @ z_y[k]
    return Form(prog, y, G, r_y.reshape(-1, size))
