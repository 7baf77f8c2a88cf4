"""Optimal regulator of a staged program without its limits, and the response of its motion."""

from typing import NamedTuple

import numpy as np

from uvms_drake.control.convex.staged_program import StagedProgram


class Regulator(NamedTuple):
    """Regulator w_k = K_k x_k + k_k + W_k r_k, with the cost a constant + ½ Σ ‖r_k‖²."""

    K: np.ndarray
    """Feedback gains K_k (N, nw, nx)."""
    k: np.ndarray
    """Feedforward k_k (N, nw)."""
    W: np.ndarray
    """Inverse factors L_k⁻ᵀ (N, nw, nw)."""


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


def motion(program: StagedProgram, regulator: Regulator, r: np.ndarray | float = 0.0
           ) -> np.ndarray:
    """Returns z (N+1, nx+nw) for some r (N, nw)."""
    N, nx, nw = program.B.shape
    z = np.zeros((N + 1, nx + nw))
    free = regulator.k + (regulator.W @ np.broadcast_to(r, (N, nw))[..., None])[..., 0]
    for i in range(N):
        z[i, nx:] = regulator.K[i] @ z[i, :nx] + free[i]
        z[i + 1, :nx] = program.A[i] @ z[i, :nx] + program.B[i] @ z[i, nx:]
    return z


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
