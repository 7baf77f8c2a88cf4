"""The convex program of one iteration, and how it is solved.

A plan is changed by x_k (state) and w_k (decision), z_k = (x_k, w_k):

    min  Σ_{k<N} (½ z_kᵀ H_k z_k + g_kᵀ z_k) + ½ x_NᵀH_N x_N + g_Nᵀx_N + ρ_s s + ρ_v v
    s.t. x_0 = 0,  x_{k+1} = A_k x_k + B_k w_k
         lower ≤ value + C_k z_k ≤ upper       (widened by v ≥ 0 where a row is soft)
         ‖value + C z_k‖₂ ≤ bound
         ‖value + T x_N‖₂ ≤ radius + s,  s ≥ 0,  and ≤ room + rowᵀx_N + s, if there is a room

Without limits this is a linear-quadratic problem, and one pass of Riccati's recursion solves it. It
also completes the square: with w_k = K_k x_k + k_k + L_k⁻ᵀ r_k the cost is a constant + ½ Σ ‖r_k‖²,
whatever the limits. So the limits ask for the shortest r that keeps them, and the few that matter
decide: r is a combination of their gradients. The program that goes to the conic solver holds only
the limits that are broken without them or nearly reached by the plan; if its solution breaks
another one, that one is put in and the program is solved again. A solution that keeps all limits
while carrying some is the solution with all of them.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from pydrake.solvers import ClarabelSolver, MathematicalProgram

from uvms_drake.model.spatial import times

KEPT = 1e-7
"""Excess of a limit, in its own unit, that does not count: ten times the solver's tolerance."""
NEAR = 0.03
"""Fraction of a limit's range below which the limit counts as nearly reached."""


class LinearLimits(NamedTuple):
    """lower ≤ value + C z ≤ upper, rows of every stage; infinite where a row has no meaning."""

    C: np.ndarray
    """Rows C of the limits (N+1, m, nx+nw); at the last stage w is zero."""
    value: np.ndarray
    """Values at the plan (N+1, m)."""
    lower: np.ndarray
    """Lower bounds of the values (N+1, m)."""
    upper: np.ndarray
    """Upper bounds of the values (N+1, m)."""
    soft: np.ndarray
    """Whether v relaxes a row (m,)."""


def stacked(parts: list[LinearLimits]) -> LinearLimits:
    """Returns all rows of several limits."""
    def rows(name: str, axis: int = 1) -> np.ndarray:
        return np.concatenate([getattr(part, name) for part in parts], axis=axis)

    return LinearLimits(rows("C"), rows("value"), rows("lower"), rows("upper"), rows("soft", 0))


class NormLimit(NamedTuple):
    """‖value + C z‖₂ ≤ bound at every stage."""

    C: np.ndarray
    """Rows C of the norm (m, nx+nw), the same at every stage."""
    value: np.ndarray
    """Vectors at the plan (N+1, m)."""
    bound: np.ndarray
    """Largest norms (N+1,); infinite where there is no limit."""


class Room(NamedTuple):
    """The least of size + rows x_N."""

    size: np.ndarray
    """At the plan (m,)."""
    rows: np.ndarray
    """How it changes with x_N (m, nx)."""


class TerminalLimit(NamedTuple):
    """‖value + T x_N‖₂ ≤ radius + s, and at most what there is room for + s."""

    T: np.ndarray
    value: np.ndarray
    radius: float
    room: Room | None = None
    """None if there is room everywhere."""

    def excess(self, x: np.ndarray) -> float:
        """Returns how far the end is outside for x_N (nx,); negative inside."""
        room = np.inf if self.room is None else np.min(self.room.size + self.room.rows @ x)
        return float(np.linalg.norm(self.value + self.T @ x) - min(self.radius, room))

    def near(self) -> bool:
        """Returns whether the plan has nearly reached the boundary."""
        room = np.inf if self.room is None else np.min(self.room.size)
        return bool(np.linalg.norm(self.value) > (1.0 - NEAR) * min(self.radius, room))


@dataclass(frozen=True)
class StagedProgram:
    """The program; N stages, nx states, nw decisions."""

    A: np.ndarray
    """∂x_{k+1}/∂x_k (N, nx, nx)."""
    B: np.ndarray
    """∂x_{k+1}/∂w_k (N, nx, nw)."""
    H: np.ndarray
    """Hessians of the stage costs (N, nx+nw, nx+nw); semidefinite, and definite in w."""
    g: np.ndarray
    """Gradients of the stage costs (N, nx+nw)."""
    H_end: np.ndarray
    """Hessian of the cost of the end (nx, nx)."""
    g_end: np.ndarray
    """Gradient of the cost of the end (nx,)."""
    linear: LinearLimits
    norms: tuple[NormLimit, ...]
    terminal: TerminalLimit
    slack_penalty: float
    """Penalty ρ_s of the slack s."""
    excess_penalty: float
    """Penalty ρ_v of the excess v."""


class StagedSolution(NamedTuple):
    """The optimal change of the plan."""

    w: np.ndarray
    """Decisions w (N, nw)."""
    slack: float
    """Slack s of the terminal set."""
    excess: float
    """Excess v of the softened limits."""
    cone_programs: int
    """Number of conic programs solved; 0 where no limit mattered."""


class Regulator(NamedTuple):
    """w_k = K_k x_k + k_k + W_k r_k, in which the cost is a constant + ½ Σ ‖r_k‖²."""

    K: np.ndarray
    """Feedback gains K_k (N, nw, nx)."""
    k: np.ndarray
    """Feedforward k_k (N, nw)."""
    W: np.ndarray
    """Inverse factors L_k⁻ᵀ (N, nw, nw)."""


def solve_staged(program: StagedProgram) -> StagedSolution | None:
    """Returns the solution, or None if there is none: infeasible, ill-conditioned or not finite."""
    if not _is_finite(program):
        return None
    try:
        regulator = riccati(program)
    except np.linalg.LinAlgError:
        return None
    z = _rollout(program, regulator)
    active = _Limits.broken(program, z, 0.0)
    if not active.any():
        return StagedSolution(z[:-1, program.B.shape[1]:], 0.0, 0.0, 0)
    active |= _Limits.near(program)
    response = _responses(program, regulator)
    cone_programs = 0
    while True:
        found = _shortest(program, z, response, active)
        cone_programs += 1
        if found is None:
            return None
        r, slack, excess = found
        z_best = z + response @ r
        broken = _Limits.broken(program, z_best, excess).without(active)
        if not broken.any():
            return StagedSolution(
                z_best[:-1, program.B.shape[1]:], slack, excess, cone_programs)
        active |= broken


def _is_finite(program: StagedProgram) -> bool:
    """Returns whether no number is NaN, and none infinite that is no bound."""
    numbers = [program.A, program.B, program.H, program.g, program.H_end, program.g_end,
               program.linear.C, program.linear.value, program.terminal.T, program.terminal.value,
               *(limit.value for limit in program.norms)]
    return all(bool(np.all(np.isfinite(each))) for each in numbers)


def riccati(program: StagedProgram) -> Regulator:
    """Returns the optimal regulator of the program without its limits."""
    N, nx, nw = program.B.shape
    AB = np.concatenate([program.A, program.B], axis=2)
    S, s = program.H_end, program.g_end
    K, k, W = np.empty((N, nw, nx)), np.empty((N, nw)), np.empty((N, nw, nw))
    for i in range(N - 1, -1, -1):
        H = program.H[i] + AB[i].T @ S @ AB[i]
        g = program.g[i] + AB[i].T @ s
        root = np.linalg.inv(np.linalg.cholesky(H[nx:, nx:]))
        by_x, constant = root @ H[nx:, :nx], root @ g[nx:]
        K[i], k[i], W[i] = -root.T @ by_x, -root.T @ constant, root.T
        S = H[:nx, :nx] - by_x.T @ by_x
        s = g[:nx] - by_x.T @ constant
    return Regulator(K, k, W)


def _rollout(program: StagedProgram, regulator: Regulator) -> np.ndarray:
    """Returns z (N+1, nx+nw) for r = 0."""
    N, nx, nw = program.B.shape
    z = np.zeros((N + 1, nx + nw))
    for i in range(N):
        z[i, nx:] = regulator.K[i] @ z[i, :nx] + regulator.k[i]
        z[i + 1, :nx] = program.A[i] @ z[i, :nx] + program.B[i] @ z[i, nx:]
    return z


def _responses(program: StagedProgram, regulator: Regulator) -> np.ndarray:
    """Returns ∂z/∂r (N+1, nx+nw, N nw), r = (r_0, r_1, ...)."""
    N, nx, nw = program.B.shape
    Z = np.zeros((N + 1, nx + nw, N * nw))
    for i in range(N):
        past, now = slice(0, i * nw), slice(i * nw, (i + 1) * nw)
        Z[i, nx:, past] = regulator.K[i] @ Z[i, :nx, past]
        Z[i, nx:, now] = regulator.W[i]
        Z[i + 1, :nx, past] = program.A[i] @ Z[i, :nx, past] + program.B[i] @ Z[i, nx:, past]
        Z[i + 1, :nx, now] = program.B[i] @ regulator.W[i]
    return Z


@dataclass
class _Limits:
    """Some of the limits of a program."""

    upper: np.ndarray
    """Linear limits whose upper bound is among them (N+1, m)."""
    lower: np.ndarray
    """Linear limits whose lower bound is among them (N+1, m)."""
    norms: np.ndarray
    """Norm limits that are among them (number of norm limits, N+1)."""
    terminal: bool
    """Whether the terminal set is among them."""

    def any(self) -> bool:
        return bool(self.terminal or self.upper.any() or self.lower.any() or self.norms.any())

    def __or__(self, other: "_Limits") -> "_Limits":
        return _Limits(self.upper | other.upper, self.lower | other.lower,
                       self.norms | other.norms, self.terminal or other.terminal)

    def without(self, other: "_Limits") -> "_Limits":
        return _Limits(self.upper & ~other.upper, self.lower & ~other.lower,
                       self.norms & ~other.norms, self.terminal and not other.terminal)

    @staticmethod
    def broken(program: StagedProgram, z: np.ndarray, excess: float) -> "_Limits":
        """Returns the limits that z (N+1, nx+nw) breaks, soft ones by more than `excess`."""
        linear, terminal = program.linear, program.terminal
        value = linear.value + times(linear.C, z)
        room = KEPT + excess * linear.soft
        return _Limits(
            upper=value > linear.upper + room,
            lower=value < linear.lower - room,
            norms=np.array([np.linalg.norm(limit.value + z @ limit.C.T, axis=1)
                            > limit.bound + KEPT for limit in program.norms]),
            terminal=terminal.excess(z[-1, : terminal.T.shape[1]]) > KEPT)

    @staticmethod
    def near(program: StagedProgram) -> "_Limits":
        """Returns the limits that the plan itself has nearly reached."""
        linear, terminal = program.linear, program.terminal
        width = linear.upper - linear.lower
        margin = NEAR * np.where(np.isfinite(width), width, 0.0)
        return _Limits(
            upper=linear.upper - linear.value < margin,
            lower=linear.value - linear.lower < margin,
            norms=np.array([np.linalg.norm(limit.value, axis=1) > (1.0 - NEAR) * limit.bound
                            for limit in program.norms]),
            terminal=terminal.near())


def _shortest(program: StagedProgram, z: np.ndarray, response: np.ndarray, active: _Limits
              ) -> tuple[np.ndarray, float, float] | None:
    """Returns the r (N nw,) of least cost that keeps the `active` limits, with its s and v.

    r is a combination of the gradients of these limits, the rows of a matrix F. With a QR
    decomposition Fᵀ = basis · Gᵀ, r = basis · p, and the limits are rows of F r = G p: a small
    program with a lower triangular matrix.
    """
    linear, terminal = program.linear, program.terminal

    # Gradients and room of the linear limits, each as an upper bound.
    rows, room = [], []
    for sign, mask, bound in ((1.0, active.upper, linear.upper),
                              (-1.0, active.lower, -linear.lower)):
        stage, row = np.nonzero(mask)
        C = sign * linear.C[stage, row]
        rows.append((C[:, None, :] @ response[stage])[:, 0])
        room.append(bound[stage, row] - sign * linear.value[stage, row] - np.sum(C * z[stage], 1))
    soft = np.concatenate([linear.soft[np.nonzero(mask)[1]]
                           for mask in (active.upper, active.lower)])
    num_linear = len(soft)

    # Those of the norms, one block of rows each, and of the terminal set.
    cones = [(limit.value[k] + limit.C @ z[k], limit.bound[k], limit.C @ response[k])
             for limit, mask in zip(program.norms, active.norms, strict=True)
             for k in np.flatnonzero(mask)]
    rows += [cone_rows for *_, cone_rows in cones]
    nx = terminal.T.shape[1]
    if active.terminal:
        rows.append(terminal.T @ response[-1, :nx])
        if terminal.room is not None:
            rows.append(terminal.room.rows @ response[-1, :nx])
    basis, triangle = np.linalg.qr(np.concatenate(rows).T)
    G = np.ascontiguousarray(triangle.T)

    # minimise ½‖p‖² + ρ_s s + ρ_v v
    prog = MathematicalProgram()
    p = prog.NewContinuousVariables(G.shape[1], "p")
    s, v = prog.NewContinuousVariables(1, "s"), prog.NewContinuousVariables(1, "v")
    prog.AddQuadraticCost(np.eye(len(p)), np.zeros(len(p)), p, is_convex=True)
    prog.AddLinearCost([program.slack_penalty, program.excess_penalty], np.concatenate([s, v]))
    prog.AddBoundingBoxConstraint(0.0, np.inf, np.concatenate([s, v]))
    # linear: G p − v ≤ room, v in the soft rows only
    if num_linear:
        prog.AddLinearConstraint(
            np.hstack([G[:num_linear], -soft[:, None].astype(float)]),
            np.full(num_linear, -np.inf), np.concatenate(room), np.concatenate([p, v]))
    # norms: ‖value + G p‖ ≤ bound
    first = num_linear
    for value, bound, _ in cones:
        last = first + len(value)
        prog.AddLorentzConeConstraint(
            np.vstack([np.zeros((1, len(p))), G[first:last]]),
            np.concatenate([[bound], value]), p)
        first = last
    # terminal set: ‖value + G p‖ ≤ radius + s, and ≤ room + g p + s
    if active.terminal:
        last = first + len(terminal.T)
        A = np.zeros((1 + len(terminal.T), len(p) + 1))
        A[0, -1], A[1:, :-1] = 1.0, G[first:last]
        value = terminal.value + terminal.T @ z[-1, :nx]
        if terminal.room is None:
            prog.AddLorentzConeConstraint(
                A, np.concatenate([[terminal.radius], value]), np.concatenate([p, s]))
        else:  # ‖value + G p‖ ≤ t, and t is at most each of the bounds: one cone for all of them.
            t = prog.NewContinuousVariables(1, "t")
            prog.AddLorentzConeConstraint(
                A, np.concatenate([[0.0], value]), np.concatenate([p, t]))
            sizes = terminal.room.size + terminal.room.rows @ z[-1, :nx]
            most = np.append(sizes, terminal.radius)
            by_p = np.vstack([-G[last: last + len(sizes)], np.zeros((1, len(p)))])
            kept = np.isfinite(most)
            ones = np.ones((np.count_nonzero(kept), 1))
            prog.AddLinearConstraint(
                np.hstack([by_p[kept], ones, -ones]), np.full(len(ones), -np.inf), most[kept],
                np.concatenate([p, t, s]))

    result = ClarabelSolver().Solve(prog)
    if not result.is_success():
        return None
    r = basis @ result.GetSolution(p)
    if not np.all(np.isfinite(r)):
        return None
    return r, float(result.GetSolution(s)[0]), float(result.GetSolution(v)[0])
