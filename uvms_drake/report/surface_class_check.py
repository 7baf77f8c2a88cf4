"""Whether the wall of a run was of the class that the controller was told of, by what was seen.

Nothing is asked of the wall but its static force where the tip was, so any surface can be looked
at. What was not touched is not seen: a wall that passes may be out of its class elsewhere.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from uvms_drake.model.surface import SensedContact
from uvms_drake.tube.contact.force_ripple import ripple

NOTHING = 1e-3
"""Force that is rounding [N]."""
FELT, MOVING = 1.0, 1e-3
"""Force [N] and speed [m/s] from which on their ratios are looked at."""
ROUNDING = 1.0 + 1e-6


class Seen(NamedTuple):
    """A bound of the class that was seen to be exceeded."""

    told: float
    seen: float


def departures(told: SensedContact, time: np.ndarray, tip: np.ndarray, velocity: np.ndarray,
               force: np.ndarray, static: Callable[[np.ndarray], np.ndarray]) -> dict[str, Seen]:
    """Returns the bounds of a class, by their keys, that a wall was seen to exceed.

    Between any two places φ(𝔭') ≤ φ(𝔭) + κ₊⟨𝔭' − 𝔭⟩₊ (`SurfaceClass`), of which pairs of samples in
    a row are looked at; 𝐅 is at most θ + arctan μ off n; ‖𝐅‖ ≤ √(1 + μ²) φ (1 + c₊⟨v⟩₊); and of a
    tip that goes back ‖𝐅‖ ≥ φ (1 − c₊⟨−v⟩₊).

    Args:
        told: The class.
        time: Instants (T,) [s].
        tip: Where the tip was (T, 3) [m].
        velocity: Of the tip (T, 3) [m/s].
        force: 𝐅 of the tip on the wall (T, 3) [N].
        static: Gives φ (...) [N] at places of the tip (..., 3).
    """
    walls, phi, size = told.walls, static(tip), np.linalg.norm(force, axis=1)
    felt = size > FELT
    # Angle and friction, as the angle between force and direction; a wall that pulls is far off.
    cone = told.angle + float(np.arctan(told.friction))
    off = np.arctan2(walls.aside(force), walls.depth(force))[felt]
    # Damping.
    damped = np.append(
        _damping(walls.advance(velocity), size / np.hypot(1.0, told.friction), phi),
        -_damping(walls.advance(-velocity), size, phi))
    # The way from the start that is free.
    ahead = np.linspace(0.0, told.clearance, 101)
    free = static(tip[0] + ahead[:, None] * walls.direction) <= NOTHING
    nearest = told.clearance if np.all(free) else float(ahead[np.argmin(free)])
    seen = {
        "stiffness": Seen(told.stiffness, _steepest(walls.advance(np.diff(tip, axis=0)),
                                                    walls.advance(-np.diff(tip, axis=0)), phi)),
        "angle and friction": Seen(cone, float(np.max(off, initial=0.0))),
        "dissipation": Seen(told.dissipation, float(np.max(damped, initial=0.0))),
        "force_ripple": Seen(told.force_ripple, ripple(
            time, force @ walls.axes[1:].T, told.force_rate)),
    }
    out = {key: each for key, each in seen.items() if each.seen > ROUNDING * each.told}
    return out | ({} if nearest == told.clearance else {"clearance": Seen(told.clearance, nearest)})


def _damping(speed: np.ndarray, force: np.ndarray, phi: np.ndarray) -> np.ndarray:
    """Returns (F/φ − 1) over the speed, where it moves and presses [s/m]."""
    quick = (phi > FELT) & (speed > MOVING)
    factors: np.ndarray = (force[quick] / phi[quick] - 1.0) / speed[quick]
    return factors


def _steepest(ahead: np.ndarray, back: np.ndarray, phi: np.ndarray) -> float:
    """Returns the largest growth of φ (T,) over ⟨·⟩₊ of the way, there (T−1,) and back [N/m]."""
    change = np.diff(phi)
    grown = np.concatenate([change, -change]) - NOTHING
    way = np.maximum(np.concatenate([ahead, back]), 1e-12)
    return float(np.max((grown / way)[grown > 0.0], initial=0.0))
