"""The scenario's own surface and sensor beside the class of walls that its contact declares.

The law of the surface is evaluated below the path of the tip, up to the largest force, before
anything is simulated: a bound that is exceeded there is not kept, nor is one of which nothing could
be evaluated, at a place of the path without a surface. A surface that passes may leave its class
elsewhere; `drawn_surfaces.is_member` proves a `ShapedSurface`'s membership.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from uvms_drake.common.errors import require
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.surface.law import Surface, check_surface
from uvms_drake.model.surface.surface_class import SurfaceClass
from uvms_drake.station.contact.drawn_mission import places_of
from uvms_drake.station.contact.tube_in_contact import force_bounds
from uvms_drake.station.problem import true_surface
from uvms_drake.station.scenario.scenario import Scenario

AROUND, FARTHEST = 0.5, 5.0
"""Search distances for a surface, about a tip of a run, and into it along the path [m]."""
STEP, HALVINGS = 0.005, 20
"""Steps of that search [m], and number of bisections of one."""
SPACING, DEPTHS = 0.005, 60
"""Distance of places along the path [m], and number of depths at each."""
DEEPEST = 3.0
"""Largest depth over that of the largest force at the largest stiffness."""
TOUCHED = 1.0
"""Smallest force whose direction counts [N]."""
SLOW, FAST = 1e-3, 100.0
"""Speeds at which damping is measured, and friction, which has reached its bound by then [m/s]."""
ROUNDING = 1.0 + 1e-3
NOT_FOUND = "surface"
"""Key of the places of the path at which no surface could be evaluated."""


class Departure(NamedTuple):
    """Bound of the class that was exceeded, in the unit of the bound."""

    specified: float
    """Specified bound."""
    observed: float
    """Observed value."""


def outside(scenario: Scenario, model: ContactModel) -> dict[str, Departure]:
    """Returns the bounds of `contact`, by key, that the scenario's own surface or sensor exceeds.

    `NOT_FOUND` has the numbers of places of the path, and of those without a surface within
    `FARTHEST` that gives a force. None of a known surface.

    Args:
        scenario: The scenario.
        model: The controller's model.
    """
    contact = scenario.contact.declared_wall()
    if contact is None:
        return {}
    start = model.task_pose(scenario.start.config)[:6]
    path = path_of(scenario, contact.walls, start[:3])
    observed = _observed(check_surface(true_surface(scenario)), contact.walls, contact.force,
                         np.concatenate([path, np.tile(start[3:], (len(path), 1))], axis=1))
    nearest, missing = observed.pop("clearance"), observed.pop(NOT_FOUND)
    reading = force_bounds(scenario)
    assert reading is not None  # The wall is declared.
    found = {key: Departure(getattr(contact, key), value)
             for key, value in (observed | {"force_error": reading.error}).items()}
    out = {key: each for key, each in found.items()
           if not each.observed <= ROUNDING * each.specified}  # A NaN keeps no bound.
    if ROUNDING * nearest < contact.clearance:
        out["clearance"] = Departure(contact.clearance, nearest)
    if missing:
        out[NOT_FOUND] = Departure(len(path), missing)
    return out


def in_words(departed: dict[str, Departure]) -> str:
    """Returns the bounds that are exceeded, in a line; empty if none is."""
    return "; ".join(
        f"surface not found along the path, at {each.observed:g} of its {each.specified:g} places"
        if key == NOT_FOUND else
        f"contact.{key} declares {each.specified:.4g}, it is {each.observed:.4g}"
        for key, each in departed.items())


def path_of(scenario: Scenario, walls: SurfaceClass, start: np.ndarray) -> np.ndarray:
    """Returns places (m, 3) [m] along the path of the tip across n, from its start (3,) on."""
    require(scenario.task.pose is not None, "task.pose", None,
            "given: a wall leaves five coordinates free")
    goal = np.asarray(scenario.task.pose, dtype=float)[:3]
    ends = places_of(scenario.mission, walls, goal, start)
    if not scenario.mission.steps:
        ends = np.array([start, goal - walls.direction * (walls.direction @ (goal - start))])
    pieces = [np.linspace(first, second, 2 + int(np.linalg.norm(second - first) / SPACING))
              for first, second in pairwise(ends)]
    return np.concatenate(pieces)


def _observed(surface: Surface, walls: SurfaceClass, force: float, chi: np.ndarray
              ) -> dict[str, float]:
    """Returns the largest stiffness, angle, dissipation and friction, and the clearance at first.

    And the number of places at which there is none to evaluate.

    Args:
        surface: The surface.
        walls: Class of the walls.
        force: Largest static force [N].
        chi: Poses of the tip before the surface (m, 6), the start first.
    """
    n = walls.direction
    advance = surface_depth(surface, chi, n, FARTHEST) - chi[:, :3] @ n
    nearest = float(np.nan_to_num(advance[0], nan=np.inf))
    depths = np.linspace(0.0, DEEPEST * force / walls.stiffness, DEPTHS)
    at = np.tile(chi[np.isfinite(advance)], (DEPTHS, 1, 1))  # (depths, places, 6)
    at[..., :3] += (advance[np.isfinite(advance)] + depths[:, None])[..., None] * n
    phi = surface.static_force(at)
    slopes = np.diff(phi, axis=0) / depths[1]
    stiffness = np.max(slopes[phi[:-1] <= force], initial=0.0)
    # The directions, and both factors, of a tip that has just touched or presses up to the force.
    before = np.concatenate([np.zeros_like(phi[:1]), phi[:-1]])
    pressed = (phi > TOUCHED) & (before <= force)
    at, missing = at[pressed], len(chi) - int(np.count_nonzero(np.any(pressed, axis=0)))
    if not len(at):
        return {"clearance": nearest, NOT_FOUND: missing}
    rest = surface.force(at, np.zeros_like(at))[:, :3]
    size = np.linalg.norm(rest, axis=1)
    into, moving = rest / size[:, None], np.zeros_like(at)
    moving[:, :3] = SLOW * into
    damped = np.sum(surface.force(at, moving)[:, :3] * into, axis=1)
    along = np.cross(into, walls.axes[1] + walls.axes[2])
    moving[:, :3] = FAST * along / np.linalg.norm(along, axis=1)[:, None]
    slid = surface.force(at, moving)[:, :3]
    return {
        "stiffness": float(stiffness),
        "angle": float(np.max(np.arctan2(walls.lateral(rest), walls.depth(rest)))),
        "dissipation": float(np.max((damped / size - 1.0) / walls.advance(SLOW * into))),
        "friction": float(np.max(np.linalg.norm(slid - rest, axis=1) / size)),
        "clearance": nearest, NOT_FOUND: missing}


def surface_depth(surface: Surface, chi: np.ndarray, direction: np.ndarray, farthest: float = AROUND
                  ) -> np.ndarray:
    """Returns the depth n·𝔭 (T,) [m] at which the tip first touches the surface along n.

    The search is from `AROUND` before the tip on; NaN if there is no surface.

    Args:
        surface: The surface.
        chi: Poses of the end-effector (T, 6) [m, rad].
        direction: Unit vector n into the surface (3,).
        farthest: Distance of the search behind the tip [m].
    """
    along = np.pad(direction, (0, 3))
    steps = np.linspace(-AROUND, farthest, 1 + round((AROUND + farthest) / STEP))
    inside = (surface.penetration(chi + steps[:, None] * along)[:, None] > 0.0 if len(chi) == 1 else
              np.array([surface.penetration(chi + step * along) > 0.0 for step in steps]))
    first = np.argmax(inside, axis=0)
    low, high = steps[first - 1], steps[first]
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        deep = surface.penetration(chi + middle[:, None] * along) > 0.0
        low, high = np.where(deep, low, middle), np.where(deep, middle, high)
    return np.where(first > 0, chi[:, :3] @ direction + high, np.nan)
