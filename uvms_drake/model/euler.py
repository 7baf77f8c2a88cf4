"""Attitude by ZYX Euler angles (φ, θ, ψ): R = R_z(ψ) R_y(θ) R_x(φ), as in SNAME.

Every function takes stacks of any leading shape, and complex numbers, so that a derivative can
be taken by a complex step (Squire and Trapp, 1998: f'(x) = Im f(x + ih)/h, exact to rounding).
"""

import numpy as np


def rotation_matrix(rpy: np.ndarray) -> np.ndarray:
    """Returns R_AB (..., 3, 3) of frame B with ZYX Euler angles `rpy` (..., 3) [rad] in A."""
    sin, cos = np.sin(rpy), np.cos(rpy)
    sf, st, sp = sin[..., 0], sin[..., 1], sin[..., 2]
    cf, ct, cp = cos[..., 0], cos[..., 1], cos[..., 2]
    R = np.empty((*rpy.shape, 3), dtype=sin.dtype)
    R[..., 0, 0] = cp * ct
    R[..., 0, 1] = cp * st * sf - sp * cf
    R[..., 0, 2] = cp * st * cf + sp * sf
    R[..., 1, 0] = sp * ct
    R[..., 1, 1] = sp * st * sf + cp * cf
    R[..., 1, 2] = sp * st * cf - cp * sf
    R[..., 2, 0] = -st
    R[..., 2, 1] = ct * sf
    R[..., 2, 2] = ct * cf
    return R


def euler_angles(R: np.ndarray) -> np.ndarray:
    """Returns the ZYX Euler angles (..., 3) of R (..., 3, 3), with |θ| ≤ π/2 and φ, ψ ∈ (−π, π]."""
    pitch = np.arctan2(
        -R[..., 2, 0].real, np.hypot(R[..., 2, 1].real, R[..., 2, 2].real))
    if np.iscomplexobj(R):
        # d asin(s) = ds/cos θ carries the imaginary part.
        pitch = pitch - 1j * R[..., 2, 0].imag / np.cos(pitch)
    return np.stack(
        [_atan2(R[..., 2, 1], R[..., 2, 2]), pitch, _atan2(R[..., 1, 0], R[..., 0, 0])], axis=-1)


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
    sf, cf = np.sin(rpy[..., 0]), np.cos(rpy[..., 0])
    ct, tt = np.cos(rpy[..., 1]), np.tan(rpy[..., 1])
    T = np.zeros((*rpy.shape, 3), dtype=sf.dtype)
    T[..., 0, 0] = 1.0
    T[..., 0, 1] = sf * tt
    T[..., 0, 2] = cf * tt
    T[..., 1, 1] = cf
    T[..., 1, 2] = -sf
    T[..., 2, 1] = sf / ct
    T[..., 2, 2] = cf / ct
    return T


def wrap_angle(angle: np.ndarray) -> np.ndarray:
    """Returns the angle plus a multiple of 2π, in [−π, π)."""
    return (angle + np.pi) % (2.0 * np.pi) - np.pi
