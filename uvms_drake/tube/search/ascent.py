"""Largest values of a `SearchProblem`, searched for by ascent from samples.

Remainders are functions of the pose, of ζ̄, in balls, of ū, in a box, and of the errors, sums of
ellipsoids. In ū they are affine, in ζ̄ and the errors nearly linear or quadratic: there the point
of the set that is furthest up the gradient is soon the maximum. So a step goes part of the way to
that point, and in 𝔮̄ part of the way along the gradient, in units of the set's widths, bent along
active limits of tip pitch and contact, with and without some of the last step's direction. Several
lengths are tried at once, the best counts, if it is better. All climbers, a few for each channel
from the worst samples, go in parallel in one batch, and the better of them go on.

A value that is found is reached, so it is a bound from below; `second_search` looks for the same by
other means. See tube/theory.md#estimates-and-second-searches.
"""

from itertools import product

import numpy as np

from uvms_drake.model.frames.euler import COMPLEX_STEP
from uvms_drake.tube.search.search_problem import SearchProblem

LEADERS, ROUNDS, STEPS = 8, 3, 4
"""Climbers for each channel, from its worst samples; rounds, after each of which the better half
goes on; and steps in a round."""
BATCH = 400
"""States evaluated at a time."""
REACHES = (1.0, 0.3, 0.1, 0.0)
"""Steps in 𝔮̄ that are tried, over a climber's reach."""
JUMPS = (1.0, 0.3)
"""Fractions of the way in ζ̄, ū and the errors that are tried."""
MOMENTUM = 0.7
"""Share of the last step's direction that is tried in the next one: ridges are bent."""
WIDENED, NARROWED = 2.5, 0.3
"""Factors of a climber's reach after its best step and after none."""
ACTIVE = 0.97
"""Fraction of a bound from which on it bends a step."""
DIFFERENCE = 1e-6
"""Step of the finite differences of bounded values."""


def first_order(problem: SearchProblem, x: np.ndarray) -> np.ndarray:
    """Returns the largest values to first order in the errors (m, channels)."""
    steps = 1j * COMPLEX_STEP * np.eye(problem.errors)
    out = np.empty((len(x), len(problem.channels)))
    for i in range(0, len(x), BATCH // problem.size):
        some = slice(i, i + BATCH // problem.size)
        slopes = problem.values(x[some, None] + 0j, steps).imag / COMPLEX_STEP  # (m, errors, c)
        out[some] = np.stack([sum(
            radius * np.linalg.norm(matrix.T @ slopes[..., row], 2, axis=(1, 2))
            for matrix, radius in problem.parts) for row in problem.channels], axis=1)
    return out


def supremum(problem: SearchProblem, x: np.ndarray, values: np.ndarray, patience: int = 1,
             leaders: int | None = None) -> np.ndarray:
    """Returns the largest values that were found, by channel; zero where there are no errors.

    Args:
        problem: The problem.
        x: Samples of motions (m, 3(6+n)).
        values: Their `first_order`; zero for channels that are not wanted (m, c).
        patience: Factor of the number of steps.
        leaders: Number of climbers for each channel; None: `LEADERS`.
    """
    out = np.max(values, axis=0)
    wanted = np.nonzero(out > 0.0)[0]
    if len(wanted) == 0:
        return out
    worst = np.argsort(-values[:, wanted], axis=0, kind="stable")[:leaders or LEADERS].T
    start = x[worst.ravel()]
    climb = Climb(problem, start, np.zeros((len(start), problem.errors)),
                  [problem.channels[i] for i in wanted for _ in range(worst.shape[1])])
    first = np.arange(len(wanted))[:, None]
    for _ in range(ROUNDS):
        for _ in range(patience * STEPS):
            climb.step()
        climb.exchange()
        value = climb.value.reshape(len(wanted), -1)
        better = np.argsort(-value, axis=1, kind="stable")[:, : max(1, value.shape[1] // 2)]
        climb.keep((first * value.shape[1] + better).ravel())
    climb.keep(first[:, 0] * (len(climb.x) // len(wanted)))  # The best for each channel.
    out[wanted] = climb.value
    return out


class Climb:
    """Climbers in parallel, each for one channel.

    Args:
        problem: The problem.
        x: Initial motions of the set (m, 3(6+n)).
        error: Initial errors (m, errors).
        channels: Channel of each.
    """

    def __init__(self, problem: SearchProblem, x: np.ndarray, error: np.ndarray,
                 channels: list[slice]):
        self._problem = problem
        value = problem.values(x, error)
        self._mask = np.zeros_like(value)
        for row, channel in zip(self._mask, channels, strict=True):
            row[channel] = 1.0
        declared, size = problem.declared, problem.size
        lower, upper = declared.box
        free = np.full(3, np.inf)
        self._box = np.concatenate([-free, lower]), np.concatenate([free, upper])
        self._scale = declared.scale(problem.model)[:size]
        self._balls = ((slice(size, size + 3), declared.nu1), (slice(size + 3, size + 6),
                       declared.nu2), (slice(size + 6, 2 * size), declared.qdot))
        self.x, self.error = x, error
        self.value: np.ndarray = np.linalg.norm(value * self._mask, axis=1)
        self._reach = np.ones(len(x))
        self._last = np.zeros((len(x), size))

    def keep(self, which: np.ndarray) -> None:
        """Keeps the climbers of these indices."""
        self.x, self.error, self.value = self.x[which], self.error[which], self.value[which]
        self._mask, self._reach, self._last = (
            self._mask[which], self._reach[which], self._last[which])

    def exchange(self) -> None:
        """Puts the best motion of all in the place of each channel's worst, if it is a record."""
        reached = np.linalg.norm(self._problem.values(self.x, self.error)[:, None]
                                 * self._mask, axis=2)  # (m, m): motions by channels
        for mask in np.unique(self._mask, axis=0):
            own = np.nonzero(np.all(self._mask == mask, axis=1))[0]
            best = np.argmax(reached[:, own[0]])
            if reached[best, own[0]] > np.max(self.value[own]):
                worst = own[np.argmin(self.value[own])]
                self.x[worst], self.error[worst] = self.x[best], self.error[best]
                self.value[worst] = reached[best, own[0]]

    def step(self) -> None:
        """Takes one step."""
        # Points and directions up the gradients.
        by_x, by_error = self._gradients()
        size = self._problem.size
        toward = self._furthest_motion(by_x), self._furthest_error(by_error)
        pose, toward_pose = self.x[:, :size], self._uphill(by_x[:, :size])
        directions = (toward_pose, toward_pose + MOMENTUM * self._last)
        # Candidates of several lengths, all in one batch.
        tried = [(reach, jump, direction) for reach in REACHES for jump, direction in product(
            JUMPS, directions if reach > 0.0 else directions[:1])]
        motions = np.stack([self.x + jump * (toward[0] - self.x) for _, jump, _ in tried])
        errors = np.stack([self.error + jump * (toward[1] - self.error) for _, jump, _ in tried])
        motions[..., :size] = self._kept(np.stack([
            pose + (reach * self._reach)[:, None] * direction for reach, _, direction in tried]))
        values = self._values(motions, errors)
        # The best of them, if it is better, and the reach of the next step.
        best = np.argmax(values, axis=0), np.arange(len(self.x))
        better = values[best] > self.value
        self.value = np.where(better, values[best], self.value)
        gone = np.where(better[:, None], motions[best], self.x)
        moved = (gone - self.x)[:, :size]
        length = np.max(np.abs(moved / self._scale), axis=1, keepdims=True)
        self._last = moved / np.maximum(length, 1e-300)
        self.x = gone
        self.error = np.where(better[:, None], errors[best], self.error)
        reach = np.array([reach for reach, _, _ in tried])[best[0]]
        self._reach = np.clip(self._reach * np.where(
            better & (reach > 0.0), WIDENED * reach, NARROWED), 1e-4, 1.0)

    def _values(self, x: np.ndarray, error: np.ndarray) -> np.ndarray:
        """Returns the sizes of the climbers' channels (k, m) at k motions and errors of each."""
        mask = np.tile(self._mask, (len(x), 1))
        motions, errors = (each.reshape(len(mask), -1) for each in (x, error))
        return np.concatenate([np.linalg.norm(
            self._problem.values(motions[i: i + BATCH], errors[i: i + BATCH]) * mask[i: i + BATCH],
            axis=1) for i in range(0, len(mask), BATCH)]).reshape(x.shape[:2])

    def _gradients(self) -> tuple[np.ndarray, np.ndarray]:
        """Returns the derivatives of the climbers' channels by motion and by error.

        At no errors all is zero: there the channel counts along its leading direction.
        """
        problem, size = self._problem, self._problem.size
        by_x, by_error = np.empty((len(self.x), 3 * size)), np.empty(self.error.shape)
        some = max(1, BATCH // (3 * size))
        for i in range(0, len(self.x), some):
            x, error, mask = (each[i: i + some, None] for each in (self.x, self.error, self._mask))
            value = problem.values(x, error) * mask
            moved = problem.values(x + 0j, error + 1j * COMPLEX_STEP * np.eye(problem.errors))
            slope = moved.imag / COMPLEX_STEP * mask
            length = np.linalg.norm(value, axis=-1, keepdims=True)
            unit = value / np.maximum(length, 1e-300)
            still = ~np.any(error != 0.0, axis=(-2, -1))
            unit[still] = np.linalg.svd(slope[still], full_matrices=False)[2][:, :1]
            unit = unit.swapaxes(-1, -2)
            by_error[i: i + some] = (slope @ unit)[..., 0]
            moved = problem.values(x + 1j * COMPLEX_STEP * np.eye(3 * size), error + 0j)
            by_x[i: i + some] = (moved.imag / COMPLEX_STEP @ unit)[..., 0]
        return by_x, by_error

    def _furthest_motion(self, gradient: np.ndarray) -> np.ndarray:
        """Returns the ζ̄ and ū furthest up the gradient, and the poses as they are."""
        size, out = self._problem.size, self.x.copy()
        for ball, radius in self._balls:
            out[:, ball] = radius * _unit(gradient[:, ball], out[:, ball] / radius)
        by_u = gradient[:, 2 * size:]
        out[:, 2 * size:] = np.where(by_u == 0.0, out[:, 2 * size:], np.sign(by_u))
        return out

    def _furthest_error(self, gradient: np.ndarray) -> np.ndarray:
        """Returns the error furthest up the gradient."""
        out = np.zeros_like(gradient)
        for matrix, radius in self._problem.parts:
            out += radius * _unit(gradient @ matrix, 0.0) @ matrix.T
        return out

    def _uphill(self, gradient: np.ndarray) -> np.ndarray:
        """Returns the poses' direction up (m, 6+n), scaled by the widths of the set."""
        pose, scale = self.x[:, : self._problem.size], self._scale
        up = gradient * scale
        up[:, 3:] = np.where(((pose >= self._box[1]) & (up > 0.0)
                              | (pose <= self._box[0]) & (up < 0.0))[:, 3:], 0.0, up[:, 3:])
        # Along active limits.
        steps = DIFFERENCE * np.diag(scale)
        sides = (pose[:, None] + np.concatenate([steps, -steps])).reshape(-1, len(scale))
        level = self._problem.bounded(pose)
        plus, minus = np.split(self._problem.bounded(sides).reshape(
            len(pose), -1, level.shape[1]), 2, axis=1)
        for i in range(level.shape[1]):
            slope = (plus - minus)[..., i] * (np.abs(up) > 0.0)
            slope = slope / np.maximum(np.linalg.norm(slope, axis=1, keepdims=True), 1e-12)
            along = np.sum(up * slope, axis=1)
            leaves = (np.abs(level[:, i]) > ACTIVE) & (along * level[:, i] > 0.0)
            up -= np.where(leaves, along, 0.0)[:, None] * slope
        return scale * up / np.maximum(np.max(np.abs(up), axis=1, keepdims=True), 1e-300)

    def _kept(self, pose: np.ndarray) -> np.ndarray:
        """Returns poses (k, m, 6+n), pulled towards the climbers until they are inside."""
        here = np.broadcast_to(self.x[:, : self._problem.size], pose.shape)
        return self._problem.pulled(
            *(each.reshape(-1, pose.shape[-1]) for each in (np.clip(pose, *self._box), here)),
            ).reshape(pose.shape)


def _unit(vectors: np.ndarray, otherwise: np.ndarray | float) -> np.ndarray:
    """Returns unit vectors (m, j), `otherwise` where one is zero."""
    size = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.where(size > 0.0, vectors / np.maximum(size, 1e-300), otherwise)
