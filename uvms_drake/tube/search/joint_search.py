"""Largest values of functions of the joint angles, and of other numbers in a box."""

from collections.abc import Callable

import numpy as np

from uvms_drake.tube.estimates import Check, extremes_of, searched_again
from uvms_drake.tube.search.second_search import by_flips

GRID_POINTS = 6000
"""Approximate number of points of the grid."""
MOST_AXES = 13
"""Largest number of axes of a grid; with more, points are random."""
ROUNDS, ROUND_POINTS, SHRINK = 12, 600, 0.6
"""Rounds of random points about the worst ones, points in each, and ratio of the sizes of two
rounds."""
POINTS, SWEEPS = 500, 3
"""Random points of the second search, and sweeps over all coordinates from the worst ones."""
STARTS = 3
"""Random points, the worst for each value, that are moved by flips where there is no grid."""
BATCH = 128
"""Number of points evaluated at a time: their matrices stay in the processor's cache."""
BOUND_SHARE = 0.3
"""Probability with which a coordinate of a random point is on a bound."""

Function = Callable[[np.ndarray], np.ndarray]
"""Values (m, c) at m points of a box (m, n)."""


def supremum_over_joints(function: Function, lower: np.ndarray, upper: np.ndarray, seed: int = 0
                         ) -> np.ndarray:
    """Returns the largest values (c,) of a function that are found in a box of joint angles.

    Args:
        function: Values (m, c) at m sets of joint angles (m, n).
        lower: Corner of the box (n,) [rad].
        upper: The opposite corner (n,) [rad].
        seed: Seed of the random points.
    """
    # A grid, or random points.
    size, rng = len(lower), np.random.default_rng(seed)
    if size == 0:  # A robot without joints: there is one point.
        found: np.ndarray = function(np.zeros((1, 0)))[0]
        return found
    along = max(2, int(GRID_POINTS ** (1.0 / size)))
    if size > MOST_AXES:
        unit = rng.uniform(-0.5 * BOUND_SHARE, 1.0 + 0.5 * BOUND_SHARE, (GRID_POINTS, size))
        unit = np.clip(unit, 0.0, 1.0)
    else:
        axes = [np.linspace(0.0, 1.0, along)] * size
        unit = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, size)

    def values_at(unit: np.ndarray) -> np.ndarray:
        at = lower + unit * (upper - lower)
        return np.concatenate([function(at[i: i + BATCH]) for i in range(0, len(at), BATCH)])

    # Random points closer and closer to the worst ones.
    values = values_at(unit)
    best, where = values.max(axis=0), unit[np.argmax(values, axis=0)]
    if size > MOST_AXES:  # By flips of their coordinates, before.
        worst = np.unique(np.argsort(-values, axis=0)[:STARTS])
        best, where = by_flips(lambda z: values_at(0.5 * (1.0 + z)), 2.0 * unit[worst] - 1.0, rng,
                               SWEEPS, STARTS)
        where = 0.5 * (1.0 + where)
    each, reach = max(8, ROUND_POINTS // len(best)), 1.0 / (along - 1)
    for _ in range(ROUNDS):
        steps = reach * rng.uniform(-1.0, 1.0, (len(best), each, size))
        near = np.clip(where[:, None] + steps, 0.0, 1.0).reshape(-1, size)
        values = values_at(near)
        better = values.max(axis=0) > best
        best = np.maximum(best, values.max(axis=0))
        where[better] = near[np.argmax(values, axis=0)[better]]
        reach *= SHRINK
    return best


def second_over_joints(function: Function, lower: np.ndarray, upper: np.ndarray, seed: int = 0,
                       attempt: int = 0) -> np.ndarray:
    """Returns the largest values (c,) of a second search, see `supremum_over_joints`."""
    middle, half = 0.5 * (upper + lower), 0.5 * (upper - lower)
    rng = np.random.default_rng([seed, 1, attempt])
    start = np.clip(rng.uniform(-1.3, 1.3, (POINTS, len(lower))), -1.0, 1.0)
    return by_flips(lambda z: function(middle + half * z), start, rng, SWEEPS, 1)[0]


def claimed_over_joints(name: str, function: Function, lower: np.ndarray, upper: np.ndarray,
                        factor: float, seed: int) -> tuple[np.ndarray, Check]:
    """Returns the claims (c,) of a function, and their check; its estimates are the extreme ones.

    Args:
        name: Name of the estimate.
        function: As of `supremum_over_joints`, as are `lower`, `upper` and `seed`.
        lower: See `function`.
        upper: See `function`.
        factor: Factor of the values found.
        seed: See `function`.
    """
    claim = factor * supremum_over_joints(function, lower, upper, seed)
    return claim, lambda: extremes_of(name, claim, searched_again(
        claim, lambda which, attempt: second_over_joints(
            lambda x: function(x)[:, which], lower, upper, seed, attempt)))
