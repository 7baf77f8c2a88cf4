"""Linear periodic system of a `LinearLoop`: its stability and its impulse responses.

A period consists of steps, x ← e^{A d}(J x + K w) + Γ w: an instant with updates, if there is one,
and a flow that ends at the next instant or at most `STEP` later. Outputs are recorded at the ends
of the steps. See tube/coupled/theory.md#coupled-loop.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property, reduce

import numpy as np

from uvms_drake.model.signals.linear import Block, LinearLoop, Signal
from uvms_drake.tube.loops.sampled_loop import exponential

STEP = 0.005
"""Longest step [s]."""
AT_ONCE = 64
"""Periods of a response computed at once."""
TAIL = 0.003
"""Fraction of the slowest mode at which a response ends."""
LONGEST = 120.0
"""Longest response [s]."""
STABLE = 1e-9


@dataclass(frozen=True)
class Step:
    """A part of the period."""

    time: Fraction
    """Start [s]."""
    duration: float
    """d [s]."""
    jump: np.ndarray
    """J (m, m)."""
    inputs: np.ndarray
    """K (m, w), of entries at the updates."""


@dataclass(frozen=True)
class PeriodicSystem:
    """A loop as matrices."""

    A: np.ndarray
    """Flow (m, m) [1/s]."""
    B: np.ndarray
    """Entries into the flow (m, w)."""
    C: np.ndarray
    """Outputs (o, m)."""
    D: np.ndarray
    """Entries in the outputs (o, w)."""
    steps: tuple[Step, ...]
    period: Fraction
    """[s]."""
    states: dict[Block, slice]
    entries: dict[Block, slice]

    @cached_property
    def maps(self) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """State after each step by that before it (m, m), and by the entries (m, w)."""
        m, w = self.B.shape
        flow = np.zeros((m + w, m + w))
        flow[:m, :m], flow[:m, m:] = self.A, self.B
        over = {step.duration: exponential(flow * step.duration) for step in self.steps}
        by_state, by_entry = [], []
        for step in self.steps:
            moved = over[step.duration]
            by_state.append(moved[:m, :m] @ step.jump)
            by_entry.append(moved[:m, :m] @ step.inputs + moved[:m, m:])
        return by_state, by_entry

    def cycle(self, after: int) -> np.ndarray:
        """Returns Φ (m, m) from the end of a step to that a period later."""
        maps = self.maps[0]
        turned = maps[after + 1:] + maps[: after + 1]
        return reduce(lambda done, step: step @ done, turned, np.eye(len(self.A)))

    @cached_property
    def multipliers(self) -> np.ndarray:
        """Eigenvalues of Φ (m,), the largest first."""
        found = np.linalg.eigvals(self.cycle(len(self.steps) - 1))
        return found[np.argsort(-np.abs(found))]

    @property
    def radius(self) -> float:
        """Spectral radius of Φ."""
        return float(np.abs(self.multipliers[0]))

    @property
    def stable(self) -> bool:
        """True if every response decays."""
        return self.radius < 1.0 - STABLE

    @property
    def decay(self) -> np.ndarray:
        """Decay rates of the modes (m,), the slowest first [1/s]."""
        size = np.maximum(np.abs(self.multipliers), 1e-300)
        rates: np.ndarray = -np.log(size) / float(self.period)
        return rates

    @cached_property
    def periods(self) -> int:
        """Number of periods of a response, a multiple of `AT_ONCE`."""
        needed = math.log(1.0 / TAIL) / max(float(self.decay[0]), 1.0 / LONGEST)
        periods = min(needed, LONGEST) / float(self.period)
        return AT_ONCE * math.ceil(periods / AT_ONCE)

    def ticks(self, entry: Block) -> list[int]:
        """Returns the steps in which an entry has an effect."""
        columns = self.entries[entry]
        return [i for i, inputs in enumerate(self.maps[1]) if np.any(inputs[:, columns])]

    def response(self, entry: Block, after: int) -> np.ndarray:
        """Returns the impulse responses (lags, o, size) of the outputs at the end of a step.

        The lags are those of an entry's inputs before that instant, the latest first: of its
        ticks, or of the steps over which it is constant.

        Args:
            entry: The entry.
            after: Index of the step.
        """
        by_state, by_entry = self.maps
        columns, count = self.entries[entry], len(self.steps)
        order = [(after - i) % count for i in range(count)]  # Back in time.
        inputs, onward = [], np.eye(len(self.A))
        active = self.ticks(entry)
        for i in order:
            if i in active:
                inputs.append(onward @ by_entry[i][:, columns])
            onward = onward @ by_state[i]
        start = np.concatenate(inputs, axis=1)  # (m, ticks · size)
        cycle = self.cycle(after)
        rows = np.empty((AT_ONCE, *self.C.shape))
        row = self.C
        for i in range(AT_ONCE):
            rows[i], row = row, row @ cycle
        far = np.linalg.matrix_power(cycle, AT_ONCE)
        out = np.empty((self.periods, len(self.C), start.shape[1]))
        for i in range(0, self.periods, AT_ONCE):
            out[i: i + AT_ONCE] = rows @ start
            start = far @ start
        size = columns.stop - columns.start
        by_tick = np.moveaxis(out.reshape(self.periods, len(self.C), len(inputs), size), 2, 1)
        by_lag = by_tick.reshape(-1, len(self.C), size)
        if order[0] in active:
            by_lag[0] += self.D[:, columns]
        return by_lag


def compiled(loop: LinearLoop, outputs: Sequence[Signal]) -> PeriodicSystem:
    """Returns the system of a loop with these outputs, one below the other."""
    def numbered(kind: str) -> dict[Block, slice]:
        blocks = [block for block in loop.blocks if block.kind == kind]
        ends = np.cumsum([0, *(block.size for block in blocks)])
        return {block: slice(int(a), int(b))
                for block, a, b in zip(blocks, ends, ends[1:], strict=False)}

    states, entries = numbered("state"), numbered("entry")
    m, w = (max((part.stop for part in parts.values()), default=0) for parts in (states, entries))

    def matrices(signal: Signal) -> tuple[np.ndarray, np.ndarray]:
        by_state, by_entry = np.zeros((signal.size, m)), np.zeros((signal.size, w))
        for block, part in loop.resolved(signal).parts.items():
            if block.kind == "state":
                by_state[:, states[block]] = part
            else:
                by_entry[:, entries[block]] = part
        return by_state, by_entry

    # Flow, and the instants of all clocks over their common period.
    A, B = np.zeros((m, m)), np.zeros((m, w))
    for block, rate in loop.rates.items():
        A[states[block]], B[states[block]] = matrices(rate)
    values = [(block, *matrices(value), every, offset)
              for block, value, every, offset in loop.updates]
    period = reduce(_common, [every for *_, every, _ in values], values[0][3])
    instants = sorted({offset + k * every for *_, every, offset in values
                       for k in range(int(period / every))})
    # Steps from one instant to the next, in parts that are short enough.
    steps = []
    for time, end in zip(instants, [*instants[1:], instants[0] + period], strict=True):
        jump, inputs = np.eye(m), np.zeros((m, w))
        for block, by_state, by_entry, every, offset in values:
            if (time - offset) % every == 0:
                jump[states[block]], inputs[states[block]] = by_state, by_entry
        parts = max(math.ceil(float(end - time) / STEP - 1e-9), 1)
        length = (end - time) / parts
        steps += [Step(time + i * length, float(length), *(
            (jump, inputs) if i == 0 else (np.eye(m), np.zeros((m, w))))) for i in range(parts)]
    rows = [matrices(signal) for signal in outputs]
    return PeriodicSystem(
        A, B, np.concatenate([row[0] for row in rows]), np.concatenate([row[1] for row in rows]),
        tuple(steps), period, states, entries)


def _common(a: Fraction, b: Fraction) -> Fraction:
    """Returns the least common multiple of two periods."""
    return Fraction(math.lcm(a.numerator, b.numerator), math.gcd(a.denominator, b.denominator))
