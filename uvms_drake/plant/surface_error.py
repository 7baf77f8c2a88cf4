"""How the simulated surface differs from the one that the controller knows."""

from dataclasses import dataclass, field, replace

import numpy as np

from uvms_drake.common.errors import require, vector
from uvms_drake.model.euler import (
    euler_angles,
    inverse_rate_matrix,
    rate_matrix,
    rotation_matrix,
)
from uvms_drake.model.spatial import block_diagonal, skew
from uvms_drake.model.surface.law import BilateralSpring, SurfaceConfig, UnilateralPlane


@dataclass
class SurfaceError:
    """The simulated surface against the controller's: stiffer, shifted and turned."""

    stiffness: float = 1.0
    """Over the controller's."""
    shift: np.ndarray = field(default_factory=lambda: np.zeros(3))
    """Of the plane's point or the spring's equilibrium in Σ_I [m]."""
    turn: np.ndarray = field(default_factory=lambda: np.zeros(3))
    """Rotation vector in Σ_I, about that point [rad]."""

    @property
    def size(self) -> float:
        """Returns the largest of relative error, ‖shift‖ and ‖turn‖; zero if there is none."""
        return max(abs(self.stiffness - 1.0), float(np.linalg.norm(self.shift)),
                   float(np.linalg.norm(self.turn)))


def check_surface_error(error: SurfaceError) -> None:
    """Raises `InvalidParameter` for the first value that is out of range."""
    require(bool(0.01 <= error.stiffness <= 100.0), "stiffness", error.stiffness,
            "between 0.01 and 100")
    vector("shift", error.shift, 3)
    turn = vector("turn", error.turn, 3)
    require(bool(np.linalg.norm(turn) <= np.pi), "turn", turn, "a rotation of at most π")


def displaced(config: SurfaceConfig, error: SurfaceError) -> SurfaceConfig:
    """Returns the simulated surface where the controller has that of `config`.

    A plane keeps its dissipation and its transition; R turns its normal. A spring is carried along
    with its axes: about its equilibrium it pulls a tip that is carried along as before. With
    A = blkdiag(R_WE, T(𝔬)) at χ_eq, χ̇ = A V_E, that is the same AᵀKA, which is its stiffness in the
    axes of Σ_E; hence K' = BᵀKB with B = blkdiag(Rᵀ, T(𝔬) T(𝔬')⁻¹).
    """
    if error.size == 0.0:
        return config
    shift, R = np.asarray(error.shift, dtype=float), rotation_by(error.turn)
    if isinstance(config, UnilateralPlane):
        return replace(config, stiffness=error.stiffness * config.stiffness,
                       point=config.point + shift, normal=R @ config.normal)
    return _displaced_spring(config, error.stiffness, shift, R)


def _displaced_spring(config: BilateralSpring, factor: float, shift: np.ndarray, R: np.ndarray
                      ) -> BilateralSpring:
    position, attitude = np.split(np.asarray(config.equilibrium, dtype=float), 2)
    turned = euler_angles(R @ rotation_matrix(attitude))
    B = block_diagonal(R.T, rate_matrix(attitude) @ inverse_rate_matrix(turned))
    K = factor * B.T @ config.stiffness @ B
    return BilateralSpring(stiffness=0.5 * (K + K.T),
                           equilibrium=np.concatenate([position + shift, turned]))


def rotation_by(turn: np.ndarray) -> np.ndarray:
    """Returns R (3, 3) of a rotation vector (3,) [rad], by Rodrigues' formula."""
    S, angle = skew(np.asarray(turn, dtype=float)), float(np.linalg.norm(turn))
    return np.eye(3) + np.sinc(angle / np.pi) * S + 0.5 * np.sinc(0.5 * angle / np.pi)**2 * S @ S
