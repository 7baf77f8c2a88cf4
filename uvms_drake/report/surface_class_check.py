"""Check that the wall of a run was of the specified class, from the run's signals.

It needs only the static force along the tip's path, so it applies to any surface. It is a
necessary condition: a wall that passes may be out of its class elsewhere.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from uvms_drake.model.surface.unknown_contact import UnknownContact
from uvms_drake.tube.contact.sensor_error import ripple

NOTHING = 1e-3
"""Rounding of a force [N]."""
CONTACT_FORCE, MOVING = 1.0, 1e-3
"""Smallest force [N] and speed [m/s] for which their ratios are evaluated."""
ROUNDING = 1.0 + 1e-6


class Departure(NamedTuple):
    """Bound of the class that was exceeded, in the unit of the bound."""

    specified: float
    """Specified bound."""
    observed: float
    """Observed value."""


def departures(specified: UnknownContact, time: np.ndarray, tip: np.ndarray, velocity: np.ndarray,
               force: np.ndarray, static: Callable[[np.ndarray], np.ndarray],
               stood: np.ndarray | None = None) -> dict[str, Departure]:
    """Returns the bounds of a class, by their keys, that a wall has exceeded.

    Between any two places φ(𝔭') ≤ φ(𝔭) + κ₊⟨𝔭' − 𝔭⟩₊ (`SurfaceClass`), checked for successive
    samples; the angle of 𝐅 to n is at most θ + arctan μ; ‖𝐅‖ ≤ √(1 + μ²) φ (1 + c₊⟨v⟩₊); and for a
    receding tip ‖𝐅‖ ≥ φ (1 − c₊⟨−v⟩₊).

    Args:
        specified: Specification of the contact, with its class.
        time: Instants (T,) [s].
        tip: Positions of the tip (T, 3) [m].
        velocity: Velocities of the tip (T, 3) [m/s].
        force: 𝐅 of the tip on the wall (T, 3) [N].
        static: Function from positions of the tip (..., 3) to φ (...) [N].
        stood: Whether it is a hold (T,); None: never.
    """
    walls, phi, size = specified.walls, static(tip), np.linalg.norm(force, axis=1)
    in_contact = size > CONTACT_FORCE
    # Angle and friction, as the angle between force and direction; large if the wall pulls.
    cone = specified.angle + float(np.arctan(specified.friction))
    off = np.arctan2(walls.lateral(force), walls.depth(force))[in_contact]
    # Damping.
    damped = np.append(
        _damping(walls.advance(velocity), size / np.hypot(1.0, specified.friction), phi),
        -_damping(walls.advance(-velocity), size, phi))
    # Free distance from the start.
    advance = np.linspace(0.0, specified.clearance, 101)
    free = static(tip[0] + advance[:, None] * walls.direction) <= NOTHING
    nearest = specified.clearance if np.all(free) else float(advance[np.argmin(free)])
    observed = {
        "stiffness": Departure(specified.stiffness, _steepest(
            walls.advance(np.diff(tip, axis=0)), walls.advance(-np.diff(tip, axis=0)), phi)),
        "angle and friction": Departure(cone, float(np.max(off, initial=0.0))),
        "dissipation": Departure(specified.dissipation, float(np.max(damped, initial=0.0))),
        "force_ripple": Departure(specified.force_ripple, ripple(
            time, force @ walls.axes[1:].T, specified.force_rate)),
    }
    if stood is not None:
        slow = specified.hold_forces
        begins, ends = (np.flatnonzero(np.diff(stood.astype(int), prepend=0, append=0) == sign)
                        for sign in (1, -1))
        observed["hold.force_ripple"] = Departure(slow.force_ripple, max((
            ripple(time[begin:end], force[begin:end] @ walls.axes[1:].T, slow.force_rate)
            for begin, end in zip(begins, ends, strict=True)), default=0.0))
    out = {key: each for key, each in observed.items() if each.observed > ROUNDING * each.specified}
    if nearest != specified.clearance:
        out["clearance"] = Departure(specified.clearance, nearest)
    return out


def _damping(speed: np.ndarray, force: np.ndarray, phi: np.ndarray) -> np.ndarray:
    """Returns (F/φ − 1) over the speed, for samples in motion and contact [s/m]."""
    quick = (phi > CONTACT_FORCE) & (speed > MOVING)
    factors: np.ndarray = (force[quick] / phi[quick] - 1.0) / speed[quick]
    return factors


def _steepest(advance: np.ndarray, back: np.ndarray, phi: np.ndarray) -> float:
    """Returns the largest slope of φ (T,) over the advance, forwards (T−1,) and back [N/m]."""
    change = np.diff(phi)
    grown = np.concatenate([change, -change]) - NOTHING
    distance = np.maximum(np.concatenate([advance, back]), 1e-12)
    return float(np.max((grown / distance)[grown > 0.0], initial=0.0))
