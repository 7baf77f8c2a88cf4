"""Waves of small amplitude (Airy's), as oscillating water, uniform over the robot.

World is Σ_I, z down. At a depth z below the still surface, over a floor at the depth h, a wave of
the amplitude A and the angular frequency ω that goes along e moves the water with

    v = A ω [cosh k(h − z) cos θ e + sinh k(h − z) sin θ e_z] / sinh kh,     θ = ωt + phase,     (1)

ω² = g k tanh kh. The robot is small against the length 2π/k of a wave (56 m at 6 s in deep water)
and nearly fixed, so the water's motion is uniform; neglected are its gradient, v·∇v, of second
order in A, and waves made by the robot.

Reference: Fossen (2021), *Handbook of Marine Craft Hydrodynamics and Motion Control*, chapter 10;
Newman (1977), *Marine Hydrodynamics*, chapter 6.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder, LeafSystem, System

from uvms_drake.common.constraints import Between, Finite, Positive
from uvms_drake.common.errors import require, vector
from uvms_drake.common.schema import check_values
from uvms_drake.model.uvms import STANDARD_GRAVITY

STEEPEST = 0.446
"""kA / tanh kh of a wave that breaks (Miche: a height of 0.142 wavelengths times tanh kh)."""


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
    sea_depth: float | None = None
    """Depth h of the floor [m]; left out: deep water."""

    def check(self) -> None:
        """Raises `InvalidParameter` for the first value that has no meaning."""
        require(self.sea_depth is None or self.depth <= self.sea_depth < np.inf, "sea_depth",
                self.sea_depth, f"at least the robot's depth, {self.depth:g} m, or left out")
        k, h = self.wavenumber, self._floor
        largest = min(self.depth, STEEPEST * float(np.tanh(k * h)) / k)
        require(0.0 <= self.amplitude <= largest, "amplitude", self.amplitude,
                f"from 0 to {largest:.3g} m: lower than it breaks, and above the robot")

    @property
    def _floor(self) -> float:
        return np.inf if self.sea_depth is None else self.sea_depth

    @property
    def frequency(self) -> float:
        """ω [rad/s]."""
        return 2.0 * np.pi / self.period

    @property
    def wavenumber(self) -> float:
        """The k of (1) [1/m], by Newton's method from Eckart's approximation."""
        deep = self.frequency**2 / STANDARD_GRAVITY
        if self.sea_depth is None:
            return deep
        h = self.sea_depth
        k = deep / np.sqrt(np.tanh(deep * h))
        for _ in range(20):
            t = np.tanh(k * h)
            k -= (k * t - deep) / (t + k * h * (1.0 - t**2))
        return float(k)

    @property
    def speeds(self) -> tuple[float, float]:
        """Amplitudes of the horizontal and of the vertical velocity [m/s]."""
        k, h = self.wavenumber, self._floor
        # Hyperbolic functions would overflow in deep water.
        scale = self.amplitude * self.frequency * np.exp(-k * self.depth) / -np.expm1(-2.0 * k * h)
        image = -2.0 * k * (h - self.depth)
        return float(scale * (1.0 + np.exp(image))), float(scale * -np.expm1(image))

    def motion(self, time: float) -> tuple[np.ndarray, np.ndarray]:
        """Returns v (3,) [m/s] and v̇ (3,) [m/s²] in Σ_I at a time [s]; see (1)."""
        along, down = self.speeds
        theta = self.frequency * time + self.phase
        c, s = np.cos(theta), np.sin(theta)
        e = np.array([np.cos(self.direction), np.sin(self.direction), 0.0])
        e_z = np.array([0.0, 0.0, 1.0])
        return (along * c * e + down * s * e_z,
                self.frequency * (down * c * e_z - along * s * e))


def largest_speed(waves: Sequence[Wave]) -> float:
    """Returns a bound of the speed of the water by waves alone [m/s]."""
    return sum(wave.speeds[0] for wave in waves)


def water_motion(current: np.ndarray, waves: Sequence[Wave], time: float
                 ) -> tuple[np.ndarray, np.ndarray]:
    """Returns v_c (3,) [m/s] and v̇_c (3,) [m/s²] of a steady current with waves at a time [s]."""
    velocity, acceleration = np.array(current, dtype=float), np.zeros(3)
    for wave in waves:
        v, a = wave.motion(time)
        velocity += v
        acceleration += a
    return velocity, acceleration


class WaterMotion(LeafSystem):
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

    def __init__(self, current: np.ndarray, waves: Sequence[Wave] = ()):
        super().__init__()
        for wave in waves:
            check_values(wave)
        self._current, self._waves = vector("current", current, 3), list(waves)
        when = self.time_ticket() if self._waves else self.nothing_ticket()
        for i, name in enumerate(("current", "current_acceleration")):
            self.DeclareVectorOutputPort(
                name, 3, lambda context, output, i=i: self._calc(i, context, output), {when})

    def _calc(self, i: int, context: Context, output: BasicVector) -> None:
        output.SetFromVector(water_motion(self._current, self._waves, context.get_time())[i])

    @staticmethod
    def AddToBuilder(builder: DiagramBuilder, current: np.ndarray, waves: Sequence[Wave], *,
                     plant: System, name: str = "water") -> "WaterMotion":
        """Adds the system and connects it to the plant's inputs of the names of its ports."""
        system: WaterMotion = builder.AddNamedSystem(name, WaterMotion(current, waves))
        for i in range(system.num_output_ports()):
            port = system.get_output_port(i)
            builder.Connect(port, plant.GetInputPort(port.get_name()))
        return system
