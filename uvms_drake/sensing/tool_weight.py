"""The tool beyond a wrist sensor, and its weight in water."""

from dataclasses import dataclass, field

import numpy as np

from uvms_drake.common.errors import require, vector
from uvms_drake.model.frames.spatial import cross


@dataclass
class Tool:
    """Tool beyond a wrist sensor, without which it would measure the contact alone.

    Only its weight and its buoyancy are in the reading: its inertia force, mass and added mass
    times some 0.1 m/s², and its drag are left out.
    """

    mass: float = 0.0
    """Mass [kg]."""
    centre: np.ndarray = field(default_factory=lambda: np.zeros(3))
    """Centre of mass in the sensor's frame [m]."""
    displaced: float = 0.0
    """Mass of the water that it displaces [kg]."""
    buoyancy: np.ndarray = field(default_factory=lambda: np.zeros(3))
    """Centre of buoyancy in the sensor's frame [m]."""
    error: float = 0.0
    """Relative error of the weight that the sensor's model takes off: too much, if positive."""

    def check(self) -> None:
        """Raises `InvalidParameter` for the first value that has no meaning."""
        for key in ("mass", "displaced"):
            require(0.0 <= getattr(self, key) < np.inf, key, getattr(self, key), "zero or positive")
        for key in ("centre", "buoyancy"):
            vector(key, getattr(self, key), 3)
        require(bool(abs(self.error) <= 1.0), "error", self.error, "between -1 and 1")

    @property
    def _moment(self) -> np.ndarray:
        """First moment of the mass less that of the water (3,) [kg m]."""
        return self.mass * np.asarray(self.centre) - self.displaced * np.asarray(self.buoyancy)

    def hold(self, g_S: np.ndarray) -> np.ndarray:
        """Returns the wrench (..., 6) [N, N m] about the sensor's origin that holds it at rest.

        −((m − m_w) g, (m c − m_w c_b) × g), m_w the mass of the water that it displaces.

        Args:
            g_S: Gravity in the sensor's axes (..., 3) [m/s²].
        """
        force = (self.mass - self.displaced) * g_S
        return -np.concatenate([force, cross(self._moment, g_S)], axis=-1)

    def largest_hold(self, gravity: float) -> np.ndarray:
        """Returns the largest components (6,) of `hold` in any attitude, ‖g‖ = `gravity`."""
        weight = abs(self.mass - self.displaced)
        a, b, c = self._moment**2
        return gravity * np.array([weight] * 3 + list(np.sqrt([b + c, a + c, a + b])))
