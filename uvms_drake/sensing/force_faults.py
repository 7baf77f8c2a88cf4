"""Faults of the sensor of the contact force, between it and the controller."""

from dataclasses import dataclass, field

import numpy as np

from uvms_drake.common.errors import require, vector
from uvms_drake.sensing.faulty_sensor import SensorFault


class ForceFault(SensorFault):
    """A fault of the measured force 𝔉_s, whatever measures it."""

    place = "force"
    motions = ("dynamic",)


@dataclass
class LostForce(ForceFault):
    """The measured force is not a number; the law goes on with the last one that was."""

    def faulty(self, true: np.ndarray, held: np.ndarray) -> np.ndarray:
        """Returns NaN."""
        return np.full_like(true, np.nan)


@dataclass
class FrozenForce(ForceFault):
    """The measured force stays what it was at `start`."""

    def faulty(self, true: np.ndarray, held: np.ndarray) -> np.ndarray:
        """Returns the measurement at the start."""
        return held


@dataclass
class SaturatedForce(ForceFault):
    """No component of the measured force is larger than `largest`."""

    largest: float = 10.0
    """Largest component, either way [N, N m]."""

    def check(self) -> None:
        """Raises `InvalidParameter` for the first value that has no meaning."""
        super().check()
        require(0.0 <= self.largest < np.inf, "largest", self.largest, "zero or positive")

    def faulty(self, true: np.ndarray, held: np.ndarray) -> np.ndarray:
        """Returns the measurement, cut."""
        return np.clip(true, -self.largest, self.largest)


@dataclass
class JumpedForce(ForceFault):
    """The measured force has a bias that was not there when it was tared."""

    jump: np.ndarray = field(default_factory=lambda: np.array([5.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
    """Bias of 𝔉_s, in Σ_I (6,) [N (3), N m (3)]."""

    def check(self) -> None:
        """Raises `InvalidParameter` for the first value that has no meaning."""
        super().check()
        vector("jump", self.jump, 6)

    def faulty(self, true: np.ndarray, held: np.ndarray) -> np.ndarray:
        """Returns the measurement with the bias."""
        return true + self.jump
