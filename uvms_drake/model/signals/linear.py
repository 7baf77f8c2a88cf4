"""Linear model of a loop with clocks: states, signals, updates and the errors that enter.

A state block flows, ẋ = a linear signal, or is updated at the ticks of a clock, x⁺ = a linear
signal; a signal is a linear combination of states and entries. All updates of an instant read the
values before it, as those of Drake's discrete events do. A part of the loop adds its blocks in
`Part.linear`, as it adds its systems in `add_to`; `tube.coupled.periodic` has the solution.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Literal

import numpy as np

from uvms_drake.model.uvms_model import UvmsModel

FINEST = 10**6
"""Largest denominator of a time of a clock [1/s]."""
SAME = 1e-6
"""Fraction of a period within which two instants are the same."""


@dataclass(frozen=True)
class OperatingPoint:
    """Point at which a loop is linearised: a robot at rest, or in a steady motion."""

    model: UvmsModel
    """The controller's model."""
    state: np.ndarray
    """(𝔮, ζ) (2(6+n),) [m, rad, m/s, rad/s]."""
    contact: np.ndarray
    """𝔉 on the surface (6,) [N, N m]."""
    tau: np.ndarray
    """Generalised force that acts (6+n,) [N, N m]."""
    modelled: np.ndarray
    """The same by the controller's model of the actuation (6+n,) [N, N m]."""


@dataclass(frozen=True)
class Block:
    """States, an entry, or a port of a loop."""

    name: str
    size: int
    index: int
    """Number among the blocks of a loop."""
    kind: Literal["state", "entry", "port"] = "state"


class Signal:
    """Linear combination of blocks: M @ signal, sums, and selected rows are signals.

    Args:
        size: Number of components.
        parts: Matrix (size, block's size) of each block.
    """

    __array_ufunc__ = None  # M @ signal is a signal.

    def __init__(self, size: int, parts: Mapping[Block, np.ndarray]):
        self.size, self.parts = size, dict(parts)

    def __add__(self, other: "Signal") -> "Signal":
        assert self.size == other.size
        parts = dict(self.parts)
        for block, matrix in other.parts.items():
            parts[block] = parts[block] + matrix if block in parts else matrix
        return Signal(self.size, parts)

    def __rmatmul__(self, matrix: np.ndarray) -> "Signal":
        return Signal(len(matrix), {
            block: matrix @ part for block, part in self.parts.items()})

    def __rmul__(self, factor: float) -> "Signal":
        return Signal(self.size, {block: factor * part for block, part in self.parts.items()})

    def __sub__(self, other: "Signal") -> "Signal":
        return self + (-1.0) * other

    def __getitem__(self, rows: slice | Sequence[int]) -> "Signal":
        return np.eye(self.size)[rows] @ self


def stacked(signals: Sequence[Signal]) -> Signal:
    """Returns the signals one below the other."""
    size = sum(signal.size for signal in signals)
    out, start = Signal(size, {}), 0
    for signal in signals:
        place = np.zeros((size, signal.size))
        place[start: start + signal.size] = np.eye(signal.size)
        out, start = out + place @ signal, start + signal.size
    return out


@dataclass(frozen=True)
class Fixes:
    """Fixes that correct an error, of which some are lost, and its growth in between.

    Fix 0, `most`, 2 `most`, ... is always there; the others are lost independently.
    """

    per_tick: float
    """Fixes, lost ones too, in the time between two ticks of the entry."""
    most: int
    """Largest number of periods of the fixes from one to the next."""
    lost: float
    """Probability that a fix is lost."""
    growth: np.ndarray
    """Bound of the rate at which each component grows from a fix on, always the same [1/s]."""

    @property
    def ticks(self) -> tuple[int, int]:
        """Least and largest number of ticks between two fixes."""
        return max(int(1.0 / self.per_tick), 1), math.ceil(self.most / self.per_tick)


@dataclass(frozen=True)
class ErrorChannel:
    """Error that enters a loop, by its distribution or its bound.

    A random one is a sum of independent samples with zero mean, Gaussian and cut, so that each is
    sub-Gaussian with its σ; all others are bounded only.
    """

    name: str
    """Source in the budget."""
    entry: Signal
    """Place at which it enters."""
    bound: np.ndarray
    """Bound of each component."""
    sigma: np.ndarray | None = None
    """σ of each component of a sample; None: not random."""
    kind: str = "samples"
    """`samples`, any value at each tick; `fixes`, one value from fix to fix, and a ramp;
    `constant`; `slow`, a constant and a rate of at most `rate`; `flow`, any function of time."""
    fixes: Fixes | None = None
    """Fixes at which a value begins."""
    rate: np.ndarray | None = None
    """Bound of the rate, of a slow error [1/s]."""


@dataclass
class LinearLoop:
    """Blocks of a loop, with their flows and updates, and the errors that enter."""

    rates: dict[Block, Signal] = field(default_factory=dict)
    """Flow ẋ of blocks; others are constant between updates."""
    updates: list[tuple[Block, Signal, Fraction, Fraction]] = field(default_factory=list)
    """Block, its value after an update, period and offset of the clock [s]."""
    blocks: list[Block] = field(default_factory=list)
    channels: list[ErrorChannel] = field(default_factory=list)
    connections: dict[Block, Signal] = field(default_factory=dict)
    """Signals at ports."""
    starts: dict[Block, np.ndarray] = field(default_factory=dict)
    """Deviations from the point at the start of a run, if not zero."""

    def state(self, name: str, size: int) -> Signal:
        """Returns a new block of states; its flow and its updates follow."""
        return self._new(name, size, "state")

    def entry(self, name: str, size: int) -> Signal:
        """Returns a new entry of errors, by which updates or flows are off."""
        return self._new(name, size, "entry")

    def port(self, name: str, size: int) -> Signal:
        """Returns a signal that is connected later, of a part further on in the loop."""
        return self._new(name, size, "port")

    def start(self, state: Signal, value: np.ndarray) -> None:
        """Sets the deviation of a block at the start of a run."""
        self.starts[_block_of(state)] = value

    def connect(self, port: Signal, signal: Signal) -> None:
        """Connects a port."""
        self.connections[_block_of(port)] = signal

    def resolved(self, signal: Signal) -> Signal:
        """Returns a signal in states and entries alone."""
        while ports := [block for block in signal.parts if block.kind == "port"]:
            out = Signal(signal.size, {
                block: part for block, part in signal.parts.items() if block not in ports})
            for block in ports:
                out += signal.parts[block] @ self.connections[block]
            signal = out
        return signal

    def _new(self, name: str, size: int, kind: Literal["state", "entry", "port"]) -> Signal:
        block = Block(name, size, len(self.blocks), kind)
        self.blocks.append(block)
        return self.signal_of(block)

    def signal_of(self, block: Block) -> Signal:
        """Returns a block as a signal."""
        return Signal(block.size, {block: np.eye(block.size)})

    def flow(self, state: Signal, rate: Signal) -> None:
        """Sets ẋ of a block."""
        self.rates[_block_of(state)] = rate

    def update(self, state: Signal, value: Signal, period: float, offset: float = 0.0) -> None:
        """Adds x⁺ of a block at offset + k period [s]."""
        every = Fraction(period).limit_denominator(FINEST)
        self.updates.append((_block_of(state), value, every,
                             Fraction(offset).limit_denominator(FINEST) % every))

    def sampled(self, name: str, signal: Signal, period: float, delay: float = 0.0,
                offset: float = 0.0) -> Signal:
        """Returns a signal sampled at kh and held from kh + δ on, as by a `SampledVector`.

        Args:
            name: Name of the blocks.
            signal: The signal.
            period: h [s].
            delay: δ [s].
            offset: Time of the first sample [s].
        """
        hold = self.state(name, signal.size)
        under_way = math.ceil(delay / period - SAME)
        for i in range(under_way):  # Samples that are taken and do not act yet.
            taken = self.state(f"{name}, sample {i}", signal.size)
            self.update(taken, signal, period, offset)
            signal = taken
        self.update(hold, signal, period, offset + delay)
        return hold


def _block_of(state: Signal) -> Block:
    (block,) = state.parts
    return block
