"""How far a row of the law `tip first` is pushed by each source: its loop, lagged, sampled, late.

A row obeys ÿ = Gv + (G − 1)h + c + δ. v is what the law asks for; G is what actuators and clocks
make of it (a lag T, a dead time, a hold; 1 for a constant); h is the rest of what the forces have
to carry, δ = (J_y d)ᵢ, and c comes of what changes meanwhile, see below. With
v = ÿ̄ − (k + σ)ė − kσe − δ̂,

    ë = −G[(k + σ)ė + kσe + δ̂] + δ + c + (G − 1) f,    f = ÿ̄ + h.                              (1)

For a first-order lag, with Δ(s) = Ts³ + s² + (k + σ)s + kσ and an observer λ,

    e = s(Ts + 1 + λT)/((s + λ)Δ) δ − (Ts/Δ) f,                                               (2)

stable if and only if Tkσ < k + σ, by Routh's criterion. Without lag and observer that is
δ/((s + k)(s + σ)), whose impulse response is positive: a gain of exactly 1/(kσ). An observer does
nothing about f, which it knows of.

*Where (1) comes from, for the vehicle.* The tip's rows give q̈ from ν̇, so the vehicle obeys
M*ν̇ = τ_v − β with M* = M_vv − M_vq J_sq⁻¹J_sv, β = b_v + (Jᵀ𝔉)_v + M_vq J_sq⁻¹(v_s − J̇_sζ). That is
η̈ = Aτ_v − h + δ with A = J_ηv M*⁻¹, h = Aβ − J̇_ηv ν, and (L) commands τ_c = A⁻¹(v + h). With
τ_v = Gτ_c it is η̈ = Gv + (G − 1)h + c + δ, where c = (AG − GA)τ_c. For a lag,
T(Aτ_v)˙ + Aτ_v = Aτ_c + TȦτ_v, so that c = G[TȦτ_v]. ∎

*And for the tip.* s̈ = Bτ_q − h + δ with B = J_s M⁻¹[0; 1], h = −J_s M⁻¹((τ_v, 0) − b) − J̇_sζ, and
(A) commands τ_q = B⁻¹(v + h). So (1) holds, with hold and delay only in G; τ_v is in its h.

*These are all sources of a row*, in its own unit [m/s², rad/s²]:

- `disturbance`: δ that may be anything, at most ‖(J_yW)ᵢ‖ d̃. In it are M⁻¹Jᵀ(𝔉_s − 𝔉) of a force
  sensor, M⁻¹(ε, 0) of thrusters that give τ_v + ε, and c.
- `disturbance_rate`: δ̇, of a δ of any level, which an observer makes finite.
- `feed_forward`: f, if it changes at ticks only, where there are any. A constant leaves nothing: f
  may be taken less any constant, so half of its range counts.
- `feed_forward_rate`: ḟ. A plan that jumps, and h, which is smooth, are one part each of f.
- `position`, `velocity`: errors of y and ẏ as they are measured, per sample. A latency t_L is one
  too, ȳ(t − t_L) − ȳ(t) and its rate, beside what it does to the loop.

Their parts add up to the radius of a row, with what is left of the error at the start. Rows of the
same gains share a kernel, which is a scalar: bounds of the norm of their δ give one of the norm of
their e. The command to a δ whose level and rate are known is bounded by the smaller of the two.

*What is not linear* is that A, B and h follow the robot: within the delays of G that is c, and the
observer's ÿ_pred, if it has a sampled state, is off likewise.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from uvms_drake.common.errors import require
from uvms_drake.tube.periodic_loop import PeriodicLoop, Stretch

EXACT = 1e-6
"""Part of a period by which times differ that are meant to be the same."""
FRACTION = 0.1
"""Length of a period of a loop without clocks, by its fastest rate: for the quadrature only."""
E, RATE = 0, 1
"""The first two states: e and ė."""


class Peak(NamedTuple):
    """Largest values by a source of size 1, one for each row that has these gains."""

    position: float
    """Of e."""
    velocity: float
    """Of ė."""
    command: float
    """Of the feedback −(k + σ)ė − kσe − δ̂, with the errors of what is measured."""


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
    """From a tick to where the command comes to the actuator [s], of a sampled feedback."""
    latency: int = 0
    """Age of the state that is measured, in periods."""

    def __post_init__(self) -> None:
        for key in ("k", "sigma"):
            require(0.0 < getattr(self, key) < np.inf, key, getattr(self, key), "positive")
        for key in ("observer", "lag", "period", "dead_time"):
            require(0.0 <= getattr(self, key) < np.inf, key, getattr(self, key), "zero or positive")
        for key in ("dead_time", "latency"):
            late = getattr(self, key)
            require(late == 0 or (self.period > 0.0 and late > 0), key, late,
                    "zero, or positive with a positive period")

    @property
    def stable(self) -> bool:
        """Whether the loop is stable."""
        return bool(np.isfinite(self._system.loop.periods))

    @cached_property
    def gains(self) -> dict[str, Peak]:
        """The gains by source, all inf if the loop is unstable."""
        system = self._system
        loop, delta, f, f_sampled = system.loop, system.delta, system.f, system.f_sampled
        gains = {
            "disturbance": loop.flow_gain(delta),
            "disturbance_rate": loop.rate_gain(delta),
            "feed_forward": (loop.held_gain(f, f_sampled) if self.period > 0.0
                             else loop.flow_gain(f)),
            "feed_forward_rate": loop.rate_gain(f, f_sampled)}
        for i, name in enumerate(("position", "velocity")):
            D = np.array([0.0, 0.0, -(self.k * self.sigma, self.k + self.sigma)[i]])
            if self.period > 0.0:
                gains[name] = loop.sample_gain(system.noise[i], D)
            else:
                D[2] -= self.observer * i
                gains[name] = loop.flow_gain(system.noise[i], D)
        return {name: Peak(*map(float, values)) for name, values in gains.items()}

    def wave(self, omega: float) -> Peak:
        """Returns the amplitudes by δ = sin(ωt + φ) of any φ, once they have settled.

        Far less than those of a δ that may be anything, if ω [rad/s] is: waves, of one period.
        """
        system = self._system
        return Peak(*map(float, system.loop.wave_gain(system.delta, omega)))

    @cached_property
    def _system(self) -> "_System":
        return _sampled(self) if self.period > 0.0 else _continuous(self)


class _System(NamedTuple):
    """A loop, and how sources enter it."""

    loop: PeriodicLoop
    delta: np.ndarray
    """δ, into the flow (m,)."""
    f: np.ndarray
    """f, into the flow (m,)."""
    f_sampled: np.ndarray
    """f, at a tick (m,)."""
    noise: np.ndarray
    """Errors of y and of ẏ (2, m), at a tick or into the flow."""


def _feedback(row: RowLoop, m: int, e: int, rate: int, estimate: int | None) -> np.ndarray:
    """Returns −(k + σ)ė − kσe − δ̂ as a row (m,) of states with these indices."""
    v = np.zeros(m)
    v[rate], v[e] = -(row.k + row.sigma), -row.k * row.sigma
    if estimate is not None:
        v[estimate] = -1.0
    return v


def _continuous(row: RowLoop) -> _System:
    """Returns the loop of a feedback and an observer in continuous time.

    The states are e, ė, the lagged acceleration a if there is a lag, and x = δ̂ − λn of an observer,
    ẋ = λ(δ − x − λn) with the error n of ẏ.
    """
    m = 2 + (row.lag > 0.0) + (row.observer > 0.0)
    a, x, k, sigma, rate = 2, m - 1, row.k, row.sigma, row.observer
    v = _feedback(row, m, E, RATE, x if rate else None)
    from_noise = np.array([-k * sigma, -(k + sigma) - rate])
    A, noise, f, delta = np.zeros((m, m)), np.zeros((2, m)), np.zeros(m), np.eye(m)[RATE]
    A[E, RATE] = 1.0
    if row.lag > 0.0:
        A[RATE, a], A[a] = 1.0, v / row.lag
        A[a, a] -= 1.0 / row.lag
        noise[:, a] = from_noise / row.lag
        f[RATE], f[a] = -1.0, 1.0 / row.lag
    else:
        A[RATE], noise[:, RATE] = v, from_noise
    if rate:
        A[x, x], delta[x], noise[1, x] = -rate, rate, -(rate**2)
    period = FRACTION / float(np.max(np.abs(np.linalg.eigvals(A))))
    loop = PeriodicLoop(A, np.array([np.eye(m)[E], np.eye(m)[RATE], v]),
                        (Stretch(period, np.eye(m)),))
    return _System(loop, delta, f, np.zeros(m), noise)


def _sampled(row: RowLoop) -> _System:
    """Returns the loop of a held feedback.

    The states are e and ė; a, if there is a lag; the command w that acts; those that are under way,
    the youngest first; e and ė as they were measured, the youngest first, as old as the latency;
    and of an observer δ̂, the last ė that it has seen, and ∫(ÿ_pred − ÿ̄) since the last tick. At a
    tick the law has the estimate of the tick before.
    """
    h = row.period
    whole = int(row.dead_time / h + EXACT)
    rest = row.dead_time - whole * h
    rest = rest if rest > EXACT * h else 0.0
    waiting = whole + (rest > 0.0)
    names = ["e", "rate", *["a"] * (row.lag > 0.0), "w", *(f"q{i}" for i in range(waiting)),
             *(f"{name}{i}" for i in range(row.latency) for name in ("e", "rate")),
             *["estimate", "seen", "predicted"] * (row.observer > 0.0)]
    at, m = {name: i for i, name in enumerate(names)}, len(names)
    unit = np.eye(m)
    pushed = unit[at["a"] if "a" in at else at["w"]]

    A, f, delta = np.zeros((m, m)), np.zeros(m), unit[RATE]
    A[E, RATE], A[RATE], f[RATE] = 1.0, pushed, -1.0
    if row.lag > 0.0:
        A[at["a"]] = (unit[at["w"]] - unit[at["a"]]) / row.lag

    # A tick: what is measured, commanded and estimated.
    jump, noise, f_sampled = unit.copy(), np.zeros((2, m)), np.zeros(m)
    late = row.latency - 1
    e, rate = (at["e"], at["rate"]) if late < 0 else (at[f"e{late}"], at[f"rate{late}"])
    estimate = at.get("estimate")
    v = _feedback(row, m, e, rate, estimate)
    for name, index, i in (("e", E, 0), ("rate", RATE, 1)):
        for age in range(row.latency):
            jump[at[f"{name}{age}"]] = unit[index if age == 0 else at[f"{name}{age - 1}"]]
        if row.latency:
            noise[i, at[f"{name}0"]] = 1.0
    first = at["q0"] if waiting else at["w"]
    jump[first], f_sampled[first] = v, 1.0
    for i in range(1, waiting):
        jump[at[f"q{i}"]] = unit[at[f"q{i - 1}"]]
    if waiting and not rest:
        jump[at["w"]] = unit[at[f"q{waiting - 1}"]]
    if not row.latency:
        noise[:, first] = -row.k * row.sigma, -(row.k + row.sigma)
    if estimate is not None:
        share = -np.expm1(-row.observer * h)
        A[at["predicted"]], f[at["predicted"]] = pushed, -1.0
        mean = (unit[rate] - unit[at["seen"]] - unit[at["predicted"]]) / h
        jump[estimate] = (1.0 - share) * unit[estimate] + share * mean
        jump[at["seen"]], jump[at["predicted"]] = unit[rate], 0.0
        if not row.latency:
            noise[1, estimate], noise[1, at["seen"]] = share / h, 1.0

    stretches: tuple[Stretch, ...] = (Stretch(h, jump),)
    if rest:
        arrives = unit.copy()
        arrives[at["w"]] = unit[at[f"q{waiting - 1}"]]
        stretches = (Stretch(rest, arrives), Stretch(h - rest, jump))
    C = np.array([unit[E], unit[RATE], _feedback(row, m, E, RATE, estimate)])
    return _System(PeriodicLoop(A, C, stretches), delta, f, f_sampled, noise)
