"""Limits on how deep the end-effector goes along a direction, and how fast.

Between two knots of a plan n·𝔭 is, but for its third derivative, a parabola, and bounds at the
knots on n·𝔭 and on n·𝔭 + ½h n·𝔭̇ hold in between (`contact.approach.between_knots`): there is no
margin to take off, and none is lost where the motion just stops. What is left is at most (2/81) h³
sup|d³(n·𝔭)/dt³|, the largest |t²(t − h)|/6: with h = 0.2 s, 0.2 mm per m/s³.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from uvms_drake.control.contact.approach import between_knots
from uvms_drake.control.limits.limit import Limit
from uvms_drake.control.points import About, Points, Slopes


@dataclass
class Front(Limit):
    """n·𝔭 ≤ depth."""

    name = "front"
    soft: ClassVar[bool] = False

    direction: np.ndarray
    """Unit vector n (3,) in Σ_I, into the surface."""
    depth: float
    """Largest n·𝔭 [m]; less what the tube takes."""

    def values(self, at: Points) -> np.ndarray:
        """Returns n·𝔭."""
        return (at.y[..., :3] @ self.direction)[..., None]

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Returns −∞ and the depth."""
        return np.array([-np.inf]), np.array([self.depth])

    def slopes(self, at: Points) -> Slopes:
        """Returns n."""
        return Slopes(np.pad(self.direction, (0, at.model.size - 3))[None])

    def unit_of(self, signal: str) -> str:
        """Returns m."""
        return "m"


@dataclass
class Approach(Limit):
    """n·𝔭 + ½h n·𝔭̇ ≤ depth, n·𝔭̇ ≤ speed."""

    name = "approach"
    about: ClassVar[About] = "speed"

    direction: np.ndarray
    """Unit vector n (3,) in Σ_I, into the surface."""
    depth: float
    """As of the `Front` [m]."""
    speed: float
    """Largest n·𝔭̇ [m/s]."""
    time_step: float
    """Length h of an interval of the plan [s]."""

    def values(self, at: Points) -> np.ndarray:
        """Returns n·𝔭 + ½h n·𝔭̇ and n·𝔭̇."""
        x = at.y[..., :3] @ self.direction
        v = (at.tip_jacobian @ at.zeta[..., None])[..., 0] @ self.direction
        return np.stack([between_knots(x, v, self.time_step), v], axis=-1)

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Returns −∞, and depth and speed."""
        return np.full(2, -np.inf), np.array([self.depth, self.speed])

    def slopes(self, at: Points) -> Slopes:
        """Returns those of 𝔭 and of 𝔭̇ = J_𝔭(𝔮)ζ."""
        by_zeta = (self.direction @ at.tip_jacobian)[..., None, :]
        along = np.einsum("i,...ijk,...j->...k", self.direction, at.tip_jacobian_rates, at.zeta)
        by_y = along[..., None, :] @ at.config_y
        n = np.broadcast_to(np.pad(self.direction, (0, at.model.size - 3)), by_y.shape)
        half = 0.5 * self.time_step
        return Slopes(np.concatenate([n + half * by_y, by_y], axis=-2),
                      np.concatenate([half * by_zeta, by_zeta], axis=-2))

    @property
    def labels(self) -> list[str]:
        """front_ahead, approach."""
        return ["front_ahead", "approach"]

    def unit_of(self, signal: str) -> str:
        """Returns m or m/s."""
        return "m" if signal.startswith("front") else "m/s"
