"""The tubes: bounds on the deviation of the real from the nominal motion, each with its proof.

Both laws of `control.laws` lead to a pair of inequalities for E = ‖𝔢‖ (or ‖𝔢_b‖, a block of
rows of the extended task) and R = ‖𝔯‖,

    D⁺E ≤ −a E + g R,        D⁺R ≤ G E − b R + d̃,        g, G ≥ 0.                          (1)

*Comparison lemma.* Let (x_E, x_R) solve (1) with equality from (E, R)(0). Then E ≤ x_E, R ≤ x_R at
all later times. Proof: E and R are norms of solutions, so they are absolutely continuous and (1)
holds of their derivatives almost everywhere, also for a d that is merely measurable. Consider
w = (E − x_E)₊ + (R − x_R)₊, (·)₊ = max(·, 0). Where E > x_E, since g ≥ 0 (the right-hand side is
quasi-monotone),

    d/dt (E − x_E) ≤ −a(E − x_E) + g(R − x_R) ≤ |a|(E − x_E)₊ + g(R − x_R)₊,

and elsewhere d/dt (E − x_E)₊ = 0 almost everywhere; likewise for R with G ≥ 0. So w(0) = 0 and
ẇ ≤ (|a| + |b| + g + G) w almost everywhere: w = 0 by Grönwall. ∎

*Monotone.* From zero, dx/dt = e^{At}(0, d̃) with A = [−a g; G −b]. Off its diagonal A is not
negative, so neither is e^{At}: x rises, to −A⁻¹(0, d̃) if A is stable, that is if a + b > 0 and
ab > gG. So a tube that grows from zero comes with each radius.

*Norms.* Where 𝔢 ≠ 0, D⁺‖𝔢‖ = 𝔢ᵀ𝔢̇/‖𝔢‖; where 𝔢 = 0, D⁺‖𝔢‖ = ‖𝔢̇‖. Either way 𝔢̇ = −s𝔢 + v gives
D⁺‖𝔢‖ ≤ −s‖𝔢‖ + ‖v‖.

*Where the constants hold.* They are suprema over the constraint set of the *real* state. If the
nominal state keeps a set that is tightened by the tube, the real one cannot be the first to leave:
up to the time at which it did, the bounds would hold, and put it inside. The wrapped differences of
the Euler angles are differences for the same reason, as long as the radii are below π.
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
    g: float
    G: float
    b: float
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

    *Bound.* ‖𝔯(t)‖ ≤ R(t) = (d̃/k)(1 − e^{−kt}), ‖𝔢_b(t)‖ ≤ E(t) ≤ E∞ = g d̃/(kσ), with
    E(t) = E∞[1 − (k e^{−σt} − σ e^{−kt})/(k − σ)], or E∞[1 − (1 + kt)e^{−kt}] for k = σ. Further
    ‖𝔢̇_b‖ ≤ σE + gR ≤ 2g d̃/k. For every k, σ > 0: there is no condition.

    *Proof.* By definition J_x(𝔮)ζ_ref = J_x(𝔮̄)ζ̄ − σ𝔢_y, so with ζ = ζ_ref + 𝔯

        𝔢̇_y = J_x(𝔮)ζ − J_x(𝔮̄)ζ̄ = −σ𝔢_y + J_x(𝔮)𝔯,

    and u = ζ̇_ref − f − k𝔯 in ζ̇ = f + u + d leaves 𝔯̇ = −k𝔯 + d. σ is a scalar, hence any rows b of
    the first equation, or any constant combinations of rows, stand for themselves:
    𝔢̇_b = −σ𝔢_b + J_b(𝔮)𝔯. That is (1) with a = σ, b = k, G = 0. ∎

    A constant J_b and a constant d along its leading right-singular vector make both inequalities
    equations: the bound cannot be improved for a block whose J_b may stand still.

    *Ellipsoid.* For ‖Ŵ⁻¹d‖₂ ≤ d̃, Ŵ diagonal, all of it holds of 𝔯′ = Ŵ⁻¹𝔯 and J_bŴ in place of 𝔯
    and J_b: Ŵ commutes with the scalar k, so that 𝔯̇′ = −k𝔯′ + Ŵ⁻¹d and 𝔢̇_b = −σ𝔢_b + J_bŴ𝔯′. The
    bounds of ‖𝔢_b‖ and ‖𝔢̇_b‖ then have g = sup ‖J_bŴ‖₂.

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

    *Proof.* The rows [0 I] of J_x ζ_ref = J_x(𝔮̄)ζ̄ − σ𝔢_y say q̇_ref = q̄̇ − σ𝔢_q, so that
    q̇ − q̄̇ = 𝔯_q − σ𝔢_q, which is at most R + σE_q ≤ 2d̃/k. And 𝔢̇_q = −σ𝔢_q + 𝔯_q, 𝔯̇_q = −k𝔯_q + d_q
    are linear with constant coefficients: q̇ − q̄̇ is the convolution of d_q with ġ, where
    g(t) = (e^{−σt} − e^{−kt})/(k − σ) is the response of 𝔢_q to an impulse. Its norm is at most
    d̃ ∫|ġ|, d̃ times the variation of g, which rises from 0 to its maximum at t* = ln(k/σ)/(k − σ)
    and falls to 0: 2 g(t*) d̃ = 2d̃ e^{−σt*}/k. ∎ A d that is constant for long, and changes its sign
    t* before the end, attains it.

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

    𝔭₀ is what 𝔭 would be if J_x stood still, 𝔭̇₀ = −σ𝔭₀ + 𝔯, from zero like 𝔭; ‖Ŵ⁻¹𝔭₀‖ ≤ d̃/(kσ).

    *Bound.* αd̃/(kσ(σ − ω)).

    *Proof.* 𝔢̇_y = −σ𝔢_y + J_x𝔯 says 𝔭̇ = −σ𝔭 + 𝔯 − A𝔭 with A = J_x⁻¹J̇_x. So δ = 𝔭 − 𝔭₀ has
    δ̇ = −σδ − A(𝔭₀ + δ) and D⁺‖δ‖ ≤ −(σ − ω)‖δ‖ + ‖AŴ‖‖Ŵ⁻¹𝔭₀‖. ∎ Rows of zeros of A leave their
    components of 𝔭 as they are. In the norm ‖Ŵ⁻¹·‖, δ would ask for a σ that is larger by up to the
    ratio of Ŵ's entries; here they ask for none.

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

    *Bound.* |θ − θ̄| ≤ ρ and |φ − φ̄| ≤ ρ/cos θ_max with ρ = ‖𝔬 − 𝔬̄‖ + √n‖q − q̄‖.

    *Proof.* R_WB = R(𝔬)R_BE(q)ᵀ. Move 𝔬 and q from 𝔬̄ and q̄ to their places on a straight line. The
    axes of 𝔬's φ and θ are orthogonal, so R_WB turns by ‖𝔬 − 𝔬̄‖ at most, apart from a turn about
    the vertical, which changes neither φ nor θ of the vehicle; joints that move by δq turn the arm,
    seen from its tip, by Σ|δqᵢ| ≤ √n‖δq‖, and the vehicle with it. Its Euler angles then change by
    |dθ| ≤ ρ and |dφ| ≤ ρ/cos θ, and on the way |θ| ≤ |θ̄| + ρ ≤ θ_max. ∎

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

    *Bound.* E and R of (1) with

        a = σJ̲ − L_𝔠,   g = J̄,   b = k − L₂ − σJ̄²,
        G = L₁ + L₂σJ̄ + σL_𝔠J̄ + σJ̃ + σ²J̄³,

    if a > 0, b > 0 and ab > J̄G; then ‖𝔷‖ ≤ R + σJ̄E. All of it goes to zero like d̃/k.

    *Proof.* Let J = J(𝔮̄), 𝔟 = (J(𝔮) − J)ζ, 𝔩 = f(𝔮, ζ) − f(𝔮̄, ζ̄). With 𝔷 = 𝔯 − σJᵀ𝔢

        𝔢̇ = 𝔟 + J𝔷 = 𝔟 − σJJᵀ𝔢 + J𝔯,
        𝔯̇ = 𝔩 − k𝔯 + d + σJ̇ᵀ𝔢 + σJᵀ(𝔟 + J𝔯 − σJJᵀ𝔢),

    where 𝔢ᵀJJᵀ𝔢 ≥ J̲E², ‖𝔟‖ ≤ L_𝔠E and ‖𝔩‖ ≤ L₁E + L₂‖𝔷‖ ≤ L₁E + L₂(R + σJ̄E). Collect E and R. ∎

    Args:
        constants: Constants of the robot over its constraint sets; see there what they presuppose.
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
        Condition("a = σJ̲ − L_c", a, ">", 0.0, theorem=TRANSPOSE),
        Condition("b = k − L₂ − σJ̄²", b, ">", 0.0, theorem=TRANSPOSE),
        # A positive product of two negative numbers is no consolation.
        Condition("ab, above J̄G", a * b if min(a, b) > 0.0 else -abs(a * b), ">", J * G,
                  theorem=TRANSPOSE)))


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

    *Proof.* For a > 0 the conditions say k > h(σ) = L₂ + σJ̄² + J̄G(σ)/(σJ̲ − L_𝔠). G is a quadratic
    in σ; with x = σJ̲ − L_𝔠 > 0 and J̄G = N₀ + N₁x + N₂x²,

        h = L₂ + J̄²(x + L_𝔠)/J̲ + N₀/x + N₁ + N₂x,

    which is convex in x and smallest at x = √(N₀/(N₂ + J̄²/J̲)). N₀ = 0 only if L₁ = L_𝔠 = 0; then h
    falls as σ → 0, and the limit at σ = 0 is returned, which is no gain to use. ∎

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
