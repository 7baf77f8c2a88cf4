"""The paper's surface: a spring in all six coordinates of the end-effector's pose."""

from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np

from uvms_drake.common.constraints import Vector
from uvms_drake.common.errors import InvalidParameter, symmetric_matrix
from uvms_drake.model.frames import euler
from uvms_drake.model.frames.spatial import block_diagonal, in_ball
from uvms_drake.model.surface.law import StaticForceRows, Surface, TipErrors


@dataclass
class BilateralSpring(Surface):
    """The paper's surface law, 𝔉 = K(χ − χ_eq), (eq:force_F). It is bilateral.

    Angles count by the shorter way round.
    """

    stiffness: np.ndarray = field(default_factory=lambda: np.eye(6))
    """Stiffness K, symmetric positive definite 6×6 [N/m, N, N m/rad]."""
    equilibrium: Annotated[np.ndarray, Vector(6)] = field(default_factory=lambda: np.zeros(6))
    """Pose χ_eq of the undeformed environment [m, rad]."""

    @property
    def anchor(self) -> np.ndarray:
        """Position 𝔭_eq (3,) [m]."""
        return self.equilibrium[:3]

    def checked(self) -> "BilateralSpring":
        """Returns the spring with arrays, K symmetric to the last digit, or raises."""
        return replace(super().checked(), stiffness=symmetric_matrix(
            "stiffness", self.stiffness, 6, definite=True))

    def force(self, chi: np.ndarray, chi_dot: np.ndarray) -> np.ndarray:
        """Returns K(χ − χ_eq); χ̇ does not matter."""
        stretch = chi - self.equilibrium
        # An Euler angle that passes ±π jumps by 2π, but the force is continuous.
        stretch[..., 3:] -= 2.0 * np.pi * np.round(stretch[..., 3:].real / (2.0 * np.pi))
        return stretch @ self.stiffness.T

    def turned(self, chi: np.ndarray) -> np.ndarray:
        """Returns the largest Euler angle to the equilibrium's, over π, where the way round jumps.

        ZYX angles are singular before their pitch gets there.
        """
        off = euler.wrap_angle(chi[..., 3:] - self.equilibrium[3:])
        return np.max(np.abs(off), axis=-1) / np.pi

    def penetration(self, chi: np.ndarray) -> np.ndarray:
        """Returns ‖𝔭 − 𝔭_eq‖: the spring is attached to the end-effector."""
        return np.linalg.norm(chi[..., :3] - self.anchor, axis=-1)

    def pose_for(self, force: np.ndarray, pose: np.ndarray | None) -> np.ndarray:
        """Returns χ_des = χ_eq + K⁻¹𝔉_des (Section IV-A of the paper)."""
        if pose is not None:
            raise InvalidParameter("pose", pose, "left out: K⁻¹𝔉_des fixes all six coordinates")
        return self.equilibrium + np.linalg.solve(self.stiffness, force)

    def force_jacobian(self) -> np.ndarray:
        """Returns the rows of K that give the force (3, 6)."""
        return self.stiffness[:3]

    def static_force_rows(self, chi: np.ndarray, bound: float) -> StaticForceRows:
        """Returns ‖force‖ ≤ `bound` over ‖K_p‖, exact."""
        scale = self.stiffness_bound
        return StaticForceRows(self.force_jacobian() / scale,
                               self.force(chi, np.zeros_like(chi))[..., :3] / scale, bound / scale,
                               one_sided=False)

    def contact_measure(self, chi: np.ndarray, force_max: float) -> np.ndarray:
        """Returns ‖force part of 𝔉‖² / force_max² (m,), since the spring is attached."""
        force = self.force(chi, np.zeros_like(chi))[:, :3]
        return np.sum(force**2, axis=1) / force_max**2

    def contact_reach(self, force_max: float) -> float:
        """Returns `force_max` over the stiffness by position [m]."""
        return force_max / float(np.linalg.norm(self.stiffness[:3, :3], ord=2))

    def sample_contact(self, chi: np.ndarray, force_max: float, rng: np.random.Generator
                       ) -> np.ndarray:
        """Returns positions (m, 3) for forces of a ball, half of them on its boundary."""
        force = in_ball(rng, len(chi), 3, force_max)
        at_rest = chi.copy()
        at_rest[:, :3] = self.anchor
        missing = force - self.force(at_rest, np.zeros_like(chi))[:, :3]
        return self.anchor + np.linalg.solve(self.stiffness[:3, :3], missing.T).T

    def force_error(self, chi: np.ndarray, wrench: np.ndarray, off: TipErrors) -> float:
        """Returns ‖K_pp‖ `off.position` + ‖K_po‖ `off.angle` [N]: there is no damping."""
        return self.force_radius(off.position, off.angle)

    def stiffened(self, factor: float) -> "BilateralSpring":
        """Returns the spring with `factor` times K."""
        return replace(self, stiffness=factor * np.asarray(self.stiffness))

    def moved(self, R: np.ndarray, shift: np.ndarray) -> "BilateralSpring":
        """Returns the spring carried along with its axes: it pulls a carried tip as before.

        With A = blkdiag(R_WE, T(𝔬)) at χ_eq, χ̇ = A V_E, that is the same AᵀKA, its stiffness in
        the axes of Σ_E; hence K' = BᵀKB with B = blkdiag(Rᵀ, T(𝔬) T(𝔬')⁻¹).
        """
        position, attitude = np.split(np.asarray(self.equilibrium, dtype=float), 2)
        turned = euler.euler_angles(R @ euler.rotation_matrix(attitude))
        B = block_diagonal(R.T, euler.rate_matrix(attitude) @ euler.inverse_rate_matrix(turned))
        K = B.T @ self.stiffness @ B
        return replace(self, stiffness=0.5 * (K + K.T),
                       equilibrium=np.concatenate([R @ position + shift, turned]))
