"""A limit on the velocity of the end-effector along the axes of Σ_I."""

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from uvms_drake.common.errors import vector
from uvms_drake.control.limits.limit import Limit
from uvms_drake.control.points import About, Points


@dataclass
class TipVelocity(Limit):
    """|𝔭̇ᵢ| ≤ bound. No tube here bounds what it takes of it, so it leaves no certificate."""

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

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Returns ∓bound."""
        return -np.asarray(self.bound), np.asarray(self.bound)
