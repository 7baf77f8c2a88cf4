"""Remainders of the law `tip first`, beyond the linear parts of (1) of `rows.image`."""

import numpy as np

from uvms_drake.control.laws.outputs import vehicle_motion
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.frames.euler import pose_difference
from uvms_drake.model.frames.spatial import times
from uvms_drake.model.uvms_model import Kinematics, configuration_rate_matrix
from uvms_drake.tube.resolved.remainders import jacobian_rate_times
from uvms_drake.tube.search.nominal_motion import NominalMotion

ITERATIONS = 6
"""Number of Newton's steps to the joint angles of outputs."""


def tip_first_remainders(model: ContactModel, rows: np.ndarray, nominal: NominalMotion,
                         nominal_u: np.ndarray, x: np.ndarray, x_dot: np.ndarray) -> np.ndarray:
    """Returns the remainders by errors of the outputs y = (η, s) (..., 4(6+n) − 3).

    The errors are e = (x_η, J_sq x_q) and ė = (x_η', J_sq x_q'), J_sq that of the real robot: those
    of s are in joint angles. In the order ζ − ζ̄; q − q̄ (n) and 𝔬 − 𝔬̄ of the end-effector; the
    remainders of u and of τ = Mu, u − ū − J_y⁻¹w and τ − τ̄ − MJ_y⁻¹w for the
    w = −(K + Σ)ė − KΣe of the law, J_y and M those of the real robot. Any argument may be complex,
    for a derivative.

    Args:
        model: The prediction model.
        rows: The tip's task in (χ, q) (n,).
        nominal: The nominal motion.
        nominal_u: ū (..., 6+n).
        x: (x_η, x_q) (..., 6+n).
        x_dot: (x_η', x_q') (..., 6+n).
    """
    # The nominal motion in y.
    config_bar, zeta_bar, at = nominal.config, nominal.zeta, nominal.kinematics
    J_bar = output_jacobian(model, config_bar, at, rows)
    y_dot = times(J_bar, zeta_bar)
    y_ddot = (times(J_bar, nominal_u + nominal.drift)
              + output_bias(config_bar, at, zeta_bar, rows))

    # The real state, and the acceleration of the law in it but for w.
    config = configuration_of(model, rows, config_bar, at, x)
    real = model.kinematics(config)
    J = output_jacobian(model, config, real, rows)
    inverse = np.linalg.inv(J)
    x_dot = np.broadcast_to(x_dot, config.shape)
    e_dot = np.concatenate([x_dot[..., :6], times(J[..., 6:, 6:], x_dot[..., 6:])], axis=-1)
    zeta = times(inverse, y_dot + e_dot)
    zeta_dot = times(inverse, y_ddot - output_bias(config, real, zeta, rows))
    f, M = model.drift_and_inertia(real, zeta)
    u_remainder = zeta_dot - f - nominal_u
    turned = pose_difference(real.chi, at.chi + 0.0 * real.chi)[..., 3:]
    return np.concatenate([
        zeta - zeta_bar, config[..., 6:] - config_bar[..., 6:], turned, u_remainder,
        times(M, u_remainder + nominal_u) - times(nominal.M, nominal_u)], axis=-1)


def output_jacobian(model: ContactModel, config: np.ndarray, kinematics: Kinematics,
                    rows: np.ndarray) -> np.ndarray:
    """Returns J_y (..., 6+n, 6+n), ẏ = J_y ζ."""
    J_eta = configuration_rate_matrix(config)[..., :6, :]
    return np.concatenate([J_eta, model.extended(kinematics.J_chi)[..., rows, :]], axis=-2)


def output_bias(config: np.ndarray, kinematics: Kinematics, zeta: np.ndarray, rows: np.ndarray
                ) -> np.ndarray:
    """Returns J̇_y ζ (..., 6+n)."""
    return np.concatenate([vehicle_motion(config, zeta)[2],
                           jacobian_rate_times(kinematics, zeta, zeta)[..., rows]], axis=-1)


def configuration_of(model: ContactModel, rows: np.ndarray, nominal_config: np.ndarray,
                     nominal: Kinematics, x: np.ndarray) -> np.ndarray:
    """Returns 𝔮 (..., 6+n) with the outputs ȳ + (x_η, J_sq(𝔮)x_q), by Newton's method from q̄."""
    s_bar = np.concatenate([nominal.chi, nominal_config[..., 6:]], axis=-1)[..., rows]
    config = nominal_config + 0.0 * x
    config[..., :6] += x[..., :6]
    for _ in range(ITERATIONS):
        kinematics = model.tip_kinematics(config)
        y = np.concatenate([kinematics.chi, config[..., 6:]], axis=-1)
        whole = y + 0.0
        whole[..., rows] = s_bar
        missing = pose_difference(whole, y)[..., rows]
        J_sq = model.extended(kinematics.J_chi)[..., rows, :][..., 6:]
        config[..., 6:] += np.linalg.solve(J_sq, missing[..., None])[..., 0] + x[..., 6:]
    return config
