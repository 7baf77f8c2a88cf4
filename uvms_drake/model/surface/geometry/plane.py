"""A flat wall of any orientation."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from uvms_drake.model.frames.spatial import cross
from uvms_drake.model.surface.geometry.geometry import Geometry, Spread, angle_between


@dataclass
class Plane(Geometry):
    """δ = x₃."""

    flat: ClassVar[bool] = True

    @property
    def tangent(self) -> np.ndarray:
        """A unit vector (3,) along the plane, normal to an axis of Σ_I."""
        along = cross(self.normal, np.eye(3)[np.argmin(np.abs(self.normal))])
        return along / np.linalg.norm(along)

    def depth(self, position: np.ndarray) -> np.ndarray:
        """Returns δ (...) [m] at points of Σ_I (..., 3)."""
        depth: np.ndarray = (self.point - position) @ self.normal
        return depth

    def depth_and_gradient(self, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns δ (...) [m] and ∇δ (..., 3), which is −`normal`, at points of Σ_I (..., 3)."""
        return self.depth(position), np.zeros(position.shape) - self.normal

    def local_depth(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns δ (...) and e₃ (..., 3)."""
        return x[..., 2], np.broadcast_to([0.0, 0.0, 1.0], x.shape)

    def local_lengths(self, x: np.ndarray) -> np.ndarray:
        """Returns (x₁, x₂) (..., 2)."""
        return x[..., :2]

    def local_point(self, lengths: np.ndarray, depth: np.ndarray) -> np.ndarray:
        """Returns (s₁, s₂, δ) (..., 3)."""
        return np.concatenate([lengths, depth[..., None]], axis=-1)

    def spread(self, direction: np.ndarray, center: np.ndarray, reach: float) -> Spread:
        """Returns the tilt, the same everywhere."""
        return Spread(angle_between(direction, -self.normal))
