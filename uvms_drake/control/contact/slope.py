"""How steep a wall is: least squares of force against depth, with what its noise can do to it.

A line F = F₀ + κ(x − x₀) through readings (x_i, F_i) off by at most ν_i, with weights g_i w_i,
Σ g_i = 1 and w_i = (ν/ν_i)², has the slope κ_LS = S_xF/S_xx of the weighted central moments. On a
wall of slope κ, F_i = κx_i + const + n_i, |n_i| ≤ ν_i,

    |κ_LS − κ| = |Σ g_i w_i (x_i − x₀) n_i| / S_xx ≤ ν Σ g_i √w_i |x_i − x₀| / S_xx ≤ ν/√S_xx

by Cauchy and Schwarz. So κ̂ = min(κ₊, (κ_LS)₊ + ν/√S_xx), see `slope`, is in (0, κ₊] and *never
below the slope of a straight wall*: as long as nothing is known of it κ̂ = κ₊, and the force is
approached from below (`target`). An error of x_i counts in ν_i, κ₊ times as large: the line is one
through what was measured.

*Weights count the way, not the time*: the older readings keep e^(−u), the new one gets 1 − e^(−u),
u the change of the force along the way since the last one, κ̂|Δx|, over `memory`. A tip at rest
learns and forgets nothing, and of a soft and a stiff wall the same range of force is remembered.

*A wall that is no line* (soft on hard, gone, moved) gives itself away: F₀ is off by at most
Σ g_i w_i ν_i / W ≤ ν/√W, W = Σ g_i w_i, κ_LS by ν/√S_xx, so a reading at x on a straight wall is
off the line by at most ν_i + ν/√W + ν|x − x₀|/√S_xx. If it is off by more, all before is forgotten:
κ̂ = κ₊.

*A slide* on a wall that runs off n is none of this: x changes at one force, slowly enough to pass
for a soft wall, and κ̂ falls *below* κ. With ν = 4.2 N, κ₊ = 1000 N/m and κ = 700 N/m it is at 780
N/m after 0.3 m at 3°, and below κ after 0.4 m; with a better sensor sooner. Below κ/2 the press is
no contraction (`target`), though the front holds whatever κ̂ is.
"""

from typing import NamedTuple

import numpy as np


class Line(NamedTuple):
    """The moments of what is remembered of the readings; scalars, or arrays of walls."""

    weight: np.ndarray
    """W = Σ g_i w_i; zero: nothing yet."""
    depth: np.ndarray
    """x₀, weighted mean depth [m]."""
    force: np.ndarray
    """F₀, weighted mean force [N]."""
    spread: np.ndarray
    """S_xx = Σ g_i w_i (x_i − x₀)² [m²]."""
    rise: np.ndarray
    """S_xF = Σ g_i w_i (x_i − x₀)(F_i − F₀) [N m]."""
    last: np.ndarray
    """Depth of the last reading [m]."""


NOTHING = Line(*np.zeros(6))
"""No reading yet."""


def _ratio(a: np.ndarray | float, b: np.ndarray, otherwise: float) -> np.ndarray:
    """Returns a/b, and another value where b is zero."""
    return np.where(b > 0.0, a / np.where(b > 0.0, b, 1.0), otherwise)


def slope_error(line: Line, noise: float) -> np.ndarray:
    """Returns ν/√S_xx [N/m], the largest error of κ_LS on a straight wall; inf without a spread."""
    return _ratio(noise, np.sqrt(line.spread), np.inf)


def slope(line: Line, most: float, noise: float) -> np.ndarray:
    """Returns κ̂ [N/m], in (0, κ₊] and at least the slope of a straight wall.

    Args:
        line: What is remembered.
        most: κ₊ [N/m].
        noise: ν [N].
    """
    fitted = np.maximum(_ratio(line.rise, line.spread, 0.0), 0.0)
    return np.minimum(most, fitted + slope_error(line, noise))


def surface_depth(line: Line, most: float, noise: float) -> np.ndarray:
    """Returns x₀ − F₀/κ̂ [m], where the wall begins by the line; NaN without a reading."""
    depth = line.depth - line.force / slope(line, most, noise)
    return np.where(line.weight > 0.0, depth, np.nan)


def excess(line: Line, depth: np.ndarray, force: np.ndarray, most: float, noise: float,
           error: np.ndarray) -> np.ndarray:
    """Returns by how much a reading is above (> 0) or below what a straight wall allows [N].

    See the module; the slope is between 0 and κ₊ in any case. Zero without a line.

    Args:
        line: What is remembered.
        depth: x of the reading [m].
        force: F [N].
        most: κ₊ [N/m].
        noise: ν [N].
        error: ν_i of this reading [N].
    """
    away = depth - line.depth
    fitted, unsure = _ratio(line.rise, line.spread, 0.0), slope_error(line, noise)
    ends = (np.maximum(fitted - unsure, 0.0) * away, np.minimum(fitted + unsure, most) * away)
    allowed = noise * np.sqrt(_ratio(1.0, line.weight, 0.0)) + error
    off = force - line.force
    above = np.maximum(off - np.maximum(*ends) - allowed, 0.0)
    below = np.minimum(off - np.minimum(*ends) + allowed, 0.0)
    return np.where(line.weight > 0.0, above + below, 0.0)


def with_reading(line: Line, depth: np.ndarray, force: np.ndarray, most: float, noise: float,
                 memory: float, error: np.ndarray) -> Line:
    """Returns the line with one more reading of a contact (recursive least squares).

    It is begun anew by a reading that no straight wall allows.

    Args:
        line: What is remembered.
        depth: x [m].
        force: F [N].
        most: κ₊ [N/m].
        noise: ν [N].
        memory: Change of the force over which a reading is forgotten by 1/e [N].
        error: ν_i ≥ ν of this reading [N].
    """
    way = np.abs(depth - line.last) * slope(line, most, noise) / memory
    new = (line.weight == 0.0) | (excess(line, depth, force, most, noise, error) != 0.0)
    keep = np.where(new, 0.0, np.exp(-way))
    w = (1.0 - keep) * (noise / error) ** 2
    weight = keep * line.weight + w
    dx, dF = depth - line.depth, force - line.force
    share = _ratio(w, weight, 0.0)
    joint = keep * line.weight * share
    return Line(weight, line.depth + share * dx, line.force + share * dF,
                keep * line.spread + joint * dx * dx, keep * line.rise + joint * dx * dF, depth)


def without_contact(line: Line, depth: np.ndarray, force: np.ndarray, most: float, noise: float,
                    error: np.ndarray) -> Line:
    """Returns the line after a reading without contact: nothing, if there should have been one.

    In front of the wall the force is above the line, which goes on below zero. The arguments are
    those of `with_reading`.
    """
    gone = excess(line, depth, force, most, noise, error) < 0.0
    return Line(*(np.where(gone, 0.0, moment) for moment in line))
