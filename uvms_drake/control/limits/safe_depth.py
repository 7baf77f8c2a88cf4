"""Limits on the depth of the end-effector in the safe region, at the knots of a plan and between.

Between two knots n·𝔭 is a parabola but for its third derivative, and bounds at the knots on n·𝔭 and
on n·𝔭 + ½h n·𝔭̇ hold in between, without loss where the motion just stops: see
control/plan/theory.md#depth-between-two-knots. The remainder is at most (2/81) h³ sup|d³(n·𝔭)/dt³|;
the depth is tightened by that (`tube.contact.tip_motion`).
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from uvms_drake.control.limits.limit import Limit
from uvms_drake.control.plan.plan import between_knots
from uvms_drake.control.plan.points import About, Points, Slopes


@dataclass
class SafeDepth(Limit):
    """Depths N·𝔭 ≤ depth of the facets N."""

    name = "safe_depth"
    soft: ClassVar[bool] = False
    overshoots: ClassVar[bool] = False

    facets: np.ndarray
    """Facets N (m, 3) in Σ_I, all of them into the surface."""
    depth: np.ndarray
    """Largest N·𝔭 (m,) [m], tightened by the tube."""

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
    """Depths N·𝔭 + ½h N·𝔭̇ ≤ depth of the facets N."""

    name = "safe_depth_between_knots"
    overshoots: ClassVar[bool] = False
    about: ClassVar[About] = "speed"

    facets: np.ndarray
    """Facets N (m, 3), see `SafeDepth`."""
    depth: np.ndarray
    """Largest depths (m,) [m], see `SafeDepth`."""
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
        """Returns the derivatives of 𝔭 and of 𝔭̇ = J_𝔭(𝔮)ζ."""
        rows = 0.5 * self.time_step * self.facets
        by_y = rows @ at.tip_velocity_y
        by_y[..., :3] += self.facets
        return Slopes(by_y, rows @ at.tip_jacobian)

    def unit_of(self, signal: str) -> str:
        """Returns m."""
        return "m"
