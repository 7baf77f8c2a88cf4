"""Interface of a shape: depth of a point, and its gradient.

Axes of the shape at its point: e₁ and e₂ along the surface, e₃ into it; x = (x₁, x₂, x₃) is a
point in them. Lengths (s₁, s₂) along the undeformed surface and the depth δ are coordinates too:
`local_point` takes them to x, and `local_depth` and `local_lengths` back.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace
from typing import Annotated, ClassVar, NamedTuple, Self

import numpy as np

from uvms_drake.common.constraints import UnitVector, Vector
from uvms_drake.common.errors import require
from uvms_drake.model.frames.spatial import cross


class Spread(NamedTuple):
    """Bounds of the inward direction ∇δ within a ball."""

    angle: float
    """Largest angle of ∇δ from a direction [rad]."""
    stretch: float = 1.0
    """Largest ‖∇δ‖; it is at least 1 everywhere."""
    bend: float = 0.0
    """Largest ‖∇‖∇δ‖‖ [1/m]."""


@dataclass
class Geometry(ABC):
    """A smooth shape in Σ_I, by the depth δ of points in it; the dataclass of its YAML settings.

    δ and ∇δ are functions of complex numbers too.
    """

    point: Annotated[np.ndarray, Vector(3)] = field(default_factory=lambda: np.zeros(3))
    """A point of the undeformed surface in Σ_I [m]."""
    normal: Annotated[np.ndarray, UnitVector] = field(
        default_factory=lambda: np.array([-1.0, 0.0, 0.0]))
    """Unit normal in Σ_I at `point`, from the surface into the water."""

    flat: ClassVar[bool] = False
    """Whether `normal` is the normal everywhere."""
    is_distance: ClassVar[bool] = True
    """Whether δ is a distance, ‖∇δ‖ = 1."""

    @property
    @abstractmethod
    def tangent(self) -> np.ndarray:
        """Unit vector e₁ (3,) along the surface at `point`, in Σ_I."""

    @property
    def lengths(self) -> tuple[float, float]:
        """Largest range of s₁ and of s₂ in which no point comes twice [m]."""
        return np.inf, np.inf

    @abstractmethod
    def local_depth(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns δ (...) [m] and its gradient by x (..., 3) at x (..., 3)."""

    @abstractmethod
    def local_lengths(self, x: np.ndarray) -> np.ndarray:
        """Returns (s₁, s₂) (..., 2) [m] at x (..., 3)."""

    @abstractmethod
    def local_point(self, lengths: np.ndarray, depth: np.ndarray) -> np.ndarray:
        """Returns x (..., 3) at (s₁, s₂) (..., 2) and δ (...) [m]."""

    @abstractmethod
    def spread(self, direction: np.ndarray, center: np.ndarray, reach: float) -> Spread:
        """Returns the bounds of ∇δ about a unit vector (3,) within `reach` [m] of a point (3,)."""

    @property
    def axes(self) -> np.ndarray:
        """e₁, e₂ and e₃, the rows of a matrix (3, 3), in Σ_I."""
        into, along = -self.normal, self.tangent
        return np.array([along, cross(into, along), into])

    def local(self, position: np.ndarray) -> np.ndarray:
        """Returns x (..., 3) of points of Σ_I (..., 3)."""
        return (position - self.point) @ self.axes.T

    def depth_and_gradient(self, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns δ (...) [m], negative outside, and ∇δ (..., 3) at points of Σ_I (..., 3)."""
        axes = self.axes
        depth, gradient = self.local_depth((position - self.point) @ axes.T)
        return depth, gradient @ axes

    def depth(self, position: np.ndarray) -> np.ndarray:
        """Returns δ (...) [m] at points of Σ_I (..., 3)."""
        return self.local_depth(self.local(position))[0]

    def point_at(self, lengths: np.ndarray, depth: np.ndarray | float) -> np.ndarray:
        """Returns the points (..., 3) of Σ_I at (s₁, s₂) (..., 2) and δ (...) [m]."""
        x = self.local_point(lengths, np.broadcast_to(depth, lengths.shape[:-1]))
        return self.point + x @ self.axes

    def patch(self, center: np.ndarray, size: float, count: int) -> np.ndarray:
        """Returns points (count, count, 3) of the undeformed surface; see `Surface.patch`."""
        middle = self.local_lengths(self.local(center))
        sides = [at + np.linspace(-0.5, 0.5, count) * min(size, length)
                 for at, length in zip(middle, self.lengths, strict=True)]
        return self.point_at(np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1), 0.0)

    def moved(self, R: np.ndarray, shift: np.ndarray) -> Self:
        """Returns the shape, every point 𝔭 of it moved to R𝔭 + `shift` (3,)."""
        return replace(self, point=R @ self.point + shift, normal=R @ self.normal)


@dataclass
class DirectedGeometry(Geometry, ABC):
    """A shape that is turned about its normal by a direction along it."""

    axis: Annotated[np.ndarray, UnitVector] = field(
        default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    """Unit vector e₁ in Σ_I along the surface at `point`; a cylinder's axis is parallel to it."""

    @property
    def tangent(self) -> np.ndarray:
        """`axis`."""
        return self.axis

    def check(self) -> None:
        """Raises `InvalidParameter` for an axis that is not along the surface."""
        require(bool(abs(np.dot(self.axis, self.normal)) < 1e-6), "axis", self.axis,
                "perpendicular to the normal")

    def moved(self, R: np.ndarray, shift: np.ndarray) -> Self:
        """Returns the shape, every point 𝔭 of it moved to R𝔭 + `shift` (3,)."""
        return replace(super().moved(R, shift), axis=R @ self.axis)


def angle_between(a: np.ndarray, b: np.ndarray) -> float:
    """Returns the angle of two vectors (m,), accurate for small ones too [rad]."""
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    return float(2.0 * np.arctan2(np.linalg.norm(a - b), np.linalg.norm(a + b)))
