"""The explored front: where the tip may go without pressing too hard, by what it has felt so far.

*A measurement is for good.* If φ ≤ φ⁺ ≤ F_max at a point 𝔮, then φ(𝔭) ≤ φ⁺ + κ₊⟨𝔭 − 𝔮⟩₊ ≤ F_max
for every 𝔭 of the cone

    C(𝔞) = {𝔭 : ⟨𝔭 − 𝔞⟩ ≤ 0},    its apex 𝔞 = 𝔮 + (F_max − φ⁺)/κ₊ n:

⟨𝔭 − 𝔮⟩ = ⟨𝔭 − 𝔞 + (𝔞 − 𝔮)⟩ = ⟨𝔭 − 𝔞⟩ + (F_max − φ⁺)/κ₊. Straight on, α = 0, it is the half-space
x ≤ x_safe = x_𝔮 + (F_max − φ⁺)/κ₊. If φ⁺ > F_max the measurement says nothing of any place: behind
𝔮 the force is no larger, but nobody knows how far back it is below F_max; a soft wall gives in
slowly. (To write x_safe as the maximum over *all* measurements is wrong for those, if taken alone:
with φ = 46 N, F_max = 45 N and κ = κ₊/10, x_𝔮 − 1 N/κ₊ still has 45.9 N.)

*A reading is older than it looks.* Sensors hold, delay and average. A reading that is any average
of the force over the last W seconds is at least the least force of that time, so some 𝔭_s in it has
φ(𝔭_s) ≤ φ⁺, with the fastest retreat of that time in φ⁺; and every 𝔮 with ⟨𝔮 − 𝔭_s⟩ ≤ 0 for all s
has φ(𝔮) ≤ φ(𝔭_s). The deepest such 𝔮 beside the tip 𝔭 is 𝔭 − n max_s⟨𝔭 − 𝔭_s⟩. No filter has to be
known for that, only W. Forces that turn, at an edge or with the friction, cancel in an average: of
one only the part along n counts, see `SurfaceClass.normal_force_bound`. Of the s between two
readings, see `between_readings`. (A lag T without an end gives the older past the weight e^(−W/T),
so the force is at most the reading over 1 − e^(−W/T): take W = 3T and ν for the 5 %.)

*The pyramid never shrinks* where the plan goes. A plan keeps linear rows, `SurfaceClass.facets`:
the pyramid n·m + α‖P_t m‖₁ ≤ 0 in the cone, with the same apex. One takes the place of another only
if nothing is lost over all places across n at which the rest of the plan that is followed is
(`plan_extent`), see `dominates`, so a plan that was allowed still is. What lies behind a tip that
slides is lost, for no plan goes there.

*The real tip and the planned one.* 𝔮 is the real tip. If the planned tip 𝔭̄ is at most E_n from it
along n and E_t across, then N·(𝔭̄ − 𝔞) ≤ −(E_n + √2 αE_t) for all facets N puts the real one in
C(𝔞). Between the knots of a plan whose acceleration is constant in each interval, see
`approach.between_knots`.
"""

import numpy as np

from uvms_drake.model.surface.surface_class import SurfaceClass


def apex(surface: SurfaceClass, points: np.ndarray, velocities: np.ndarray, force: np.ndarray,
         force_max: float, noise: float, period: float = 0.0) -> np.ndarray:
    """Returns the apex 𝔞 (..., 3) of what a reading makes safe; NaN if it says nothing.

    It says nothing either if one of the velocities is NaN, for a time at which nobody saw the tip.

    Args:
        surface: The class of walls.
        points: Tip positions of the reading's time W, the present one last (..., m, 3) [m].
        velocities: Tip velocities of that time (..., m, 3) [m/s].
        force: The reading (..., 3) [N].
        force_max: F_max, largest static normal force [N].
        noise: ν, see `SurfaceClass.normal_force_bound` [N].
        period: Time between two of the positions [s]; 0 if the tip was nowhere else.
    """
    averaged = points.shape[-2] > 1
    bound = np.max(surface.static_force_bound(
        force[..., None, :], velocities, noise, averaged=averaged), axis=-1)
    now = points[..., -1:, :]
    back = np.max(surface.advance(now - points), axis=-1)
    back += between_readings(surface, velocities, period)
    safe_distance = np.where(bound <= force_max, (force_max - bound) / surface.stiffness - back, np.nan)
    return now[..., 0, :] + safe_distance[..., None] * surface.direction


def between_readings(surface: SurfaceClass, velocities: np.ndarray, period: float) -> np.ndarray:
    """Returns by how much ⟨𝔭 − 𝔭_s⟩ may exceed its values at the readings about s (...) [m].

    Let the velocity between two readings, T apart, be a mean of those at them, as it is with a
    constant acceleration; what is not so is in ν. ⟨·⟩ is convex, so there ⟨±v⟩ ≤ A_±, the larger of
    the two values and zero, and a retreat is not faster than at a reading. By subadditivity

        ⟨𝔭 − 𝔭_s⟩ ≤ ⟨𝔭 − 𝔭_i⟩ + ⟨−∫v⟩ ≤ ⟨𝔭 − 𝔭_i⟩ + (s − t_i) A_−,
        ⟨𝔭 − 𝔭_s⟩ ≤ ⟨𝔭 − 𝔭_{i+1}⟩ + ⟨∫v⟩ ≤ ⟨𝔭 − 𝔭_{i+1}⟩ + (t_{i+1} − s) A_+.

    The lesser of a rising and a falling line is at most T A_+A_−/(A_+ + A_−): nothing, for a tip
    that does not turn round, and at most T/2 times the larger of the two.

    Args:
        surface: The class of walls.
        velocities: Tip velocities at the readings (..., m, 3) [m/s].
        period: T [s].
    """
    rates = np.stack([np.maximum(surface.advance(sign * velocities), 0.0) for sign in (1.0, -1.0)])
    rates = np.maximum(rates[..., 1:], rates[..., :-1])
    total = np.sum(rates, axis=0)
    turned = np.prod(rates, axis=0) / np.where(total == 0.0, 1.0, total)
    return period * np.max(turned, axis=-1, initial=0.0)


def free_distance(surface: SurfaceClass, at: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Returns how far ahead of 𝔭 (..., 3) along n the cone of an apex (..., 3) ends (...) [m].

    It is −⟨𝔭 − 𝔞⟩, below zero outside; −inf for an apex that is NaN.
    """
    distance = -surface.advance(point - at)
    return np.where(np.isnan(distance), -np.inf, distance)


def dominates(surface: SurfaceClass, new: np.ndarray, old: np.ndarray, extent: np.ndarray
             ) -> np.ndarray:
    """Returns whether an apex takes the place of the old one: nothing is lost where plans go.

    With ‖·‖ that of `SurfaceClass.around`, at a lateral place 𝔲 the new pyramid has all of the old
    one iff s' − α‖𝔲 − 𝔲'‖ ≥ s − α‖𝔲 − 𝔲₀‖, s = n·𝔞 and 𝔲', 𝔲₀ the apexes' own places. Along each
    axis the difference |uᵢ − u'ᵢ| − |uᵢ − u₀ᵢ| is monotone in uᵢ, so in a box of places it is
    largest at an end, and

        s' ≥ s + α Σᵢ max over the ends uᵢ of (|uᵢ − u'ᵢ| − |uᵢ − u₀ᵢ|)

    iff nothing is lost in all of the box. A tip that presses at a place keeps all that it has. One
    that slides gains α for each metre that it leaves behind, more than any wall takes.

    Args:
        surface: The class of walls.
        new: Apex of the latest reading (..., 3); NaN replaces nothing.
        old: The one so far (..., 3); NaN is replaced by any.
        extent: Ends of the box, least and largest 𝔲 = (t₁, t₂)·𝔭 of places (..., 2, 2) [m].
    """
    places = surface.across(new)[..., None, :], surface.across(old)[..., None, :]
    closer = np.subtract(*(np.abs(extent - place) for place in places))
    lost = surface.tilt * np.sum(np.max(closer, axis=-2), axis=-1)
    better = surface.depth(new - old) >= lost
    return ~np.isnan(new[..., 0]) & (np.isnan(old[..., 0]) | better)


def bounds(surface: SurfaceClass, at: np.ndarray, margin: float) -> np.ndarray:
    """Returns N·𝔞 − E of each facet N (..., number of facets) [m]: N·𝔭̄ up to them is φ ≤ F_max.

    Args:
        surface: The class of walls.
        at: 𝔞 (..., 3); NaN, for no place is known to be safe, gives −∞.
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
        place: Where across n (..., 3) [m].
        margin: E [m].
    """
    depth = surface.depth(at) - surface.tilt * surface.around(place - at) - margin
    return np.where(np.isnan(depth), -np.inf, depth)
