"""Largest values and variances of outputs by errors that enter a linear periodic system.

For the impulse responses hₗ of a row, l the number of ticks since an input, and errors within w:

    samples    worst Σ|hₗ| w,    variance Σ hₗ² σ²,                                        (1)
    fixes      the same of the sums H of hₗ from fix to fix, and Σ hₗ · (time since the fix) times
               the growth, largest over all sequences of fixes; by chance ln E e^{sx}, see (2),
    constant   |Σ hₗ| w,    slow  |Σ hₗ| w + ẇ h Σₗ |Σ_{j>l} hⱼ|.

All are the largest over the recorded phases of a period. Of `most` fixes the first is always there,
and those after it independently, so that for a growth a, with H and the ramp's R from fix to fix,

    E e^{sx} = Π Σ P(lost fixes) Π e^{s²σ²H²/2 + saR},                                      (2)

over groups of `most` fixes. Proofs: tube/coupled/theory.md#gains-by-the-pattern-of-an-error.
"""

import math
from collections.abc import Callable, Sequence
from fractions import Fraction
from itertools import product
from typing import NamedTuple

import numpy as np

from uvms_drake.model.signals.linear import Block, ErrorChannel
from uvms_drake.tube.coupled.periodic import STEP, PeriodicSystem

FINEST = 1000
"""Largest denominator of the time between two ticks over that of a group of fixes."""
SEARCH, THINNED = 6, 8
"""Steps of the search for s, and number of times of the fixes that it looks at."""


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

    def gains(self, channels: Sequence[ErrorChannel], quantile: float) -> list[Gain]:
        """Returns the largest effect of each channel over the phases.

        The variance of fixes, of which there is one channel at most, is that of a Gaussian one with
        the same bound together with all other channels.

        Args:
            channels: The channels.
            quantile: q, with P(x > bound) ≤ e^{−q²/2}.
        """
        found = [self.gain(channel) for channel in channels]
        rest = np.sum([gain.variance for gain in found], axis=0)
        return [gain if channel.fixes is None else
                gain._replace(variance=self._of_fixes(channel, rest, quantile))
                for channel, gain in zip(channels, found, strict=True)]

    def gain(self, channel: ErrorChannel) -> Gain:
        """Returns the largest effect of a channel over the phases; of fixes without a variance."""
        entry, tick = self._entry(channel)
        found = [_gain(channel, h, tick) for h in self._by_phase(channel, entry)]
        return Gain(*(np.max(each, axis=0) for each in zip(*found, strict=True)))

    def _entry(self, channel: ErrorChannel) -> tuple[Block, float]:
        """Returns the entry of a channel and the time between two of its ticks [s]."""
        (entry,) = channel.entry.parts
        return entry, float(self.system.period) / len(self.system.ticks(entry))

    def _by_phase(self, channel: ErrorChannel, entry: Block) -> list[np.ndarray]:
        return [self.system.response(entry, phase) @ channel.entry.parts[entry]
                for phase in self.phases]

    def _of_fixes(self, channel: ErrorChannel, rest: np.ndarray, quantile: float) -> np.ndarray:
        """Returns (b/q)² less the other variances (o,), with the bound b of their sum.

        For any s it is P(x > b) ≤ e^{−q²/2}, b = [q²/2 + s²(rest + V)/2]/s, V = 2 ln E e^{sx}/s².
        """
        assert channel.sigma is not None and channel.fixes is not None
        entry, tick = self._entry(channel)
        responses = self._by_phase(channel, entry)

        def variance(s: np.ndarray, times: int, of: list[np.ndarray]) -> np.ndarray:
            return np.max([_variance(channel, h, tick, s, times, i / len(of))
                           for i, h in enumerate(of)], axis=0)

        # Times of the fixes are `STEP` apart in all phases together.
        times = math.ceil(tick / channel.fixes.per_tick * channel.fixes.most
                          / (STEP * len(responses)))

        whole = rest + np.max([np.sum(h**2, axis=0) @ channel.sigma**2 for h in responses], axis=0)
        s = quantile / np.sqrt(np.maximum(whole, np.finfo(float).tiny))
        for _ in range(SEARCH):  # Towards s = q / √(rest + V), at which b is least.
            s = np.sqrt(s * quantile / np.sqrt(rest + variance(s, THINNED, responses[:1])))
        bound = 0.5 * quantile**2 / s + 0.5 * s * (rest + variance(s, times, responses))
        out: np.ndarray = (bound / quantile)**2 - rest
        return out


def _gain(channel: ErrorChannel, h: np.ndarray, tick: float) -> Gain:
    """Returns the effect by responses (lags, o, size)."""
    bound = np.asarray(channel.bound, dtype=float)
    sigma = np.zeros_like(bound) if channel.sigma is None else channel.sigma
    none = np.zeros(h.shape[1])
    if channel.fixes is not None:
        least, most = channel.fixes.ticks
        constant = _over_dwells(h, least, most, lambda sums, _: np.abs(sums))
        grown = np.maximum(*(_over_dwells(
            sign * h, least, most,
            lambda sums, ages: tick * (ages + np.maximum(sums, 0.0))) for sign in (1.0, -1.0)))
        return Gain(constant @ bound + grown @ channel.fixes.growth, none)
    total = np.abs(np.sum(h, axis=0))
    if channel.kind == "constant":
        return Gain(total @ bound, none)
    if channel.kind == "slow":
        after = np.sum(h, axis=0) - np.cumsum(h, axis=0)
        rate = tick * np.sum(np.abs(after), axis=0) @ np.asarray(channel.rate, dtype=float)
        return Gain(total @ bound + rate, none)
    return Gain(np.sum(np.abs(h), axis=0) @ bound, np.sum(h**2, axis=0) @ sigma**2)


def _variance(channel: ErrorChannel, h: np.ndarray, tick: float, s: np.ndarray,
              times: int, shift: float = 0.0) -> np.ndarray:
    """Returns 2 ln E e^{sx}/s² (o,) of (2), the largest over signs of a and times of the fixes.

    Args:
        channel: Channel of fixes.
        h: Responses (lags, o, size).
        tick: Time between two ticks [s].
        s: The argument, positive (o,).
        times: Number of times of the fixes, over the time of `most` of them.
        shift: First of them over the time between two.
    """
    fixes = channel.fixes
    assert fixes is not None and channel.sigma is not None
    most, (lags, o, size) = fixes.most, h.shape
    share = Fraction(fixes.per_tick / most).limit_denominator(FINEST)
    n, whole = share.numerator, share.denominator  # A tick is n, a group of fixes `whole` units.
    unit = tick / n
    every = max(whole // times, 1)
    flat = h.reshape(lags, -1)
    grows = np.array(list(product((1.0, -1.0), repeat=size))) * fixes.growth
    out = np.zeros(o)
    for newest in range(int(shift * every), whole, every):
        # Sums of h, and of h times the time since the fix, over the ticks of each fix.
        at = newest - n * np.arange(lags)
        fix = at * most // whole
        first = np.flatnonzero(np.diff(fix, prepend=fix[0] + 1))
        age = unit * (at - fix * whole / most)
        groups = fix[0] // most - fix[-1] // most + 1
        H, R = np.zeros((2, groups * most, o * size))
        place = fix[first] - fix[-1] // most * most
        H[place], R[place] = np.add.reduceat(flat, first), np.add.reduceat(
            flat * age[:, None], first)
        H, R = (each.reshape(groups, most, o, size) for each in (H, R))
        # Logarithm of the mean over lost fixes, up to each fix that is there.
        mean = [np.zeros((len(grows), groups, o))]
        for end in range(1, most + 1):
            parts = []
            for begin in range(end):
                since, later = H[:, begin:end], np.arange(end - begin)[:, None, None]
                ramp = np.sum(R[:, begin:end] + later * (unit * whole / most) * since, axis=1)
                chance = fixes.lost**(end - 1 - begin) * (1.0 - fixes.lost if begin else 1.0)
                with np.errstate(divide="ignore"):
                    parts.append(mean[begin] + np.log(chance) + s * np.einsum(
                        "ac,goc->ago", grows, ramp) + 0.5 * s**2 * (
                            np.sum(since, axis=1)**2 @ channel.sigma**2))
            mean.append(np.logaddexp.reduce(parts))
        out = np.maximum(out, np.max(np.sum(mean[-1], axis=1), axis=0))
    return 2.0 * out / s**2


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
