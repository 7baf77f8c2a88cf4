"""Conditions as rows of a table, and those of the paper: as printed, and as its proof needs them.

Symbols are those of (lemma:tube): 𝔢 = e − ē, 𝔷 = ζ − ζ̄, 𝔯 = 𝔷 + σJ(𝔮̄)ᵀ𝔢, and the law is
u = ū − k𝔯. What the Lemma bounds is one quadratic, V = ½‖𝔢‖² + ½‖𝔯‖². `tubes.transpose_tube` gets
much smaller tubes out of the same constants.
"""

import math
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

from uvms_drake.common.errors import require

Relation = Literal["<", "<=", ">", ">="]
LEMMA = "tube/theory.md#lemma-of-the-paper"
"""Theorem of the conditions of `paper_conditions`."""
BEYOND = "not with this vehicle, because "
"""How an advice begins where no key helps: why, and what the vehicle would need."""


@dataclass(frozen=True)
class Condition:
    """An inequality between two numbers."""

    name: str
    left: float
    relation: Relation
    right: float
    advice: str = ""
    """What to add to the command line, `--set key=value`, if it is not met and a value is known; or
    what begins with `BEYOND`."""
    theorem: str = field(kw_only=True)
    """Link, below `uvms_drake/`, to the theorem that needs it: `path/theory.md#heading`."""

    @property
    def holds(self) -> bool:
        """True if it is met; a NaN meets nothing."""
        return self.margin > 0.0 or ("=" in self.relation and self.left == self.right)

    @property
    def margin(self) -> float:
        """How far the sides are apart, negative if it is not met; in the unit of the sides."""
        return self.left - self.right if self.relation.startswith(">") else self.right - self.left

    @property
    def is_count(self) -> bool:
        """Whether the number is a yes or no, or a count of what should not be: the name says it."""
        return self.relation == "<=" and self.right == 0.0 and float(self.left).is_integer()

    def __str__(self) -> str:
        if self.is_count:
            return f"none of this: {self.name}" if self.holds else self.name
        return (f"{self.name}: {self.left:.4g} {self.relation} {self.right:.4g} "
                f"{'holds' if self.holds else 'does not hold'}")


@dataclass(frozen=True)
class LemmaConstants:
    """What (lemma:tube) assumes about the robot, over its constraint sets.

    The paper takes 𝔮 for a function of χ. For an arm with self-motion it is none: then 𝔢 = 0 does
    not make J(𝔮) = J(𝔮̄), no L_c and L_1 as defined here exist, and a tube from them certifies
    nothing, unless something else keeps ‖𝔮 − 𝔮̄‖ below a multiple of ‖𝔢‖.
    """

    J_min: float
    """J̲, smallest eigenvalue of J Jᵀ: of order ‖J‖², in spite of its name."""
    J_max: float
    """J̄, largest ‖J‖₂."""
    J_dot: float
    """J̃, largest ‖J̇‖₂ along the nominal motion [1/s]."""
    L_c: float
    """L_𝔠: ‖(J(𝔮) − J(𝔮̄))ζ‖ ≤ L_𝔠‖𝔢‖, for the speeds of the real ζ [1/s]."""
    L_1: float
    """‖f(𝔮, ζ) − f(𝔮̄, ζ)‖ ≤ L₁‖𝔢‖ [1/s²]."""
    L_2: float
    """‖f(𝔮̄, ζ) − f(𝔮̄, ζ̄)‖ ≤ L₂‖𝔷‖ [1/s]."""

    def __post_init__(self):
        for key, value in vars(self).items():
            require(bool(0.0 <= value < math.inf), key, value, "finite, zero or positive")


class QuadraticTube(NamedTuple):
    """A tube that one quadratic V gives."""

    e: float
    """Radius of Ω₁, bounds ‖𝔢‖; inf if a condition fails."""
    z: float
    """Radius of Ω₂, bounds ‖𝔷‖; inf if a condition fails."""
    Lambda_1: float
    """Λ₁, the factor of ‖𝔢‖‖𝔯‖ in the bound of V̇."""
    Lambda_2: float
    """Λ₂ [1/s]: the factor of −‖𝔯‖² in the bound of V̇ is k − Λ₂."""
    sigma_lower: float
    """σ̲ = σJ̲ − L_𝔠 [1/s], the factor of −‖𝔢‖² in the bound of V̇."""
    rho: float
    """ρ, the weight in ‖𝔢‖‖𝔯‖ ≤ ‖𝔢‖²/(4ρ) + ρ‖𝔯‖²."""
    alpha_1: float
    """α₁ = σ̲ − Λ₁/(4ρ), the part of σ̲ that is left for −‖𝔢‖² [1/s]."""
    alpha_2: float
    """α₂ = k − ρΛ₁ − Λ₂, the part of k that is left for −‖𝔯‖² [1/s]."""
    conditions: tuple[Condition, ...]
    """Conditions of (eq:sigma_under_sigma)."""


class PaperTubes(NamedTuple):
    """The Lemma as it is printed, and with the terms that its proof loses."""

    printed: QuadraticTube
    corrected: QuadraticTube


def paper_conditions(constants: LemmaConstants, k: float, sigma: float, d_bound: float,
                     rho: float | None = None) -> PaperTubes:
    """Returns the tubes of (lemma:tube) for the law `transpose`.

    With 𝔢̇ = 𝔟 + J𝔷 and 𝔷 = 𝔯 − σJᵀ𝔢, J = J(𝔮̄), 𝔟 = (J(𝔮) − J)ζ, 𝔩 = f − f̄, exactly

        V̇ = 𝔢ᵀ𝔟 − σ𝔢ᵀJJᵀ𝔢 + 𝔢ᵀJ𝔯 + 𝔯ᵀ𝔩 + σ𝔯ᵀJ̇ᵀ𝔢 + σ𝔯ᵀJᵀ𝔟 + σ𝔯ᵀJᵀJ𝔯 − σ²𝔯ᵀJᵀJJᵀ𝔢 − k𝔯ᵀ𝔯 + 𝔯ᵀd,

    hence, with L = max(L₁, L₂), ‖𝔟‖ ≤ L_𝔠‖𝔢‖ and ‖𝔩‖ ≤ L‖𝔢‖ + L(‖𝔯‖ + σJ̄‖𝔢‖),

        V̇ ≤ −σ̲‖𝔢‖² + Λ₁‖𝔢‖‖𝔯‖ − (k − Λ₂)‖𝔯‖² + d̃‖𝔯‖,    Λ₂ = L + σJ̄²,
        Λ₁ = L(1 + σJ̄) + J̄ + σ(L_𝔠J̄ + J̃) + σ²J̄³                              (corrected)
        Λ₁ = L + J̄ + σ(L_𝔠 + J̃)                                                (printed).

    By ‖𝔢‖‖𝔯‖ ≤ ‖𝔢‖²/(4ρ) + ρ‖𝔯‖² it is at most −min(α₁, α₂)‖(𝔢, 𝔯)‖² + d̃‖(𝔢, 𝔯)‖, so the ball
    ‖(𝔢, 𝔯)‖ ≤ d̃/min(α₁, α₂) is invariant, and ‖𝔢‖ is below its radius. It is that ball which is
    invariant: Ω₁ × Ω₂ is not. Since ‖𝔷‖ ≤ ‖𝔯‖ + σJ̄‖𝔢‖, inside of it ‖𝔷‖ ≤ √(1 + σ²J̄²) times the
    radius (Cauchy–Schwarz; corrected). Printed is 2/J̄ times the radius, without σ: a lower bound
    taken for an upper one.

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
        return 1.0  # There is nothing to split; any ρ will do.
    if half >= 0.0:
        return (half + root) / (2.0 * Lambda_1)
    return 0.5 * Lambda_1 / (root - half)


class KinematicTubes(NamedTuple):
    """Radii of the tube of χ̇ = J(𝔮)ζ + w with the input ζ, the paper's simulation."""

    printed: float
    """Radius w̃/(σJ̲ + L_𝔠) of the paper."""
    corrected: float
    """Radius w̃/(σJ̲ − L_𝔠); inf if the condition fails."""
    resolved: float
    """Radius w̃/σ of the law `resolved`."""
    condition: Condition
    """Condition σJ̲ > L_𝔠 of the law `transpose`; `resolved` needs none."""


def kinematic_tubes(J_min: float, L_c: float, sigma: float, w_bound: float) -> KinematicTubes:
    """Returns the tubes of the kinematic model χ̇ = J(𝔮)ζ + w, ‖w‖₂ ≤ w̃, with the input ζ.

    `transpose`: ζ = ζ̄ − σJ(𝔮̄)ᵀ𝔢 gives 𝔢̇ = 𝔟 − σJJᵀ𝔢 + w, so D⁺‖𝔢‖ ≤ −(σJ̲ − L_𝔠)‖𝔢‖ + w̃: 𝔟 works
    against the gain, the printed sign is wrong. From 0, ‖𝔢(t)‖ ≤ w̃(1 − e^{−at})/a, a = σJ̲ − L_𝔠.

    `resolved`: ζ = J_x(𝔮)⁻¹[J_x(𝔮̄)ζ̄ − σ𝔢_y] gives exactly 𝔢̇_y = −σ𝔢_y + (w, 0), so
    ‖𝔢_y‖ ≤ w̃(1 − e^{−σt})/σ, which a constant w attains.

    Args:
        J_min: J̲, smallest eigenvalue of J Jᵀ.
        L_c: L_𝔠, see `LemmaConstants`.
        sigma: σ.
        w_bound: w̃, bound of ‖w‖₂; of w̃ sin(t) in six components it is √6 times the amplitude.
    """
    condition = Condition("σJ̲, above L_c", sigma * J_min, ">", L_c,
                          theorem="tube/theory.md#kinematic-tubes")
    corrected = w_bound / (sigma * J_min - L_c) if condition.holds else math.inf
    return KinematicTubes(
        w_bound / (sigma * J_min + L_c), corrected, w_bound / sigma, condition)
