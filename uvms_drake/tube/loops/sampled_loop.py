"""Peak-to-peak gain of a linear loop that flows, and jumps at the ticks of a clock.

    ẋ = A x + B w between ticks,   x⁺ = R x at each tick,   z = C x.

An input |w(t)| ≤ 1 moves z at the time t by at most ∫|K(t, u)|du, K the response to an impulse at
u, and the worst w does so. The largest over a period is computed at phases of it, with bounds
between them: see tube/loops/theory.md#peak-to-peak-gains-of-a-sampled-loop.
"""

import math

import numpy as np

PHASES = 16
"""Intervals of a period, at the ends of which the gain is computed."""
TAIL = 1e-7
"""Fraction of a response at which it is over."""
STABLE = 1e-9
"""Distance of a stable loop's eigenvalues from the unit circle."""


def peak_gain(A: np.ndarray, B: np.ndarray, C: np.ndarray, R: np.ndarray, period: float,
              points: int) -> np.ndarray:
    """Returns the largest |z| (o,) by any input |w(t)| ≤ 1; inf: unstable.

    Args:
        A: Flow (m, m) [1/s].
        B: Input (m,).
        C: Outputs (o, m).
        R: Jump (m, m) at a tick.
        period: Time from a tick to the next [s].
        points: Intervals of the quadrature of |K| in a period, a multiple of `PHASES`.
    """
    step, each, o = period / points, points // PHASES, len(C)
    flow = powers(exponential(A * step), points + 1)
    cycle = R @ flow[-1]
    radius = np.max(np.abs(np.linalg.eigvals(cycle)))
    if radius >= 1.0 - STABLE:
        return np.full(o, np.inf)
    periods = len(A) + math.ceil(math.log(TAIL) / math.log(max(radius, TAIL)))

    # ∫|K| of z, of z̈ and of the states at the phases: impulses before the last tick, and since.
    read = np.concatenate([C, C @ A @ A, np.eye(len(A))])
    response = flow @ B  # (points + 1, m), since an impulse
    after_tick = powers(cycle, periods) @ R @ response.T
    values = np.array([
        np.sum(absolute_integral(read @ flow[j] @ after_tick, step), axis=0)
        + absolute_integral(read @ response[: j + 1].T, step)
        for j in range(0, points + 1, each)])

    # Between two phases: the deviation from a line, and impulses since the phase before.
    z, second, states = np.split(values, [o, 2 * o], axis=1)
    length = period / PHASES
    fourth = np.abs(C @ np.linalg.matrix_power(A, 4)) @ exponential(np.abs(A) * length)
    bend = 0.125 * length**2 * (np.maximum(second[:-1], second[1:])
                                + 0.125 * length**2 * states[:-1] @ fourth.T)
    fresh = np.abs(response[: each + 1] @ C.T)
    uneven = 0.25 * each * step * np.ptp(fresh, axis=0)
    return np.max(np.maximum(z[:-1], z[1:]) + bend, axis=0) + uneven


def powers(matrix: np.ndarray, count: int) -> np.ndarray:
    """Returns matrixⁱ for i < count (count, m, m)."""
    out = np.empty((count, *matrix.shape))
    out[0] = np.eye(len(matrix))
    for i in range(1, count):
        out[i] = matrix @ out[i - 1]
    return out


def absolute_integral(values: np.ndarray, step: float) -> np.ndarray:
    """Returns a bound of ∫|K| (...) from the values of K at equidistant points (..., m).

    Between two points K is monotone but for terms of second order, and |K| at most the larger of
    the two ends.
    """
    size = np.abs(values)
    return step * np.sum(np.maximum(size[..., 1:], size[..., :-1]), axis=-1)


def exponential(A: np.ndarray) -> np.ndarray:
    """Returns e^A (m, m), by its series for A/2ᵏ and k squarings."""
    squarings = max(0, math.ceil(math.log2(max(float(np.linalg.norm(A, 1)), 1e-300))) + 3)
    small, term = A / 2.0**squarings, np.eye(len(A))
    total = term
    for i in range(1, 14):
        term = term @ small / i
        total = total + term
    for _ in range(squarings):
        total = total @ total
    return total
