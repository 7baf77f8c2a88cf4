"""Bounds that no certificate uses, to be held against runs: in time, and of ζ in the units of 𝔮."""

import math

import numpy as np

from uvms_drake.model.contact_model import ContactModel
from uvms_drake.tube.conditions import Condition
from uvms_drake.tube.row_gains import Tube, joint_rate_radius
from uvms_drake.tube.search.constraint_set import ConstraintSet


def rise(tube: Tube, time: float | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns E(t) and R(t), of the shape of `time` [s], which is zero or positive.

    The eigenvalues of A are −p and −q, real since gG ≥ 0: p = ½(a + b) + δ ≥ q = (ab − gG)/p,
    δ² = ¼(a − b)² + gG. With φ(s) = (1 − e^{−st})/s and the divided difference

        D(t) = [φ(q) − φ(p)]/(p − q) = [φ(q) − t e^{−qt} (1 − e^{−x})/x]/p,    x = (p − q) t,

    E = g d̃ D and R = d̃ [φ(p) + (p − b) D], by Sylvester's formula for ∫ e^{As} ds. The second
    form of D has no singularity at p = q.
    """
    t = np.asarray(time, dtype=float)
    if not tube.holds:
        return np.full_like(t, math.inf), np.full_like(t, math.inf)
    delta = math.hypot(0.5 * (tube.a - tube.b), math.sqrt(tube.g * tube.G))
    p = 0.5 * (tube.a + tube.b) + delta
    q = (tube.a * tube.b - tube.g * tube.G) / p
    x = (p - q) * t
    safe = np.where(x > 0.0, x, 1.0)
    mean = np.where(x > 0.0, -np.expm1(-safe) / safe, 1.0)
    D = (-np.expm1(-q * t) / q - t * np.exp(-q * t) * mean) / p
    return (tube.g * tube.d_bound * D,
            tube.d_bound * (-np.expm1(-p * t) / p + (p - tube.b) * D))


def resolved_preimage_tube(k: float, sigma: float, d_bound: float, mu: float) -> Tube:
    """Returns the tube of w = J_x(𝔮)⁻¹𝔢_y under the law `resolved`, in the units of 𝔮.

    *Bound.* ‖w(t)‖ ≤ W(t) ≤ d̃/(k(σ − μ)), if σ > μ.

    *Proof.* ẇ = J_x⁻¹𝔢̇_y − J_x⁻¹J̇_x w = −σw − J_x⁻¹J̇_x w + 𝔯, and −wᵀJ_x⁻¹J̇_x w ≤ μ‖w‖². ∎

    J_x drops out, but for its rate: through ‖J_x⁻¹‖ E∞ the condition number of J_x would come in.

    Args:
        k: Velocity gain [1/s].
        sigma: σ [1/s].
        d_bound: d̃, bound of ‖d‖₂.
        mu: μ, supremum of the largest eigenvalue of the symmetric part of −J_x⁻¹J̇_x [1/s].
    """
    a = sigma - mu
    return Tube(a, 1.0, 0.0, k, d_bound, (Condition("σ, above μ", sigma, ">", mu, theorem="t"),))


def resolved_velocity_radius(k: float, sigma: float, d_bound: float, mu: float, turning: float,
                             L_w: float) -> float:
    """Returns a bound of ‖ζ − ζ̄‖ under the law `resolved`; inf if σ ≤ μ.

    *Bound.* The smaller of R∞ + (σ + L_w)W∞ and `joint_rate_radius` + (N + L_w)W∞.

    *Proof.* With w = J_x(𝔮)⁻¹𝔢_y, ζ − ζ̄ = 𝔯 + ζ_ref − ζ̄ = 𝔯 − σw + J_x(𝔮)⁻¹(J_x(𝔮̄) − J_x(𝔮))ζ̄,
    where the last term is at most L_w‖w‖. That is the first. For the second, w = w₀ + w₁ with
    ẇ₀ = −σw₀ + 𝔯 and ẇ₁ = −σw₁ − J_x⁻¹J̇_x w from zero: 𝔯 − σw₀ obeys the proof of
    `joint_rate_radius`, and σ‖w₁‖ ≤ N W∞. ∎

    Args:
        k: Velocity gain [1/s].
        sigma: σ [1/s].
        d_bound: d̃, bound of ‖d‖₂.
        mu: μ, see `resolved_preimage_tube` [1/s].
        turning: N, supremum of ‖J_x⁻¹J̇_x‖₂ [1/s].
        L_w: With ‖J_x(𝔮)⁻¹(J_x(𝔮̄) − J_x(𝔮))ζ̄‖ ≤ L_w‖w‖ [1/s]; here 𝔮 *is* a function of y.
    """
    tube = resolved_preimage_tube(k, sigma, d_bound, mu)
    return min(tube.r + (sigma + L_w) * tube.e,
               joint_rate_radius(k, sigma, d_bound) + (turning + L_w) * tube.e)


def contains(declared: ConstraintSet, model: ContactModel, config: np.ndarray, zeta: np.ndarray,
             tolerance: float = 1e-7) -> np.ndarray:
    """Returns whether each of m states is in a set, to within `tolerance` of a bound."""
    lower, upper = declared.box
    x, size = config[:, 3:], 1.0 + tolerance
    inside = np.all((x >= lower - tolerance) & (x <= upper + tolerance), axis=1)
    tip = declared.normalised_tip(model, model.task_pose(config)[:, :6])
    speeds = [np.linalg.norm(part, axis=1) / limit for part, limit in zip(
        np.split(zeta, [3, 6], axis=1), (declared.nu1, declared.nu2, declared.qdot), strict=True)]
    return inside & np.all(np.abs(tip) <= size, axis=1) & np.all(np.array(speeds) <= size, axis=0)
