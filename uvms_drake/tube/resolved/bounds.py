"""Bounds on the deviation of the real from the nominal motion, by a comparison system.

A law leads to a pair of inequalities for E = ‖𝔢‖ (or ‖𝔢_b‖, a block of rows of the extended
task) and R = ‖𝔯‖,

    D⁺E ≤ −a E + g R,        D⁺R ≤ G E − b R + d̃,        g, G ≥ 0,                          (1)

whose solution with equality from zero bounds both and rises to g d̃/(ab − gG) and a d̃/(ab − gG) if
a + b > 0 and ab > gG: tube/theory.md#comparison-lemma.
"""

import math
from dataclasses import dataclass

from uvms_drake.common.errors import require
from uvms_drake.tube.conditions import Condition
from uvms_drake.tube.search.constraint_set import ConstraintSet


@dataclass(frozen=True)
class Tube:
    """Bounds on E and R from a comparison system (1) that starts at zero."""

    a: float
    """Decay rate of E [1/s]."""
    g: float
    """Gain from R to the rate of E."""
    G: float
    """Gain from E to the rate of R."""
    b: float
    """Decay rate of R [1/s]."""
    d_bound: float
    """Bound d̃ of ‖d‖₂."""
    conditions: tuple[Condition, ...] = ()
    """Conditions for (1) to be stable."""

    @property
    def holds(self) -> bool:
        """True if all conditions hold; if not, every bound is inf."""
        return all(condition.holds for condition in self.conditions)

    @property
    def e(self) -> float:
        """E∞ = g d̃/(ab − gG)."""
        return self._steady(self.g)

    @property
    def r(self) -> float:
        """R∞ = a d̃/(ab − gG)."""
        return self._steady(self.a)

    def _steady(self, factor: float) -> float:
        if not self.holds:
            return math.inf
        return factor * self.d_bound / (self.a * self.b - self.g * self.G)


def resolved_tube(k: float, sigma: float, d_bound: float, gain: float) -> Tube:
    """Returns the tube of a block of rows of y under the law `resolved`.

    ‖Ŵ⁻¹𝔯(t)‖ ≤ (d̃/k)(1 − e^{−kt}) and ‖𝔢_b(t)‖ ≤ E(t) ≤ E∞ = g d̃/(kσ), with
    E(t) = E∞[1 − (k e^{−σt} − σ e^{−kt})/(k − σ)], or E∞[1 − (1 + kt)e^{−kt}] for k = σ. Further
    ‖𝔢̇_b‖ ≤ σE + gR ≤ 2g d̃/k. For every k, σ > 0: there is no condition. Proof:
    tube/theory.md#tube-of-the-law-resolved.

    Args:
        k: Velocity gain [1/s].
        sigma: σ [1/s].
        d_bound: d̃, bound of ‖Ŵ⁻¹d‖₂.
        gain: g, supremum of ‖J_b(𝔮)Ŵ‖₂; for the joints or some of them, J_b = [0 I], the largest of
            their entries of Ŵ.
    """
    check_gains(k, sigma, d_bound)
    require(bool(0.0 <= gain < math.inf), "gain", gain, "finite, zero or positive")
    return Tube(sigma, gain, 0.0, k, d_bound)


def joint_rate_radius(k: float, sigma: float, d_bound: float) -> float:
    """Returns the bound (2d̃/k)(σ/k)^{σ/(k−σ)} of ‖q̇ − q̄̇‖ under the law `resolved`.

    Proof: tube/theory.md#joint-rates-under-the-law-resolved.

    Args:
        k: Velocity gain [1/s].
        sigma: σ [1/s].
        d_bound: d̃, bound of ‖d_q‖₂.
    """
    check_gains(k, sigma, d_bound)
    ratio = (k - sigma) / sigma
    # σt* = ln(1 + ρ)/ρ, ρ = k/σ − 1
    exponent = math.log1p(ratio) / ratio if abs(ratio) > 1e-8 else 1.0 - 0.5 * ratio
    return 2.0 * d_bound / k * math.exp(-exponent)


def preimage_shift(k: float, sigma: float, d_bound: float, omega: float, alpha: float) -> float:
    """Returns a bound of ‖𝔭 − 𝔭₀‖ under the law `resolved`, 𝔭 = J_x(𝔮)⁻¹𝔢_y; inf if σ ≤ ω.

    𝔭₀ has 𝔭̇₀ = −σ𝔭₀ + 𝔯, from zero like 𝔭. The bound is αd̃/(kσ(σ − ω)). Proof:
    tube/theory.md#preimage-of-the-task-error.

    Args:
        k: Velocity gain [1/s].
        sigma: σ [1/s].
        d_bound: d̃, bound of ‖Ŵ⁻¹d‖₂.
        omega: ω, supremum of ‖A‖₂ [1/s].
        alpha: α, supremum of ‖AŴ‖₂ [1/s].
    """
    check_gains(k, sigma, d_bound)
    return alpha * d_bound / (k * (sigma - omega) * sigma) if omega < sigma else math.inf


def attitude_radii(declared: ConstraintSet, orientation: float, joints: float = 0.0,
                   num_joints: int = 0) -> tuple[float, float]:
    """Returns the bounds of |φ − φ̄| and |θ − θ̄| of the vehicle.

    They are ρ/cos θ_max and ρ with ρ = ‖𝔬 − 𝔬̄‖ + √n‖q − q̄‖. Proof:
    tube/theory.md#attitude-of-the-vehicle.

    Args:
        declared: Limits θ.
        orientation: Bound of ‖𝔬 − 𝔬̄‖₂ [rad].
        joints: Bound of ‖q − q̄‖₂ [rad].
        num_joints: n.
    """
    turn = orientation + (math.sqrt(num_joints) * joints if num_joints > 0 else 0.0)
    return turn / math.cos(declared.pitch), turn


def check_gains(k: float, sigma: float, d_bound: float) -> None:
    """Raises `InvalidParameter` unless the gains are positive and d̃ is at least zero."""
    for key, value in (("k", k), ("sigma", sigma)):
        require(bool(0.0 < value < math.inf), key, value, "positive")
    require(bool(0.0 <= d_bound < math.inf), "d_bound", d_bound, "finite, zero or positive")
