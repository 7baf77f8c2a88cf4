"""Claims of suprema, and the second search for each: flips of coordinates to their bounds.

A point of the cube [−1, 1]ᵈ is moved along one coordinate after the other: to either bound, to
anywhere, and a little; the best of these counts, if it is better. In ū and in errors, in which
remainders are affine or nearly so, a flip to a bound is soon the maximum. Motions are points by a
map on which poses are moved into the set, ζ̄ is projected on its balls, and the errors are furthest
along a direction in their sets. From several random points each, and from where the flips end by a
few steps of `ascent`: nothing of it knows where the first search has been. See
tube/theory.md#estimates-and-second-searches.
"""

from collections.abc import Callable, Sequence

import numpy as np

from uvms_drake.tube.estimates import Check, Estimate, searched_again
from uvms_drake.tube.search.ascent import Climb, supremum
from uvms_drake.tube.search.constraint_set import MANY
from uvms_drake.tube.search.search_problem import SearchProblem

STARTS, SWEEPS, STEPS = 4, 1, 8
"""Points that start for each value of motions, sweeps over all coordinates, and steps of the ascent
from where the flips end."""
NEAR = 0.3
"""Size of the little moves in the first sweep; it is halved in each."""
BATCH = 400
"""Number of points evaluated at a time."""

Values = Callable[[np.ndarray], np.ndarray]
"""Values (m, c) at points (m, d)."""


def by_flips(function: Values, start: np.ndarray, rng: np.random.Generator, sweeps: int,
             kept: int) -> tuple[np.ndarray, np.ndarray]:
    """Returns the largest values (c,) found, and for each the best point (c, d) that it moved.

    Args:
        function: Values (m, c) at points (m, d) of the cube.
        start: Points (s, d).
        rng: Source of the moves.
        sweeps: Sweeps over all coordinates.
        kept: Number of the points, the best for each value, from which it is searched for.
    """
    values, d = _evaluated(function, start), start.shape[1]
    order = np.argsort(-values, axis=0, kind="stable")[:kept]
    count, kept = values.shape[1], len(order)
    own = np.repeat(np.arange(count), kept)
    point, best = start[order.T.ravel()], values[order.T.ravel(), own]
    row, first = np.arange(len(own)), kept * np.arange(count)
    for sweep in range(sweeps):
        for i in rng.permutation(d):
            tried = np.repeat(point[:, None], 4, axis=1)
            tried[:, 0, i], tried[:, 1, i] = -1.0, 1.0
            tried[:, 2, i] = rng.uniform(-1.0, 1.0, len(own))
            tried[:, 3, i] += NEAR * 0.5**sweep * rng.normal(size=len(own))
            tried = np.clip(tried, -1.0, 1.0)
            at = tried.reshape(-1, d)
            every = _evaluated(function, at)
            found = every.reshape(len(own), 4, -1)[row, :, own]
            which = np.argmax(found, axis=1)
            better = found[row, which] > best
            point[better] = tried[row, which][better]
            best[better] = found[row, which][better]
            # A record for a value by a move of another's point takes the place of its worst point.
            slots = best.reshape(count, kept)
            worst = first + np.argmin(slots, axis=1)
            value, most = np.max(every, axis=0), np.argmax(every, axis=0)
            record = value > np.max(slots, axis=1)
            point[worst[record]], best[worst[record]] = at[most[record]], value[record]
    first = first + np.argmax(best.reshape(count, kept), axis=1)
    return best[first], point[first]


def _evaluated(function: Values, at: np.ndarray) -> np.ndarray:
    """Returns the values (m, c) at points (m, d), batch by batch."""
    return np.concatenate([function(at[i: i + BATCH]) for i in range(0, len(at), BATCH)])


def second_search(problem: SearchProblem, wanted: np.ndarray, rng: np.random.Generator,
                  effort: int = 1) -> np.ndarray:
    """Returns the largest values found of the wanted channels (number of `wanted`,).

    Args:
        problem: The problem.
        wanted: Indices of channels.
        rng: Source of random numbers.
        effort: Factor of the number of sweeps and of steps.
    """
    # The cube of all coordinates, about the middle of the set.
    size, declared, channels = problem.size, problem.declared, [problem.channels[i] for i in wanted]
    drawn, scale = problem.draw(MANY, rng), declared.scale(problem.model)[:size]
    within = drawn[np.argmin(np.max(np.abs(problem.bounded(drawn[:, :size])), axis=1)), :size]
    middle = np.append(within[:3], np.mean(declared.box, axis=0))
    balls = ((slice(0, 3), declared.nu1), (slice(3, 6), declared.nu2),
             (slice(6, size), declared.qdot))

    def decode(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns the motions and the errors of points."""
        pose, zeta, u, along = np.split(z, [size, 2 * size, 3 * size], axis=1)
        pose, zeta = middle + scale * pose, zeta.copy()
        pose[:, 3:] = np.clip(pose[:, 3:], *declared.box)
        pose = problem.pulled(pose, within)
        for ball, radius in balls:
            zeta[:, ball] *= radius / np.maximum(
                1.0, np.linalg.norm(zeta[:, ball], axis=1, keepdims=True))
        error = np.zeros_like(along)
        for matrix, radius in problem.parts:
            part = along @ matrix
            length = np.linalg.norm(part, axis=1, keepdims=True)
            error += radius * (part / np.maximum(length, 1e-12)) @ matrix.T
        return np.concatenate([pose, zeta, u], axis=1), error

    def values(z: np.ndarray) -> np.ndarray:
        """Returns the sizes of the channels."""
        found = problem.values(*decode(z))
        return np.stack([np.linalg.norm(found[:, each], axis=1) for each in channels], axis=1)

    # Flips from random motions of the set and anything else, then an ascent.
    start = rng.uniform(-1.0, 1.0, (MANY, 3 * size + problem.errors))
    start[:, 3:size] = np.clip((drawn[:, 3:size] - middle[3:]) / scale[3:], -1.0, 1.0)
    start[:, :3] = 0.0
    largest, point = by_flips(values, start, rng, effort * SWEEPS, STARTS)
    climb = Climb(problem, *decode(point), channels)
    for _ in range(effort * STEPS):
        climb.step()
    return np.maximum(largest, climb.value)


def again(problem: SearchProblem, wanted: np.ndarray, claim: np.ndarray, seed: int) -> np.ndarray:
    """Returns the result of `second_search`, repeated with more effort where it has no power."""
    return searched_again(claim, lambda which, attempt: second_search(
        problem, wanted[which], np.random.default_rng([seed, 1, attempt]), 1 + attempt))


def claimed(problem: SearchProblem, names: Sequence[str], x: np.ndarray, values: np.ndarray,
            factor: float, seed: int, patience: int = 1, leaders: int | None = None
            ) -> tuple[np.ndarray, Check]:
    """Returns the claims of a problem's channels, zero where there are no errors, and their check.

    Args:
        problem: The problem.
        names: Names of the channels.
        x: As of `supremum`, as are `values`, `patience` and `leaders`.
        values: See `x`.
        factor: Factor of the values found.
        seed: Seed of the second search.
        patience: See `x`.
        leaders: See `x`.
    """
    claim = factor * supremum(problem, x, values, patience, leaders)
    wanted = np.nonzero(np.any(values > 0.0, axis=0))[0]

    def check() -> tuple[Estimate, ...]:
        second = again(problem, wanted, claim[wanted], seed)
        return tuple(Estimate(names[int(i)], float(claim[i]), float(each))
                     for i, each in zip(wanted, second, strict=True))

    return claim, check
