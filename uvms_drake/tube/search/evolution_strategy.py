"""Maximisation without gradients: the CMA evolution strategy, several searches in one batch.

Hansen (2016), "The CMA evolution strategy: a tutorial", with its default parameters: from a mean m,
a step s and a covariance C come λ candidates m + s N(0, C); the weighted mean of the better half is
the next m, and two evolution paths adapt s and C. Only the order of the values matters.
"""

from collections.abc import Callable

import numpy as np

EIGEN_EVERY = 5
"""Number of generations between two decompositions of C, which changes slowly."""


def evolve(function: Callable[[np.ndarray], np.ndarray], start: np.ndarray, generations: int,
           rng: np.random.Generator, step: float = 0.5) -> tuple[np.ndarray, np.ndarray]:
    """Returns the largest values (r,) of r searches, and their places (r, d).

    Args:
        function: Values (r, λ) of candidates (r, λ, d), one row for each search.
        start: Initial means (r, d), in coordinates of about equal range.
        generations: Number of generations.
        rng: Source of the candidates.
        step: First standard deviation, in these coordinates.
    """
    # Parameters of the tutorial.
    runs, d = start.shape
    count = 4 + int(3.0 * np.log(d))
    half = count // 2
    weights = np.log(half + 0.5) - np.log(np.arange(1, half + 1))
    weights /= np.sum(weights)
    mass = 1.0 / np.sum(weights**2)
    c_step = (mass + 2.0) / (d + mass + 5.0)
    damping = 1.0 + c_step + 2.0 * max(0.0, np.sqrt((mass - 1.0) / (d + 1.0)) - 1.0)
    c_path = (4.0 + mass / d) / (d + 4.0 + 2.0 * mass / d)
    c_one = 2.0 / ((d + 1.3) ** 2 + mass)
    c_many = min(1.0 - c_one, 2.0 * (mass - 2.0 + 1.0 / mass) / ((d + 2.0) ** 2 + mass))
    usual = np.sqrt(d) * (1.0 - 1.0 / (4.0 * d) + 1.0 / (21.0 * d**2))

    # Mean, step, covariance and paths.
    mean, size = start.copy(), np.full(runs, step)
    C = np.tile(np.eye(d), (runs, 1, 1))
    basis, axes = C.copy(), np.ones((runs, d))
    step_path, path = np.zeros((runs, d)), np.zeros((runs, d))
    best, where, run = np.full(runs, -np.inf), start.copy(), np.arange(runs)
    for generation in range(generations):
        # Candidates, and the best so far.
        normal = rng.normal(size=(runs, count, d)) * axes[:, None]
        moves = normal @ basis.swapaxes(-1, -2)
        tried = mean[:, None] + size[:, None, None] * moves
        values = function(tried)
        order = np.argsort(-values, axis=1)
        top = order[:, 0]
        better = values[run, top] > best
        best = np.where(better, values[run, top], best)
        where = np.where(better[:, None], tried[run, top], where)

        # Mean, paths and covariance of the next generation.
        chosen = moves[run[:, None], order[:, :half]]
        move = weights @ chosen
        mean = mean + size[:, None] * move
        white = (basis @ ((basis.swapaxes(-1, -2) @ move[..., None]) / axes[..., None]))[..., 0]
        step_path = (1.0 - c_step) * step_path + np.sqrt(c_step * (2.0 - c_step) * mass) * white
        length = np.linalg.norm(step_path, axis=1)
        short = length / np.sqrt(1.0 - (1.0 - c_step) ** (2 * generation + 2)) < (
            1.4 + 2.0 / (d + 1.0)) * usual
        path = (1.0 - c_path) * path + (
            short * np.sqrt(c_path * (2.0 - c_path) * mass))[:, None] * move
        C = ((1.0 - c_one - c_many) * C + c_one * path[:, :, None] * path[:, None, :]
             + c_many * np.einsum("i,rij,rik->rjk", weights, chosen, chosen))
        size = size * np.exp(np.minimum(c_step / damping * (length / usual - 1.0), 1.0))
        if generation % EIGEN_EVERY == 0:
            spread, basis = np.linalg.eigh(C)
            axes = np.sqrt(np.maximum(spread, 1e-20))
    return best, where
