"""Optimal regulator of a staged program without its limits, and the response of its motion."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from uvms_drake.control.convex.staged_program import StagedProgram
from uvms_drake.model.frames.spatial import times


@dataclass(frozen=True)
class Regulator:
    """Regulator w_k = K_k x_k + k_k + W_k r_k, with the cost a constant + ½ Σ ‖r_k‖²."""

    K: np.ndarray
    """Feedback gains K_k (N, nw, nx)."""
    k: np.ndarray
    """Feedforward k_k (N, nw)."""
    W: np.ndarray
    """Factors L_k⁻ᵀ of the inverse Hessians by w, L_k L_kᵀ = ∂²/∂w_k² (N, nw, nw)."""
    closed: np.ndarray
    """Closed loop A_k + B_k K_k (N, nx, nx)."""
    driven: np.ndarray
    """Derivatives B_k W_k of x_{k+1} by r_k (N, nx, nw)."""

    @cached_property
    def responses(self) -> np.ndarray:
        """Responses ∂z/∂r (N+1, nx+nw, N nw), r = (r_0, r_1, ...); z_k has none to a later r.

        A solver asks for the motion and for gradients of rows many times, each a product with it.
        """
        N, nx, nw = self.driven.shape
        Z = np.zeros(((N + 1) * (nx + nw), N * nw))
        # Rows of w_k and x_{k+1}, which follow those of x_k.
        by_x = np.concatenate([self.K, self.closed], axis=1)
        by_r = np.concatenate([self.W, self.driven], axis=1)
        for k in range(N):
            x, past = k * (nx + nw), k * nw
            after = Z[x + nx: x + nx + nw + nx]
            after[:, :past] = by_x[k] @ Z[x: x + nx, :past]
            after[:, past: past + nw] = by_r[k]
        return Z.reshape(N + 1, nx + nw, N * nw)

    def moved(self, r: np.ndarray) -> np.ndarray:
        """Returns the change of z (N+1, nx+nw) by r (N, nw)."""
        stages, width, size = self.responses.shape
        return (self.responses.reshape(stages * width, size) @ r.ravel()).reshape(stages, width)

    def row_gradients(self, stages: np.ndarray, C: np.ndarray) -> np.ndarray:
        """Returns the gradients (m, N nw) by r of values C_i z of one stage each.

        Args:
            stages: Stage of each row (m,).
            C: Rows (m, nx+nw); w is zero at the last stage.
        """
        order = np.argsort(stages, kind="stable")
        ordered, out = C[order], np.empty((len(C), self.responses.shape[-1]))
        begin, by_stage = 0, np.empty_like(out)
        for k, end in enumerate(np.cumsum(np.bincount(stages)).tolist()):
            if end > begin:
                np.matmul(ordered[begin:end], self.responses[k], out=by_stage[begin:end])
                begin = end
        out[order] = by_stage
        return out


def riccati(program: StagedProgram) -> Regulator:
    """Returns the optimal regulator of the program without its limits."""
    N, nx, nw = program.B.shape
    # Homogeneous coordinates (w, x, 1) have Hessian and gradient in one matrix.
    AB, H = np.zeros((N, nx + 1, nw + nx + 1)), np.zeros((N, nw + nx + 1, nw + nx + 1))
    AB[:, :nx, :nw], AB[:, :nx, nw:-1], AB[:, nx, -1] = program.B, program.A, 1.0
    parts = (slice(nw), slice(nx, None)), (slice(nw, -1), slice(nx))
    for rows, own in parts:
        H[:, rows, -1] = H[:, -1, rows] = program.g[:, own]
        for columns, others in parts:
            H[:, rows, columns] = program.H[:, own, others]
    S = np.zeros((nx + 1, nx + 1))
    S[:nx, :nx], S[:nx, nx], S[nx, :nx] = program.H_end, program.g_end, program.g_end
    by_w, by_rest = np.empty((N, nw, nw)), np.empty((N, nw, nx + 1))
    for i in range(N - 1, -1, -1):
        step = AB[i]
        total = H[i] + step.T @ (S @ step)
        by_w[i] = total[:nw, :nw]
        by_rest[i] = by = np.linalg.inv(by_w[i]) @ total[:nw, nw:]
        S = total[nw:, nw:] - total[nw:, :nw] @ by
    W = np.linalg.inv(np.linalg.cholesky(by_w)).swapaxes(1, 2)
    law = -by_rest
    K = law[..., :nx]
    return Regulator(K, law[..., nx], W, program.A + program.B @ K, program.B @ W)


def motion(program: StagedProgram, regulator: Regulator) -> np.ndarray:
    """Returns z (N+1, nx+nw) for r = 0."""
    N, nx, nw = program.B.shape
    z = np.zeros((N + 1, nx + nw))
    x = np.zeros(nx)
    for i, (closed, constant) in enumerate(zip(
            regulator.closed, times(program.B, regulator.k), strict=True)):
        z[i + 1, :nx] = x = closed @ x + constant
    z[:-1, nx:] = times(regulator.K, z[:-1, :nx]) + regulator.k
    return z
