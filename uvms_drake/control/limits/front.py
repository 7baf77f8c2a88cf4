"""Limits on how deep the end-effector goes along a direction, and how fast.

Between two knots of a plan n·𝔭 is, but for its third derivative, a parabola, and bounds at the
knots on n·𝔭 and on n·𝔭 + ½h n·𝔭̇ hold in between (`contact.approach.between_knots`): nothing
is lost where the motion just stops. What is left is at most (2/81) h³ sup|d³(n·𝔭)/dt³|, the largest
|t²(t − h)|/6: with h = 0.2 s, 0.2 mm per m/s³. The depth has that taken off (`tube.tip_jerk`).
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from uvms_drake.control.contact.approach import between_knots
from uvms_drake.control.limits.limit import Limit
from uvms_drake.control.points import About, Points, Slopes


@dataclass
class Front(Limit):
    """N·𝔭 ≤ depth, for each of some facets N."""

    name = "front"
    soft: ClassVar[bool] = False
    bulges: ClassVar[bool] = False

    facets: np.ndarray
    """N (m, 3) in Σ_I, all of them into the surface."""
    depth: np.ndarray
    """Largest N·𝔭 (m,) [m]; less what the tube takes."""

    def values(self, at: Points) -> np.ndarray:
        """Returns the N·𝔭."""
        depths: np.ndarray = at.y[..., :3] @ self.facets.T
        return depths

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Returns −∞ and the depths."""
        return np.full(len(self.facets), -np.inf), self.depth

    def slopes(self, at: Points) -> Slopes:
        """Returns the N."""
        return Slopes(np.pad(self.facets, ((0, 0), (0, at.model.size - 3))))

    def unit_of(self, signal: str) -> str:
        """Returns m."""
        return "m"


@dataclass
class Approach(Limit):
    """N·𝔭 + ½h N·𝔭̇ ≤ depth for each facet, n·𝔭̇ ≤ speed."""

    name = "approach"
    bulges: ClassVar[bool] = False
    about: ClassVar[About] = "speed"

    direction: np.ndarray
    """Unit vector n (3,) in Σ_I, into the surface."""
    facets: np.ndarray
    """As of the `Front` (m, 3)."""
    depth: np.ndarray
    """Likewise (m,) [m]."""
    speed: float
    """Largest n·𝔭̇ [m/s]."""
    time_step: float
    """Length h of an interval of the plan [s]."""

    def values(self, at: Points) -> np.ndarray:
        """Returns the N·𝔭 + ½h N·𝔭̇, and n·𝔭̇."""
        v = (at.tip_jacobian @ at.zeta[..., None])[..., 0]
        ahead = between_knots(at.y[..., :3] @ self.facets.T, v @ self.facets.T, self.time_step)
        return np.concatenate([ahead, (v @ self.direction)[..., None]], axis=-1)

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Returns −∞, and depths and speed."""
        most = np.append(self.depth, self.speed)
        return np.full(len(most), -np.inf), most

    def slopes(self, at: Points) -> Slopes:
        """Returns those of 𝔭 and of 𝔭̇ = J_𝔭(𝔮)ζ."""
        # By row: half an interval of a facet's speed, and its depth; then the speed alone.
        rows = np.concatenate([0.5 * self.time_step * self.facets, self.direction[None]])
        here = np.pad(self.facets, ((0, 1), (0, at.model.size - 3)))
        rates = np.einsum("...ijk,...j->...ik", at.tip_jacobian_rates, at.zeta)
        return Slopes(here + rows @ rates @ at.config_y, rows @ at.tip_jacobian)

    @property
    def labels(self) -> list[str]:
        """front_ahead of each facet, approach."""
        count = len(self.facets)
        ahead = [f"front_ahead[{i}]" for i in range(count)] if count > 1 else ["front_ahead"]
        return [*ahead, "approach"]

    def unit_of(self, signal: str) -> str:
        """Returns m or m/s."""
        return "m" if signal.startswith("front") else "m/s"
