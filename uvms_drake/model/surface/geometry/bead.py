"""A plate with a weld on it: a ridge along a line, with smooth flanks."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from uvms_drake.common.errors import require
from uvms_drake.model.surface.geometry.bumpy import STEEPEST
from uvms_drake.model.surface.geometry.geometry import DirectedGeometry, Spread, angle_between


@dataclass
class Bead(DirectedGeometry):
    """δ = x₃ + h(x₂), h(s) = H cos⁴(πs/W) for |s| < W/2, and 0 elsewhere.

    The weld runs along e₁, `axis`, through `point`. δ is measured along the plate's normal, and
    ∇δ = e₃ + h′e₂ is longer than 1 by the slope; h has three continuous derivatives.
    """

    height: float = 0.003
    """Height H above the plate [m]."""
    width: float = 0.03
    """Width W [m]; 0.36 W at half height."""

    is_distance: ClassVar[bool] = False

    @property
    def slope(self) -> float:
        """Largest |h′|, where tan² = 1/3: (3√3/4) πH/W."""
        return 0.75 * np.sqrt(3.0) * np.pi * self.height / self.width

    @property
    def curvature(self) -> float:
        """Largest |h″|, at the crest: 4 (π/W)² H [1/m]."""
        return 4.0 * (np.pi / self.width) ** 2 * self.height

    def checked(self) -> "Bead":
        """Returns the shape with arrays, or raises."""
        for key in ("height", "width"):
            value = getattr(self, key)
            require(bool(0.0 < value < np.inf), key, value, "positive")
        require(self.slope <= STEEPEST, "height", self.height,
                f"at most {STEEPEST * self.height / self.slope:.3g} m, a slope of {STEEPEST:g}")
        return super().checked()

    def profile(self, lateral: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns h (...) [m] and h′ (...) at distances s (...) [m] from the weld's middle."""
        angle = np.where(np.abs(lateral.real) < 0.5 * self.width, np.pi * lateral / self.width,
                         0.5 * np.pi)
        cos = np.where(np.abs(lateral.real) < 0.5 * self.width, np.cos(angle), 0.0)
        return (self.height * cos**4,
                -4.0 * np.pi / self.width * self.height * cos**3 * np.sin(angle))

    def local_depth(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns δ (...) and (0, h′, 1) (..., 3)."""
        height, slope = self.profile(x[..., 1])
        return x[..., 2] + height, np.stack(
            [np.zeros_like(slope), slope, np.ones_like(slope)], axis=-1)

    def local_lengths(self, x: np.ndarray) -> np.ndarray:
        """Returns (x₁, x₂) (..., 2)."""
        return x[..., :2]

    def local_point(self, lengths: np.ndarray, depth: np.ndarray) -> np.ndarray:
        """Returns (s₁, s₂, δ − h) (..., 3)."""
        return np.concatenate(
            [lengths, (depth - self.profile(lengths[..., 1])[0])[..., None]], axis=-1)

    def spread(self, direction: np.ndarray, center: np.ndarray, reach: float) -> Spread:
        """Returns bounds that hold everywhere; ∇‖∇δ‖ = h″h′/‖∇δ‖ across the weld."""
        stretch = float(np.hypot(1.0, self.slope))
        return Spread(angle_between(direction, -self.normal) + float(np.arctan(self.slope)),
                      stretch, self.curvature * self.slope / stretch)
