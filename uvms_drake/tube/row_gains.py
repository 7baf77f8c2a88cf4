"""Bounds of rows of the error dynamics: by a comparison system, and by peak-to-peak gains.

A law leads to a pair of inequalities for E = ‖𝔢‖ (or ‖𝔢_b‖, a block of rows of the extended
task) and R = ‖𝔯‖,

    D⁺E ≤ −a E + g R,        D⁺R ≤ G E − b R + d̃,        g, G ≥ 0,                          (1)

whose solution with equality from zero bounds both and rises to g d̃/(ab − gG) and a d̃/(ab − gG) if
a + b > 0 and ab > gG: tube/theory.md#comparison-lemma.

Every constant combination of rows of 𝔯̇ = −k𝔯 + δ, 𝔢̇ = −σ𝔢 + 𝔯 obeys ë + (k + σ)ė + kσe = δ, so
that

    e = δ/((s + k)(s + σ)),   ė = sδ/(...),   u − ū = −((k + σ)s + kσ)δ/(...),   𝔯 = δ/(s + k).

`Gains` are the L₁ norms of these four impulse responses: of any δ (`instant_gains`), and of the
error δ = F̂ − F of a measurement F̂ with a first-order lag T, under a zero-order hold of h
(`lagged_gains`). See tube/theory.md#error-of-a-held-and-lagged-measurement.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from uvms_drake.common.errors import require
from uvms_drake.tube.conditions import Condition
from uvms_drake.tube.search.constraint_set import ConstraintSet

PHASES = 16
"""Intervals of a period, at the ends of which the gain is computed."""
TAIL = 1e-7
"""Fraction of a response at which it is over."""
STABLE = 1e-9
"""Distance of a stable loop's eigenvalues from the unit circle."""
MOMENT_POINTS, MOMENT_SPAN = 20_001, 40.0
"""Points of the quadrature of a moment for each time constant, and its length in them."""
FINENESS = 400
"""Points of the quadrature of |K| in each time constant."""


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


def input_gain(k: float, sigma: float) -> float:
    """Returns the L₁ norm of ((k + σ)s + kσ)/((s + k)(s + σ)), symmetric in k and σ.

    Its impulse response (k² e^{−kt} − σ² e^{−σt})/(k − σ) changes its sign once, at
    t* = 2 ln(k/σ)/(k − σ); with F(t) the integral up to t and F(∞) = 1, the norm is 2F(t*) − 1.
    """
    if abs(k - sigma) < 1e-6 * k:
        sigma = k * (1.0 - 1e-6)
    t_star = 2.0 * np.log(k / sigma) / (k - sigma)
    part = (k * (1.0 - np.exp(-k * t_star)) - sigma * (1.0 - np.exp(-sigma * t_star))) / (k - sigma)
    return float(2.0 * part - 1.0)


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


def attitude_radii(declared: ConstraintSet, R_WT: np.ndarray, orientation: float,
                   joints: float = 0.0, num_joints: int = 0) -> tuple[float, float]:
    """Returns the bounds of |φ − φ̄| and |θ − θ̄| of the vehicle.

    They are ρ/cos θ_max and ρ with ρ = c‖𝔬 − 𝔬̄‖ + √n‖q − q̄‖, c = 1 or, if z of Σ_T is not vertical,
    √(1 + sin θ_max) of the tip. Proof: tube/theory.md#attitude-of-the-vehicle.

    Args:
        declared: Limits θ of the vehicle and of the tip.
        R_WT: Axes of Σ_T.
        orientation: Bound of ‖𝔬 − 𝔬̄‖₂ [rad].
        joints: Bound of ‖q − q̄‖₂ [rad].
        num_joints: n.
    """
    upright = R_WT[2, 2] > 1.0 - 1e-12
    turn = orientation * (1.0 if upright else math.sqrt(1.0 + math.sin(declared.tip_pitch)))
    turn += math.sqrt(num_joints) * joints if num_joints > 0 else 0.0
    return turn / math.cos(declared.pitch), turn


def check_gains(k: float, sigma: float, d_bound: float) -> None:
    """Raises `InvalidParameter` unless the gains are positive and d̃ is at least zero."""
    for key, value in (("k", k), ("sigma", sigma)):
        require(bool(0.0 < value < math.inf), key, value, "positive")
    require(bool(0.0 <= d_bound < math.inf), "d_bound", d_bound, "finite, zero or positive")


class Gains(NamedTuple):
    """Largest values by |δ| ≤ 1."""

    position: float
    """Gain to e [s²]."""
    velocity: float
    """Gain to ė [s]."""
    input: float
    """Gain to u − ū [1]."""
    error: float
    """Gain to 𝔯 [s]."""


def instant_gains(k: float, sigma: float) -> Gains:
    """Returns the gains from any δ, in closed form.

    Args:
        k: Velocity gain [1/s].
        sigma: σ [1/s].
    """
    return Gains(1.0 / (k * sigma), joint_rate_radius(k, sigma, 1.0), input_gain(k, sigma), 1.0 / k)


def moments(k: float, sigma: float) -> Gains:
    """Returns the first moments ∫t|g(t)|dt of the impulse responses.

    Times a rate they bound the loss of taking a factor of δ that changes at that rate out of the
    convolution: |∫g(τ)(J(t − τ) − J(t))δ(t − τ)dτ| ≤ sup‖J̇‖ ∫τ|g(τ)|dτ sup|δ|.

    Args:
        k: Velocity gain [1/s].
        sigma: σ [1/s].
    """
    return _weighted(k, sigma, lambda t: t)


def grown_gains(k: float, sigma: float, growth: float) -> np.ndarray:
    """Returns the gains (4,) with an effect of age t counted e^(growth · t) times."""
    return np.array(_weighted(k, sigma, lambda t: np.exp(growth * t)))


def _weighted(k: float, sigma: float, weight: Callable[[np.ndarray], np.ndarray]) -> Gains:
    """Returns ∫w(t)|g(t)|dt of the four impulse responses, by quadrature."""
    if abs(k - sigma) < 1e-6 * k:
        sigma = k * (1.0 - 1e-6)
    rates, span = np.array([k, sigma]), k - sigma
    t = np.unique(np.linspace(0.0, MOMENT_SPAN / rates, MOMENT_POINTS))
    decays = np.exp(-np.multiply.outer(t, rates))
    responses = ((-1.0 / span, 1.0 / span), (k / span, -sigma / span),
                 (k**2 / span, -sigma**2 / span), (1.0, 0.0))
    return Gains(*(float(np.trapezoid(weight(t) * np.abs(decays @ np.array(parts)), t))
                   for parts in responses))


@lru_cache(maxsize=128)
def lagged_gains(k: float, sigma: float, lag: float, period: float, growth: float = 0.0) -> Gains:
    """Returns the gains from a force by the error of its measurement; see `peak_gain`.

    Args:
        k: Velocity gain [1/s].
        sigma: σ [1/s].
        lag: T [s]; zero for none: then between two samples all of F can be missed.
        period: h > 0 [s].
        growth: Rate by which an effect of age t counts e^(growth · t) times [1/s], below all rates.
    """
    if lag == 0.0:
        require(growth == 0.0, "growth", growth, "zero without a lag")
        return Gains(*(2.0 * gain for gain in instant_gains(k, sigma)))
    # The states are e, ė, the lagged force, and its held sample.
    A = np.array([[0.0, 1.0, 0.0, 0.0], [-k * sigma, -(k + sigma), 0.0, 1.0],
                  [0.0, 0.0, -1.0 / lag, 0.0], [0.0, 0.0, 0.0, 0.0]])
    C = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [-k * sigma, -(k + sigma), 0.0, 0.0],
                  [sigma, 1.0, 0.0, 0.0]])
    needed = math.ceil(FINENESS * period * max(k, sigma, 1.0 / lag) / PHASES)
    points = PHASES * max(2, needed)
    A += growth * np.eye(4)
    B = np.array([0.0, -1.0, 1.0 / lag, 0.0])
    return Gains(*map(float, peak_gain(A, B, C, np.eye(4)[[0, 1, 2, 2]], period, points)))


def peak_gain(A: np.ndarray, B: np.ndarray, C: np.ndarray, R: np.ndarray, period: float,
              points: int) -> np.ndarray:
    """Returns the largest |z| (o,) by any input |w(t)| ≤ 1; inf: unstable.

    Args:
        A: Flow (m, m) [1/s].
        B: Input (m,).
        C: Outputs (o, m).
        R: Jump (m, m) at a tick.
        period: Time from a tick to the next [s].
        points: Intervals of the quadrature of |K| in a period, a multiple of `PHASES`.
    """
    step, each, o = period / points, points // PHASES, len(C)
    flow = powers(exponential(A * step), points + 1)
    cycle = R @ flow[-1]
    radius = np.max(np.abs(np.linalg.eigvals(cycle)))
    if radius >= 1.0 - STABLE:
        return np.full(o, np.inf)
    periods = len(A) + math.ceil(math.log(TAIL) / math.log(max(radius, TAIL)))

    # ∫|K| of z, of z̈ and of the states at the phases: impulses before the last tick, and since.
    read = np.concatenate([C, C @ A @ A, np.eye(len(A))])
    response = flow @ B  # (points + 1, m), since an impulse
    after_tick = powers(cycle, periods) @ R @ response.T
    values = np.array([
        np.sum(absolute_integral(read @ flow[j] @ after_tick, step), axis=0)
        + absolute_integral(read @ response[: j + 1].T, step)
        for j in range(0, points + 1, each)])

    # Between two phases: the deviation from a line, and impulses since the phase before.
    z, second, states = np.split(values, [o, 2 * o], axis=1)
    length = period / PHASES
    fourth = np.abs(C @ np.linalg.matrix_power(A, 4)) @ exponential(np.abs(A) * length)
    bend = 0.125 * length**2 * (np.maximum(second[:-1], second[1:])
                                + 0.125 * length**2 * states[:-1] @ fourth.T)
    fresh = np.abs(response[: each + 1] @ C.T)
    uneven = 0.25 * each * step * np.ptp(fresh, axis=0)
    return np.max(np.maximum(z[:-1], z[1:]) + bend, axis=0) + uneven


def powers(matrix: np.ndarray, count: int) -> np.ndarray:
    """Returns matrixⁱ for i < count (count, m, m)."""
    out = np.empty((count, *matrix.shape))
    out[0] = np.eye(len(matrix))
    for i in range(1, count):
        out[i] = matrix @ out[i - 1]
    return out


def absolute_integral(values: np.ndarray, step: float) -> np.ndarray:
    """Returns a bound of ∫|K| (...) from the values of K at equidistant points (..., m).

    Between two points K is monotone but for terms of second order, and |K| at most the larger of
    the two ends.
    """
    size = np.abs(values)
    return step * np.sum(np.maximum(size[..., 1:], size[..., :-1]), axis=-1)


def exponential(A: np.ndarray) -> np.ndarray:
    """Returns e^A (m, m), by its series for A/2ᵏ and k squarings."""
    squarings = max(0, math.ceil(math.log2(max(float(np.linalg.norm(A, 1)), 1e-300))) + 3)
    small, term = A / 2.0**squarings, np.eye(len(A))
    total = term
    for i in range(1, 14):
        term = term @ small / i
        total = total + term
    for _ in range(squarings):
        total = total @ total
    return total
