"""Loop of one row of the law `tip first`, behind its actuator and clock: gains by source.

A row obeys ÿ = Gv + (G − 1)h + c + δ. v is the commanded acceleration, G that of actuators and
clocks (a lag T, a dead time, a hold; 1 for a constant), h the remaining part of the forces,
δ = (J_y d)ᵢ, and c comes of changes within the delays. With v = ÿ̄ − (k + σ)ė − kσe − δ̂,

    ë = −G[(k + σ)ė + kσe + δ̂] + δ + c + (G − 1) f,    f = ÿ̄ + h,                              (1)

and for a first-order lag, with Δ(s) = Ts³ + s² + (k + σ)s + kσ and an observer λ,

    e = s(Ts + 1 + λT)/((s + λ)Δ) δ − (Ts/Δ) f,    stable iff Tkσ < k + σ.                      (2)

Sources are `disturbance`, `feed_forward` and `feed_forward_rate`; their parts add up to the radius
of a row. Definitions and proofs: tube/loops/theory.md#row-loop-behind-an-actuator.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from uvms_drake.common.errors import require
from uvms_drake.tube.loops.row_gains import Gains, instant_gains, moments
from uvms_drake.tube.loops.sampled_loop import PeriodicLoop, Stretch

EXACT = 1e-6
"""Tolerance of equal times, over a period."""
FRACTION = 0.1
"""Length of a period of a loop without clocks, by its fastest rate: for the quadrature only."""
E, RATE, W, ACCELERATION = range(4)
"""Columns of gains and bounds of e, ė, w and ë; e and ė are the first two states, too."""


class Peak(NamedTuple):
    """Largest values by a source of size 1, for each row of these gains."""

    position: float
    """Gain to e."""
    velocity: float
    """Gain to ė."""
    command: float
    """Gain to the feedback −(k + σ)ė − kσe − δ̂."""


@dataclass(frozen=True)
class RowLoop:
    """A row with its gains, its actuator and its clock."""

    k: float
    """Gain of the velocity error [1/s]."""
    sigma: float
    """σ, gain of the error [1/s]."""
    observer: float = 0.0
    """λ [1/s]; zero for none. It has the period of the feedback."""
    lag: float = 0.0
    """T of the actuator [s]."""
    period: float = 0.0
    """h, time between two commands [s]; zero for a continuous feedback."""
    dead_time: float = 0.0
    """Delay from a tick to the arrival of its command [s], of a sampled feedback."""
    drag: float = 0.0
    """κ of the linear part −κė of a row, which the sampled command compensates by κė of its tick
    [1/s]."""

    def __post_init__(self) -> None:
        for key in ("k", "sigma"):
            require(0.0 < getattr(self, key) < np.inf, key, getattr(self, key), "positive")
        for key in ("observer", "lag", "period", "dead_time", "drag"):
            require(0.0 <= getattr(self, key) < np.inf, key, getattr(self, key), "zero or positive")
        for key in ("dead_time", "drag"):
            require(getattr(self, key) == 0.0 or self.period > 0.0, key, getattr(self, key),
                    "zero, or positive with a positive period")

    @property
    def stable(self) -> bool:
        """True if the loop is stable."""
        return bool(np.isfinite(self._system.loop.periods))

    @cached_property
    def gains(self) -> dict[str, Peak]:
        """Gains by source, all inf if the loop is unstable."""
        system = self._system
        loop, delta, f, f_sampled = system.loop, system.delta, system.f, system.f_sampled
        gains = {
            "disturbance": self._exact or loop.flow_gain(delta),
            "feed_forward": (loop.zoh_gain(f, f_sampled) if self.period > 0.0
                             else loop.flow_gain(f)),
            "feed_forward_rate": loop.rate_gain(f, f_sampled)}
        return {name: Peak(*map(float, values[:3])) for name, values in gains.items()}

    @property
    def at_once(self) -> bool:
        """True if there is nothing but the row and its gains."""
        return not (self.observer or self.lag or self.period)

    @property
    def _exact(self) -> Gains | None:
        """Gains of δ in closed form, if there is one."""
        return instant_gains(self.k, self.sigma) if self.at_once else None

    @cached_property
    def moment(self) -> Peak:
        """Bound of ∫t|g|dt of the impulse responses to δ, for changes within the loop's memory."""
        found = moments(self.k, self.sigma) if self.at_once else (
            self._system.loop.flow_moment(self._system.delta))
        return Peak(*map(float, found[:3]))

    def grown(self, growth: float) -> np.ndarray:
        """Returns the gains to e, ė, w and ë (4,) of a δ whose effect grows by e^(growth · t)."""
        at_once = np.array([0.0, 0.0, 0.0, 1.0])
        return self._grown(growth).flow_gain(self._system.delta, at_once)

    def zoh_gains(self, growth: float = 0.0, *, pulses: int = 0, until: float = 0.0) -> np.ndarray:
        """Returns the gains (4,) of changes since the sample of the present command.

        That is a δ of at most its age; or, with `pulses`, of at most 1 from each of these ticks
        until a time after it.

        Args:
            growth: As of `grown` [1/s].
            pulses: Number of ticks from one pulse to the next.
            until: Time after the tick, at which a stretch ends [s].
        """
        loop, h, dead_time = self._grown(growth), self.period, self.dead_time
        loop = loop.repeated(max(pulses, 1))
        ends = loop.times.max(axis=1, keepdims=True)  # of stretches
        if pulses:
            weight = 1.0 * (ends <= until + EXACT * h) + 0.0 * loop.times
        else:
            whole = int(dead_time / h + EXACT)
            waits = (ends <= dead_time - whole * h + EXACT * h) & (
                dead_time > (whole + EXACT) * h)
            weight = loop.times + h * (whole + waits)
        at_once = np.array([0.0, 0.0, 0.0, np.max(weight)])
        return loop.flow_gain(self._system.delta, at_once, weight)

    def _grown(self, growth: float) -> PeriodicLoop:
        """Returns the loop with states e^(growth · t) as large, and with ë as an output, too."""
        loop = self._system.loop
        return replace(loop, A=loop.A + growth * np.eye(len(loop.A)),
                       C=np.append(loop.C, loop.A[RATE: RATE + 1], axis=0))

    def wave(self, omega: float) -> Peak:
        """Returns the amplitudes by δ = sin(ωt + φ) of any φ, once they have settled.

        Far less than those of an arbitrary δ, if ω [rad/s] is: waves, of one period.
        """
        system = self._system
        return Peak(*map(float, system.loop.wave_gain(system.delta, omega)))

    @cached_property
    def _system(self) -> "_System":
        return _sampled(self) if self.period > 0.0 else _continuous(self)


class _System(NamedTuple):
    """A loop with its input vectors by source."""

    loop: PeriodicLoop
    delta: np.ndarray
    """Input vector of δ, into the flow (m,)."""
    f: np.ndarray
    """Input vector of f, into the flow (m,)."""
    f_sampled: np.ndarray
    """Input vector of f, at a tick (m,)."""


def _feedback(row: RowLoop, m: int, estimate: int | None) -> np.ndarray:
    """Returns −(k + σ)ė − kσe − δ̂ as a row (m,) of states, δ̂ by its index."""
    v = np.zeros(m)
    v[RATE], v[E] = -(row.k + row.sigma), -row.k * row.sigma
    if estimate is not None:
        v[estimate] = -1.0
    return v


def _continuous(row: RowLoop) -> _System:
    """Returns the loop of a feedback and an observer in continuous time.

    The states are e, ė, the lagged acceleration a if there is a lag, and the δ̂ of an observer.
    """
    m = 2 + (row.lag > 0.0) + (row.observer > 0.0)
    a, x, rate = 2, m - 1, row.observer
    v = _feedback(row, m, x if rate else None)
    A, commanded, delta = np.zeros((m, m)), np.zeros(m), np.eye(m)[RATE]
    A[E, RATE] = 1.0
    if row.lag > 0.0:
        A[RATE, a], A[a] = 1.0, v / row.lag
        A[a, a] -= 1.0 / row.lag
        commanded[a] = 1.0 / row.lag
    else:
        A[RATE], commanded[RATE] = v, 1.0
    if rate:
        A[x, x], delta[x] = -rate, rate
    period = FRACTION / float(np.max(np.abs(np.linalg.eigvals(A))))
    loop = PeriodicLoop(A, np.array([np.eye(m)[E], np.eye(m)[RATE], v]),
                        (Stretch(period, np.eye(m)),))
    return _System(loop, delta, commanded - np.eye(m)[RATE], np.zeros(m))


def _sampled(row: RowLoop) -> _System:
    """Returns the loop of a feedback under zero-order hold.

    The states are e and ė; a, if there is a lag; the present command w; those that are under way,
    the youngest first; and of an observer δ̂, the last ė that it has seen, and ∫(ÿ_pred − ÿ̄) since
    the last tick. At a tick the law has the estimate of the tick before.
    """
    # Commands under way: whole periods of the dead time, and its remainder.
    h = row.period
    whole = int(row.dead_time / h + EXACT)
    remainder = row.dead_time - whole * h
    remainder = remainder if remainder > EXACT * h else 0.0
    waiting = whole + (remainder > 0.0)
    names = ["e", "rate", *["a"] * (row.lag > 0.0), "w", *(f"q{i}" for i in range(waiting)),
             *["estimate", "seen", "predicted"] * (row.observer > 0.0)]
    at, m = {name: i for i, name in enumerate(names)}, len(names)
    unit = np.eye(m)
    driven = unit[at["a"] if "a" in at else at["w"]]

    # The flow between ticks.
    A, f, delta = np.zeros((m, m)), np.zeros(m), unit[RATE]
    A[E, RATE], A[RATE], f[RATE] = 1.0, driven - row.drag * unit[RATE], -1.0
    if row.lag > 0.0:
        A[at["a"]] = (unit[at["w"]] - unit[at["a"]]) / row.lag

    # A tick: measurement, command and estimate.
    jump, f_sampled = unit.copy(), np.zeros(m)
    estimate = at.get("estimate")
    v = _feedback(row, m, estimate)
    first = at["q0"] if waiting else at["w"]
    jump[first], f_sampled[first] = v + row.drag * unit[RATE], 1.0
    for i in range(1, waiting):
        jump[at[f"q{i}"]] = unit[at[f"q{i - 1}"]]
    if waiting and not remainder:
        jump[at["w"]] = unit[at[f"q{waiting - 1}"]]
    if estimate is not None:
        share = -np.expm1(-row.observer * h)
        A[at["predicted"]], f[at["predicted"]] = driven, -1.0
        mean = (unit[RATE] - unit[at["seen"]] - unit[at["predicted"]]) / h
        jump[estimate] = (1.0 - share) * unit[estimate] + share * mean
        jump[at["seen"]], jump[at["predicted"]] = unit[RATE], 0.0

    # A command that arrives between two ticks splits the period.
    stretches: tuple[Stretch, ...] = (Stretch(h, jump),)
    if remainder:
        arrives = unit.copy()
        arrives[at["w"]] = unit[at[f"q{waiting - 1}"]]
        stretches = (Stretch(remainder, arrives), Stretch(h - remainder, jump))
    C = np.array([unit[E], unit[RATE], v])
    return _System(PeriodicLoop(A, C, stretches), delta, f, f_sampled)
