"""The Lemma of the paper, as printed and as its proof needs it.

Symbols are those of (lemma:tube): 𝔢 = e − ē, 𝔷 = ζ − ζ̄, 𝔯 = 𝔷 + σJ(𝔮̄)ᵀ𝔢, and the law is
u = ū − k𝔯. The Lemma bounds one quadratic, V = ½‖𝔢‖² + ½‖𝔯‖²; `transpose_tube` gets much smaller
tubes out of the same constants. Proofs: papers/nikou2018/theory.md#lemma-of-the-paper.
"""

import math
from typing import NamedTuple

from uvms_drake.papers.nikou2018.transpose import LemmaConstants
from uvms_drake.tube.conditions import Condition

LEMMA = "papers/nikou2018/theory.md#lemma-of-the-paper"
"""Theorem of the conditions of `paper_conditions`."""


class QuadraticTube(NamedTuple):
    """A tube that one quadratic V gives."""

    e: float
    """Radius of Ω₁, bound of ‖𝔢‖; inf if a condition fails."""
    z: float
    """Radius of Ω₂, bound of ‖𝔷‖; inf if a condition fails."""
    Lambda_1: float
    """Λ₁, the factor of ‖𝔢‖‖𝔯‖ in the bound of V̇."""
    Lambda_2: float
    """Λ₂ [1/s]: the factor of −‖𝔯‖² in the bound of V̇ is k − Λ₂."""
    sigma_lower: float
    """σ̲ = σJ̲ − L_𝔠 [1/s], the factor of −‖𝔢‖² in the bound of V̇."""
    rho: float
    """ρ, the weight in ‖𝔢‖‖𝔯‖ ≤ ‖𝔢‖²/(4ρ) + ρ‖𝔯‖²."""
    alpha_1: float
    """α₁ = σ̲ − Λ₁/(4ρ), the part of σ̲ available for −‖𝔢‖² [1/s]."""
    alpha_2: float
    """α₂ = k − ρΛ₁ − Λ₂, the part of k available for −‖𝔯‖² [1/s]."""
    conditions: tuple[Condition, ...]
    """Conditions of (eq:sigma_under_sigma)."""


class PaperTubes(NamedTuple):
    """The Lemma as printed, and with the terms that its proof loses."""

    printed: QuadraticTube
    corrected: QuadraticTube


def paper_conditions(constants: LemmaConstants, k: float, sigma: float, d_bound: float,
                     rho: float | None = None) -> PaperTubes:
    """Returns the tubes of (lemma:tube) for the law `transpose`.

    α₁ = σ̲ − Λ₁/(4ρ) and α₂ = k − ρΛ₁ − Λ₂ with σ̲ = σJ̲ − L_𝔠, Λ₂ = L + σJ̄², L = max(L₁, L₂), and

        Λ₁ = L(1 + σJ̄) + J̄ + σ(L_𝔠J̄ + J̃) + σ²J̄³                              (corrected)
        Λ₁ = L + J̄ + σ(L_𝔠 + J̃)                                                (printed):

    the ball ‖(𝔢, 𝔯)‖ ≤ d̃/min(α₁, α₂) is invariant, and in it ‖𝔷‖ ≤ √(1 + σ²J̄²) times the radius;
    printed is 2/J̄ times. Proof: papers/nikou2018/theory.md#lemma-of-the-paper.

    Args:
        constants: Constants of the robot over its constraint sets.
        k: Velocity gain [1/s].
        sigma: σ.
        d_bound: d̃, bound of ‖d‖₂.
        rho: ρ; if None, each tube gets the one that makes it smallest, at which α₁ = α₂ is the
            smaller eigenvalue of the quadratic form [σ̲ −Λ₁/2; −Λ₁/2 k−Λ₂].
    """
    c = constants
    L = max(c.L_1, c.L_2)
    J = c.J_max
    printed = L + J + sigma * (c.L_c + c.J_dot)
    corrected = (L * (1.0 + sigma * J) + J + sigma * (c.L_c * J + c.J_dot) + sigma**2 * J**3)
    z_printed = 2.0 / J if J > 0.0 else math.inf
    z_corrected = math.hypot(1.0, sigma * J)
    Lambda_2 = L + sigma * J**2
    sigma_lower = sigma * c.J_min - c.L_c
    return PaperTubes(*(
        _quadratic_tube(Lambda_1, Lambda_2, sigma_lower, k, d_bound, rho, ratio)
        for Lambda_1, ratio in ((printed, z_printed), (corrected, z_corrected))))


def _quadratic_tube(Lambda_1: float, Lambda_2: float, sigma_lower: float, k: float, d_bound: float,
                    rho: float | None, z_ratio: float) -> QuadraticTube:
    if rho is None:
        rho = _best_rho(Lambda_1, Lambda_2, sigma_lower, k)
    alpha_1 = sigma_lower - Lambda_1 / (4.0 * rho)
    alpha_2 = k - rho * Lambda_1 - Lambda_2
    smallest_rho = Lambda_1 / (4.0 * sigma_lower) if sigma_lower > 0.0 else math.inf
    conditions = (
        Condition("σ̲ = σJ̲ − L_c", sigma_lower, ">", 0.0, theorem=LEMMA),
        Condition("ρ, above Λ₁/(4σ̲)", rho, ">", smallest_rho, theorem=LEMMA),
        Condition("k, above ρΛ₁ + Λ₂", k, ">", rho * Lambda_1 + Lambda_2, theorem=LEMMA))
    holds = all(item.holds for item in conditions)
    radius = d_bound / min(alpha_1, alpha_2) if holds else math.inf
    return QuadraticTube(radius, z_ratio * radius, Lambda_1, Lambda_2, sigma_lower, rho, alpha_1,
                         alpha_2, conditions)


def _best_rho(Lambda_1: float, Lambda_2: float, sigma_lower: float, k: float) -> float:
    """Returns the ρ > 0 with α₁ = α₂: α₁ rises with ρ, α₂ falls.

    It solves Λ₁ρ² − (k − Λ₂ − σ̲)ρ − Λ₁/4 = 0; the two forms of the root avoid cancellation.
    """
    half = k - Lambda_2 - sigma_lower
    root = math.hypot(half, Lambda_1)
    if Lambda_1 == 0.0:
        return 1.0  # Without a mixed term any ρ serves.
    if half >= 0.0:
        return (half + root) / (2.0 * Lambda_1)
    return 0.5 * Lambda_1 / (root - half)
