"""Outputs y = (η, s) of a pair of motions: the vehicle's pose, rows of the extended task."""

import numpy as np

from uvms_drake.control.laws.law import Outputs, Pair
from uvms_drake.model.frames.euler import pose_difference
from uvms_drake.model.frames.spatial import cross, times
from uvms_drake.model.uvms_model import configuration_rate_matrix

ROLL, PITCH = 3, 4
"""Indices of φ and θ in 𝔮, and of their rates in η̇."""


def outputs_of(now: Pair, rows: np.ndarray) -> Outputs:
    """Returns the outputs of a pair of motions; `rows` (n,) are the tip's in (χ, q)."""
    error = pose_difference(*now.config)[:6], pose_difference(*now.y)[rows]
    return Outputs(np.concatenate(error), *output_motion(
        now.config, now.zeta, now.J_x, now.J_x_dot, rows))


def output_motion(config: np.ndarray, zeta: np.ndarray, J_x: np.ndarray, J_x_dot: np.ndarray,
                  rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns ẏ (..., 6+n), J_y (..., 6+n, 6+n) and J̇_y ζ (..., 6+n).

    Args:
        config: 𝔮 (..., 6+n).
        zeta: ζ (..., 6+n).
        J_x: J_x(𝔮) (..., 6+n, 6+n).
        J_x_dot: Rate of J_x (..., 6+n, 6+n).
        rows: The tip's rows in (χ, q) (n,).
    """
    rate, J, bias = vehicle_motion(config, zeta)
    J_s = J_x[..., rows, :]
    return (np.concatenate([rate, times(J_s, zeta)], axis=-1),
            np.concatenate([J, J_s], axis=-2),
            np.concatenate([bias, times(J_x_dot[..., rows, :], zeta)], axis=-1))


def vehicle_motion(config: np.ndarray, zeta: np.ndarray
                   ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns η̇ (..., 6), J_η (..., 6, 6+n) with η̇ = J_η ζ, and J̇_η ζ (..., 6).

    Real or complex. With η̇ = (Rν₁, Tν₂), J̇_η ζ = (R(ν₂ × ν₁), Ṫν₂).
    """
    Gamma = configuration_rate_matrix(config)[..., :6, :]
    rate, nu1, nu2 = times(Gamma, zeta), zeta[..., :3], zeta[..., 3:6]
    sin, cos = np.sin(config[..., 3:6]), np.cos(config[..., 3:6])
    sin_phi, cos_phi = sin[..., 0], cos[..., 0]
    tan, sec = np.tan(config[..., PITCH]), 1.0 / cos[..., 1]
    roll_rate, pitch_rate = rate[..., ROLL], rate[..., PITCH]
    across = cos_phi * nu2[..., 1] - sin_phi * nu2[..., 2]  # θ̇
    about = sin_phi * nu2[..., 1] + cos_phi * nu2[..., 2]  # ψ̇ cos θ
    turned = times(Gamma[..., :3, :3], cross(nu2, nu1))
    bias = np.stack([
        tan * across * roll_rate + about * sec**2 * pitch_rate, -about * roll_rate,
        sec * across * roll_rate + about * sec * tan * pitch_rate], axis=-1)
    return rate, Gamma, np.concatenate([turned, bias], axis=-1)
