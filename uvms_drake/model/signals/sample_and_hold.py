"""Sample and hold of a vector by several clocks, with a delay."""

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues

from uvms_drake.common.wiring import WiredSystem, output_of

SAME = 1e-6
"""Fraction of a period within which two instants are the same."""
FASTEST = 10
"""Number of ticks in a period for which a `TickedVector` has memory."""
MOST_PARTS = 4
"""Largest number of parts of a period, such that instants are those of a faster clock."""


class Clock(NamedTuple):
    """Clock that samples some components of a vector."""

    rows: Sequence[int]
    """Indices of the components."""
    period: float
    """Sampling period h [s]."""
    delay: float = 0.0
    """Delay δ of a sample [s]."""
    error: Callable[[float], np.ndarray] | None = None
    """Error of a sample (rows,) as a function of its time [s]; None: no error."""
    propagated: bool = False
    """Whether only the error of the sample is held, and added to the present vector."""

    @property
    def kept(self) -> int:
        """Largest number of samples in transit or held."""
        return 1 + math.ceil(self.delay / self.period - SAME)

    @property
    def passing_on(self) -> tuple[float, float] | None:
        """Period and offset of a set of instants that includes those of the output [s].

        None if samples are taken at those instants. If a half, a third or a quarter of a period
        remains, they are those of a clock that is as many times as fast, to the last digit: such a
        clock then samples always the value before, or always that after.
        """
        between = self.delay / self.period % 1.0
        if not SAME < between < 1.0 - SAME:
            return None
        parts = round(1.0 / between)
        if parts <= MOST_PARTS and abs(parts * between - 1.0) < SAME:
            return self.period / parts, 0.0
        return self.period, between * self.period


def _index(rows: Sequence[int]) -> slice | list[int]:
    """Returns the rows as a slice, if they are consecutive: faster than a list."""
    first, last = rows[0], rows[-1]
    consecutive = list(rows) == list(range(first, last + 1))
    return slice(first, last + 1) if consecutive else list(rows)


class SampledVector(WiredSystem):
    """Delayed sample and hold: the sample of kh from kh + δ to (k + 1)h + δ, for each clock.

    Propagated components are the present vector plus the error of the sample.

    Until the first sample the output is the vector itself, and until that is due that sample, as in
    steady operation: Drake's ZeroOrderHold is zero until its first event, and the first plan is
    made before that. At the instant of a sample without delay it is still the one before.

    .. pydrake_system::

        name: SampledVector
        input_ports:
        - vector
        output_ports:
        - hold

    - `vector`, `hold` (size).

    The discrete state is the held vector (size); for each clock the number k of its last sample,
    NaN if there is none; and a group for each with the samples in transit, each at k modulo their
    number. A delayed sample is due at the first step of the simulation that begins at its instant
    but for rounding: of two periodic events that are as near as that, Drake may leave one out.

    Args:
        size: Size of the vector.
        clocks: Clocks that have each component once.
    """

    def __init__(self, size: int, clocks: Sequence[Clock]):
        super().__init__()
        assert sorted(row for clock in clocks for row in clock.rows) == list(range(size))
        self._clocks, self._rows = list(clocks), [_index(clock.rows) for clock in clocks]
        self._port = self.DeclareVectorInputPort("vector", size)
        self.DeclareDiscreteState(size)  # group 0
        self.DeclareDiscreteState(np.full(len(clocks), np.nan))  # group 1
        for i, clock in enumerate(self._clocks):
            self.DeclareDiscreteState(clock.kept * len(clock.rows))  # group 2 + i
            self.DeclarePeriodicDiscreteUpdateEvent(clock.period, 0.0, partial(self._sample, i))
            if (event := clock.passing_on) is not None:  # Only ends a step there.
                self.DeclarePeriodicPublishEvent(*event, lambda context: None)
        self._propagated = [rows for clock, rows in zip(clocks, self._rows, strict=True)
                            if clock.propagated]
        if any(clock.delay > 0.0 for clock in clocks):
            self.DeclarePerStepDiscreteUpdateEvent(self._pass_on)
        now = {self.time_ticket()} if any(clock.error for clock in clocks) else set()
        self.DeclareVectorOutputPort(
            "hold", size, self._calc, {self.xd_ticket(), self._port.ticket(), *now})

    def _samples(self, state: np.ndarray, i: int) -> np.ndarray:
        """Returns the samples (kept, rows) in a group of the state, a view."""
        return state.reshape(self._clocks[i].kept, -1)

    def _measured(self, context: Context, i: int) -> np.ndarray:
        """Returns a present sample (rows,), or its error."""
        clock = self._clocks[i]
        error = 0.0 if clock.error is None else clock.error(context.get_time())
        return error + (np.zeros(len(clock.rows)) if clock.propagated
                        else self._port.Eval(context)[self._rows[i]])

    def _sample(self, i: int, context: Context, state: DiscreteValues) -> None:
        clock, numbers = self._clocks[i], state.get_mutable_value(1)
        k, sample = round(context.get_time() / clock.period), self._measured(context, i)
        is_first = math.isnan(numbers[i])
        samples = self._samples(state.get_mutable_value(2 + i), i)
        samples[slice(None) if is_first else k % clock.kept] = sample
        numbers[i] = k
        if clock.delay == 0.0 or is_first:
            state.get_mutable_value(0)[self._rows[i]] = sample

    def _pass_on(self, context: Context, state: DiscreteValues) -> None:
        now, hold = context.get_time(), state.get_mutable_value(0)
        numbers = context.get_discrete_state(1).value().tolist()
        for i, (clock, last) in enumerate(zip(self._clocks, numbers, strict=True)):
            if clock.delay > 0.0 and not math.isnan(last):
                k = math.floor((now - clock.delay) / clock.period + SAME)
                samples = self._samples(context.get_discrete_state(2 + i).value(), i)
                hold[self._rows[i]] = samples[min(k, int(last)) % clock.kept]

    def _calc(self, context: Context, output: BasicVector) -> None:
        hold = context.get_discrete_state(0).value().copy()
        numbers = context.get_discrete_state(1).value().tolist()
        if math.isnan(sum(numbers)):
            for i in (i for i, last in enumerate(numbers) if math.isnan(last)):
                hold[self._rows[i]] = self._measured(context, i)
        if self._propagated:
            now = self._port.Eval(context)
            for rows in self._propagated:
                hold[rows] += now[rows]
        output.SetFromVector(hold)


class TickedVector(WiredSystem):
    """Delayed sample and hold of a vector, by the ticks of a clock outside of the Diagram.

    There is a sample at the beginning of the first step of the simulation with a new value of
    `tick`, whatever the value; it is held from the first step on that begins δ later, and the first
    one at once. At regular ticks, with a step that begins whenever a sample is due, it is a
    `SampledVector` with one clock without error.

    .. pydrake_system::

        name: TickedVector
        input_ports:
        - vector
        - tick
        output_ports:
        - hold
        - newest

    - `vector`, `hold` (size).
    - `tick` (1).
    - `newest`: last sample (size), even if it is not held yet; NaN before it.

    The discrete state is the held vector (size); and a row for each of the last samples, the newest
    last: its tick, the time at which it is due, and the sample. They are enough for ticks `FASTEST`
    times as fast as the period; of faster ones the oldest is lost.

    Args:
        size: Size of the vector.
        clocks: The clock, one, with the period of regular ticks.
    """

    def __init__(self, size: int, clocks: Sequence[Clock]):
        super().__init__()
        self._size, (self._clock,) = size, clocks
        self._vector_port = self.DeclareVectorInputPort("vector", size)
        self._tick_port = self.DeclareVectorInputPort("tick", 1)
        self.DeclareDiscreteState(size)
        self.DeclareDiscreteState(np.full(FASTEST * self._clock.kept * (2 + size), np.nan))
        self.DeclarePerStepDiscreteUpdateEvent(self._update)
        known = {self.xd_ticket()}
        output_of(self, "hold", size, lambda context: (
            self._vector_port.Eval(context) if math.isnan(self._rows(context)[-1, 0])
            else context.get_discrete_state(0).value()), known | {self._vector_port.ticket()})
        output_of(self, "newest", size, lambda context: self._rows(context)[-1, 2:], known)

    def _rows(self, context: Context) -> np.ndarray:
        return context.get_discrete_state(1).value().reshape(-1, 2 + self._size)

    def _update(self, context: Context, state: DiscreteValues) -> None:
        rows, tick, now = self._rows(context), self._tick_port.Eval(context), context.get_time()
        if tick[0] != rows[-1, 0]:
            due = -math.inf if math.isnan(rows[-1, 0]) else now + self._clock.delay
            rows = np.vstack([rows[1:], [*tick, due, *self._vector_port.Eval(context)]])
            state.set_value(1, rows.ravel())
        ready = rows[rows[:, 1] <= now + SAME * self._clock.period, 2:]
        if len(ready):
            state.set_value(0, ready[-1])
