"""Input limits that hold for every contact force of a class.

A law that adds the measured force commands 𝔲 = ζ̇ − f₀(𝔮, ζ) + M⁻¹J_𝔭ᵀ𝔣, f₀ being the drift without
contact and 𝔣 the force of the tip on the surface: τ = M𝔲 is affine in 𝔣, too. The forces are a cone

    𝔣 = N n + 𝔱,  𝔱 ⟂ n,  0 ≤ N ≤ largest,  ‖𝔱‖ ≤ N tan(spread),

the convex hull of its apex 0 and of the disc at N = largest. So the extremes of a value v + G𝔣 over
the cone are at v and at v + largest (G n ± tan(spread) ‖G_t‖), G_t being G across n: exactly.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from uvms_drake.common.errors import require
from uvms_drake.control.limits.inputs import InputLimit
from uvms_drake.control.limits.limit import Limit
from uvms_drake.control.plan.points import About, Points, Slopes
from uvms_drake.model.surface.surface_class import SurfaceClass


@dataclass(frozen=True)
class ForceCone:
    """Cone of the possible contact forces 𝔣 = N n + 𝔱."""

    direction: np.ndarray
    """Unit vector n (3,) in Σ_I, into the surface."""
    largest: float
    """Largest N [N]."""
    spread: float = 0.0
    """Largest angle between 𝔣 and n [rad], below π/2."""

    @staticmethod
    def of_surface(surface: SurfaceClass, force: float) -> "ForceCone":
        """Returns the smallest cone for all surfaces of a class that are pressed with F ≤ `force`.

        Their forces are F n′ + 𝔱′, ‖𝔱′‖ ≤ μF across n′, and n′ is at most θ from n. With ψ = atan μ
        that is at most F√(1 + μ²) long and at most ψ from n′, so at most θ + ψ from n; and its
        largest component along n is F√(1 + μ²) cos(ψ − θ) while θ ≤ ψ, else the whole length.

        Args:
            surface: The class, with n, θ and μ.
            force: Largest normal force, in motion too [N].
        """
        psi = np.arctan(surface.friction)
        require(surface.angle + psi < 0.5 * np.pi, "angle", surface.angle,
                f"below π/2 − atan(friction), {0.5 * np.pi - psi:.3g}")
        return ForceCone(surface.direction, force * surface.largest_share,
                         float(surface.angle + psi))


@dataclass
class UnderContact(Limit):
    """A limit on the input that holds for every force of a `ForceCone`.

    Its values are those of the limit at N = 0, then the largest and the smallest ones at the other
    end. The change of G𝔣 within the tube is in the radii of the input, `contact_input_remainder`.
    """

    about: ClassVar[About] = "input"

    limit: InputLimit
    """Limit on the input."""
    forces: ForceCone
    """Possible contact forces."""

    @property
    def name(self) -> str:  # type: ignore[override]
        """Name of the limit."""
        return self.limit.name

    def values(self, at: Points) -> np.ndarray:
        """Returns the 3m values."""
        points, index = at.whole or (at, ...)  # The forces' part depends on the pose alone.
        along, across = self._parts(self.limit.by_force(points))
        size = np.sqrt(np.sum(across**2, axis=-1))
        free = self.limit.values(at)
        return np.concatenate(
            [free, free + (along + size)[index], free + (along - size)[index]], axis=-1)

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Returns the limit's bounds thrice.

        Either bound may be applied to both extremes: the largest value is above the lower bound
        where the smallest one is, and vice versa.
        """
        return np.tile(self.limit.lower, 3), np.tile(self.limit.upper, 3)

    def slopes(self, at: Points) -> Slopes:
        """Returns the limit's slopes and, by y, those of the forces' part, in closed form."""
        points, index = at.whole or (at, ...)  # The forces' part depends on the pose alone.
        _, across = self._parts(self.limit.by_force(points))
        size = np.sqrt(np.sum(across**2, axis=-1, keepdims=True))
        unit = across / np.maximum(size, np.finfo(float).tiny)
        # The extremes change as G does times the 𝔣 where they are, n ± tan(spread) unit vectors.
        turned = np.tan(self.forces.spread) * unit
        extremes = self.forces.largest * np.stack(
            [self.forces.direction + turned, self.forces.direction - turned], axis=-2)
        by_config = np.moveaxis(extremes @ self.limit.by_force_rates(points), -2, -3)
        most, least = np.moveaxis(by_config @ points.config_y[..., None, :, :], -3, 0)
        by_y, _, by_u = self.limit.slopes(at)
        free = np.zeros_like(most[index]) if by_y is None else by_y
        assert by_u is not None
        return Slopes(np.concatenate([free, free + most[index], free + least[index]], axis=-2),
                      u=np.concatenate([by_u] * 3, axis=-2))

    def _parts(self, G: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns N G n (..., m) and N tan(spread) G_t (..., m, 3) at the largest N."""
        n = self.forces.direction
        along = G @ n
        return (self.forces.largest * along,
                self.forces.largest * np.tan(self.forces.spread) * (G - along[..., None] * n))

    @property
    def labels(self) -> list[str]:
        """Values of the limit: free, then most and least when pressed."""
        return [f"{label}{end}" for end in ("", ", largest in contact", ", smallest in contact")
                for label in self.limit.labels]
