"""Unknown surfaces that a campaign draws: any of the specified class.

A wall is drawn with an angle, a stiffness, damping and friction of its own, up to those of the
class and in a quarter of the draws at them. `ShapedSurface.membership` proves that it is in the
class, in a ball with every point where the tip may touch it.
"""

from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.model.frames.spatial import cross
from uvms_drake.model.surface import ShapedSurface
from uvms_drake.model.surface.contact_laws import AnyNormalLaw, Bilinear, Hardening, Linear
from uvms_drake.model.surface.geometry import Bumpy, Cylinder, Plane
from uvms_drake.model.surface.surface_class import SurfaceClass
from uvms_drake.model.surface.unknown_contact import UnknownContact

SOFTEST = 0.1
"""Smallest slope of a wall's static force over the largest of the class."""
AT_THE_BOUND, BELOW = 0.25, 1.0 - 1e-9
"""Probability that a parameter is at the bound of the class, and that bound but for rounding."""
FLAT = 0.5
"""Largest fraction of the angle for curvature or bumps, in place of tilt."""
TRANSITIONS, KNEES, DEEP = (0.001, 0.005), (0.005, 0.03), (0.01, 0.05)
"""Ranges of the transition depths of the laws [m]."""
WAVELENGTHS = (0.1, 0.6)
"""Range of the shortest wavelength of bumps [m]."""
SLACK = 0.03
"""Extra radius of the ball for the tube and for bumps [m]."""


class Ball(NamedTuple):
    """Ball with every contact point of admissible force."""

    center: np.ndarray
    """Centre (3,) [m]."""
    reach: float
    """Radius [m]."""


def share(rng: np.random.Generator, likely: float, least: float = 0.0) -> float:
    """Returns a fraction of a bound, uniform from `least` to 1, or 1 but for rounding."""
    part = rng.uniform(least, 1.0)
    return BELOW if rng.uniform() < likely else float(part)


def draw_wall(contact: UnknownContact, start: np.ndarray, goal: np.ndarray,
              rng: np.random.Generator, likely: float = AT_THE_BOUND) -> ShapedSurface | None:
    """Returns a wall at the start, its friction with a creep of 1 m/s; None: not in the class.

    It stays in the class when moved along n.

    Args:
        contact: Specification of the contact.
        start: Start of the tip (3,) [m].
        goal: A point (3,) of the line along n to press at [m].
        rng: Random generator.
        likely: Probability of a parameter to be at its bound.
    """
    n, part = np.asarray(contact.direction, dtype=float), partial(share, rng, likely)
    law = draw_law(SOFTEST * contact.stiffness, contact.stiffness, rng, likely)
    angle, flat = contact.angle * part(), float(rng.uniform(FLAT, 1.0))
    dissipation, friction = contact.dissipation * part(), contact.friction * part()
    point = start + 0.5 * across(n, goal - start)
    reach = ball_about(point, contact, law, start, goal).reach
    surface = ShapedSurface(draw_shape(point, n, angle, flat, reach, rng), law, dissipation,
                            friction, creep=1.0)
    return within_class(surface, contact, start, goal)


def draw_law(least: float, most: float, rng: np.random.Generator, likely: float = AT_THE_BOUND
             ) -> AnyNormalLaw:
    """Returns a static force with slopes from `least` to `most` [N/m] past its transition."""
    high = most * share(rng, likely, least / most)
    low, transition = float(rng.uniform(least, high)), float(rng.uniform(*TRANSITIONS))
    kind = rng.integers(4)
    if kind == 0:
        return Linear(high, transition)
    if kind == 1:
        return Hardening(low, transition, high / low, float(rng.uniform(*DEEP)))
    first, second = (low, high) if kind == 2 else (high, low)
    return Bilinear(first, transition, second / first, float(rng.uniform(*KNEES)))


def within_class(surface: ShapedSurface, contact: UnknownContact, start: np.ndarray,
                 goal: np.ndarray) -> ShapedSurface | None:
    """Returns the surface, softer and less damped if the class requires it; None: not in it."""
    found = membership(surface, contact, start, goal)
    if found is None:
        return None
    too_stiff, too_damped = (max(1.0, getattr(found, name) / (BELOW * getattr(contact, name)))
                             if getattr(found, name) else 1.0
                             for name in ("stiffness", "dissipation"))
    surface = replace(surface, law=surface.law.stiffened(1.0 / too_stiff),
                      dissipation=surface.dissipation / too_damped)
    return surface if is_member(surface, contact, start, goal) else None


def is_member(surface: ShapedSurface, contact: UnknownContact, start: np.ndarray, goal: np.ndarray
              ) -> bool:
    """Returns whether a surface is in the class wherever a tip can touch it."""
    found = membership(surface, contact, start, goal)
    return found is not None and all(
        getattr(found, name) <= getattr(contact, name)
        for name in ("stiffness", "angle", "dissipation", "friction"))


def membership(surface: ShapedSurface, contact: UnknownContact, start: np.ndarray,
               goal: np.ndarray) -> SurfaceClass | None:
    """Returns the class of a surface in the ball of `ball_about`; None if it turns away there."""
    ball = ball_about(surface.anchor, contact, surface.law, start, goal)
    try:
        return surface.membership(contact.direction, *ball)
    except InvalidParameter:
        return None


def ball_about(point: np.ndarray, contact: UnknownContact, law: AnyNormalLaw, start: np.ndarray,
               goal: np.ndarray) -> Ball:
    """Returns a ball with all contact points of at most the largest static force.

    Normal to n they lie between start and goal, over which the wall's depth changes by at most
    tan α of that distance; along n they are no deeper than the depth of the class's force.

    Args:
        point: Point of the wall, midway between start and goal normal to n (3,) [m].
        contact: Specification of the contact.
        law: Static force by the depth.
        start: Start of the tip (3,) [m].
        goal: A point (3,) of the line along n to press at [m].
    """
    n = np.asarray(contact.direction, dtype=float)
    lateral = 0.5 * float(np.linalg.norm(across(n, goal - start))) + SLACK
    half = 0.5 * law.depth_for(contact.force) / float(np.cos(contact.angle))
    along = half + lateral * float(np.tan(contact.angle)) + SLACK
    return Ball(point + half * n, float(np.hypot(lateral, along)))


def across(n: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Returns the component normal to n (..., 3) of a vector (..., 3)."""
    return vector - (vector @ n)[..., None] * n


def draw_shape(point: np.ndarray, n: np.ndarray, angle: float, flat: float, reach: float,
               rng: np.random.Generator) -> Plane | Cylinder | Bumpy:
    """Returns a plane, the outside or inside of a cylinder, or bumps, within an angle about n.

    Args:
        point: A point of it (3,) [m].
        n: Direction into the wall (3,).
        angle: The angle [rad].
        flat: Fraction of it for tilt; the rest is for curvature or bumps.
        reach: Distance from the point within which it has to hold [m].
        rng: Random generator.
    """
    kind = int(rng.integers(4))
    into, axis = tilted(n, angle if kind == 0 else flat * angle, rng)
    bent = (1.0 - flat) * angle
    if kind == 0:
        return Plane(point, -into)
    if kind == 3:
        shortest = float(np.exp(rng.uniform(*np.log(WAVELENGTHS))))
        bumps = Bumpy(point, -into, axis, 1.0, shortest, int(rng.integers(2**31)))
        return replace(bumps, amplitude=max(float(np.tan(bent)), 1e-6) / bumps.slope)
    turn = np.sin(bent)
    radius = reach * (1.0 + turn) / max(turn, 1e-6)  # The ball's centre is nearer to the axis.
    return Cylinder(point, -into, axis, float(radius), kind == 2)


def tilted(n: np.ndarray, angle: float, rng: np.random.Generator
           ) -> tuple[np.ndarray, np.ndarray]:
    """Returns a random unit vector (3,) at an angle from n (3,), and a random one normal to it."""
    lateral = across(n, rng.normal(size=3))
    into = np.cos(angle) * n + np.sin(angle) * lateral / np.linalg.norm(lateral)
    into /= np.linalg.norm(into)
    along = cross(into, rng.normal(size=3))
    return into, along / np.linalg.norm(along)
