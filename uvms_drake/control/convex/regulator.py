"""Optimal regulator of a staged program without its limits, and the response of its motion."""

from typing import NamedTuple

import numpy as np

from uvms_drake.control.convex.staged_program import StagedProgram
from uvms_drake.model.frames.spatial import times


class Regulator(NamedTuple):
    """Regulator w_k = K_k x_k + k_k + W_k r_k, with the cost a constant + ½ Σ ‖r_k‖²."""

    K: np.ndarray
    """Feedback gains K_k (N, nw, nx)."""
    k: np.ndarray
    """Feedforward k_k (N, nw)."""
    W: np.ndarray
    """Inverse factors L_k⁻ᵀ (N, nw, nw)."""
    closed: np.ndarray
    """Closed loop A_k + B_k K_k (N, nx, nx)."""


def riccati(program: StagedProgram) -> Regulator:
    """Returns the optimal regulator of the program without its limits."""
    N, nx, nw = program.B.shape
    # Homogeneous coordinates (x, 1, w) have Hessian and gradient in one matrix.
    AB, H = np.zeros((N, nx + 1, nx + 1 + nw)), np.zeros((N, nx + 1 + nw, nx + 1 + nw))
    AB[:, :nx, :nx], AB[:, :nx, nx + 1:], AB[:, nx, nx] = program.A, program.B, 1.0
    index = np.r_[:nx, nx + 1: nx + 1 + nw]
    H[:, index[:, None], index], H[:, nx, index], H[:, index, nx] = program.H, program.g, program.g
    S = np.zeros((nx + 1, nx + 1))
    S[:nx, :nx], S[:nx, nx], S[nx, :nx] = program.H_end, program.g_end, program.g_end
    roots, rows = np.empty((N, nw, nw)), np.empty((N, nw, nx + 1))
    for i in range(N - 1, -1, -1):
        total = H[i] + AB[i].T @ (S @ AB[i])
        roots[i] = root = np.linalg.inv(np.linalg.cholesky(total[nx + 1:, nx + 1:]))
        rows[i] = by = root @ total[nx + 1:, : nx + 1]
        S = total[: nx + 1, : nx + 1] - by.T @ by
    W = roots.swapaxes(1, 2)
    law = -(W @ rows)
    K = law[..., :nx]
    return Regulator(K, law[..., nx], W, program.A + program.B @ K)


def motion(program: StagedProgram, regulator: Regulator, r: np.ndarray | float = 0.0
           ) -> np.ndarray:
    """Returns z (N+1, nx+nw) for some r (N, nw)."""
    N, nx, nw = program.B.shape
    z = np.zeros((N + 1, nx + nw))
    free = regulator.k + times(regulator.W, np.broadcast_to(r, (N, nw)))
    x = np.zeros(nx)
    for i, (closed, constant) in enumerate(zip(
            regulator.closed, times(program.B, free), strict=True)):
        z[i + 1, :nx] = x = closed @ x + constant
    z[:-1, nx:] = times(regulator.K, z[:-1, :nx]) + free
    return z


def row_gradients(program: StagedProgram, regulator: Regulator, stages: np.ndarray, C: np.ndarray
                  ) -> np.ndarray:
    """Returns the gradients (m, N nw) by r of values C_i z of one stage each.

    By the adjoint recursion: the gradients by x of all rows go back stage by stage.

    Args:
        program: The program.
        regulator: Its regulator.
        stages: Stage of each row (m,).
        C: Rows (m, nx+nw); w is zero at the last stage.
    """
    N, nx, nw = program.B.shape
    order = np.argsort(-stages, kind="stable")
    by_x, by_w, stages = C[order, :nx], C[order, nx:], stages[order]
    inner = np.flatnonzero(stages < N)
    at = stages[inner]
    by_x[inner] += (by_w[inner, None] @ regulator.K[at])[:, 0]
    out = np.zeros((len(C), N, nw))
    out[inner, at] = (by_w[inner, None] @ regulator.W[at])[:, 0]
    # Rows of later stages come first: those before `reach[k]` are of stages after k.
    reach = np.searchsorted(-stages, -np.arange(N))
    response = program.B @ regulator.W
    for k in range(N - 1, -1, -1):
        later = by_x[: reach[k]]
        out[: reach[k], k] = later @ response[k]
        by_x[: reach[k]] = later @ regulator.closed[k]
    ordered = np.empty_like(out)
    ordered[order] = out
    return ordered.reshape(len(C), N * nw)


def responses(program: StagedProgram, regulator: Regulator) -> np.ndarray:
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
