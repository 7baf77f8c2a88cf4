"""Gains of the errors of a force sensor: norms of matrices of the joints alone.

In axes of the tip, J_E the Jacobian of its velocity and M the inertia with added mass, M⁻¹J_Eᵀ
takes a wrench to the acceleration of the robot and J_EM⁻¹J_Eᵀ to that of its tip. Both are
functions of q alone, so that their suprema are over a box of joints. They are found on a grid and
closer and closer to the worst of it, and multiplied by a declared factor, which makes a claim;
`sensor_gains_proof` proves it.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from uvms_drake.model.frames.spatial import motion_matrix, skew
from uvms_drake.model.uvms_model import UvmsModel, beyond_columns
from uvms_drake.tube.search.constraint_set import ConstraintSet


class OperatorNorms(NamedTuple):
    """Suprema of norms of matrices A(q), one or several of them."""

    force: np.ndarray | float
    """Norms of the columns of the force, A_f."""
    normal: np.ndarray | float
    """Norms of A_f n."""
    torque: np.ndarray | float
    """Norms of the columns of the torque."""
    by_joints: np.ndarray | float
    """(Σᵢ‖∂A_f/∂qᵢ‖²)^½; times ‖q̇‖ it bounds ‖dA_f/dt‖."""


class Suprema(NamedTuple):
    """Suprema of the matrices of (3) of `sensor_error`."""

    turning: float
    """‖J_ω,q‖, of the tip's angular velocity by the joints' rates."""
    linear: float
    """‖J_v‖, of the tip's velocity by ζ."""
    linear_by_joints: float
    """(Σᵢ‖∂J_v/∂qᵢ‖²)^½ in axes of the vehicle."""
    angular: float
    """‖J_ω‖, of the tip's angular velocity by ζ."""
    angular_by_joints: float
    """(Σᵢ‖∂J_ω/∂qᵢ‖²)^½ in axes of the tip."""
    depth: OperatorNorms
    """Norms of the row of n·𝔭̇."""
    position: OperatorNorms
    """Norms of the rows of the tip's velocity, in its axes."""
    rotation: OperatorNorms
    """Norms of the rows of its angular velocity, likewise."""
    zeta: OperatorNorms
    """Norms of the rows of ν₁, ν₂ and q̇, (3,) each."""
    rows: OperatorNorms
    """Norms of each row of ζ̇ (6+n,)."""


ALONE = 5
"""Number of `Suprema` before those that are `OperatorNorms`."""


def tip_jacobian_and_gain(model: UvmsModel, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns J_E (..., 6, 6+n) and M⁻¹J_Eᵀ (..., 6+n, 6) at joint angles (..., n).

    The latter takes a wrench of the tip in the tip's own axes, (force, torque), to an acceleration.
    """
    config = np.concatenate([np.zeros((*q.shape[:-1], 6), dtype=q.dtype), q], axis=-1)
    kinematics = model.kinematics(config)
    J_E = kinematics.J_links[..., -1, :, :]
    return J_E, np.linalg.solve(model.mass_matrix(kinematics), J_E.swapaxes(-1, -2))


class TipSlopes(NamedTuple):
    """Jacobian J_E of the tip, G = M⁻¹J_Eᵀ, and their derivatives by the joints."""

    J_E: np.ndarray
    """(m, 6, 6+n)."""
    gain: np.ndarray
    """G (m, 6+n, 6)."""
    J_E_by: np.ndarray
    """∂ᵢJ_E (m, n, 6, 6+n)."""
    gain_by: np.ndarray
    """∂ᵢG = M⁻¹(∂ᵢJ_Eᵀ − ∂ᵢM G) (m, n, 6+n, 6)."""


def tip_and_slopes(model: UvmsModel, q: np.ndarray) -> TipSlopes:
    """Returns J_E, G and their derivatives at joint angles (m, n), real."""
    kinematics = model.kinematics(np.concatenate([np.zeros((len(q), 6)), q], axis=1))
    J_E = kinematics.J_links[:, -1]
    J_by = tip_slopes(J_E)
    inverse = np.linalg.inv(model.mass_matrix(kinematics))
    G = inverse @ J_E.swapaxes(-1, -2)
    G_by = inverse[:, None] @ (
        J_by.swapaxes(-1, -2) - model.mass_matrix_rates(kinematics) @ G[:, None])
    return TipSlopes(J_E, G, J_by, G_by)


def tip_slopes(J_E: np.ndarray) -> np.ndarray:
    """Returns ∂J_E/∂qᵢ (m, n, 6, 6+n) of J_E (m, 6, 6+n): joint i carries columns along."""
    screws = J_E[..., 6:].swapaxes(-1, -2)
    return -motion_matrix(screws) @ (J_E[:, None] * beyond_columns(screws.shape[1])[:, None])


def norms_over_joints(model: UvmsModel, declared: ConstraintSet, tool_angle: float) -> tuple[
        Callable[[np.ndarray], np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """Returns the norms by the joints and n in the cone about the tip's x-axis, and their box."""
    size, num_joints = model.size, model.num_joints
    blocks = (slice(0, 3), slice(3, 6), slice(6, size))

    def matrices(at_tip: np.ndarray, gain: np.ndarray, n: np.ndarray) -> list[np.ndarray]:
        """Returns the matrices (..., rows, 6)."""
        return [n[..., None, :] @ at_tip[..., :3, :], at_tip[..., :3, :], at_tip[..., 3:, :],
                *(gain[..., block, :] for block in blocks),
                *(gain[..., i: i + 1, :] for i in range(size))]

    def sizes(at: np.ndarray) -> np.ndarray:
        q, (off, about) = at[:, :num_joints], at[:, num_joints:].T
        n = np.stack([np.cos(off), np.sin(off) * np.cos(about), np.sin(off) * np.sin(about)], -1)
        J_E, gain, J_E_by, gain_by = tip_and_slopes(model, q)
        here = matrices(J_E @ gain, gain, n)
        slopes = matrices(J_E_by @ gain[:, None] + J_E[:, None] @ gain_by, gain_by, n[:, None])
        columns = [norm(J_E[:, 3:, 6:]), norm(J_E[:, :3]),
                   together(J_E_by[..., :3, :] + in_vehicle(J_E)),
                   norm(J_E[:, 3:]), together(J_E_by[..., 3:, :])]
        for A, slope in zip(here, slopes, strict=True):
            columns += [norm(A[..., :3]), norm(A[..., :3] @ n[..., None]), norm(A[..., 3:]),
                        together(slope[..., :3])]
        return np.stack(columns, axis=-1)

    return sizes, (np.append(declared.q_lower, [0.0, 0.0]),
                   np.append(declared.q_upper, [tool_angle, 2.0 * np.pi]))


def suprema_of(worst: np.ndarray) -> Suprema:
    """Returns the suprema of `norms_over_joints` by their names."""
    table = worst[ALONE:].reshape(-1, 4).T
    turning, linear, linear_by_joints, angular, angular_by_joints = map(float, worst[:ALONE])
    return Suprema(turning, linear, linear_by_joints, angular, angular_by_joints, *(
        OperatorNorms(*table[:, part]) for part in (0, 1, 2, slice(3, 6), slice(6, None))))


def in_vehicle(J_E: np.ndarray) -> np.ndarray:
    """Returns the difference of ∂J_v/∂qᵢ in axes of the vehicle and of the tip.

    (..., n, 3, 6+n): these turn with joint i about its axis aᵢ, so it is aᵢ × J_v, in their axes.
    """
    axes = J_E[..., 3:, 6:].swapaxes(-1, -2)
    out: np.ndarray = skew(axes) @ J_E[..., None, :3, :]
    return out


def norm(A: np.ndarray) -> np.ndarray:
    """Returns spectral norms (...) of matrices (..., r, c); zero if one has no rows or columns."""
    if 0 in A.shape[-2:]:
        return np.zeros(A.shape[:-2])
    out: np.ndarray
    if 1 in A.shape[-2:]:
        out = np.sqrt(np.sum(np.square(A), axis=(-2, -1)))
    else:  # Of the smaller of AᵀA and AAᵀ: several times faster than singular values.
        A_T = A.swapaxes(-1, -2)
        gram = A_T @ A if A.shape[-1] <= A.shape[-2] else A @ A_T
        out = np.sqrt(np.maximum(np.linalg.eigvalsh(gram)[..., -1], 0.0))  # Rounding.
    return out


def together(A: np.ndarray) -> np.ndarray:
    """Returns (Σᵢ‖Aᵢ‖²)^½ (...) of n matrices (..., n, r, c)."""
    out: np.ndarray = np.linalg.norm(norm(A), axis=-1)
    return out
