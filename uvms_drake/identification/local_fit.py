"""Samples of a signal at irregular times, on a grid with both derivatives, by local fits."""

import numpy as np

REACH = 0.15
"""Half of the time that a fit uses [s]."""
LEAST = 5
"""Smallest number of samples of a fit."""


def local_quadratic(time: np.ndarray, values: np.ndarray, grid: np.ndarray, reach: float = REACH
                    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns x, ẋ, ẍ (T, c) at times of a grid, nan where samples are missing.

    At each time t it is the least-squares fit x + ẋs + ½ẍs², s = tᵢ − t, to the samples within
    `reach` of t, or to the `LEAST` nearest ones, unless the gap about t is longer than `reach`.

    Args:
        time: Times of the samples, increasing (N,) [s].
        values: Samples (N, c); those that are not finite are left out.
        grid: Times (T,) [s].
        reach: Half of the time that a fit uses [s].
    """
    known = np.all(np.isfinite(values), axis=1)
    time, values = time[known], values[known]
    missing = np.full((len(grid), values.shape[1]), np.nan)
    if len(time) < LEAST:
        return missing, missing.copy(), missing.copy()
    first, last = (np.searchsorted(time, grid + side * reach) for side in (-1.0, 1.0))
    count = max(int(np.max(last - first)), LEAST)
    middle = np.searchsorted(time, grid)
    start = np.clip(np.where(last - first < LEAST, middle - LEAST // 2 - 1, first),
                    0, max(len(time) - count, 0))
    at = np.minimum(start[:, None] + np.arange(count), len(time) - 1)
    s = (time[at] - grid[:, None]) / reach
    # Of those within reach all count, and the nearest ones in any case.
    nearest = np.sort(np.abs(s), axis=1)[:, min(LEAST, count) - 1]
    weight = np.abs(s) <= np.maximum(nearest, 1.0)[:, None]
    basis = np.stack([np.ones_like(s), s, 0.5 * s**2], axis=-1) * weight[..., None]
    normal = basis.swapaxes(1, 2) @ basis
    x = np.linalg.solve(normal + 1e-12 * np.eye(3), basis.swapaxes(1, 2) @ values[at])
    before = grid - time[np.maximum(np.searchsorted(time, grid, "right") - 1, 0)]
    after = time[np.minimum(middle, len(time) - 1)] - grid
    x[(before + after > reach) | (np.minimum(before, after) < -1e-9)] = np.nan
    return x[:, 0], x[:, 1] / reach, x[:, 2] / reach**2
