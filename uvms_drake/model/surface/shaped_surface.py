"""A surface composed of a shape, a static force by the depth, damping and friction."""

from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np

from uvms_drake.common.constraints import Between, Positive
from uvms_drake.common.errors import InvalidParameter, require
from uvms_drake.model.frames.euler import COMPLEX_STEP
from uvms_drake.model.surface.contact_laws import (
    STEEPEST,
    AnyNormalLaw,
    Linear,
    coulomb,
    dissipation_factor,
)
from uvms_drake.model.surface.geometry import Geometry, Plane
from uvms_drake.model.surface.law import Surface
from uvms_drake.model.surface.plane import OUTSIDE, Dissipation
from uvms_drake.model.surface.surface_class import SurfaceClass

NEARBY = 0.1
"""Distance along the surface within which contacts are sampled, and poses looked for [m]."""
STEPS, ACCURACY, FREE = 30, 1e-9, 1e-6
"""Newton's method for a pose: largest number of steps, largest relative error of the force, and
smallest relative stiffness."""


@dataclass
class ShapedSurface(Surface):
    """𝔉 = φ(δ) ψ(cδ̇) (∇δ + ‖∇δ‖ μ ρ(‖v‖/v_s) v/‖v‖) at depth δ, and no torque.

    φ is the law's and ψ `dissipation_factor`; the friction is that of `coulomb`, with v the
    velocity along the surface. φ∇δ is a gradient, ψ − 1 has the sign of δ̇, and the friction that of
    v: no closed path yields energy. φ and ψ are not negative: the surface never pulls.
    """

    geometry: Geometry = field(default_factory=Plane)
    """Shape of the undeformed surface, with its depth δ."""
    law: AnyNormalLaw = field(default_factory=Linear)
    """Static force φ by the depth."""
    dissipation: Dissipation = 2.5
    """Dissipation c (Hunt and Crossley, 1975) [s/m]: damping of about c F [N s/m] at force F."""
    friction: Annotated[float, Between(0, 2)] = 0.2
    """Coefficient of friction μ; materials under water have less than 1."""
    creep: Annotated[float, Positive] = 0.01
    """Creep velocity v_s of a sticking tip [m/s]."""

    @property
    def normal(self) -> np.ndarray | None:  # type: ignore[override]  # Of its shape, no setting.
        """Unit normal into the water (3,) of a flat shape."""
        return self.geometry.normal if self.geometry.flat else None

    @property
    def anchor(self) -> np.ndarray:
        """The shape's point."""
        return self.geometry.point

    def force(self, chi: np.ndarray, chi_dot: np.ndarray) -> np.ndarray:
        """Returns 𝔉 (..., 6)."""
        depth, gradient = self.geometry.depth_and_gradient(chi[..., :3])
        if (depth.real <= 0.0).all():  # No contact.
            return np.zeros(np.broadcast_shapes(chi.shape, chi_dot.shape))
        velocity = chi_dot[..., :3]
        rate = np.add.reduce(gradient * velocity, axis=-1)
        square = np.add.reduce(gradient * gradient, axis=-1, keepdims=True)
        along = velocity - rate[..., None] / square * gradient
        load = self.law.force(depth) * dissipation_factor(self.dissipation * rate)
        direction = gradient + np.sqrt(square) * coulomb(along, self.friction, self.creep)
        return np.concatenate([load[..., None] * direction, np.zeros_like(direction)], axis=-1)

    def is_clear(self, position: np.ndarray) -> bool:
        """Returns whether δ ≤ 0; not known of a subclass with a force of its own."""
        own = type(self).force is ShapedSurface.force
        return own and bool(self.geometry.depth(position) <= 0.0)

    def penetration(self, chi: np.ndarray) -> np.ndarray:
        """Returns max(δ, 0)."""
        return np.maximum(self.geometry.depth(chi[..., :3]), 0.0)

    def pose_for(self, force: np.ndarray, pose: np.ndarray | None) -> np.ndarray:
        """Returns `pose`, moved to the position of 𝔉_des at rest, by Newton's method.

        Of several such positions, as along a plane, it is about the nearest. 𝔉_des must be along an
        inward normal of the surface within `NEARBY` of `pose`.
        """
        if pose is None:
            raise InvalidParameter("pose", pose, "given: the force leaves the attitude free")
        size, least = float(np.linalg.norm(force[:3])), self.law.smallest
        require(bool(size >= least and np.allclose(force[3:], 0.0, atol=1e-9)), "force", force,
                f"a push of at least {least:g} N without a torque")
        near = self.geometry.local_lengths(self.geometry.local(pose[:3]))
        start = self.geometry.point_at(near, self.law.depth_for(size))
        position = start
        for _ in range(STEPS):
            there, stiffness = self._static(position)
            if np.linalg.norm(position - start) > NEARBY:
                break
            if np.linalg.norm(force[:3] - there) <= ACCURACY * size:
                return np.concatenate([position, pose[3:]])
            position = position + np.linalg.pinv(stiffness, FREE) @ (force[:3] - there)
        _, into = self.geometry.depth_and_gradient(start)
        normal = np.round(into / np.linalg.norm(into), 4) + 0.0  # No −0.
        raise InvalidParameter("force", force, "along a normal of the surface near the pose, which "
                               f"is {normal.tolist()} there")

    def _static(self, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns the force at rest (3,) [N], and its derivative by the position (3, 3) [N/m]."""
        chi = np.zeros((3, 6), dtype=complex)
        chi[:, :3] = position + 1j * COMPLEX_STEP * np.eye(3)
        force = self.force(chi, np.zeros_like(chi))[:, :3]
        return force[0].real, force.imag.T / COMPLEX_STEP

    def penetration_for(self, force: float) -> float | None:
        """Returns the law's depth at a force [N] where ‖∇δ‖ = 1."""
        return self.law.depth_for(force) if self.geometry.is_distance else None

    def slip_damping(self, force: float) -> float:
        """Returns that at half of v_s."""
        return STEEPEST * self.friction * force / self.creep

    def force_jacobian(self) -> np.ndarray:
        """Raises: it depends on a reach; see `membership`."""
        raise self._lacks("force_jacobian")

    def sample_contact(self, chi: np.ndarray, force_max: float, rng: np.random.Generator
                       ) -> np.ndarray:
        """Returns positions (m, 3) below and above the surface near its point."""
        lengths, deepest = self.geometry.lengths, self.law.depth_for(force_max)
        half = [min(NEARBY, 0.5 * length) for length in lengths]
        return self.geometry.point_at(rng.uniform(np.negative(half), half, (len(chi), 2)),
                                      rng.uniform(-OUTSIDE, deepest, len(chi)))

    def stiffened(self, factor: float) -> "ShapedSurface":
        """Returns the surface with `factor` times φ."""
        return replace(self, law=self.law.stiffened(factor))

    def moved(self, R: np.ndarray, shift: np.ndarray) -> "ShapedSurface":
        """Returns the surface with its shape moved."""
        return replace(self, geometry=self.geometry.moved(R, shift))

    def patch(self, center: np.ndarray, size: float, count: int) -> np.ndarray:
        """Returns points of the shape."""
        return self.geometry.patch(center, size, count)

    def membership(self, direction: np.ndarray, center: np.ndarray, reach: float) -> SurfaceClass:
        """Returns the class of the surface about a unit vector (3,) into it.

        It holds within `reach` [m] of a point (3,). Its bounds are (3) of
        `model/surface/theory.md#class-of-a-shaped-surface`.

        Raises:
            InvalidParameter: The normal turns away from `direction` by π/2 or more.
        """
        law, spread = self.law, self.geometry.spread(direction, center, reach)
        deepest = self.geometry.depth(center) + spread.stretch * reach
        force, (least, most) = float(law.force(deepest)), law.slopes
        turn = spread.bend * max(float(deepest), 0.0) * law.stiffness / least
        angle = spread.angle + float(np.arcsin(min(turn, 1.0)))
        require(angle < 0.5 * np.pi, "reach", reach,
                "so short that the surface's normal stays within 90° of the direction")
        return SurfaceClass(
            direction=direction,
            stiffness=most * spread.stretch**2 + force * spread.bend,
            least_stiffness=max(least - force * spread.bend, 0.0) * float(np.cos(angle)),
            angle=angle, dissipation=self.dissipation * spread.stretch, friction=self.friction)
