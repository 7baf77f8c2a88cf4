"""Waves of small amplitude (Airy's), as oscillating water, uniform over the robot.

World is Σ_I, z down. At a depth z below the still surface of deep water a wave of the amplitude A
and the angular frequency ω that goes along e moves the water with

    v = A ω exp(−kz) (cos θ e + sin θ e_z),     θ = ωt + phase,     ω² = g k.                   (1)

The robot is small against the length 2π/k of a wave (56 m at 6 s) and nearly fixed, so the water's
motion is uniform; neglected are its gradient, v·∇v, of second order in A, and waves made by the
robot.

Reference: Fossen (2021), *Handbook of Marine Craft Hydrodynamics and Motion Control*, chapter 10;
Newman (1977), *Marine Hydrodynamics*, chapter 6.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Annotated, ClassVar, Literal

import numpy as np

from uvms_drake.common.constraints import Between, Finite, NotNegative, Positive, Vector
from uvms_drake.common.errors import require, vector
from uvms_drake.common.schema import check_values
from uvms_drake.common.wiring import WiredSystem, cached, output_of
from uvms_drake.model.signals.fault import Fault
from uvms_drake.model.uvms import STANDARD_GRAVITY

STEEPEST = 0.446
"""kA of a wave that breaks (Miche: a height of 0.142 wavelengths)."""


@dataclass
class Wave:
    """A regular wave."""

    amplitude: float = 0.25
    """Amplitude A of the surface: half the height from trough to crest [m]."""
    period: Annotated[float, Between(0.1, 1000, " s")] = 6.0
    """Period 2π/ω [s]."""
    direction: Annotated[float, Finite] = 0.0
    """Angle about z from x of Σ_I to the direction of propagation [rad]."""
    phase: Annotated[float, Finite] = 0.0
    """Phase θ at t = 0 [rad]; 0 is a crest."""
    depth: Annotated[float, Positive] = 2.5
    """Depth z of the robot below the still surface [m]."""

    def check(self) -> None:
        """Raises `InvalidParameter` for the first value that has no meaning."""
        largest = min(self.depth, STEEPEST / self.wavenumber)
        require(0.0 <= self.amplitude <= largest, "amplitude", self.amplitude,
                f"from 0 to {largest:.3g} m: lower than it breaks, and above the robot")

    @property
    def frequency(self) -> float:
        """ω [rad/s]."""
        return 2.0 * np.pi / self.period

    @property
    def wavenumber(self) -> float:
        """The k of (1) [1/m]."""
        return self.frequency**2 / STANDARD_GRAVITY

    @property
    def speed(self) -> float:
        """Speed of the water [m/s], which goes round."""
        return self.amplitude * self.frequency * float(np.exp(-self.wavenumber * self.depth))

    def motion(self, time: float) -> tuple[np.ndarray, np.ndarray]:
        """Returns v (3,) [m/s] and v̇ (3,) [m/s²] in Σ_I at a time [s]; see (1)."""
        theta = self.frequency * time + self.phase
        c, s = np.cos(theta), np.sin(theta)
        e = np.array([np.cos(self.direction), np.sin(self.direction), 0.0])
        e_z = np.array([0.0, 0.0, 1.0])
        return (self.speed * (c * e + s * e_z),
                self.speed * self.frequency * (c * e_z - s * e))


@dataclass
class UnknownFlow(Fault):
    """Flow that nobody has declared: a gust of current, or a swell, in addition to the water's."""

    place: ClassVar[Literal["water"]] = "water"

    velocity: Annotated[np.ndarray, Vector(3)] = field(
        default_factory=lambda: np.array([0.0, 0.5, 0.0]))
    """Velocity in Σ_I (3,) [m/s]; of a swell its largest."""
    period: Annotated[float, Between(0.1, 1000, " s")] | None = None
    """Period of a swell [s]; None: a steady current."""
    rise: Annotated[float, Positive] = 2.0
    """Time in which it rises [s]."""
    start: Annotated[float, NotNegative] = 0.0
    """First instant of the flow [s]."""

    def motion(self, time: float) -> tuple[np.ndarray, np.ndarray]:
        """Returns v (3,) [m/s] and v̇ (3,) [m/s²] in Σ_I at a time [s]."""
        t = time - self.start
        if not self.is_active(time):
            return np.zeros(3), np.zeros(3)
        omega = 0.0 if self.period is None else 2.0 * np.pi / self.period
        x = np.pi * min(t / self.rise, 1.0)
        share, share_rate = 0.5 * (1.0 - np.cos(x)), 0.5 * np.pi / self.rise * np.sin(x)
        c, s = np.cos(omega * t), np.sin(omega * t)
        velocity = np.asarray(self.velocity, dtype=float)
        return share * c * velocity, (share_rate * c - omega * share * s) * velocity


def largest_speed(waves: Sequence[Wave]) -> float:
    """Returns a bound of the speed of the water by waves alone [m/s]."""
    return sum(wave.speed for wave in waves)


def water_motion(current: np.ndarray, waves: Sequence[Wave | UnknownFlow], time: float
                 ) -> tuple[np.ndarray, np.ndarray]:
    """Returns v_c (3,) [m/s] and v̇_c (3,) [m/s²] of a steady current with waves at a time [s]."""
    velocity, acceleration = np.array(current, dtype=float), np.zeros(3)
    for wave in waves:
        v, a = wave.motion(time)
        velocity += v
        acceleration += a
    return velocity, acceleration


class WaterMotion(WiredSystem):
    """The water's motion, to the ports of the same names of the plant.

    .. pydrake_system::

        name: WaterMotion
        output_ports:
        - current
        - current_acceleration

    - `current` (3) [m/s]: v_c in Σ_I.
    - `current_acceleration` (3) [m/s²]: v̇_c.

    It has no state.

    Args:
        current: The steady part (3,) [m/s].
        waves: Waves added to it.
    """

    def __init__(self, current: np.ndarray, waves: Sequence[Wave | UnknownFlow] = ()):
        super().__init__()
        for wave in waves:
            check_values(wave)
        steady, waves = vector("current", current, 3), list(waves)
        motion = cached(self, "v_c and v̇_c", lambda c: water_motion(steady, waves, c.get_time()),
                        {self.time_ticket() if waves else self.nothing_ticket()})
        output_of(self, "current", 3, lambda c: motion.Eval(c)[0], {motion.ticket()})
        output_of(self, "current_acceleration", 3, lambda c: motion.Eval(c)[1], {motion.ticket()})
