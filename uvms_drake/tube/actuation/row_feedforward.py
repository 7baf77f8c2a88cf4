"""Feedforward part of the rows of `tip first`, at stacks of states.

The rows are η̈ = Aτ_v − h_v + δ_v and s̈ = Bτ_q − h_s + δ_s, see `tube.loops.row_loop`; the sources
`feed_forward`, f = ÿ̄ + h, and c are bounded by A, B, h_v and h_s.
"""

from typing import NamedTuple

import numpy as np

from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.frames.spatial import times
from uvms_drake.tube.rows.remainders import output_bias, output_jacobian


class RowFeedforward(NamedTuple):
    """Maps and feedforward of the rows at stacks of states."""

    vehicle_map: np.ndarray
    """A = J_ηv M*⁻¹ (..., 6, 6), M* = M_vv − M_vq J_sq⁻¹J_sv."""
    vehicle: np.ndarray
    """h_v = Aβ − J̇_ηv ν (..., 6), β = b_v + (Jᵀ𝔉)_v + M_vq J_sq⁻¹(v_s − J̇_sζ)."""
    tip_map: np.ndarray
    """B = J_s M⁻¹[0; 1] (..., n, n)."""
    tip: np.ndarray
    """h_s = −J_s M⁻¹((τ_v, 0) − b − Jᵀ𝔉) − J̇_sζ (..., n)."""
    by_tip: np.ndarray
    """A M_vq J_sq⁻¹ (..., 6, n), gain of h_v by v_s."""
    by_wrench: np.ndarray
    """J_s M⁻¹[1; 0] (..., n, 6), gain of −h_s by τ_v."""
    M: np.ndarray
    """M (..., 6+n, 6+n)."""
    b: np.ndarray
    """b + Jᵀ𝔉 (..., 6+n)."""


def row_feedforward(model: ContactModel, config: np.ndarray, zeta: np.ndarray, rows: np.ndarray, *,
              tip_acceleration: np.ndarray, wrench: np.ndarray, contact: np.ndarray | None = None
              ) -> RowFeedforward:
    """Returns maps and feedforward, of real or complex states.

    Args:
        model: The robot.
        config: 𝔮 (..., 6+n).
        zeta: ζ (..., 6+n).
        rows: The tip's rows in (χ, q) (n,), see `tip_rows`.
        tip_acceleration: v_s (..., n), commanded by the tip's rows [m/s², rad/s²].
        wrench: τ_v (..., 6), wrench of the thrusters [N, N m].
        contact: 𝔉 (..., 6); None: that of the model's surface.
    """
    kinematics = model.kinematics(config)
    J = output_jacobian(model, config, kinematics, rows)
    bias = output_bias(config, kinematics, zeta, rows)
    M = model.mass_matrix(kinematics)
    b = model.inverse_dynamics(kinematics, zeta, np.zeros_like(zeta), contact)
    # To the vehicle, by the arm, which holds the tip.
    by_arm = np.linalg.solve(J[..., 6:, 6:].swapaxes(-1, -2), M[..., :6, 6:].swapaxes(-1, -2)
                             ).swapaxes(-1, -2)  # M_vq J_sq⁻¹
    carried = b[..., :6] + times(by_arm, tip_acceleration - bias[..., 6:])
    A = J[..., :6, :6] @ np.linalg.inv(M[..., :6, :6] - by_arm @ J[..., 6:, :6])
    # To the tip, by the joints' torques.
    by_forces = np.linalg.solve(M, J[..., 6:, :].swapaxes(-1, -2)).swapaxes(-1, -2)  # J_s M⁻¹
    given = -b
    given[..., :6] += wrench
    return RowFeedforward(A, times(A, carried) - bias[..., :6], by_forces[..., 6:],
                          -times(by_forces, given) - bias[..., 6:], A @ by_arm,
                          by_forces[..., :6], M, b)
