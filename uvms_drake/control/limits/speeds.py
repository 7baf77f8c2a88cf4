"""Limits on the speeds of the vehicle and of the joints: norms of blocks of ζ."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from uvms_drake.control.limits.limit import AbsoluteLimit, Cone
from uvms_drake.control.limits.radii import TubeRadii
from uvms_drake.control.plan.points import About, Points, Slopes

BLOCKS = {"nu1": (slice(0, 3), "vehicle speed", "m/s"),
          "nu2": (slice(3, 6), "vehicle turn rate", "rad/s"),
          "qdot": (slice(6, None), "joint speed", "rad/s")}
"""Block of ζ of each speed, the name of its bar, and its unit."""


@dataclass
class Speed(AbsoluteLimit):
    """‖block of ζ‖₂ ≤ bound. As a convex function of ζ it keeps its bound between knots too."""

    about: ClassVar[About] = "speed"
    overshoots: ClassVar[bool] = False

    name: str
    """Name of the speed: `nu1`, `nu2` or `qdot`."""
    bound: float
    """Largest norm, of ν₁ or prismatic joints [m/s], else [rad/s]."""
    slides: Sequence[bool] | np.ndarray = ()
    """Whether a joint is prismatic (n,); none is, if left out."""

    def values(self, at: Points) -> np.ndarray:
        """Returns the norm."""
        return np.linalg.norm(at.zeta[..., BLOCKS[self.name][0]], axis=-1)[..., None]

    def tube_takes(self, tube: TubeRadii) -> np.ndarray:
        """Returns the radius of the block."""
        return np.array([getattr(tube, self.name)])

    def closed_form(self, size: int) -> list[Slopes]:
        """Returns the block of ζ."""
        return [Slopes(zeta=np.eye(size)[BLOCKS[self.name][0]])]

    def cone(self, at: Points) -> Cone:
        """Returns the norm as a cone."""
        block = BLOCKS[self.name][0]
        return Cone(at.zeta[..., block], self.closed_form(at.model.size)[0], self.upper[0])

    def unit_of(self, signal: str) -> str:
        """Returns the unit of the block."""
        if self.name == "qdot" and any(self.slides):
            return "m/s" if all(self.slides) else "rad/s, m/s"
        return BLOCKS[self.name][2]

    @property
    def bars(self) -> list[str]:
        """Speed and its limit."""
        return [f"{BLOCKS[self.name][1]}  ≤ {self.upper[0]:.3g} {self.unit_of(self.name)}"]
