"""Walls with a relief: flat, with growth or dents, or with a weld on them."""

from abc import abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, ClassVar, NamedTuple

import numpy as np

from uvms_drake.common.constraints import Between, NotNegative, Positive
from uvms_drake.common.errors import require
from uvms_drake.model.surface.geometry import geometry
from uvms_drake.model.surface.surface_class import wall_axes

WAVES = 12
"""Number of cosines of a height."""
LONGEST = 4.0
"""Longest wavelength over the shortest."""
STEEPEST = 1.0
"""Largest slope that is accepted."""


@dataclass
class Plane(geometry.Geometry):
    """δ = x₃."""

    flat: ClassVar[bool] = True

    @property
    def tangent(self) -> np.ndarray:
        """A unit vector (3,) along the plane: down a wall, north on a floor, see `wall_axes`."""
        return wall_axes(-np.asarray(self.normal))[1]

    def depth(self, position: np.ndarray) -> np.ndarray:
        """Returns δ (...) [m] at points of Σ_I (..., 3)."""
        return (self.point - position) @ self.normal

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

    def spread(self, direction: np.ndarray, center: np.ndarray, reach: float) -> geometry.Spread:
        """Returns the tilt, the same everywhere."""
        return geometry.Spread(geometry.angle_between(direction, -self.normal))


@dataclass
class Relief(geometry.DirectedGeometry):
    """δ = x₃ + h(x₁, x₂), measured along the plane's normal.

    ∇δ = e₃ + ∇h is longer than 1 by the slope.
    """

    is_distance: ClassVar[bool] = False

    @property
    @abstractmethod
    def slope(self) -> float:
        """Bound of ‖∇h‖."""

    @property
    @abstractmethod
    def curvature(self) -> float:
        """Bound of the second derivatives of h [1/m]."""

    @abstractmethod
    def relief(self, lengths: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns h (...) [m] and ∇h (..., 2) at (s₁, s₂) (..., 2)."""

    def check(self) -> None:
        """Raises `InvalidParameter` for a relief that is too steep."""
        super().check()
        require(self.slope <= STEEPEST, "slope", self.slope, f"at most {STEEPEST:g}")

    def local_depth(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns δ (...) and (∇h, 1) (..., 3)."""
        height, slope = self.relief(x[..., :2])
        return x[..., 2] + height, np.concatenate([slope, np.ones_like(height)[..., None]], axis=-1)

    def local_lengths(self, x: np.ndarray) -> np.ndarray:
        """Returns (x₁, x₂) (..., 2)."""
        return x[..., :2]

    def local_point(self, lengths: np.ndarray, depth: np.ndarray) -> np.ndarray:
        """Returns (s₁, s₂, δ − h) (..., 3)."""
        return np.concatenate([lengths, (depth - self.relief(lengths)[0])[..., None]], axis=-1)

    def spread(self, direction: np.ndarray, center: np.ndarray, reach: float) -> geometry.Spread:
        """Returns bounds that hold everywhere; ∇‖∇δ‖ = H∇h/‖∇δ‖ with the second derivatives H."""
        stretch = float(np.hypot(1.0, self.slope))
        angle = geometry.angle_between(direction, -self.normal) + float(np.arctan(self.slope))
        return geometry.Spread(angle, stretch, self.curvature * self.slope / stretch)


class Waves(NamedTuple):
    """The cosines of a height, h(s) = Σᵢ aᵢ cos(kᵢ·s + ϑᵢ)."""

    amplitude: np.ndarray
    """aᵢ (m,) [m]."""
    wavenumber: np.ndarray
    """kᵢ (m, 2) [rad/m]."""
    phase: np.ndarray
    """ϑᵢ (m,) [rad]."""


@dataclass
class Bumpy(Relief):
    """A finite sum h of cosines drawn from a seed; |h| is at most `amplitude`."""

    amplitude: Annotated[float, Positive] = 0.01
    """Largest height above or below the plane [m]."""
    wavelength: Annotated[float, Between(0.001, 1000, " m")] = 0.2
    """Shortest wavelength [m]; the longest is four times that. A tip does not fit in one below a
    millimetre."""
    seed: Annotated[int, NotNegative] = 0
    """Seed of the wavelengths, directions and phases."""

    @cached_property
    def waves(self) -> Waves:
        """The cosines: wavelengths log-uniform, amplitudes proportional to them."""
        rng = np.random.default_rng(self.seed)
        wavelength = self.wavelength * LONGEST ** rng.uniform(size=WAVES)
        angle, phase = rng.uniform(0.0, 2.0 * np.pi, (2, WAVES))
        wavenumber = 2.0 * np.pi / wavelength
        return Waves(self.amplitude * wavelength / np.sum(wavelength),
                     wavenumber[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1), phase)

    @property
    def slope(self) -> float:
        """Bound of ‖∇h‖, Σᵢ aᵢ‖kᵢ‖: 2π times `amplitude` over the mean wavelength."""
        return float(self.waves.amplitude @ np.linalg.norm(self.waves.wavenumber, axis=1))

    @property
    def curvature(self) -> float:
        """Bound of the second derivatives of h, Σᵢ aᵢ‖kᵢ‖² [1/m]."""
        return float(self.waves.amplitude @ np.sum(self.waves.wavenumber**2, axis=1))

    def relief(self, lengths: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns h (...) [m] and ∇h (..., 2) at (s₁, s₂) (..., 2)."""
        amplitude, wavenumber, phase = self.waves
        angle = lengths @ wavenumber.T + phase
        return np.cos(angle) @ amplitude, -np.sin(angle) @ (amplitude[:, None] * wavenumber)


@dataclass
class Bead(Relief):
    """A weld along e₁, `axis`, through `point`: h = H cos⁴(πs₂/W) for |s₂| < W/2, and 0 elsewhere.

    h has three continuous derivatives.
    """

    height: Annotated[float, Positive] = 0.003
    """Height H above the plate [m]."""
    width: Annotated[float, Positive] = 0.03
    """Width W [m]; 0.36 W at half height."""

    @property
    def slope(self) -> float:
        """Largest |h′|, where tan² = 1/3: (3√3/4) πH/W."""
        return 0.75 * np.sqrt(3.0) * np.pi * self.height / self.width

    @property
    def curvature(self) -> float:
        """Largest |h″|, at the crest: 4 (π/W)² H [1/m]."""
        return 4.0 * (np.pi / self.width) ** 2 * self.height

    def relief(self, lengths: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns h (...) [m] and (0, h′) (..., 2) at (s₁, s₂) (..., 2)."""
        across = lengths[..., 1]
        inside = np.abs(across.real) < 0.5 * self.width
        angle = np.where(inside, np.pi * across / self.width, 0.5 * np.pi)
        cos = np.where(inside, np.cos(angle), 0.0)
        slope = -4.0 * np.pi / self.width * self.height * cos**3 * np.sin(angle)
        return self.height * cos**4, np.stack([np.zeros_like(slope), slope], axis=-1)
