"""Limit on the position of the end-effector: a box in Σ_I."""

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from uvms_drake.common.errors import vector
from uvms_drake.control.limits.limit import Limit
from uvms_drake.control.limits.radii import TubeRadii
from uvms_drake.control.plan.points import Points, Slopes


@dataclass
class TipBox(Limit):
    """lower ≤ 𝔭 ≤ upper: a corridor for the end-effector, linear in y."""

    name = "tip"
    soft: ClassVar[bool] = False

    lower_corner: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """Smallest 𝔭 (3,) [m]."""
    upper_corner: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """Largest 𝔭 (3,) [m]."""

    def check(self) -> None:
        """Raises `InvalidParameter` unless the corners are points in order."""
        for key in ("lower_corner", "upper_corner"):
            vector(key, getattr(self, key), 3)
        super().check()

    def values(self, at: Points) -> np.ndarray:
        """Returns 𝔭."""
        return at.y[..., :3]

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Returns the corners."""
        return np.asarray(self.lower_corner), np.asarray(self.upper_corner)

    def slopes(self, at: Points) -> Slopes:
        """Returns rows of the identity."""
        return Slopes(np.eye(at.model.size)[:3])

    def tube_takes(self, tube: TubeRadii) -> np.ndarray:
        """Returns the radius of the position, which bounds that of each coordinate."""
        return np.full(3, tube.position)

    def closed_form(self, size: int) -> list[Slopes]:
        """Returns rows of the identity."""
        return [Slopes(row[None]) for row in np.eye(size)[:3]]

    @property
    def labels(self) -> list[str]:
        """Labels tip_x, tip_y, tip_z."""
        return [f"tip_{axis}" for axis in "xyz"]

    @property
    def bars(self) -> list[str]:
        """Coordinates and their limits."""
        return [f"tip {axis}  {lower:.2g} … {upper:.2g} m"
                for axis, lower, upper in zip("xyz", self.lower, self.upper, strict=True)]
