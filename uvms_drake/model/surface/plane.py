"""A frictionless compliant unilateral plane, smooth enough for derivatives."""

from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np

from uvms_drake.common.constraints import Constraint, NotNegative, Positive, UnitVector, Vector
from uvms_drake.common.errors import InvalidParameter, require
from uvms_drake.model.surface.contact_laws import dissipation_factor, plane_load
from uvms_drake.model.surface.law import StaticForceRows, Surface, TipErrors

OUTSIDE = 0.01
"""Largest distance from a plane in a certificate [m]; nothing changes farther away."""
BOUND_SHARE = 0.2
"""Probability with which a sampled depth is one of the two bounds."""
Dissipation = Annotated[float, NotNegative, Constraint(
    "at most 1000 s/m: a touch of 1 mm/s would double the force", lambda x: x <= 1000.0)]
"""Dissipation of a surface [s/m]; materials have less than 10."""


@dataclass
class UnilateralPlane(Surface):
    """𝔉 = −n̂ k s(δ) ψ(aδ̇) at depth δ = −n̂·(𝔭 − 𝔭₀), no friction, no torque.

    s is `plane_load`, ψ is `dissipation_factor`. Both factors are non-negative, so the plane never
    pulls; ψ − 1 has the sign of δ̇, so it never feeds energy in; 𝔉 is continuously differentiable.
    """

    point: Annotated[np.ndarray, Vector(3)] = field(default_factory=lambda: np.zeros(3))
    """A point of the undeformed plane in Σ_I [m]."""
    normal: Annotated[np.ndarray, UnitVector] = field(
        default_factory=lambda: np.array([-1.0, 0.0, 0.0]))
    """Unit normal in Σ_I, from the surface into the water."""
    stiffness: Annotated[float, Positive] = 1000.0
    """Stiffness k of the surface pressed in beyond `transition` [N/m]."""
    dissipation: Dissipation = 2.5
    """Dissipation a (Hunt and Crossley, 1975) [s/m]: damping of about a F [N s/m] at force F."""
    transition: Annotated[float, Positive] = 0.002
    """Depth w over which the stiffness rises from zero to k [m]."""

    @property
    def anchor(self) -> np.ndarray:
        """`point`."""
        return self.point

    @property
    def smallest(self) -> float:
        """Force at the end of the transition, k w/2 [N]."""
        return 0.5 * self.stiffness * self.transition

    def depth(self, position: np.ndarray) -> np.ndarray:
        """Returns δ (...) of the points `position` (..., 3), negative outside."""
        return -((position - self.point) @ self.normal)

    def force(self, chi: np.ndarray, chi_dot: np.ndarray) -> np.ndarray:
        """Returns 𝔉 (..., 6)."""
        load = self.stiffness * plane_load(self.depth(chi[..., :3]), self.transition)
        rate = -(chi_dot[..., :3] @ self.normal)
        magnitude = load * dissipation_factor(self.dissipation * rate)
        out = np.zeros((*magnitude.shape, 6), dtype=magnitude.dtype)
        out[..., :3] = -magnitude[..., None] * self.normal
        return out

    def is_clear(self, position: np.ndarray) -> bool:
        """Returns whether δ ≤ 0; not known of a subclass with a force of its own."""
        return type(self).force is UnilateralPlane.force and bool(self.depth(position) <= 0.0)

    def penetration(self, chi: np.ndarray) -> np.ndarray:
        """Returns max(δ, 0)."""
        return np.maximum(self.depth(chi[..., :3]), 0.0)

    def pose_for(self, force: np.ndarray, pose: np.ndarray | None) -> np.ndarray:
        """Returns `pose`, moved along the normal to the depth at which the plane carries 𝔉_des.

        𝔉_des must push: a positive multiple of −n̂ of at least k w/2 (past the transition), and no
        torque.
        """
        if pose is None:
            raise InvalidParameter("pose", pose, "given: a plane leaves five coordinates free")
        magnitude = float(-force[:3] @ self.normal)
        is_normal = bool(np.allclose(force[:3], -magnitude * self.normal, atol=1e-9)
                      and np.allclose(force[3:], 0.0, atol=1e-9))
        require(is_normal and magnitude >= self.smallest, "force", force,
                f"−F·normal with F ≥ {self.smallest:g} N and no torque: a plane can only push")
        target = self.depth(pose[:3])
        depth = self.penetration_for(magnitude)
        return np.concatenate([pose[:3] - (depth - target) * self.normal, pose[3:]])

    def penetration_for(self, force: float) -> float:
        """Returns δ [m] at which the plane carries a force [N], of at least `smallest`, at rest."""
        require(force >= self.smallest, "static_force", force,
                f"at least {self.smallest:g} N, that of the transition's end")
        return force / self.stiffness + 0.5 * self.transition

    def force_jacobian(self) -> np.ndarray:
        """Returns −k n̂ᵀ and zeros (1, 6), ∂F/∂χ past the transition; before, it is less."""
        return np.concatenate([-self.stiffness * self.normal, np.zeros(3)])[None]

    def static_force_rows(self, chi: np.ndarray, bound: float) -> StaticForceRows:
        """Returns δ ≤ that of `bound`, exact."""
        row = np.concatenate([-self.normal, np.zeros(3)])
        return StaticForceRows(row[None], self.depth(chi[..., :3])[..., None],
                               self.penetration_for(bound), one_sided=True)

    def _depths(self, force_max: float) -> tuple[float, float]:
        """Returns the range of depths of contacts, a little outside at least [m]."""
        deepest = self.penetration_for(max(force_max, self.smallest))
        return -OUTSIDE, max(deepest, OUTSIDE)

    def contact_measure(self, chi: np.ndarray, force_max: float) -> np.ndarray:
        """Returns the depth (m,), scaled so that the range of contacts is [−1, 1]."""
        least, most = self._depths(force_max)
        middle = 0.5 * (most + least)
        return (self.depth(chi[:, :3]) - middle) / (most - middle)

    def contact_reach(self, force_max: float) -> float:
        """Returns half the range of depths [m]."""
        least, most = self._depths(force_max)
        return 0.5 * (most - least)

    def sample_contact(self, chi: np.ndarray, force_max: float, rng: np.random.Generator
                       ) -> np.ndarray:
        """Returns positions (m, 3) below and above `point`; the position along it is irrelevant."""
        count, bounds = len(chi), self._depths(force_max)
        depth = rng.uniform(*bounds, size=count)
        at_bound = rng.uniform(size=count) < BOUND_SHARE
        depth = np.where(at_bound, rng.choice(bounds, count), depth)
        return self.point - depth[:, None] * self.normal

    def force_error(self, chi: np.ndarray, wrench: np.ndarray, off: TipErrors) -> float:
        """Returns the largest over the depths ± `off.depth` and the rates ± `off.depth_speed`."""
        signs = np.array([-1.0, 1.0])
        near, moving = np.tile(chi, (4, 1)), np.zeros((4, 6))
        near[:, :3] += np.repeat(off.depth * signs, 2)[:, None] * self.normal
        moving[:, :3] = np.tile(off.depth_speed * signs, 2)[:, None] * self.normal
        change = (self.force(near, moving) - self.force(chi, np.zeros(6)))[:, :3]
        return float(np.max(np.linalg.norm(change, axis=1)))

    def stiffened(self, factor: float) -> "UnilateralPlane":
        """Returns the plane with `factor` times k; dissipation and transition stay."""
        return replace(self, stiffness=factor * self.stiffness)

    def moved(self, R: np.ndarray, shift: np.ndarray) -> "UnilateralPlane":
        """Returns the plane with its point moved and its normal turned."""
        return replace(self, point=R @ self.point + shift, normal=R @ self.normal)
