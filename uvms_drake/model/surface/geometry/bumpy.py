"""A wall with growth, dents or ripples on it: a plane with a smooth height."""

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, NamedTuple

import numpy as np

from uvms_drake.common.errors import require
from uvms_drake.model.surface.geometry.geometry import DirectedGeometry, Spread, angle_between

WAVES = 12
"""Number of cosines of a height."""
LONGEST = 4.0
"""Longest wavelength over the shortest."""
SHORTEST = 0.001
"""Shortest wavelength that is accepted [m]; a tip does not fit in shorter ones."""
STEEPEST = 1.0
"""Largest slope that is accepted."""


class Waves(NamedTuple):
    """The cosines of a height, h(s) = Σᵢ aᵢ cos(kᵢ·s + ϑᵢ)."""

    amplitude: np.ndarray
    """aᵢ (m,) [m]."""
    wavenumber: np.ndarray
    """kᵢ (m, 2) [rad/m]."""
    phase: np.ndarray
    """ϑᵢ (m,) [rad]."""


@dataclass
class Bumpy(DirectedGeometry):
    """δ = x₃ + h(x₁, x₂), a finite sum of cosines drawn from a seed.

    δ is measured along the plane's normal, and ∇δ = e₃ + ∇h is longer than 1 by the slope. |h| is
    at most `amplitude`, and ‖∇h‖ at most `slope`.
    """

    amplitude: float = 0.01
    """Largest height above or below the plane [m]."""
    wavelength: float = 0.2
    """Shortest wavelength [m]; the longest is four times that."""
    seed: int = 0
    """Seed of the wavelengths, directions and phases."""

    is_distance: ClassVar[bool] = False

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

    def checked(self) -> "Bumpy":
        """Returns the shape with arrays, or raises."""
        require(bool(0.0 < self.amplitude < np.inf), "amplitude", self.amplitude, "positive")
        require(bool(SHORTEST <= self.wavelength <= 1e6 * SHORTEST), "wavelength", self.wavelength,
                f"from {SHORTEST:g} to {1e6 * SHORTEST:g} m")
        require(self.seed >= 0, "seed", self.seed, "zero or positive")
        require(self.slope <= STEEPEST, "amplitude", self.amplitude,
                f"at most {STEEPEST * self.amplitude / self.slope:.3g} m, a slope of {STEEPEST:g} "
                f"with wavelengths from {self.wavelength:g} m on")
        return super().checked()

    def height(self, lengths: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns h (...) [m] and ∇h (..., 2) at (s₁, s₂) (..., 2)."""
        amplitude, wavenumber, phase = self.waves
        angle = lengths @ wavenumber.T + phase
        return np.cos(angle) @ amplitude, -np.sin(angle) @ (amplitude[:, None] * wavenumber)

    def local_depth(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns δ (...) and (∇h, 1) (..., 3)."""
        height, slope = self.height(x[..., :2])
        return x[..., 2] + height, np.concatenate([slope, np.ones_like(height)[..., None]], axis=-1)

    def local_lengths(self, x: np.ndarray) -> np.ndarray:
        """Returns (x₁, x₂) (..., 2)."""
        return x[..., :2]

    def local_point(self, lengths: np.ndarray, depth: np.ndarray) -> np.ndarray:
        """Returns (s₁, s₂, δ − h) (..., 3)."""
        return np.concatenate([lengths, (depth - self.height(lengths)[0])[..., None]], axis=-1)

    def spread(self, direction: np.ndarray, center: np.ndarray, reach: float) -> Spread:
        """Returns bounds that hold everywhere; ∇‖∇δ‖ = H∇h/‖∇δ‖ with the second derivatives H."""
        slope = self.slope
        stretch = float(np.hypot(1.0, slope))
        return Spread(angle_between(direction, -self.normal) + float(np.arctan(slope)), stretch,
                      self.curvature * slope / stretch)
