"""Safe region of the tip: the inner approximation of the set φ ≤ F_max that readings prove.

A reading that bounds the static force at 𝔮 by φ⁺ ≤ F_max makes the cone

    C(𝔞) = {𝔭 : ⟨𝔭 − 𝔞⟩ ≤ 0},    apex 𝔞 = 𝔮 + (F_max − φ⁺)/κ₊ n,

safe for good (⟨·⟩: `SurfaceClass.advance`); for α = 0 it is the half-space x ≤ x_𝔮 + (F_max −
φ⁺)/κ₊. A plan keeps the facets of the pyramid in it. Proofs in control/contact/theory.md: the cone
and readings that bound no place (#readings-that-bound-no-place), delayed and averaged readings
(#age-of-a-reading), the time between two (#tip-between-two-readings), replacement of one apex by
another (#pyramid-that-never-shrinks), the margin E (#planned-tip-within-the-safe-region).
"""

from typing import NamedTuple

import numpy as np

from uvms_drake.model.surface.surface_class import SurfaceClass


class TipAdvance(NamedTuple):
    """Advances ⟨·⟩ of a tip with the positions 𝔭_s and velocities v of a reading's time W."""

    forth: np.ndarray
    """⟨v⟩ (..., m) [m/s]."""
    retreat: np.ndarray
    """⟨−v⟩ (..., m) [m/s]."""
    since: np.ndarray
    """⟨𝔭 − 𝔭_s⟩ (..., m) [m], 𝔭 the last position."""
    before: np.ndarray
    """⟨𝔭_s − 𝔭⟩ (..., m) [m]."""


def tip_advance(surface: SurfaceClass, points: np.ndarray, velocities: np.ndarray) -> TipAdvance:
    """Returns the advances of a tip, all at once; the arguments are those of `apex`."""
    moved = points[..., -1:, :] - points
    return TipAdvance(*surface.advance(np.array([velocities, -velocities, moved, -moved])))


def apex(surface: SurfaceClass, points: np.ndarray, velocities: np.ndarray, force: np.ndarray,
         force_max: float, noise: float, period: float = 0.0, advance: TipAdvance | None = None
         ) -> np.ndarray:
    """Returns the apex 𝔞 (..., 3) of the cone that a reading proves safe; NaN if there is none.

    There is none either if one of the velocities is NaN: the tip's motion was not measured.

    Args:
        surface: The class of walls.
        points: Tip positions of the reading's time W, the present one last (..., m, 3) [m].
        velocities: Tip velocities of that time (..., m, 3) [m/s].
        force: The reading (..., 3) [N].
        force_max: F_max, largest static normal force [N].
        noise: ν, see `SurfaceClass.normal_force_bound` [N].
        period: Time between two of the positions [s]; 0 if the tip was nowhere else.
        advance: The advances of the tip, if they are known already.
    """
    advance = advance or tip_advance(surface, points, velocities)
    normal = surface.normal_force_bound(force, noise, averaged=points.shape[-2] > 1)
    bound = surface.static_behind(normal[..., None], advance.retreat).max(axis=-1)
    back = advance.since.max(axis=-1)
    back = back + between_readings(advance, period)
    free = np.where(bound <= force_max, (force_max - bound) / surface.stiffness - back, np.nan)
    return points[..., -1, :] + free[..., None] * surface.direction


def between_readings(advance: TipAdvance, period: float) -> np.ndarray:
    """Returns the largest excess of ⟨𝔭 − 𝔭_s⟩ over its values at the readings about s (...) [m].

    With A_± the larger of the values of ⟨±v⟩ at two readings, T apart, and zero it is
    T A_+A_−/(A_+ + A_−), zero for a tip that does not turn back: see
    control/contact/theory.md#tip-between-two-readings.

    Args:
        advance: Advances of the tip.
        period: T [s].
    """
    rates = np.maximum(np.array(advance[:2]), 0.0)
    forth, back = np.maximum(rates[..., 1:], rates[..., :-1])
    total = forth + back
    turned = forth * back / np.where(total == 0.0, 1.0, total)
    excess: np.ndarray = period * turned.max(axis=-1, initial=0.0)
    return excess


def dominates(surface: SurfaceClass, new: np.ndarray, old: np.ndarray, extent: np.ndarray
             ) -> np.ndarray:
    """Returns whether an apex's pyramid contains that of the old one over a box of lateral places.

    With s = n·𝔞 and 𝔲', 𝔲₀ the lateral places of the apexes it does iff

        s' ≥ s + α Σᵢ max over the ends uᵢ of (|uᵢ − u'ᵢ| − |uᵢ − u₀ᵢ|),

    see control/contact/theory.md#pyramid-that-never-shrinks.

    Args:
        surface: The class of walls.
        new: Apex of the latest reading (..., 3); NaN dominates nothing.
        old: Present apex (..., 3); NaN is dominated by any.
        extent: Ends of the box, least and largest 𝔲 = (t₁, t₂)·𝔭 of places (..., 2, 2) [m].
    """
    places = surface.across(new)[..., None, :], surface.across(old)[..., None, :]
    closer = np.subtract(*(np.abs(extent - place) for place in places))
    lost = surface.tilt * closer.max(axis=-2).sum(axis=-1)
    better = surface.depth(new - old) >= lost
    return ~np.isnan(new[..., 0]) & (np.isnan(old[..., 0]) | better)


def bounds(surface: SurfaceClass, at: np.ndarray, margin: float) -> np.ndarray:
    """Returns N·𝔞 − E of each facet N (..., number of facets) [m]: N·𝔭̄ up to them is φ ≤ F_max.

    Args:
        surface: The class of walls.
        at: 𝔞 (..., 3); NaN, no place is proven safe, gives −∞.
        margin: E = E_n + √2 αE_t of the planned tip, and errors of the measured position [m].
    """
    depths = at @ surface.facets.T - margin
    return np.where(np.isnan(depths), -np.inf, depths)


def safe_depth(surface: SurfaceClass, at: np.ndarray, place: np.ndarray, margin: float
               ) -> np.ndarray:
    """Returns x_safe (...) [m], the largest x̄ of a tip at a place across n within the `bounds`.

    Args:
        surface: The class of walls.
        at: 𝔞 (..., 3).
        place: Places across n (..., 3) [m].
        margin: E [m].
    """
    depth = surface.depth(at) - surface.tilt * surface.around(place - at) - margin
    return np.where(np.isnan(depth), -np.inf, depth)
