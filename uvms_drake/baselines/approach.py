"""Approach and contact logic: the reference of every baseline, by touch.

Its state are x_d, ẋ_d, the smoothed force along n, whether the tip touches, and since when (9).
"""

from dataclasses import dataclass

import numpy as np

from uvms_drake.baselines.law import PERIOD

RELEASE = 0.3
"""Part of the force of a touch below which the contact is lost."""
SMOOTHING = 0.05
"""Time constant of the force for that decision [s]."""


@dataclass
class ApproachGains:
    """Parameters of the approach."""

    speed: float = 0.04
    """Speed along n until the touch [m/s]."""
    across: float = 0.05
    """Largest speed across n, to a place that may jump [m/s]."""
    follow: float = 5.0
    """Time constant by which the reference's depth follows the touched tip's [s]."""
    touch: float = 1.0
    """Force along n of a touch [N]."""
    wait: float = 2.0
    """Time before the approach, for the tare of the sensor [s]."""


def moved_reference(
    gains: ApproachGains, n: np.ndarray, x: np.ndarray, tip: np.ndarray, place: np.ndarray,
    touched: bool, time: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Returns the next x_d and ẋ_d (3,): along n at `speed`, or after the tip; across to `place`.

    Args:
        gains: Its parameters.
        n: Direction (3,).
        x: Last x_d (3,) [m].
        tip: Measured position of the tip (3,) [m].
        place: Place across n (3,) [m].
        touched: Whether the tip is in contact.
        time: Instant [s].
    """
    if time < gains.wait:
        return x, np.zeros(3)
    along = n @ (tip - x) / gains.follow if touched else gains.speed
    across = place - x - n * (n @ (place - x))
    distance = float(np.linalg.norm(across))
    if distance > 0.0:
        across = across * min(gains.across, distance / PERIOD) / distance
    v = along * n + across
    return x + PERIOD * v, v


def next_approach(gains: ApproachGains, n: np.ndarray, old: np.ndarray, tip: np.ndarray,
                  read: float, place: np.ndarray, time: float) -> np.ndarray:
    """Returns the next state (9,).

    Args:
        gains: Its parameters.
        n: Direction (3,).
        old: The state (9,).
        tip: Measured position of the tip (3,) [m].
        read: Measured force along n [N].
        place: Place across n (3,) [m].
        time: Instant [s].
    """
    force = old[6] + PERIOD / SMOOTHING * (read - old[6])
    touched = force > gains.touch * (RELEASE if old[7] else 1.0)
    x, v = moved_reference(gains, n, old[:3], tip, place, touched, time)
    since = time if touched != bool(old[7]) else old[8]
    return np.concatenate([x, v, [force, float(touched), since]])
