"""Second search for estimated suprema, without gradients, samples or climbers of the first.

An evolution strategy for the suprema that `ascent` finds with gradients: in one vector of about
normal numbers, of which the pose is a linear function, ζ̄ and ū are projected on their sets, and the
errors are furthest along a direction in theirs. See tube/theory.md#estimates-and-second-searches.
"""

import numpy as np

from uvms_drake.tube.search.evolution_strategy import evolve
from uvms_drake.tube.search.search_problem import SearchProblem

GENERATIONS = 120
"""Number of generations of the evolution strategy."""
BATCH = 400
"""Number of states evaluated at a time."""


def second_search(problem: SearchProblem, wanted: np.ndarray, rng: np.random.Generator
                  ) -> np.ndarray:
    """Returns the largest values found of the wanted channels (number of `wanted`,).

    Args:
        problem: The problem.
        wanted: Indices of channels.
        rng: Source of random numbers.
    """
    # One run for each channel, from random poses.
    size, declared, runs = problem.size, problem.declared, len(wanted)
    lower, upper = declared.box
    scale = declared.scale(problem.model)[:size]
    start = problem.draw(runs, rng)[:, None, :size]
    balls = ((slice(0, 3), declared.nu1), (slice(3, 6), declared.nu2),
             (slice(6, size), declared.qdot))

    def decode(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns the motions and the errors of candidates (r, λ, 3(6+n) + errors)."""
        pose, zeta, u, along = (z[..., : size], z[..., size: 2 * size].copy(),
                                z[..., 2 * size: 3 * size], z[..., 3 * size:])
        pose = start + scale * pose
        pose[..., 3:] = np.clip(pose[..., 3:], lower, upper)
        for ball, radius in balls:
            length = np.linalg.norm(zeta[..., ball], axis=-1, keepdims=True)
            zeta[..., ball] *= radius / np.maximum(1.0, length)
        error = np.zeros_like(along)
        for matrix, radius in problem.parts:
            part = along @ matrix
            length = np.linalg.norm(part, axis=-1, keepdims=True)
            error += radius * (part / np.maximum(length, 1e-12)) @ matrix.T
        return np.concatenate([pose, zeta, np.clip(u, -1.0, 1.0)], axis=-1), error

    def values(z: np.ndarray) -> np.ndarray:
        """Returns the values (r, λ), those of motions outside of the set negative."""
        x, error = (each.reshape(-1, each.shape[-1]) for each in decode(z))
        found = np.concatenate([problem.values(x[i: i + BATCH], error[i: i + BATCH])
                                for i in range(0, len(x), BATCH)]).reshape(*z.shape[:2], -1)
        sizes = np.stack([np.linalg.norm(each[:, problem.channels[i]], axis=-1)
                          for each, i in zip(found, wanted, strict=True)])
        outside = np.max(np.abs(problem.bounded(x[:, :size])), axis=1).reshape(sizes.shape)
        return np.where(outside <= 1.0, sizes, -outside)

    first = 0.3 * rng.normal(size=(runs, 3 * size + problem.errors))
    first[:, :size] = 0.0
    return evolve(values, first, GENERATIONS, rng)[0]
