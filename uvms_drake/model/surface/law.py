"""The compliant surface: the paper's bilateral spring and a smooth unilateral plane.

χ = (𝔭, 𝔬) is the pose of the end-effector in Σ_I: position [m] and ZYX Euler angles [rad]. 𝔉 is
what the end-effector exerts *on* the environment: force in Σ_I [N] and the torque conjugate to
the Euler-angle rates [N m]; the robot feels the generalised force −J(𝔮)ᵀ𝔉.

Every law is a function of arrays of any leading shape, and of complex numbers (see `euler`).
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from uvms_drake.common.errors import InvalidParameter, require, symmetric_matrix, vector


@dataclass
class BilateralSpring:
    """The paper's surface law, 𝔉 = K(χ − χ_eq), (eq:force_F). It pulls as well as pushes."""

    stiffness: np.ndarray = field(default_factory=lambda: np.eye(6))
    """K, symmetric positive definite 6×6 [N/m, N, N m/rad]."""
    equilibrium: np.ndarray = field(default_factory=lambda: np.zeros(6))
    """χ_eq, pose of the undeformed environment [m, rad]."""


@dataclass
class UnilateralPlane:
    """A frictionless compliant plane that pushes and never pulls."""

    point: np.ndarray = field(default_factory=lambda: np.zeros(3))
    """A point of the undeformed plane in Σ_I [m]."""
    normal: np.ndarray = field(default_factory=lambda: np.array([-1.0, 0.0, 0.0]))
    """Unit normal in Σ_I, from the surface into the water."""
    stiffness: float = 1000.0
    """k [N/m]."""
    dissipation: float = 2.5
    """a, after Hunt and Crossley (1975) [s/m]: at force F the damping is about a F [N s/m]."""
    transition: float = 0.002
    """w [m]: depth over which the stiffness rises from zero to k."""


SurfaceConfig = BilateralSpring | UnilateralPlane


class SurfaceLaw(Protocol):
    """What a surface law offers to the plant and to the prediction model."""

    def force(self, chi: np.ndarray, chi_dot: np.ndarray) -> np.ndarray:
        """Returns 𝔉 (..., 6) at the pose χ (..., 6) moving with χ̇ (..., 6)."""

    def penetration(self, chi: np.ndarray) -> np.ndarray:
        """Returns how far the end-effector is inside the surface (...) [m]."""

    def pose_for(self, force: np.ndarray, pose: np.ndarray | None) -> np.ndarray:
        """Returns χ_des (6,) at rest for 𝔉_des (6,); `pose` (6,) fixes what 𝔉_des leaves free."""

    def force_jacobian(self) -> np.ndarray:
        """Returns G (m, 6) [N/m, N/rad]: at rest the force changes by at most ‖G dχ‖₂ with χ."""


def static_force(surface: SurfaceLaw, chi: np.ndarray) -> np.ndarray:
    """Returns ‖force part of 𝔉‖₂ (...) [N] at the pose χ (..., 6), not moving."""
    return np.linalg.norm(surface.force(chi, np.zeros_like(chi))[..., :3], axis=-1)


@dataclass(frozen=True)
class SpringLaw:
    """𝔉 = K(χ − χ_eq), angles by the shorter way round; see `BilateralSpring`."""

    K: np.ndarray
    chi_eq: np.ndarray

    def force(self, chi: np.ndarray, chi_dot: np.ndarray) -> np.ndarray:
        """Returns K(χ − χ_eq); χ̇ does not matter."""
        stretch = chi - self.chi_eq
        # An Euler angle that passes ±π jumps by 2π, the force must not.
        stretch[..., 3:] -= 2.0 * np.pi * np.round(stretch[..., 3:].real / (2.0 * np.pi))
        return stretch @ self.K.T

    def penetration(self, chi: np.ndarray) -> np.ndarray:
        """Returns ‖𝔭 − 𝔭_eq‖: the spring holds on to the end-effector everywhere."""
        return np.linalg.norm(chi[..., :3] - self.chi_eq[:3], axis=-1)

    def pose_for(self, force: np.ndarray, pose: np.ndarray | None) -> np.ndarray:
        """Returns χ_des = χ_eq + K⁻¹𝔉_des (Section IV-A of the paper)."""
        if pose is not None:
            raise InvalidParameter("pose", pose, "left out: K⁻¹𝔉_des fixes all six coordinates")
        return self.chi_eq + np.linalg.solve(self.K, force)

    def force_jacobian(self) -> np.ndarray:
        """Returns the rows of K that give the force (3, 6)."""
        return self.K[:3]


def plane_load(depth: np.ndarray, transition: float) -> np.ndarray:
    """Returns s(δ) [m], a twice continuously differentiable max(δ, 0).

    With x = δ/w: s = 0 for x ≤ 0, w(x³ − x⁴/2) for 0 < x < 1, δ − w/2 for x ≥ 1, so that the
    stiffness s'(δ) rises from 0 to 1 as the smooth step 3x² − 2x³.
    """
    x = depth / transition
    return np.where(x.real <= 0.0, 0.0,
                    np.where(x.real < 1.0, transition * x**3 * (1.0 - 0.5 * x),
                             depth - 0.5 * transition))


def dissipation_factor(z: np.ndarray) -> np.ndarray:
    """Returns ψ(z) = 1 + z for z ≥ 0, 1/(1 − z) for z < 0: positive, continuously differentiable.

    Hunt and Crossley's factor 1 + aδ̇ goes negative on fast withdrawal (the surface would pull)
    and clipping it at zero, as is usual, has a kink; ψ agrees with it to first order at rest.
    """
    retreat = np.where(z.real < 0.0, z, 0.0)
    return np.where(z.real < 0.0, 1.0 / (1.0 - retreat), 1.0 + z)


@dataclass(frozen=True)
class PlaneLaw:
    """𝔉 = −n̂ k s(δ) ψ(aδ̇) at depth δ = −n̂·(𝔭 − 𝔭₀), no friction, no torque; see `UnilateralPlane`.

    s is `plane_load`, ψ is `dissipation_factor`. Both factors are non-negative, so the plane never
    pulls; ψ − 1 has the sign of δ̇, so it never feeds energy in; 𝔉 is continuously differentiable.
    """

    point: np.ndarray
    normal: np.ndarray
    stiffness: float
    dissipation: float
    transition: float

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
        pushes = bool(np.allclose(force[:3], -magnitude * self.normal, atol=1e-9)
                      and np.allclose(force[3:], 0.0, atol=1e-9))
        require(pushes and magnitude >= self.smallest, "force", force,
                f"−F·normal with F ≥ {self.smallest:g} N and no torque: a plane can only push")
        target = self.depth(pose[:3])
        depth = self.depth_for(magnitude)
        return np.concatenate([pose[:3] - (depth - target) * self.normal, pose[3:]])

    def depth_for(self, magnitude: float) -> float:
        """Returns δ [m] at which the plane carries a force [N], of at least `smallest`, at rest."""
        require(magnitude >= self.smallest, "force", magnitude,
                f"at least {self.smallest:g} N, that of the transition's end")
        return magnitude / self.stiffness + 0.5 * self.transition

    def force_jacobian(self) -> np.ndarray:
        """Returns −k n̂ᵀ and zeros (1, 6), ∂F/∂χ past the transition; before, it is less."""
        return np.concatenate([-self.stiffness * self.normal, np.zeros(3)])[None]


def make_surface_law(config: SurfaceConfig) -> SurfaceLaw:
    """Checks a surface's parameters and returns its law."""
    return _MAKERS[type(config)](config)


def _make_spring(config: BilateralSpring) -> SpringLaw:
    return SpringLaw(K=symmetric_matrix("stiffness", config.stiffness, 6, definite=True),
                     chi_eq=vector("equilibrium", config.equilibrium, 6))


def _make_plane(config: UnilateralPlane) -> PlaneLaw:
    normal = vector("normal", config.normal, 3)
    require(bool(abs(np.linalg.norm(normal) - 1.0) < 1e-6), "normal", normal, "a unit vector")
    for key in ("stiffness", "transition"):
        value = getattr(config, key)
        require(bool(0.0 < value < np.inf), key, value, "positive")
    require(bool(0.0 <= config.dissipation < np.inf), "dissipation", config.dissipation,
            "zero or positive")
    return PlaneLaw(vector("point", config.point, 3), normal, float(config.stiffness),
                    float(config.dissipation), float(config.transition))


_MAKERS: dict[type, Callable[..., SurfaceLaw]] = {
    BilateralSpring: _make_spring, UnilateralPlane: _make_plane}
