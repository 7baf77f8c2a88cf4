"""Limits on how deep the end-effector goes, at the knots of a plan and between them.

Between two knots of a plan n·𝔭 is, but for its third derivative, a parabola, and bounds at the
knots on n·𝔭 and on n·𝔭 + ½h n·𝔭̇ hold in between (`contact.approach.between_knots`): nothing
is lost where the motion just stops. What is left is at most (2/81) h³ sup|d³(n·𝔭)/dt³|, the largest
|t²(t − h)|/6: with h = 0.2 s, 0.2 mm per m/s³. The depth has that taken off
(`tube.contact.tip_jerk`).
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from uvms_drake.control.limits.limit import Limit
from uvms_drake.control.plan.between_knots import between_knots
from uvms_drake.control.plan.points import About, Points, Slopes


@dataclass
class SafeDepth(Limit):
    """N·𝔭 ≤ depth, for each of some facets N."""

    name = "safe_depth"
    soft: ClassVar[bool] = False
    overshoots: ClassVar[bool] = False

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
class SafeDepthBetweenKnots(Limit):
    """N·𝔭 + ½h N·𝔭̇ ≤ depth for each facet."""

    name = "safe_depth_between_knots"
    overshoots: ClassVar[bool] = False
    about: ClassVar[About] = "speed"

    facets: np.ndarray
    """As of the `SafeDepth` (m, 3)."""
    depth: np.ndarray
    """Likewise (m,) [m]."""
    time_step: float
    """Length h of an interval of the plan [s]."""

    def values(self, at: Points) -> np.ndarray:
        """Returns the N·𝔭 + ½h N·𝔭̇."""
        v = (at.tip_jacobian @ at.zeta[..., None])[..., 0]
        return between_knots(at.y[..., :3] @ self.facets.T, v @ self.facets.T, self.time_step)

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Returns −∞ and the depths."""
        return np.full(len(self.facets), -np.inf), self.depth

    def slopes(self, at: Points) -> Slopes:
        """Returns those of 𝔭 and of 𝔭̇ = J_𝔭(𝔮)ζ."""
        rows = 0.5 * self.time_step * self.facets
        here = np.pad(self.facets, ((0, 0), (0, at.model.size - 3)))
        rates = np.einsum("...ijk,...j->...ik", at.tip_jacobian_rates, at.zeta)
        return Slopes(here + rows @ rates @ at.config_y, rows @ at.tip_jacobian)

    def unit_of(self, signal: str) -> str:
        """Returns m."""
        return "m"
