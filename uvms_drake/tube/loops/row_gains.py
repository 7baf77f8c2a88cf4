"""Peak-to-peak gains of a row of the law `resolved`, also from a force behind a sensor.

Every constant combination of rows of 𝔯̇ = −k𝔯 + δ, 𝔢̇ = −σ𝔢 + 𝔯 obeys ë + (k + σ)ė + kσe = δ, so
that

    e = δ/((s + k)(s + σ)),   ė = sδ/(...),   u − ū = −((k + σ)s + kσ)δ/(...),   𝔯 = δ/(s + k).

`Gains` are the L₁ norms of these four impulse responses: of any δ (`instant_gains`), and of the
error δ = F̂ − F of a measurement F̂ with a first-order lag T, under a zero-order hold of h
(`lagged_gains`). See tube/loops/theory.md#error-of-a-held-and-lagged-measurement.
"""

import math
from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from uvms_drake.common.errors import require
from uvms_drake.tube.loops.sampled_loop import PHASES, peak_gain
from uvms_drake.tube.resolved.bounds import joint_rate_radius
from uvms_drake.tube.resolved.image import input_gain

MOMENT_POINTS, MOMENT_SPAN = 20_001, 40.0
"""Points of the quadrature of a moment for each time constant, and its length in them."""
FINENESS = 400
"""Points of the quadrature of |K| in each time constant."""


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
    return Gains(*(float(np.trapezoid(weight(t) * np.abs(decays @ np.array(parts)), t)) for parts in (
        (-1.0 / span, 1.0 / span), (k / span, -sigma / span),
        (k**2 / span, -sigma**2 / span), (1.0, 0.0))))


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
