"""Limit on the velocity of the end-effector along the axes of Σ_I."""

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from uvms_drake.common.errors import vector
from uvms_drake.control.limits.limit import Limit
from uvms_drake.control.limits.radii import TubeRadii
from uvms_drake.control.plan.points import About, Points


@dataclass
class TipVelocity(Limit):
    """Speeds |𝔭̇ᵢ| ≤ bound; a certificate needs the radius of 𝔭̇ in the tube."""

    name = "tip_velocity"
    about: ClassVar[About] = "speed"

    bound: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """Largest size of each component (3,) [m/s]."""

    def check(self) -> None:
        """Raises `InvalidParameter` unless the bounds are three positive numbers."""
        vector("bound", self.bound, 3)
        super().check()

    def values(self, at: Points) -> np.ndarray:
        """Returns 𝔭̇ = J_𝔭(𝔮)ζ."""
        J = at.model.kinematics(at.config).J_chi[..., :3, :]
        return (J @ at.zeta[..., None])[..., 0]

    def tube_takes(self, tube: TubeRadii) -> np.ndarray | None:
        """Returns the radius of 𝔭̇, if there is one."""
        return None if tube.tip_speed is None else np.full(3, tube.tip_speed)

    def unit_of(self, signal: str) -> str:
        """Returns m/s."""
        return "m/s"

    @property
    def bars(self) -> list[str]:
        """Names of the bars that display it."""
        return [f"tip speed {axis}  ≤ {most:g} m/s"
                for axis, most in zip("xyz", self.bound, strict=True)]

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Returns ∓bound."""
        return -np.asarray(self.bound), np.asarray(self.bound)
