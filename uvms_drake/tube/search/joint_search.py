"""Largest values of functions of the joint angles, by two searches."""

from collections.abc import Callable

import numpy as np

from uvms_drake.tube.search.search_memo import active_memo

GRID_POINTS = 6000
"""Approximate number of points of the grid."""
MOST_AXES = 13
"""Largest number of axes of a grid; with more, points are random."""
ROUNDS, ROUND_POINTS, SHRINK = 12, 600, 0.6
"""Rounds of random points about the worst ones, points in each, and ratio of the sizes of two
rounds."""
CHECKS = 3000
"""Number of random points of the second search."""
BATCH = 128
"""Number of points evaluated at a time: their matrices stay in the processor's cache."""
BOUND_SHARE = 0.3
"""Probability with which a coordinate of these is on a bound."""


def supremum_over_joints(function: Callable[[np.ndarray], np.ndarray], lower: np.ndarray,
                         upper: np.ndarray, seed: int = 0, *, points: int | None = None,
                         rounds: int | None = None) -> np.ndarray:
    """Returns the largest values (c,) of a function that are found in a box of joint angles.

    Args:
        function: Values (m, c) at m sets of joint angles (m, n).
        lower: Corner of the box (n,) [rad].
        upper: The opposite corner (n,) [rad].
        seed: Seed of the random points.
        points: Number of points, see `GRID_POINTS` and `MOST_AXES`.
        rounds: Number of rounds, see `ROUNDS`.
    """
    def search() -> tuple[np.ndarray, np.ndarray]:
        return _search(function, lower, upper, seed, points or GRID_POINTS,
                       ROUNDS if rounds is None else rounds)

    searches = active_memo()
    if searches is None:
        return search()[0]
    (_, where), _ = searches.get("joints", search)
    largest: np.ndarray = np.max(function(lower + where * (upper - lower)), axis=0)
    return largest


def _search(function: Callable[[np.ndarray], np.ndarray], lower: np.ndarray, upper: np.ndarray,
            seed: int, points: int, rounds: int) -> tuple[np.ndarray, np.ndarray]:
    """Returns the largest values (c,), and their places in the unit cube (c, n)."""
    # A grid, or random points.
    size, rng = len(lower), np.random.default_rng(seed)
    if size == 0:  # A robot without joints: there is one point.
        best = function(np.zeros((1, 0)))[0]
        return best, np.zeros((len(best), 0))
    along = max(2, int(points ** (1.0 / max(size, 1))))
    if size > MOST_AXES:
        unit = _points(points, size, rng)
    else:
        axes = [np.linspace(0.0, 1.0, along)] * size
        unit = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, size)
    values = _evaluated(function, lower + unit * (upper - lower))
    # Random points closer and closer to the worst ones.
    worst = np.argmax(values, axis=0)
    best, where = values.max(axis=0), unit[worst]
    each, reach = max(8, ROUND_POINTS // len(best)), 1.0 / (along - 1)
    for _ in range(rounds):
        steps = reach * rng.uniform(-1.0, 1.0, (len(best), each, size))
        near = np.clip(where[:, None] + steps, 0.0, 1.0).reshape(-1, size)
        found = _evaluated(function, lower + near * (upper - lower))
        better = found.max(axis=0) > best
        best = np.maximum(best, found.max(axis=0))
        where[better] = near[np.argmax(found, axis=0)[better]]
        reach *= SHRINK
    return best, where


def second_over_joints(function: Callable[[np.ndarray], np.ndarray], lower: np.ndarray,
                       upper: np.ndarray, seed: int = 0, points: int | None = None) -> np.ndarray:
    """Returns the largest values (c,) at random points, many of them on faces and edges of the box.

    With an active memo a second search is not needed, and it is made at one point only.

    Args:
        function: As of `supremum_over_joints`, as are the others.
        lower: Corner of the box.
        upper: The opposite corner.
        seed: Seed of the points.
        points: Number of them.
    """
    if active_memo() is not None:
        points = 1
    unit = _points(points or CHECKS, len(lower), np.random.default_rng([seed, 1]))
    return np.max(_evaluated(function, lower + unit * (upper - lower)), axis=0)


def _evaluated(function: Callable[[np.ndarray], np.ndarray], at: np.ndarray) -> np.ndarray:
    """Returns the values (m, c) at points (m, n), batch by batch."""
    return np.concatenate([function(at[i: i + BATCH]) for i in range(0, len(at), BATCH)])


def _points(count: int, size: int, rng: np.random.Generator) -> np.ndarray:
    """Returns random points (count, size) of the unit cube, many on its faces and edges."""
    unit = rng.uniform(-0.5 * BOUND_SHARE, 1.0 + 0.5 * BOUND_SHARE, (count, size))
    return np.clip(unit, 0.0, 1.0)
