"""Tube in a hold: the deviations once the plan stands, by a fixed point of speeds and forces.

A force changes with the speed of the tip, and the tip deviates because forces change. While a plan
moves, both are bounded by the limits of speed; once it stands, speeds w = (⟨𝔭̇⟩, ‖ν₂‖, ‖q̇‖) are
those of the deviation alone. With the radii R(w) by (3) of `sensor_error`, V(w) = v̄ + BR(w) their
speeds and v̄ those at which a plan counts as standing, any w* ≥ V(w*) with

    Γ(λ)(V(w₀) − V(w*)) < w₀ − w*,        Γ the growth of the gains by weights e^λt,          (1)

bounds them from the time t on, up to Γe^−λt(w₀ − w*), w₀ those of the approach. The least w* is
found by repeated insertion from w₀. tube/contact/theory.md#tube-in-a-hold.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from uvms_drake.tube.contact.sensor_error import MeasuredForceBounds
from uvms_drake.tube.row_gains import grown_gains, lagged_gains

SETTLED = 0.01
"""Relative excess of the radii over those of the fixed point, from the printed time on."""
SHARES = np.linspace(0.05, 0.85, 17)
"""λ over the slowest rate of loop and sensor."""
ROUNDS, CLOSE = 500, 1e-6
"""Rounds in which w* is found, and the relative change at which it is."""


class TipBounds(NamedTuple):
    """Radii of the tip and of two speeds."""

    depth: float
    """|n·𝔢_p| [m]."""
    position: float
    """‖𝔢_p‖ [m]."""
    depth_speed: float
    """|n·𝔢̇_p| [m/s]."""
    tip_speed: float
    """‖𝔢̇_p‖ [m/s]."""
    nu2: float
    """‖ν₂ − ν̄₂‖ [rad/s]."""
    qdot: float
    """‖q̇ − q̄̇‖ [rad/s]."""


class HoldLaw(NamedTuple):
    """Radii of a law for the forces of a hold."""

    bounds: Callable[[MeasuredForceBounds, float, float], TipBounds]
    """Function of the forces and of bounds of ‖ν₂‖ and ‖q̇‖ [rad/s]."""
    k: float
    """Gain of the tip's rows [1/s]."""
    sigma: float
    """σ of them [1/s]."""


class Settled(NamedTuple):
    """Bounds in a hold, and the time from which on they hold."""

    bounds: TipBounds
    """Radii; infinite if there are none."""
    speeds: np.ndarray
    """Advance of the tip [m/s], ‖ν₂‖ and ‖q̇‖ [rad/s] (3,), with the plan's."""
    time: float
    """Time since the plan stands [s]; inf if (1) never holds."""
    ratio: float
    """Least ratio of both sides of (1), below 1."""


def growth_of(law: HoldLaw, lag: float, period: float, rate: float) -> float:
    """Returns Γ(λ), the largest growth of a gain of the radii by weights e^λt of the past.

    Args:
        law: The law.
        lag: T of the sensor [s].
        period: h of the sensor [s].
        rate: λ, below 1/T and the rates of the loop [1/s].
    """
    k, sigma = law.k, law.sigma
    row = float(np.max(grown_gains(k, sigma, rate)[:2] / grown_gains(k, sigma, 0.0)[:2]))
    # Weights of the past in a reading, and its mean age.
    reading = math.exp(rate * period) / (1.0 - rate * lag)
    delayed = (reading - 1.0) / (rate * (lag + period))
    # A ripple by its own kernel, or by all that a reading may miss.
    missed = 0.5 * row * (1.0 + reading)
    if lag > 0.0:
        weighted, plain = (np.array(lagged_gains(k, sigma, lag, period, growth))
                           for growth in (rate, 0.0))
        missed = float(np.max(weighted / plain))
    velocity = k / (k - rate)  # Of J̃‖𝔯‖, which is a row of its own.
    return delayed * row * max(delayed * velocity, missed)


def settled(law: HoldLaw, approach: MeasuredForceBounds, limits: np.ndarray,
            force: Callable[[float], MeasuredForceBounds], standing: np.ndarray, tilt: float
            ) -> Settled:
    """Returns the bounds in a hold.

    Args:
        law: The law.
        approach: Forces while a plan moves.
        limits: w₀, largest advance of the tip [m/s], ‖ν₂‖ and ‖q̇‖ [rad/s] (3,) of the real robot.
        force: Function that returns the forces of a hold by the advance of the tip.
        standing: v̄ (3,), those of a plan that counts as standing.
        tilt: α.
    """
    def bounds(speeds: np.ndarray) -> np.ndarray:
        return np.array(law.bounds(force(float(speeds[0])), float(speeds[1]), float(speeds[2])))

    def speeds_of(radii: np.ndarray) -> np.ndarray:
        """Returns V, which the limits bound, too."""
        now = TipBounds(*radii)
        return np.minimum(limits, standing + np.array(
            [now.depth_speed + tilt * now.tip_speed, now.nu2, now.qdot]))

    first = np.array(law.bounds(approach, float(limits[1]), float(limits[2])))
    w = limits
    for _ in range(ROUNDS):
        last, w = w, speeds_of(bounds(w))
        if np.all(last - w <= CLOSE * last):
            break
    w, radii = last, bounds(last)  # V(w) ≤ w, since V is monotone.
    # The shortest time of all λ for which (1) holds.
    coming, going = speeds_of(first) - speeds_of(radii), np.maximum(limits - w, 1e-12)
    ratio, time, best = math.inf, math.inf, np.full(len(radii), np.inf)
    for rate in SHARES * min(law.k, law.sigma, 1.0 / max(approach.lag, 1e-9)):
        growth = growth_of(law, approach.lag, approach.period, float(rate))
        here = growth * float(np.max(coming / going)) if w[0] < limits[0] else math.inf
        ratio = min(ratio, here)
        excess = growth * float(np.max((first - radii) / np.maximum(radii, 1e-12)))
        now = math.log(max(excess / SETTLED, 1.0)) / float(rate)
        if here < 1.0 and now < time:
            time, best = now, radii + math.exp(-rate * now) * growth * (first - radii)
    speeds = speeds_of(best) if math.isfinite(time) else limits
    return Settled(TipBounds(*map(float, best)), speeds, time, ratio)
