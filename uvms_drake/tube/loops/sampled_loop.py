"""Peak-to-peak gains of a linear loop that flows, and jumps at the ticks of a clock.

    ẋ = A x + B w between jumps,   x⁺ = R x at each jump,   x⁺ = R x + N v at the last of a period,

z = C x + D w. An input |w(t)| ≤ 1 moves z at the time t by at most ∫|K(t, u)|du + |D|, K the
response to an impulse at u, and the worst w does so; samples |v| ≤ 1 by at most the sum of |K|. The
largest over a period is computed at phases of it, with bounds between them: see
tube/loops/theory.md#peak-to-peak-gains-of-a-sampled-loop.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

PHASES = 16
"""Intervals of a stretch, at the ends of which the gain is computed."""
TAIL = 1e-7
"""Fraction of a response at which it is over."""
AT_ONCE = 16
"""Periods computed at once."""
STABLE = 1e-9
"""Distance of a stable loop's eigenvalues from the unit circle."""


class Stretch(NamedTuple):
    """A part of the period."""

    duration: float
    """[s]."""
    jump: np.ndarray
    """R (m, m) at its end."""


@dataclass(frozen=True)
class PeriodicLoop:
    """A linear loop with the state x (m,) and the outputs z (o,)."""

    A: np.ndarray
    """Flow (m, m) [1/s]."""
    C: np.ndarray
    """Outputs (o, m)."""
    stretches: tuple[Stretch, ...]
    """The period, from a tick to the next."""
    points: int = 32
    """Intervals of the quadrature of |K| in a stretch, a multiple of `PHASES`."""

    @cached_property
    def _flows(self) -> np.ndarray:
        """e^{At} (stretches, points + 1, m, m) at equidistant times of each stretch."""
        flows = np.empty((len(self.stretches), self.points + 1, *self.A.shape), self.A.dtype)
        for flow, stretch in zip(flows, self.stretches, strict=True):
            step = exponential(self.A * (stretch.duration / self.points))
            flow[0] = np.eye(len(self.A))
            for i in range(self.points):
                flow[i + 1] = step @ flow[i]
        return flows

    @cached_property
    def cycle(self) -> np.ndarray:
        """Φ (m, m), map of the state after a tick to that after the next."""
        cycle = np.eye(len(self.A))
        for stretch, flow in zip(self.stretches, self._flows, strict=True):
            cycle = stretch.jump @ flow[-1] @ cycle
        return cycle

    @cached_property
    def periods(self) -> float:
        """Number of periods after which every response is over; inf: never."""
        radius = np.max(np.abs(np.linalg.eigvals(self.cycle)))
        if radius >= 1.0 - STABLE:
            return math.inf
        return len(self.A) + math.ceil(math.log(TAIL) / math.log(max(radius, TAIL)))

    def flow_gain(self, B: np.ndarray, D: np.ndarray | float = 0.0,
                  weight: np.ndarray | None = None) -> np.ndarray:
        """Returns the largest |z| (o,) by any input |w(t)| ≤ 1; inf: unstable.

        Args:
            B: Input vector of w into the flow (m,).
            D: Its direct feedthrough to the outputs (o,).
            weight: Bound of |w| instead of 1, see `times` (stretches, points + 1).
        """
        return _largest(self._by_flow(B, self.periods, weight=weight)) + np.abs(D)

    def flow_moment(self, B: np.ndarray) -> np.ndarray:
        """Returns a bound of ∫(t − u)|K(t, u)|du (o,): of |K| by its age, up to two periods more.

        Args:
            B: Input vector of w into the flow (m,).
        """
        return _largest(self._by_flow(B, self.periods, by_age=True))

    @property
    def times(self) -> np.ndarray:
        """Times since the tick at the points of the quadrature (stretches, points + 1) [s]."""
        lengths = np.array([stretch.duration for stretch in self.stretches])
        starts = np.cumsum(lengths) - lengths
        share = np.linspace(0.0, 1.0, self.points + 1)
        out: np.ndarray = starts[:, None] + np.multiply.outer(lengths, share)
        return out

    def repeated(self, count: int) -> "PeriodicLoop":
        """Returns the same loop with `count` of its periods as one."""
        return replace(self, stretches=count * self.stretches)

    def zoh_gain(self, B: np.ndarray, N: np.ndarray) -> np.ndarray:
        """Returns the largest |z| (o,) by an input |w| ≤ 1 that changes at ticks only; or inf.

        Args:
            B: Input vector of w into the flow (m,).
            N: Input vector of its new value at a tick (m,).
        """
        jumps = [_bordered(stretch.jump, np.zeros(len(B)), 1.0) for stretch in self.stretches]
        jumps[-1][-1, -1] = 0.0
        return _largest(self._with_input(B, jumps)._by_samples(np.append(N, 1.0)))

    def rate_gain(self, B: np.ndarray, N: np.ndarray | float = 0.0) -> np.ndarray:
        """Returns the largest |z| (o,) by an input |ẇ(t)| ≤ 1 of any level; inf: unstable.

        It is inf, too, for an output that a constant w moves.

        Args:
            B: Input vector of w into the flow (m,).
            N: Input vector at a tick (m,), of the samples of w.
        """
        if math.isinf(self.periods):
            return np.full(len(self.C), np.inf)
        more, _, left = self._settled(B, N, 0.0)
        gain = _largest(more._by_flow(np.eye(len(more.A))[-1], self.periods))
        return np.where(left > 1e-9 * (1.0 + gain / self.periods), np.inf, gain)

    def wave_gain(self, B: np.ndarray, omega: float, N: np.ndarray | float = 0.0) -> np.ndarray:
        """Returns the amplitudes of z (o,) by w = sin(ωt + φ), any φ, once settled; inf: unstable.

        They are those at the phases.

        Args:
            B: Input vector of w into the flow (m,).
            omega: ω [rad/s].
            N: Input vector at a tick (m,), of the samples of w.
        """
        if math.isinf(self.periods):
            return np.full(len(self.C), np.inf)
        return self._settled(B, N, 1j * omega)[2]

    def _settled(self, B: np.ndarray, N: np.ndarray | float, rate: complex
                 ) -> tuple["PeriodicLoop", np.ndarray, np.ndarray]:
        """Returns the loop with w = e^(rate t) as its last state, and its settled motion.

        That is the state after a tick (m,) by w = 1 there, and the largest |z| (o,).
        """
        m = len(self.A)
        jumps = [_bordered(stretch.jump, np.zeros(m), 1.0) for stretch in self.stretches]
        jumps[-1][:m, m] = N
        more = self._with_input(B, jumps, rate)
        cycle = more.cycle
        state = np.append(np.linalg.solve(cycle[m, m] * np.eye(m) - self.cycle, cycle[:m, m]), 1.0)
        left = np.max([np.abs(more.C @ until @ state) for until in more._until()], axis=0)
        return more, state[:-1], left

    def _with_input(self, B: np.ndarray, jumps: list[np.ndarray], rate: complex = 0.0
                    ) -> "PeriodicLoop":
        """Returns the loop with an input w as its last state, ẇ = rate w, and these jumps."""
        return PeriodicLoop(
            _bordered(self.A, B, rate), np.column_stack([self.C, np.zeros(len(self.C))]),
            tuple(Stretch(stretch.duration, jump)
                  for stretch, jump in zip(self.stretches, jumps, strict=True)), self.points)

    def _until(self) -> list[np.ndarray]:
        """Returns maps of the state after a tick (m, m) to each phase of each stretch."""
        out: list[np.ndarray] = []
        before = np.eye(len(self.A))
        for stretch, flow in zip(self.stretches, self._flows, strict=True):
            out += list(flow[:: self.points // PHASES] @ before)
            before = stretch.jump @ flow[-1] @ before
        return out

    def _by_samples(self, N: np.ndarray) -> np.ndarray:
        """Returns the sum of |z| from jumps N at all ticks, see `_ends`."""
        return self._ends(self._sum(self._rows, lambda rows: np.abs(rows @ N), self.periods))

    @cached_property
    def _rows(self) -> np.ndarray:
        """`_read` by the state after a tick: (stretches · phases · (2 o + m), m)."""
        return np.concatenate([self._read @ until for until in self._until()])

    @cached_property
    def _read(self) -> np.ndarray:
        """C, CA² and all states (2 o + m, m)."""
        return np.concatenate([self.C, self.C @ self.A @ self.A, np.eye(len(self.A))])

    def _ends(self, values: np.ndarray) -> np.ndarray:
        """Returns bounds of functions of `_rows` between the phases (stretches, `PHASES`, 2, o).

        They are the values at either end of each interval, and the deviation from a line between.
        """
        if not np.all(np.isfinite(values)):
            return np.full((len(self.stretches), PHASES, 2, len(self.C)), np.inf)
        o = len(self.C)
        steps = np.array([stretch.duration / PHASES for stretch in self.stretches])
        far = np.abs(self.C @ np.linalg.matrix_power(self.A, 4))
        fourth = np.array([far @ exponential(np.abs(self.A) * step) for step in steps])
        out, second, states = np.split(
            values.reshape(len(steps), PHASES + 1, -1), [o, 2 * o], axis=2)
        eighth = 0.125 * steps[:, None, None] ** 2
        bend = np.maximum(second[:, :-1], second[:, 1:]) + (
            eighth * (states[:, :-1] @ fourth.swapaxes(1, 2)))
        return np.stack([out[:, :-1], out[:, 1:]], axis=2) + (eighth * bend)[:, :, None]

    def _by_flow(self, B: np.ndarray, periods: float, *, by_age: bool = False,
                 weight: np.ndarray | None = None) -> np.ndarray:
        """Returns the integral of |K|, see `_ends`."""
        steps = [stretch.duration / self.points for stretch in self.stretches]
        response = self._flows @ B  # (stretches, points + 1, m), since an impulse
        weight = np.ones(response.shape[:2]) if weight is None else weight
        whole = response * weight[:, ::-1, None]  # read at the end of the stretch
        # The response to an impulse in each stretch, after the next tick.
        to_tick = np.eye(len(self.A))
        after_tick: list[np.ndarray] = []
        for stretch, flow, states in zip(
                self.stretches[::-1], self._flows[::-1], whole[::-1], strict=True):
            after_tick.insert(0, to_tick @ stretch.jump @ states.T)
            to_tick = to_tick @ stretch.jump @ flow[-1]

        def integral(rows: np.ndarray) -> np.ndarray:
            return np.sum([absolute_integral(rows @ states, step)
                           for states, step in zip(after_tick, steps, strict=True)], axis=0)

        total = self._sum(self._rows, integral, periods, by_age=by_age)
        # Impulses in the same period as the output.
        within = [self._within(
            i, j, response[i, : j + 1] * weight[i, : j + 1][::-1, None], whole, steps)
            for i in range(len(steps)) for j in range(0, self.points + 1, self.points // PHASES)]
        scale = self._period if by_age else 1.0
        bound = self._ends(total + scale * np.concatenate(within))
        # Deviation by impulses since the phase before, by their age and by their weight.
        each = self.points // PHASES
        fresh = response[:, : each + 1] @ self.C.T  # (stretches, ages, o)
        whole = np.array([absolute_integral(part.T, step)
                          for part, step in zip(fresh, steps, strict=True)])
        uneven = 0.25 * each * np.array(steps)[:, None] * np.ptp(np.abs(fresh), axis=1)
        heavy = np.lib.stride_tricks.sliding_window_view(weight, each + 1, axis=1)[:, ::each]
        off = (np.max(heavy, axis=2)[..., None] * uneven[:, None]
               + np.ptp(heavy, axis=2)[..., None] * whole[:, None])  # (stretches, PHASES, o)
        return np.asarray(bound + scale * off[:, :, None])

    @property
    def _period(self) -> float:
        return sum(stretch.duration for stretch in self.stretches)

    def _within(self, i: int, j: int, newest: np.ndarray, response: np.ndarray, steps: list[float]
                ) -> np.ndarray:
        """Returns ∫|K| (2 o + m,) of impulses since the last tick, read at point j of stretch i.

        Args:
            i: The stretch.
            j: The point.
            newest: Responses to impulses in it (j + 1, m), by their age.
            response: Those to impulses in each stretch at its end (stretches, points + 1, m).
            steps: Time between two points of each stretch [s].
        """
        total = absolute_integral(self._read @ newest.T, steps[i])
        rows = self._read @ self._flows[i, j]
        for before in range(i - 1, -1, -1):
            rows = rows @ self.stretches[before].jump
            total = total + absolute_integral(rows @ response[before].T, steps[before])
            rows = rows @ self._flows[before, -1]
        return total

    def _sum(self, rows: np.ndarray, size: Callable[[np.ndarray], np.ndarray], periods: float,
             *, by_age: bool = False) -> np.ndarray:
        """Returns the sum (r,) of `size` of rows Φʲ over `periods`, of rows (r, m).

        By their age, each counts j + 2 periods.
        """
        if math.isinf(periods):
            return np.full(len(rows), np.inf)
        powers = [np.eye(len(self.A))]
        for _ in range(AT_ONCE):
            powers.append(powers[-1] @ self.cycle)
        at_once = rows @ np.array(powers[:-1])  # (AT_ONCE, r, m)
        total = np.zeros(len(rows))
        for i in range(math.ceil(periods / AT_ONCE)):
            ages = self._period * (2.0 + AT_ONCE * i + np.arange(AT_ONCE)) if by_age else np.ones(1)
            total += np.sum(ages[:, None] * size(at_once), axis=0)
            at_once = at_once @ powers[-1]
        return total


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


def _bordered(matrix: np.ndarray, column: np.ndarray, corner: complex) -> np.ndarray:
    """Returns [matrix column; 0 corner]."""
    out = np.zeros((len(matrix) + 1, len(matrix) + 1), np.result_type(corner, float))
    out[:-1, :-1], out[:-1, -1], out[-1, -1] = matrix, column, corner
    return out


def _largest(ends: np.ndarray) -> np.ndarray:
    """Returns the largest value of each output over a period, of those of `_ends`."""
    out: np.ndarray = np.max(ends, axis=(0, 1, 2))
    return out
