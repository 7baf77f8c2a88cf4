"""Error of a navigation filter: delay, sampling, noise, drift, and gaps of the velocity.

At t_k = k h there is a sample, which the controller has from t_k + δ to t_k + h + δ, with h and the
latency δ of its channel:

    x̂(t) = x(t_k) + ε(t_k),     ε = noise + (drift of the position) + (error of the velocity).   (1)

A filter with inertial sensors predicts from its last sample to the present. Such a channel is
*propagated*, x̂(t) = x(t) + ε(t_k), and the error of the prediction has to be counted in its noise.

*Noise* is drawn for each sample, Gaussian and cut to a multiple of its σ. The *drift* of each
component of the position grows at a constant rate from zero and reverses at ± its bound, a
triangular wave. The *velocity* is measured by a Doppler log (DVL): between its fixes the filter
integrates accelerometers, whose bias makes the error grow,

    ε(t) = ν_j + a (t − t_j),     t_j the last fix before t.                                     (2)

A fix may be lost, but not for longer than a declared gap. All random numbers are functions of the
seed and of the time, so that ε needs no state.
"""

from dataclasses import dataclass, field
from functools import lru_cache, partial
from itertools import pairwise
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydrake.systems.framework import DiagramBuilder, OutputPort

from uvms_drake.common.constraints import (
    Between,
    Fraction,
    NotNegative,
    Positive,
    Rate,
    Vector,
)
from uvms_drake.common.errors import require
from uvms_drake.common.keyed_random import generator_of, normal_numbers, uniform_number
from uvms_drake.common.wiring import WiredSystem, output_of
from uvms_drake.model.signals.fault import Fault
from uvms_drake.model.signals.sample_and_hold import Clock, SampledVector
from uvms_drake.model.signals.sensor_actuator import Sensor, Signals
from uvms_drake.model.uvms_model import UvmsModel

STREAM = 2
"""Key of a navigation's random numbers, distinct from those of others."""


@lru_cache(maxsize=64)
def _rates(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Returns a seed's drift and bias over their bounds (3,) each, from −1 to 1."""
    drift, bias = generator_of(seed, (STREAM, 0)).uniform(-1.0, 1.0, (2, 3))
    return drift, bias


def triangle(x: np.ndarray) -> np.ndarray:
    """Returns the triangular wave through 0 with the slopes ± 1 and the bounds ± 1."""
    return 2.0 / np.pi * np.arcsin(np.sin(0.5 * np.pi * x))


@dataclass
class Channel:
    """Components of the state that are measured together."""

    rate: Annotated[float, Rate] = 50.0
    """Samples per second [Hz]."""
    noise: Annotated[float, NotNegative] = 0.0
    """Standard deviation σ of a sample, of each component [m, rad, m/s, rad/s]."""
    latency: float = 0.01
    """Latency δ from a sample to the controller [s]."""
    propagated: bool = False
    """Whether the filter predicts from the last sample to now, instead of holding it."""

    def check(self) -> None:
        """Raises `InvalidParameter` for the first value that has no meaning."""
        require(0.0 <= self.latency <= 100.0 / self.rate, "latency", self.latency,
                f"from 0 to 100 periods, {100.0 / self.rate:g} s")


@dataclass
class Drift:
    """Slow error of the position."""

    rate: Annotated[float, NotNegative] = 0.0002
    """Bound of its rate, of each component [m/s]; the rate is drawn by the scenario's seed."""
    bound: Annotated[float, NotNegative] = 0.02
    """Bound of each component, at which it reverses [m]."""

    def at(self, time: float, rates: np.ndarray) -> np.ndarray:
        """Returns the error (3,) [m] of drawn rates (3,) [m/s]."""
        if self.bound == 0.0:
            return np.zeros(3)
        return self.bound * triangle(rates * time / self.bound)


@dataclass
class Dvl:
    """Doppler log that corrects the velocity."""

    rate: Annotated[float, Between(0.01, 100.0, " Hz")] = 9.5
    """Fixes per second [Hz]."""
    noise: Annotated[np.ndarray, Vector(3), NotNegative] = field(
        default_factory=lambda: np.array([0.0041, 0.0039, 0.0009]))
    """Standard deviation σ of a fix (3,) [m/s]."""
    gap: float = 0.38
    """Longest time between two fixes [s], of which whole periods count."""
    lost: Annotated[float, Fraction] = 0.1
    """Probability that a fix is lost; 1: every gap is the longest."""
    growth: Annotated[float, NotNegative] = 0.02
    """Bound of the growth of the error without a fix, of each component [m/s²]: the bias of the
    accelerometers, drawn by the scenario's seed."""

    def check(self) -> None:
        """Raises `InvalidParameter` for the first value that has no meaning."""
        require(1.0 <= self.gap * self.rate <= 1e4, "gap", self.gap,
                f"from one period, {1.0 / self.rate:g} s, to 10000")

    @property
    def most(self) -> int:
        """Largest number of periods from one fix to the next."""
        return int(self.gap * self.rate + 1e-9)

    def last_fix(self, time: float, seed: int) -> int:
        """Returns the index j of the last fix, at j over the rate, that is not lost.

        Every fix whose index is a multiple of `most` is there, which keeps the gaps short.
        """
        j = int(time * self.rate + 1e-9)
        while j % self.most and uniform_number(seed, (STREAM, 1, j)) < self.lost:
            j -= 1
        return j


@dataclass
class LostFixes(Fault):
    """Doppler log without a fix, for longer than the declared gap."""

    place: ClassVar[Literal["fixes"]] = "fixes"

    start: Annotated[float, NotNegative] = 0.0
    """Time of the last fix before it [s]."""
    duration: Annotated[float, Positive] = 5.0
    """Duration [s]."""

    def of(self, dvl: Dvl) -> "LostDvl":
        """Returns a log with the fault, in addition to those that it has."""
        return LostDvl(**vars(dvl) | {"outages": (*getattr(dvl, "outages", ()), self)})


@dataclass
class LostDvl(Dvl):
    """Doppler log of a scenario with its faults."""

    outages: tuple[LostFixes, ...] = ()
    """The faults."""

    def last_fix(self, time: float, seed: int) -> int:
        """Returns the index j of the last fix that is neither lost nor inside of an outage."""
        j = super().last_fix(time, seed)
        # From the last to begin on: an earlier one takes it back to before all later ones.
        for outage in sorted(self.outages, key=lambda each: each.start, reverse=True):
            if 1e-9 < j / self.rate - outage.start < outage.duration - 1e-9:
                j = super().last_fix(outage.start, seed)
        return j


@dataclass
class Navigation(Sensor):
    """State of a navigation filter, with its errors.

    It is logged as `measured_state`. Noise and rates are those measured on a vehicle in a pool: DVL
    9.5 Hz with gaps up to 0.376 s and 4.1, 3.9, 0.9 mm/s, gyro 1.6 to 2.1 mrad/s at 100 Hz, a
    filter's odometry smooth to 0.5 mm at 25 to 31.5 Hz (sbdMJ/UnderwaterScanningRobot, 2026-08);
    that of the Girona 1000's scenario for Stonefish gives 100 Hz. An arm's joints come at 50 Hz, 10
    ms a packet (Reach Bravo), and the packets of a DVL A50 take 4 ms, 13 ms at most (Water Linked).
    The others are not published and assumed: a position relative to the workpiece, which drifts by
    centimetres only; an attitude to 1 mrad; a bias of the accelerometers of 2 mg; the noise of the
    joints. Pose and velocity, which a filter predicts by inertial sensors, are propagated; gyro and
    joints are sampled.
    """


    position: Channel = field(default_factory=lambda: Channel(50.0, 0.0005, 0.01, True))
    """Position of the vehicle in Σ_I [m]."""
    attitude: Channel = field(default_factory=lambda: Channel(100.0, 0.001, 0.01, True))
    """Euler angles of the vehicle [rad]."""
    velocity: Channel = field(default_factory=lambda: Channel(50.0, 0.0, 0.01, True))
    """Velocity of the vehicle in body axes [m/s]; the error of the DVL is added to this noise."""
    turning: Channel = field(default_factory=lambda: Channel(100.0, 0.002, 0.01))
    """Angular velocity of the vehicle in body axes [rad/s]."""
    joints: Channel = field(default_factory=lambda: Channel(50.0, 0.0002, 0.01))
    """Joint angles [rad]."""
    joint_rates: Channel = field(default_factory=lambda: Channel(50.0, 0.002, 0.01))
    """Rates of the joints [rad/s]."""
    noise_multiple: Annotated[float, NotNegative] = 3.0
    """Multiple of σ to which all noise is cut, so that it is bounded."""
    drift: Drift = field(default_factory=Drift)
    """Drift of the position."""
    dvl: Dvl = field(default_factory=Dvl)
    """Doppler log of the velocity."""

    def assumption(self) -> str:
        """Returns the assumption that it breaks."""
        return "the proofs take the state for known at all times"

    def error(self, key: str, count: int, seed: int, time: float) -> np.ndarray:
        """Returns the error of a sample; see (1) and (2).

        Args:
            key: Key of the channel.
            count: Number of its components.
            seed: Seed of the random numbers.
            time: Time of the sample [s].
        """
        channel: Channel = getattr(self, key)
        error = np.zeros(count)
        if channel.noise > 0.0:
            stream = STREAM, 2, CHANNELS.index(key), round(time * channel.rate)
            error += channel.noise * self._unit(count, seed, stream)
        if key == "position":
            error += self.drift.at(time, self.drift.rate * _rates(seed)[0])
        if key == "velocity":
            j = self.dvl.last_fix(time, seed)
            error += self.dvl.noise * self._unit(3, seed, (STREAM, 3, j))
            error += self.dvl.growth * _rates(seed)[1] * (time - j / self.dvl.rate)
        return error

    def _unit(self, count: int, seed: int, key: tuple[int, ...]) -> np.ndarray:
        """Returns cut Gaussian numbers (count,) with σ = 1."""
        numbers = normal_numbers(seed, key, count)
        return np.minimum(np.maximum(numbers, -self.noise_multiple), self.noise_multiple)

    def add_to(self, builder: DiagramBuilder, model: UvmsModel, port: OutputPort,
               signals: Signals, seed: int) -> OutputPort:
        """Adds a `SampledVector` with a clock for each channel; see `Part`."""
        clocks = []
        for key, rows in channel_rows(model.size).items():
            channel: Channel = getattr(self, key)
            clocks.append(Clock(rows, 1.0 / channel.rate, channel.latency,
                                partial(self.error, key, len(rows), seed),
                                channel.propagated))
        measured = SampledVector.AddToBuilder(
            builder, port.size(), clocks, name="navigation", vector=port).get_output_port()
        signals["measured_state"] = measured
        signals["fix_age"] = FixAge.AddToBuilder(builder, self.dvl, seed).get_output_port()
        return measured


class FixAge(WiredSystem):
    """Age of the last fix of a Doppler log, which a driver knows.

    .. pydrake_system::

        name: FixAge
        output_ports:
        - fix_age

    - `fix_age` (1): [s].

    It has no state.

    Args:
        dvl: The log.
        seed: Seed of its gaps.
    """

    def __init__(self, dvl: Dvl, seed: int):
        super().__init__()
        output_of(self, "fix_age", 1, lambda c: [
            c.get_time() - dvl.last_fix(c.get_time(), seed) / dvl.rate], {self.time_ticket()})


CHANNELS = ("position", "attitude", "joints", "velocity", "turning", "joint_rates")
"""Keys of the channels, in the order of the state."""


def channel_rows(size: int) -> dict[str, range]:
    """Returns the indices of each channel in (𝔮, ζ) of 2 `size` components."""
    ends = 0, 3, 6, size, size + 3, size + 6, 2 * size
    return {key: range(*span) for key, span in zip(CHANNELS, pairwise(ends), strict=True)}
