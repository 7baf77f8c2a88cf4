"""Attitude by ZYX Euler angles (φ, θ, ψ): R = R_z(ψ) R_y(θ) R_x(φ), as in SNAME.

Every function takes stacks of any leading shape, and complex numbers, so that a derivative can
be taken by a complex step (Squire and Trapp, 1998: f'(x) = Im f(x + ih)/h, exact to rounding).
Matrices are filled by column in their transpose, where a component of a whole stack is one item.
Only `rotated` and `rotated_back` take one attitude, as plain numbers, which is faster for three.
"""

import math
from collections.abc import Sequence

import numpy as np

COMPLEX_STEP = 1e-30
"""Step h of a complex-step derivative: nothing is subtracted, so it can be arbitrarily small."""
WORLD = np.zeros(3)
"""Euler angles of Σ_I itself."""
FEW = 6
"""Number of angles up to which plain numbers are faster than arrays."""


def rotation_matrix(rpy: np.ndarray) -> np.ndarray:
    """Returns R_AB (..., 3, 3) of frame B with ZYX Euler angles `rpy` (..., 3) [rad] in A."""
    if rpy.size <= FEW and rpy.dtype.kind == "f":
        return np.array([_rotation(*each) for each in rpy.reshape(-1, 3).tolist()]
                        ).reshape(*rpy.shape, 3)
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


def _rotation(roll: float, pitch: float, yaw: float) -> list[list[float]]:
    """Returns `rotation_matrix` of one attitude by plain numbers, three times as fast."""
    sf, cf, st, ct = math.sin(roll), math.cos(roll), math.sin(pitch), math.cos(pitch)
    sp, cp = math.sin(yaw), math.cos(yaw)
    return [[cp * ct, cp * st * sf - sp * cf, cp * st * cf + sp * sf],
            [sp * ct, sp * st * sf + cp * cf, sp * st * cf - cp * sf],
            [-st, ct * sf, ct * cf]]


Numbers = tuple[float, float, float]


def rotated(rpy: Sequence[float], v: Sequence[float]) -> Numbers:
    """Returns R v of one attitude, axis after axis."""
    (sf, st, sp), (cf, ct, cp) = map(math.sin, rpy), map(math.cos, rpy)
    x, y, z = v[0], cf * v[1] - sf * v[2], sf * v[1] + cf * v[2]
    x, z = ct * x + st * z, ct * z - st * x
    return cp * x - sp * y, sp * x + cp * y, z


def rotated_back(rpy: Sequence[float], v: Sequence[float]) -> Numbers:
    """Returns Rᵀ v of one attitude, axis after axis."""
    (sf, st, sp), (cf, ct, cp) = map(math.sin, rpy), map(math.cos, rpy)
    x, y, z = cp * v[0] + sp * v[1], cp * v[1] - sp * v[0], v[2]
    x, z = ct * x - st * z, ct * z + st * x
    return x, cf * y + sf * z, cf * z - sf * y


def euler_angles(R: np.ndarray) -> np.ndarray:
    """Returns the ZYX Euler angles (..., 3) of R (..., 3, 3), with |θ| ≤ π/2 and φ, ψ ∈ (−π, π]."""
    if R.size <= 3 * FEW and R.dtype.kind == "f":
        return np.array([
            (math.atan2(zy, zz), math.atan2(-zx, math.hypot(zy, zz)), math.atan2(yx, xx))
            for xx, _, _, yx, _, _, zx, zy, zz in R.reshape(-1, 9).tolist()]).reshape(R.shape[:-1])
    xx, yx, zx, zy, zz = (R[..., row, column] for row, column in (
        (0, 0), (1, 0), (2, 0), (2, 1), (2, 2)))
    rpy = np.empty(R.shape[:-1], dtype=R.dtype)
    rpy[..., 0] = np.arctan2(zy.real, zz.real)
    rpy[..., 1] = np.arctan2(-zx.real, np.hypot(zy.real, zz.real))
    rpy[..., 2] = np.arctan2(yx.real, xx.real)
    if rpy.dtype.kind == "c":  # To first order; d asin(s) = ds/cos θ.
        rpy[..., 0] += _turned(zy, zz)
        rpy[..., 1] -= 1j * zx.imag / np.cos(rpy[..., 1])
        rpy[..., 2] += _turned(yx, xx)
    return rpy


def _turned(y: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Returns the imaginary part of atan2(y, x), times i."""
    return 1j * (x.real * y.imag - y.real * x.imag) / (x.real**2 + y.real**2)


def rate_matrix(rpy: np.ndarray) -> np.ndarray:
    """Returns T (..., 3, 3) with d(φ, θ, ψ)/dt = T(φ, θ) ω_B, ω in the rotating frame.

    It is the paper's 𝔍₂ (Fossen 2021, eq. 2.40); singular at |θ| = π/2.
    """
    if rpy.size <= FEW and rpy.dtype.kind == "f":
        return np.array([_rates(*each) for each in rpy.reshape(-1, 3).tolist()]
                        ).reshape(*rpy.shape, 3)
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


def _rates(roll: float, pitch: float, _: float) -> list[list[float]]:
    """Returns `rate_matrix` of one attitude by plain numbers."""
    sf, cf, st, ct = math.sin(roll), math.cos(roll), math.sin(pitch), math.cos(pitch)
    return [[1.0, sf * st / ct, cf * st / ct], [0.0, cf, -sf], [0.0, sf / ct, cf / ct]]


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
        y: Position, Euler angles and further coordinates, such as joint angles (..., m).
        other: y' (..., m).
    """
    difference = y - other
    if difference.ndim == 1 and difference.dtype.kind == "f":
        difference[3:6] = [math.remainder(x, math.tau) for x in difference[3:6].tolist()]
        return difference
    difference[..., 3:6] = wrap_angle(difference[..., 3:6])
    return difference
