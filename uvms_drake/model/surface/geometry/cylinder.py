"""A hull or a pipe, pressed from outside, or a pipe pressed from inside."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from uvms_drake.common.constraints import Positive
from uvms_drake.model.surface.geometry.geometry import DirectedGeometry, Spread, angle_between

ON_AXIS = 1e-15
"""Smallest distance from the axis [m], for ∇δ."""


@dataclass
class Cylinder(DirectedGeometry):
    """δ = R − r from outside, r − R from inside, with r the distance from the axis.

    The axis runs along e₁ through x₃ = ϱ, where ϱ = R from outside and −R from inside. (s₁, s₂) are
    the lengths along the axis and around it.
    """

    radius: Annotated[float, Positive] = 0.5
    """Radius R [m]."""
    inside: bool = False
    """Whether the water is inside."""

    @property
    def sign(self) -> float:
        """Sign of ϱ: −1 inside of a pipe."""
        return -1.0 if self.inside else 1.0

    @property
    def lengths(self) -> tuple[float, float]:
        """Any length along the axis, and once around it."""
        return np.inf, 2.0 * np.pi * self.radius

    def local_depth(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns δ = ±(R² − r²)/(R + r), where a large R cancels by hand, and its gradient."""
        across, up = x[..., 1], self.sign * self.radius - x[..., 2]
        up = np.where(np.hypot(across.real, up.real) < ON_AXIS, ON_AXIS, up)
        r = np.sqrt(across**2 + up**2)
        square = across**2 + x[..., 2] * (x[..., 2] - 2.0 * self.sign * self.radius)
        gradient = np.stack([np.zeros_like(r), -self.sign * across / r, self.sign * up / r], -1)
        return -self.sign * square / (self.radius + r), gradient

    def local_lengths(self, x: np.ndarray) -> np.ndarray:
        """Returns x₁ and R times the angle about the axis (..., 2)."""
        angle = np.arctan2(x[..., 1], self.radius - self.sign * x[..., 2])
        return np.stack([x[..., 0], self.radius * angle], axis=-1)

    def local_point(self, lengths: np.ndarray, depth: np.ndarray) -> np.ndarray:
        """Returns x (..., 3), a distance r = R ∓ δ from the axis."""
        angle, r = lengths[..., 1] / self.radius, self.radius - self.sign * depth
        rise = 2.0 * self.radius * np.sin(0.5 * angle)**2  # R (1 − cos), small where R is large.
        return np.stack([lengths[..., 0], r * np.sin(angle),
                         depth * np.cos(angle) + self.sign * rise], axis=-1)

    def spread(self, direction: np.ndarray, center: np.ndarray, reach: float) -> Spread:
        """Returns the exact angle: within the ball, ∇δ turns by asin(reach/r) about the axis."""
        x = self.local(center)
        _, inward = self.local_depth(x)
        across = (self.axes @ direction)[1:]
        r = float(np.hypot(x[1], self.sign * self.radius - x[2]))
        turn = np.arcsin(reach / r) if reach < r else np.pi
        turned = min(angle_between(across, inward[1:]) + turn, np.pi) if np.any(across) else 0.0
        return Spread(float(np.arccos(np.clip(np.linalg.norm(across) * np.cos(turned), -1.0, 1.0))))
