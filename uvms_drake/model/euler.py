"""Attitude by ZYX Euler angles (φ, θ, ψ): R = R_z(ψ) R_y(θ) R_x(φ), as in SNAME.

Every function takes stacks of any leading shape, and complex numbers, so that a derivative can
be taken by a complex step (Squire and Trapp, 1998: f'(x) = Im f(x + ih)/h, exact to rounding).
Matrices are filled by column in their transpose, where a component of a whole stack is one item.
"""

import numpy as np

COMPLEX_STEP = 1e-30
"""Step h of a complex-step derivative: nothing is subtracted, so it can be arbitrarily small."""


def rotation_matrix(rpy: np.ndarray) -> np.ndarray:
    """Returns R_AB (..., 3, 3) of frame B with ZYX Euler angles `rpy` (..., 3) [rad] in A."""
    sin, cos = np.sin(rpy), np.cos(rpy)
    (sf, st, sp), (cf, ct, cp) = sin.T, cos.T
    R = np.empty((*rpy.shape, 3), dtype=sin.dtype)
    columns = R.T
    columns[0, 0] = cp * ct
    columns[0, 1] = sp * ct
    columns[0, 2] = -st
    columns[1, 0] = cp * st * sf - sp * cf
    columns[1, 1] = sp * st * sf + cp * cf
    columns[1, 2] = ct * sf
    columns[2, 0] = cp * st * cf + sp * sf
    columns[2, 1] = sp * st * cf - cp * sf
    columns[2, 2] = ct * cf
    return R


def euler_angles(R: np.ndarray) -> np.ndarray:
    """Returns the ZYX Euler angles (..., 3) of R (..., 3, 3), with |θ| ≤ π/2 and φ, ψ ∈ (−π, π]."""
    pitch = np.arctan2(
        -R[..., 2, 0].real, np.hypot(R[..., 2, 1].real, R[..., 2, 2].real))
    if np.iscomplexobj(R):
        # d asin(s) = ds/cos θ carries the imaginary part.
        pitch = pitch - 1j * R[..., 2, 0].imag / np.cos(pitch)
    rpy = np.empty(R.shape[:-1], dtype=R.dtype)
    rpy[..., 0] = _atan2(R[..., 2, 1], R[..., 2, 2])
    rpy[..., 1] = pitch
    rpy[..., 2] = _atan2(R[..., 1, 0], R[..., 0, 0])
    return rpy


def _atan2(y: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Returns atan2, with the first-order imaginary part for complex arguments."""
    angle = np.arctan2(y.real, x.real)
    if np.iscomplexobj(y):
        return angle + 1j * (x.real * y.imag - y.real * x.imag) / (x.real**2 + y.real**2)
    return angle


def rate_matrix(rpy: np.ndarray) -> np.ndarray:
    """Returns T (..., 3, 3) with d(φ, θ, ψ)/dt = T(φ, θ) ω_B, ω in the rotating frame.

    It is the paper's 𝔍₂ (Fossen 2021, eq. 2.40); singular at |θ| = π/2.
    """
    (sf, st, _), (cf, ct, _) = np.sin(rpy).T, np.cos(rpy).T
    T = np.zeros((*rpy.shape, 3), dtype=rpy.dtype)
    columns = T.T
    columns[0, 0] = 1.0
    columns[1, 0] = sf * st / ct
    columns[1, 1] = cf
    columns[1, 2] = sf / ct
    columns[2, 0] = cf * st / ct
    columns[2, 1] = -sf
    columns[2, 2] = cf / ct
    return T


def inverse_rate_matrix(rpy: np.ndarray) -> np.ndarray:
    """Returns T⁻¹ (..., 3, 3) with ω_B = T⁻¹ d(φ, θ, ψ)/dt; it exists at every attitude."""
    (sf, st, _), (cf, ct, _) = np.sin(rpy).T, np.cos(rpy).T
    E = np.zeros((*rpy.shape, 3), dtype=rpy.dtype)
    columns = E.T
    columns[0, 0] = 1.0
    columns[1, 1] = cf
    columns[1, 2] = -sf
    columns[2, 0] = -st
    columns[2, 1] = sf * ct
    columns[2, 2] = cf * ct
    return E


def wrap_angle(angle: np.ndarray) -> np.ndarray:
    """Returns the angle plus a multiple of 2π, its real part in [−π, π)."""
    wrapped = (angle.real + np.pi) % (2.0 * np.pi) - np.pi
    return wrapped + 1j * angle.imag if np.iscomplexobj(angle) else wrapped


def pose_difference(y: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Returns y − y' (..., m), the Euler angles by the shorter way round.

    Args:
        y: Position, Euler angles and whatever follows, such as joint angles (..., m).
        other: y' (..., m).
    """
    difference = y - other
    difference[..., 3:6] = wrap_angle(difference[..., 3:6])
    return difference
