"""The end-effector Σ_E: map between spatial vectors in its axes and the paper's χ = (𝔭, 𝔬).

χ̇ = A(𝔬) V_E with A = blkdiag(R_WE, T(𝔬)); the force 𝔉 on the surface, conjugate to χ̇, is Aᵀ𝔉 in
axes of Σ_E.
"""

import math

import numpy as np

from uvms_drake.model.frames.euler import COMPLEX_STEP, FEW, rate_matrix, rotated, rotated_back
from uvms_drake.model.frames.spatial import block_diagonal, skew, times
from uvms_drake.model.surface.law import Surface


def pose_rate_matrix(R_WE: np.ndarray, attitude: np.ndarray) -> np.ndarray:
    """Returns A (..., 6, 6) at an attitude, given as a matrix and as Euler angles."""
    return block_diagonal(R_WE, rate_matrix(attitude))


def force_in_tip(chi: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Returns Aᵀ𝔉 (6,) at one pose χ (6,), in plain numbers: Rᵀf and Tᵀn of 𝔉 = (f, n).

    f is in the axes of the Euler angles of χ.
    """
    rpy, (*f, a, b, c) = chi[3:].tolist(), force.tolist()
    sin, cos, scale = math.sin(rpy[0]), math.cos(rpy[0]), 1.0 / math.cos(rpy[1])
    c = scale * (math.sin(rpy[1]) * a + c)
    return np.array([*rotated_back(rpy, f), a, sin * c + cos * b, cos * c - sin * b])


def force_of_tip(chi: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Returns A⁻ᵀF (6,) at one pose χ (6,): the 𝔉 of which `force_in_tip` is F (6,)."""
    rpy, (*f, a, b, c) = chi[3:].tolist(), force.tolist()
    sin, cos = math.sin(rpy[0]), math.cos(rpy[0])
    b, c = cos * b - sin * c, sin * b + cos * c
    return np.array([*rotated(rpy, f), a, b, math.cos(rpy[1]) * c - math.sin(rpy[1]) * a])


def pose_rate_matrix_rate(A: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """Returns Ȧ (..., 6, 6) as Σ_E turns by ω (..., 3) in its own axes.

    Ṙ = R S(ω), and the derivatives of T(φ, θ) follow from its entries. With columns t₂, t₃ of T,
    ∂T/∂φ = (0, t₃, −t₂). With its rows T₁ and T₃ without their first entries, which are constant,
    ∂T/∂θ has the rows T₃/cos θ, 0, T₁/cos θ there, and ‖T₃‖ = 1/cos θ.
    """
    R, T = A[..., :3, :3], A[..., 3:, 3:]
    out = np.zeros(A.shape, dtype=np.result_type(A, omega))
    out[..., :3, :3] = R @ skew(omega)
    if omega.size <= FEW and out.dtype.kind == "f":
        out[..., 3:, 3:] = np.array([_rates_rate(rows, turning) for rows, turning in zip(
            T.reshape(-1, 3, 3).tolist(), omega.reshape(-1, 3).tolist(), strict=True)]
            ).reshape(T.shape)
        return out
    rates = times(T, omega)[..., None, None]
    roll, pitch = rates[..., 0, :, :], rates[..., 1, :, :]
    out[..., 3:, 4:5] = roll * T[..., :, 2:]
    out[..., 3:, 5:] = -roll * T[..., :, 1:2]
    out[..., 3::2, 4:] += pitch * np.sqrt(T[..., 2:, 1:2]**2 + T[..., 2:, 2:]**2) * T[..., ::-2, 1:]
    return out


def _rates_rate(T: list[list[float]], omega: list[float]) -> list[list[float]]:
    """Returns Ṫ of one attitude by plain numbers, see `pose_rate_matrix_rate`."""
    (_, a, b), (_, c, d), (_, e, f) = T
    roll, turn = omega[0] + a * omega[1] + b * omega[2], c * omega[1] + d * omega[2]
    turn *= math.hypot(e, f)
    return [[0.0, roll * b + turn * e, turn * f - roll * a], [0.0, roll * d, -roll * c],
            [0.0, roll * f + turn * a, turn * b - roll * e]]


def complex_step(chi: np.ndarray, A: np.ndarray, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns χ and A after a complex step along a motion s (..., 6) in axes of Σ_E."""
    step = 1j * COMPLEX_STEP
    moved = chi + step * times(A, s)
    R_WE = A[..., :3, :3] @ (np.eye(3) + step * skew(s[..., 3:]))
    return moved, pose_rate_matrix(R_WE, moved[..., 3:])


def tip_force(surface: Surface, chi: np.ndarray, A: np.ndarray, V_E: np.ndarray) -> np.ndarray:
    """Returns Aᵀ𝔉(χ, A V_E) (..., 6), the force on the surface in axes of Σ_E."""
    force = surface.force(chi, times(A, V_E))
    return (force[..., None, :] @ A)[..., 0, :]


def tip_force_gradients(surface: Surface, chi: np.ndarray, A: np.ndarray, V_E: np.ndarray
                        ) -> tuple[np.ndarray, np.ndarray]:
    """Returns the derivatives (..., 6, 6) of `tip_force` by V_E and along motions, all real.

    A motion s, in axes of Σ_E, moves χ by A s and leaves V_E as it is.
    """
    chi, A, V_E = np.repeat(chi[..., None, :], 6, -2), A[..., None, :, :], V_E[..., None, :]
    rows = (tip_force(surface, chi, A, V_E + 1j * COMPLEX_STEP * np.eye(6)),
            tip_force(surface, *complex_step(chi, A, np.eye(6)), V_E))
    by_velocity, by_motion = (row.imag.swapaxes(-1, -2) / COMPLEX_STEP for row in rows)
    return by_velocity, by_motion
