"""Bounds on the deviation of the real from the nominal motion under both laws.

Both laws lead to a pair of inequalities for E = ‖𝔢‖ (or ‖𝔢_b‖, a block of rows of the extended
task) and R = ‖𝔯‖,

    D⁺E ≤ −a E + g R,        D⁺R ≤ G E − b R + d̃,        g, G ≥ 0,                          (1)

whose solution with equality from zero bounds both and rises to g d̃/(ab − gG) and a d̃/(ab − gG) if
a + b > 0 and ab > gG: tube/theory.md#comparison-lemma.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

from uvms_drake.common.errors import require
from uvms_drake.tube.conditions import Condition, LemmaConstants
from uvms_drake.tube.search.constraint_set import ConstraintSet

TRANSPOSE = "tube/theory.md#tube-of-the-law-transpose"
"""Theorem of the conditions of `transpose_tube`."""


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
    _check_gains(k, sigma, d_bound)
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
    _check_gains(k, sigma, d_bound)
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
    _check_gains(k, sigma, d_bound)
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


def transpose_tube(constants: LemmaConstants, k: float, sigma: float, d_bound: float) -> Tube:
    """Returns the tube of 𝔢 = χ − χ̄ under the law `transpose`, u = ū − k𝔯, 𝔯 = 𝔷 + σJ(𝔮̄)ᵀ𝔢.

    E and R of (1) with

        a = σJ̲ − L_𝔠,   g = J̄,   b = k − L₂ − σJ̄²,
        G = L₁ + L₂σJ̄ + σL_𝔠J̄ + σJ̃ + σ²J̄³,

    if a > 0, b > 0 and ab > J̄G; then ‖𝔷‖ ≤ R + σJ̄E. Proof:
    tube/theory.md#tube-of-the-law-transpose.

    Args:
        constants: Constants of the robot over its constraint sets, with their assumptions.
        k: Velocity gain [1/s].
        sigma: σ.
        d_bound: d̃, bound of ‖d‖₂.
    """
    _check_gains(k, sigma, d_bound)
    c, J = constants, constants.J_max
    a = sigma * c.J_min - c.L_c
    b = k - c.L_2 - sigma * J**2
    G = c.L_1 + sigma * (c.L_2 * J + c.L_c * J + c.J_dot) + sigma**2 * J**3
    return Tube(a, J, G, b, d_bound, (
        Condition("a = σJ̲ − L_c", a, ">", 0.0, theorem=TRANSPOSE, topic="a"),
        Condition("b = k − L₂ − σJ̄²", b, ">", 0.0, theorem=TRANSPOSE, topic="b"),
        # The product of two negative numbers does not count.
        Condition("ab, above J̄G", a * b if min(a, b) > 0.0 else -abs(a * b), ">", J * G,
                  theorem=TRANSPOSE, topic="ab")))


def transpose_velocity_radius(tube: Tube, sigma: float) -> float:
    """Returns the bound R∞ + σJ̄E∞ of ‖ζ − ζ̄‖, since 𝔷 = 𝔯 − σJ(𝔮̄)ᵀ𝔢."""
    return tube.r + sigma * tube.g * tube.e


class GainBound(NamedTuple):
    """Gains of the law `transpose` at the edge of its conditions."""

    k: float
    """Gain above which there is a tube at this σ [1/s]; inf if none has one."""
    sigma: float


def smallest_k(constants: LemmaConstants, sigma: float | None = None) -> GainBound:
    """Returns the gain above which the law `transpose` has a tube, at one σ or at the best one.

    It is the least value of a convex function of σ. If L₁ = L_𝔠 = 0, that is its limit at σ = 0,
    which is no gain to use. Proof: tube/theory.md#smallest-gain-of-the-law-transpose.

    Args:
        constants: Constants of the robot over its constraint sets.
        sigma: σ; the best one if None.
    """
    c, J = constants, constants.J_max
    if c.J_min == 0.0:
        return GainBound(math.inf, math.inf if sigma is None else sigma)
    if sigma is None:
        edge = c.L_c / c.J_min
        rate = c.L_2 * J + c.L_c * J + c.J_dot
        N_0 = J * (c.L_1 + edge * rate + edge**2 * J**3)
        N_2 = J**4 / c.J_min**2
        sigma = edge + math.sqrt(N_0 / (N_2 + J**2 / c.J_min)) / c.J_min
        if sigma == 0.0:
            return GainBound(c.L_2 + J * rate / c.J_min, 0.0)
    a = sigma * c.J_min - c.L_c
    if a <= 0.0:
        return GainBound(math.inf, sigma)
    G = transpose_tube(c, 1.0, sigma, 0.0).G
    return GainBound(c.L_2 + sigma * J**2 + J * G / a, sigma)


def _check_gains(k: float, sigma: float, d_bound: float) -> None:
    for key, value in (("k", k), ("sigma", sigma)):
        require(bool(0.0 < value < math.inf), key, value, "positive")
    require(bool(0.0 <= d_bound < math.inf), "d_bound", d_bound, "finite, zero or positive")
