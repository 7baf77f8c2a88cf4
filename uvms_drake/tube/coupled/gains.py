"""Largest values and variances of outputs by errors that enter a linear periodic system.

For the impulse responses hₗ of a row, l the number of ticks since an input, and errors within w:

    samples    worst Σ|hₗ| w,    variance Σ hₗ² σ²,                                        (1)
    hold       the same of the sums of hₗ over a dwell, largest over all sequences of dwells,
    ramp       Σ hₗ · (time since its dwell began), likewise: w is the rate,
    constant   |Σ hₗ| w,    slow  |Σ hₗ| w + ẇ h Σₗ |Σ_{j>l} hⱼ|,
    steps      Σ|hₗ − α − βl| w + |α − β/2| v/h + |β| p/h², α + βl the line that hₗ tends to.

All are the largest over the recorded phases of a period. Proofs:
tube/coupled/theory.md#gains-by-the-pattern-of-an-error.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from uvms_drake.model.signals.linear import Block, ErrorChannel
from uvms_drake.tube.coupled.periodic import PeriodicSystem


class Gain(NamedTuple):
    """Effect of a channel on each row (o,)."""

    worst: np.ndarray
    """Largest value by errors within their bounds."""
    variance: np.ndarray
    """Variance bound; zero of a channel that is not random."""


class Responses:
    """Impulse responses of a system, computed once for each entry and phase.

    Args:
        system: The system, which is stable.
        phases: Steps of a period at whose ends the outputs are looked at; all if left out.
    """

    def __init__(self, system: PeriodicSystem, phases: tuple[int, ...] | None = None):
        self.system = system
        self.phases = tuple(range(len(system.steps))) if phases is None else phases

    def gain(self, channel: ErrorChannel) -> Gain:
        """Returns the largest effect of a channel over the phases."""
        (entry, of_components), = channel.entry.parts.items()
        found = [self._gain(channel, entry, self.system.response(entry, phase) @ of_components)
                 for phase in self.phases]
        return Gain(*(np.max(each, axis=0) for each in zip(*found, strict=True)))

    def _gain(self, channel: ErrorChannel, entry: Block, h: np.ndarray) -> Gain:
        """Returns the effect by responses (lags, o, size)."""
        bound = np.asarray(channel.bound, dtype=float)
        tick = float(self.system.period) / len(self.system.ticks(entry))
        sigma = np.zeros_like(bound) if channel.sigma is None else channel.sigma
        if channel.kind == "hold":
            least, most = channel.ticks
            worst = _over_dwells(h, least, most, lambda sums, _: np.abs(sums))
            square = _over_dwells(h, least, most, lambda sums, _: sums**2)
            return Gain(worst @ bound, square @ sigma**2)
        if channel.kind == "ramp":
            least, most = channel.ticks
            worst = np.maximum(*(_over_dwells(
                sign * h, least, most,
                lambda sums, ages: tick * (ages + np.maximum(sums, 0.0))) for sign in (1.0, -1.0)))
            return Gain(worst @ bound, np.zeros(h.shape[1]))
        if channel.kind == "steps":
            assert channel.sums is not None
            speed, reach = channel.sums
            level, slope, rest = _beside_line(h)
            worst = np.sum(np.abs(rest), axis=0) @ bound + np.abs(
                level - 0.5 * slope) @ (speed / tick) + np.abs(slope) @ (reach / tick**2)
            return Gain(worst, np.zeros(h.shape[1]))
        total = np.abs(np.sum(h, axis=0))
        if channel.kind == "constant":
            return Gain(total @ bound, np.zeros(h.shape[1]))
        if channel.kind == "slow":
            after = np.sum(h, axis=0) - np.cumsum(h, axis=0)
            rate = tick * np.sum(np.abs(after), axis=0) @ np.asarray(channel.rate, dtype=float)
            return Gain(total @ bound + rate, np.zeros(h.shape[1]))
        return Gain(np.sum(np.abs(h), axis=0) @ bound, np.sum(h**2, axis=0) @ sigma**2)


def _beside_line(h: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns α, β (o, size) of the line that responses tend to, and their deviation from it."""
    lags = np.arange(len(h))
    last = lags[-len(h) // 4:]
    slope, level = np.polyfit(last, h[last].reshape(len(last), -1), 1).reshape(2, *h.shape[1:])
    return level, slope, h - level - slope * lags[:, None, None]


def _over_dwells(h: np.ndarray, least: int, most: int,
                 value: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> np.ndarray:
    """Returns the largest sum (o, size) of values of dwells that follow each other.

    A dwell has `least` to `most` ticks, the present one 1 to `most`.

    Args:
        h: Responses (lags, o, size), the latest input first.
        least: Ticks of the shortest dwell.
        most: Ticks of the longest.
        value: Value of dwells (m, o, size) by the sums of h over them, and by those of h times the
            number of ticks since the dwell began.
    """
    lags, *shape = h.shape
    zero = np.zeros((1, *shape))
    sums = np.concatenate([zero, np.cumsum(h, axis=0)])
    moments = np.concatenate([zero, np.cumsum(np.arange(lags)[:, None, None] * h, axis=0)])

    def dwells(start: int, shortest: int) -> tuple[np.ndarray, np.ndarray]:
        """Returns values of dwells from a lag on, of `shortest` ticks and more, and their ends."""
        ends = np.minimum(np.arange(start + shortest, start + most + 1), lags)
        of_h = sums[ends] - sums[start]
        # Ticks since the dwell began are counted from its earliest tick, at the largest lag.
        ages = (ends - 1)[:, None, None] * of_h - (moments[ends] - moments[start])
        return value(of_h, ages), ends

    best = np.zeros((lags + 1, *shape))
    for start in range(lags - 1, 0, -1):
        values, ends = dwells(start, least)
        best[start] = np.max(values + best[ends], axis=0)
    values, ends = dwells(0, 1)
    out: np.ndarray = np.max(values + best[ends], axis=0)
    return out
