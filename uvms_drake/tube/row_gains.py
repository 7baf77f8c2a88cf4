"""How far one row of the law `resolved` is pushed: peak-to-peak gains of an LTI loop.

Every constant combination of rows of 𝔯̇ = −k𝔯 + δ, 𝔢̇ = −σ𝔢 + 𝔯 obeys ë + (k + σ)ė + kσe = δ, so that

    e = δ/((s + k)(s + σ)),   ė = sδ/(...),   u − ū = −((k + σ)s + kσ)δ/(...),   𝔯 = δ/(s + k).

A filter with the impulse response g(t) takes |δ| ≤ 1 to at most ‖g‖₁ = ∫|g|, which the worst δ
attains. So `Gains` are these four norms: of what is known of δ at every instant (`instant_gains`),
and of what a sensor misses (`lagged_gains`).

*What a sensor misses.* A force F goes through a first-order lag T and is sampled and held over a
period h: F̂ = HF, at s in [tₖ, tₖ₊₁)

    (HF)(s) = ∫_{−∞}^{tₖ} e^{−(tₖ−u)/T} F(u) du/T.

A law that takes F̂ for F leaves δ = F̂ − F. However fast F changes, the row is pushed to

    e(t) = −∫ K(t, u) F(u) du,   K(t, u) = g(t − u) − e^{−(t_j−u)/T} Σ_{k≥j} e^{−(tₖ−t_j)/T} I_k/T,

t_j the first sample not before u, I_k = ∫g(t − s)ds over the k-th interval up to t: by at most
sup_t ∫|K(t, u)|du for |F| ≤ 1. For h short beside T and T beside 1/k it is about (T + h/2)‖ġ‖₁, far
less than the 2‖g‖₁ of somebody who knows of F̂ − F only how large it can be; a lag forgives a push
that it sees, if late. The longer h is beside T, the more a force in step with the samples hides
between them. A constant F leaves nothing.
"""

import math
from typing import NamedTuple

import numpy as np

from uvms_drake.tube.tube_image import input_gain
from uvms_drake.tube.tubes import joint_rate_radius

POINTS = 200
"""Points of the quadrature of |K| in each period."""
PHASES = 9
"""Instants t within a period at which the gain is computed; the largest counts."""
DECAY = 20.0
"""Number of time constants after which the response is over."""


class Gains(NamedTuple):
    """Largest values by |δ| ≤ 1."""

    position: float
    """Of e [s²]."""
    velocity: float
    """Of ė [s]."""
    input: float
    """Of u − ū [1]."""
    error: float
    """Of 𝔯 [s]."""


def instant_gains(k: float, sigma: float) -> Gains:
    """Returns the gains from a δ that may be anything, in closed form.

    Args:
        k: Velocity gain [1/s].
        sigma: σ [1/s].
    """
    return Gains(1.0 / (k * sigma), joint_rate_radius(k, sigma, 1.0), input_gain(k, sigma), 1.0 / k)


def lagged_gains(k: float, sigma: float, lag: float, period: float) -> Gains:
    """Returns the gains from a force to what a sensor misses of it, by quadrature.

    The error of the quadrature is bounded by the variation of K, see `_integral`, and added.

    Args:
        k: Velocity gain [1/s].
        sigma: σ [1/s].
        lag: T [s]; zero for none: then between two samples all of F can be missed.
        period: h > 0 [s].
    """
    if lag == 0.0:
        return Gains(*(2.0 * gain for gain in instant_gains(k, sigma)))
    if abs(k - sigma) < 1e-6 * k:
        sigma = k * (1.0 - 1e-6)
    span = k - sigma
    return Gains(*(_lagged_gain(np.array(parts), np.array([k, sigma]), lag, period) for parts in (
        (-1.0 / span, 1.0 / span), (k / span, -sigma / span),
        (k**2 / span, -sigma**2 / span), (1.0, 0.0))))


def _lagged_gain(parts: np.ndarray, rates: np.ndarray, lag: float, period: float) -> float:
    """Returns sup_t ∫|K| of g(t) = Σ partsᵢ e^{−ratesᵢ t}."""
    count = math.ceil(DECAY * max(1.0 / np.min(rates), lag) / period)
    kept = math.exp(-period / lag)

    def response(t: np.ndarray) -> np.ndarray:
        out: np.ndarray = np.exp(-np.multiply.outer(t, rates)) @ parts
        return out

    def gain(phase: float) -> float:
        end = count * period + phase
        samples = period * np.arange(count + 1)
        ages = end - samples
        late = np.exp(-np.multiply.outer(np.maximum(ages - period, 0.0), rates))
        held = (late - np.exp(-np.multiply.outer(ages, rates))) @ (parts / rates)  # I_k
        seen = np.zeros(count + 2)
        for j in range(count, -1, -1):
            seen[j] = held[j] / lag + kept * seen[j + 1]
        inside = np.linspace(0.0, period, POINTS + 1)
        before = samples[1:, None] - inside  # u in the period that a sample ends
        kernel = response(end - before) - np.exp(-inside / lag) * seen[1:-1, None]
        last = response(np.linspace(0.0, phase, POINTS + 1))
        return (float(np.sum(_integral(kernel, period / POINTS)))
                + float(_integral(last, phase / POINTS)))

    return max(gain(phase) for phase in np.linspace(0.0, period, PHASES))


def _integral(values: np.ndarray, step: float) -> np.ndarray:
    """Returns a bound of ∫|K| (...) from the values of K at equidistant points (..., m).

    Between two points K is monotone but for terms of second order, and |K| at most the larger of
    the two ends.
    """
    size = np.abs(values)
    return step * np.sum(np.maximum(size[..., 1:], size[..., :-1]), axis=-1)
