"""The price of a contact that is felt: what errors of the force sensor add to d, and force to u.

With the measured wrench 𝔉_s in the law, τ = M ζ̇_des + b + Jᵀ𝔉_s, and the plant M ζ̇ + b + Jᵀ𝔉 = τ +
M d, what remains of the contact is an acceleration,

    ζ̇ − ζ̇_des = d + M⁻¹Jᵀ(𝔉_s − 𝔉),                                                       (1)

whatever the surface: its law, its place and its stiffness are in neither side. In axes of the tip,
Jᵀ(𝔉_s − 𝔉) = J_Eᵀ e, J_E the Jacobian of the tip's spatial velocity in its own axes and e the
sensor's error. M, with added mass, and J_E are functions of q alone, so the suprema below are over
the box of the joints: found on a grid and closer and closer to the worst of it, multiplied by
a declared factor, and called estimates.
"""

from collections.abc import Callable

import numpy as np

from uvms_drake.model.uvms_model import COMPLEX_STEP, UvmsModel

SPLITS = np.linspace(0.05, 0.95, 10)
"""Trial values of θ in `sensor_share`."""
GRID_POINTS = 6000
"""Largest number of points of the grid."""
ROUNDS, ROUND_POINTS, SHRINK = 12, 64, 0.6
"""Rounds of random points about the worst one, points in each, and each round's size over the last
one's."""


def supremum_over_joints(function: Callable[[np.ndarray], np.ndarray], lower: np.ndarray,
                         upper: np.ndarray, seed: int = 0) -> np.ndarray:
    """Returns the largest values (c,) of a function that were found in a box of joint angles.

    Args:
        function: Values (m, c) at m sets of joint angles (m, n).
        lower: Corner of the box (n,) [rad].
        upper: The opposite corner (n,) [rad].
        seed: Seed of the random points.
    """
    size, rng = len(lower), np.random.default_rng(seed)
    along = max(2, int(GRID_POINTS ** (1.0 / max(size, 1))))
    axes = [np.linspace(0.0, 1.0, along)] * size
    unit = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, size)
    values = function(lower + unit * (upper - lower))
    worst = np.argmax(values, axis=0)
    best, where = values.max(axis=0), unit[worst]
    for column in range(len(best)):
        reach = 1.0 / (along - 1)
        for _ in range(ROUNDS):
            near = np.clip(where[column] + reach * rng.uniform(-1.0, 1.0, (ROUND_POINTS, size)),
                           0.0, 1.0)
            found = function(lower + near * (upper - lower))[:, column]
            if found.max() > best[column]:
                best[column], where[column] = found.max(), near[np.argmax(found)]
            reach *= SHRINK
    return best


def contact_gain(model: UvmsModel, q: np.ndarray) -> np.ndarray:
    """Returns M⁻¹J_Eᵀ (..., 6+n, 6) at joint angles (..., n), real or complex.

    It takes a wrench of the tip in the tip's own axes, (force, torque), to an acceleration.
    """
    config = np.concatenate([np.zeros((*q.shape[:-1], 6), dtype=q.dtype), q], axis=-1)
    kinematics = model.kinematics(config)
    J_E = kinematics.J_links[..., -1, :, :]
    gain: np.ndarray = np.linalg.solve(model.mass_matrix(kinematics), J_E.swapaxes(-1, -2))
    return gain


def sensor_share(model: UvmsModel, lower: np.ndarray, upper: np.ndarray, weight: np.ndarray,
                 force_error: float, torque_error: float, seed: int = 0) -> float:
    """Returns the largest ‖W⁻¹M⁻¹J_Eᵀe‖₂ that was found: the share of the set of d that e takes.

    Of (1), with ‖e_force‖ ≤ ε_f = `force_error` and ‖e_torque‖ ≤ ε_τ = `torque_error`. For every θ
    in (0, 1) θ‖e_force/ε_f‖² + (1 − θ)‖e_torque/ε_τ‖² ≤ 1, so that at every q it is at most
    ‖W⁻¹M⁻¹[J_fᵀ ε_f/√θ  J_τᵀ ε_τ/√(1 − θ)]‖₂; the best θ of `SPLITS` is taken.

    Args:
        model: The controller's.
        lower: Smallest joint angles (n,) [rad].
        upper: Largest joint angles (n,) [rad].
        weight: Diagonal of W (6+n,), ‖W⁻¹d‖₂ ≤ 1 [m/s² (3), rad/s² (3+n)].
        force_error: Bound of the sensor's error of force [N].
        torque_error: Bound of its error of torque [N m].
        seed: Seed of the search.
    """
    scale = np.stack([np.repeat([force_error / np.sqrt(split), torque_error / np.sqrt(1.0 - split)],
                                3) for split in SPLITS])

    def share(q: np.ndarray) -> np.ndarray:
        gain = contact_gain(model, q) / weight[:, None]
        norms = np.linalg.norm(gain[:, None] * scale[:, None, :], 2, axis=(-2, -1))
        out: np.ndarray = norms.min(axis=-1, keepdims=True)
        return out

    return float(supremum_over_joints(share, lower, upper, seed)[0])


def contact_input_rest(model: UvmsModel, lower: np.ndarray, upper: np.ndarray, force: float,
                       joints: float, orientation: float, seed: int = 0) -> np.ndarray:
    """Returns by how much the contact's part of the input may differ (6+n,) inside of the tube.

    The input for a contact force f in Σ_I is M⁻¹J_fᵀR_EW f. A plan counts it at the nominal pose.
    Row i, aᵢ(q)ᵀR_EW f, differs at the real pose by at most

        ‖f‖ (‖∂aᵢ/∂q‖ ‖q − q̄‖ + √2 ‖aᵢ‖ ‖𝔬 − 𝔬̄‖)                                             (2)

    to first order: the angle of the rotation between two attitudes is at most √2 times the norm of
    the difference of their Euler angles, since (φ̇, θ̇, ψ̇) ↦ ω has singular values √(1 ± |sin θ|), 1.
    The orientation's part is no larger for a finite difference; the joints' is for one as small as
    a tube.

    Args:
        model: The controller's.
        lower: Smallest joint angles (n,) [rad].
        upper: Largest joint angles (n,) [rad].
        force: Bound of ‖f‖ [N].
        joints: Bound of ‖q − q̄‖₂ [rad].
        orientation: Bound of ‖𝔬 − 𝔬̄‖₂ [rad].
        seed: Seed of the search.
    """
    n = len(lower)

    def rest(q: np.ndarray) -> np.ndarray:
        size = np.linalg.norm(contact_gain(model, q)[..., :3], axis=-1)
        turned: np.ndarray = np.sqrt(2.0) * orientation * size
        if n == 0:
            return force * turned
        moved = q[:, None, :] + 1j * COMPLEX_STEP * np.eye(n)
        slopes = contact_gain(model, moved)[..., :3].imag / COMPLEX_STEP  # (m, n, 6+n, 3)
        by_joints = np.linalg.norm(slopes.swapaxes(1, 2), 2, axis=(-2, -1))
        return force * (by_joints * joints + turned)

    return supremum_over_joints(rest, lower, upper, seed)
