"""Places, times and words of a mission, for the walls that a campaign draws in front of it."""

from collections.abc import Callable

import numpy as np

from uvms_drake.mission.steps import REACHED, Approach, Mission, Retreat, Step
from uvms_drake.model.surface.surface_class import SurfaceClass

HIDDEN = ("timeout", "settle", "within", "on_failure", "tolerance")
"""Fields of a step that its description leaves out."""
UNITS = {"at": "m", "along": "m", "distance": "m", "force": "N", "amplitude": "N", "seconds": "s",
         "speed": "m/s", "frequency": "Hz"}
"""Units of the fields of the steps."""


def places_of(mission: Mission, walls: SurfaceClass, origin: np.ndarray, start: np.ndarray
              ) -> np.ndarray:
    """Returns the start and, as deep, beginning and end of each step of a mission (m, 3) [m].

    Args:
        mission: The mission; without steps: the start alone.
        walls: The class of walls, for its axes.
        origin: Place of (0, 0) (3,) [m].
        start: Tip at the start (3,) [m].
    """
    across = walls.axes[1:]
    first = across @ (start - origin)
    out, place = [first], first
    for step in mission.checked().steps if mission.steps else ():
        begin = step.at if isinstance(step, Approach) else place
        place = begin + step.along
        out += [begin, place]
    return start + (np.array(out) - first) @ across


def ends_of(mission: Mission, walls: SurfaceClass, start: np.ndarray, goal: np.ndarray
            ) -> tuple[np.ndarray, np.ndarray]:
    """Returns two points between which, normal to n, the tip may touch a wall (3,), (3,) [m].

    Of a mission they are the ends of a diameter of a disk with the start and all places.

    Args:
        mission: The mission.
        walls: The class of walls, for its axes.
        start: Tip at the start (3,) [m].
        goal: Position of the task (3,) [m], of a mission the place of (0, 0).
    """
    if not mission.steps:
        return start, goal
    places = places_of(mission, walls, goal, start)
    at = places @ walls.axes[1:].T
    middle = start + (0.5 * (at.min(axis=0) + at.max(axis=0)) - at[0]) @ walls.axes[1:]
    radius = np.max(np.linalg.norm(places - middle, axis=1)) * walls.axes[1]
    return middle - radius, middle + radius


def searched(mission: Mission) -> float:
    """Returns the smallest search distance of its approaches [m]; inf without a mission."""
    return min((step.within for step in mission.steps if isinstance(step, Approach)),
               default=np.inf)


def seconds_of(mission: Mission, places: np.ndarray,
               pressing: Callable[[float], float], lag: float) -> float:
    """Returns how long a mission should take without a failure, but for its first search [s].

    A tip is at a place after T ln(d/r), T the lag, d the distance and r = `REACHED`; so is
    one that goes back to a wall which it has found.

    Args:
        mission: A mission with steps.
        places: Those of `places_of`.
        pressing: Time to press [s], by the desired force [N].
        lag: T, by which a tip follows a moving target [s].
    """
    def travel(distance: float) -> float:
        return lag * float(np.log(max(distance / REACHED, 1.0)))

    total, back = 0.0, 0.0
    for i, step in enumerate(mission.checked().steps):
        way = float(np.linalg.norm(places[2 * i + 1] - places[2 * i]))
        total += step.least_time
        if isinstance(step, Approach):
            total += travel(way) + travel(back) + pressing(step.strongest)
        elif isinstance(step, Retreat):
            back = step.distance
            total += travel(back)
        elif np.any(step.along):
            total += lag
    return total


def in_words(mission: Mission) -> str:
    """Returns the steps of a mission with their values, and its retries."""
    return "; ".join([*map(_step, mission.steps), f"retries of a spot: {mission.retries}"])


def _step(step: Step) -> str:
    said = [f"{key} {_number(value)}{f' {UNITS[key]}' if key in UNITS else ''}"
            for key, value in vars(step).items()
            if key not in HIDDEN and (key == "at" or np.any(value))]
    return " ".join([type(step).__name__.lower(), ", ".join(said)])


def _number(value: object) -> str:
    if isinstance(value, (int, float, np.ndarray, list)):
        each = np.atleast_1d(np.asarray(value, dtype=float))
        text = ", ".join(f"{part:g}" for part in each)
        return text if each.size == 1 else f"({text})"
    return str(value)
