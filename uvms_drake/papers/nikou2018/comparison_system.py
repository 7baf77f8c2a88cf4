"""Tube of the law `transpose` by a comparison system, and the smallest gain that has one."""

import math
from typing import NamedTuple

from uvms_drake.papers.nikou2018.lemma import LemmaConstants
from uvms_drake.tube.conditions import Condition
from uvms_drake.tube.row_gains import Tube, check_gains

THEOREM = "papers/nikou2018/theory.md#tube-of-the-law-transpose"
"""Theorem of the conditions of `transpose_tube`."""


def transpose_tube(constants: LemmaConstants, k: float, sigma: float, d_bound: float) -> Tube:
    """Returns the tube of 𝔢 = χ − χ̄ under the law `transpose`, u = ū − k𝔯, 𝔯 = 𝔷 + σJ(𝔮̄)ᵀ𝔢.

    E and R of (1) of `tube.row_gains` with

        a = σJ̲ − L_𝔠,   g = J̄,   b = k − L₂ − σJ̄²,
        G = L₁ + L₂σJ̄ + σL_𝔠J̄ + σJ̃ + σ²J̄³,

    if a > 0, b > 0 and ab > J̄G; then ‖𝔷‖ ≤ R + σJ̄E. Proof:
    papers/nikou2018/theory.md#tube-of-the-law-transpose.

    Args:
        constants: Constants of the robot over its constraint sets, with their assumptions.
        k: Velocity gain [1/s].
        sigma: σ.
        d_bound: d̃, bound of ‖d‖₂.
    """
    check_gains(k, sigma, d_bound)
    c, J = constants, constants.J_max
    a = sigma * c.J_min - c.L_c
    b = k - c.L_2 - sigma * J**2
    G = c.L_1 + sigma * (c.L_2 * J + c.L_c * J + c.J_dot) + sigma**2 * J**3
    return Tube(a, J, G, b, d_bound, (
        Condition("a = σJ̲ − L_c", a, ">", 0.0, theorem=THEOREM, topic="a"),
        Condition("b = k − L₂ − σJ̄²", b, ">", 0.0, theorem=THEOREM, topic="b"),
        # The product of two negative numbers does not count.
        Condition("ab, above J̄G", a * b if min(a, b) > 0.0 else -abs(a * b), ">", J * G,
                  theorem=THEOREM, topic="ab")))


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
    which is no gain to use. Proof: papers/nikou2018/theory.md#smallest-gain-of-the-law-transpose.

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
