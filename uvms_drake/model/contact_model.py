"""The prediction model of a UVMS in contact with a surface whose law is known."""

import numpy as np

from uvms_drake.model.end_effector import tip_force_gradients
from uvms_drake.model.frames.euler import WORLD
from uvms_drake.model.frames.spatial import times
from uvms_drake.model.robot import Robot
from uvms_drake.model.surface.law import Surface
from uvms_drake.model.uvms import Uvms
from uvms_drake.model.uvms_model import Kinematics, UvmsModel


class ContactModel(UvmsModel):
    """A `UvmsModel` whose f contains 𝔉(χ, χ̇) of a surface.

    Args:
        uvms: The robot and its water.
        surface: The surface, as `check_surface` returns it.
        task_frame: ZYX Euler angles of Σ_T, as of `UvmsModel`.
    """

    def __init__(self, uvms: Uvms, surface: Surface, task_frame: np.ndarray = WORLD):
        super().__init__(uvms, task_frame)
        self.surface = surface

    @staticmethod
    def load(model: str, surface: Surface) -> "ContactModel":
        """Returns the model of a shipped robot or a robot's folder, in front of a surface."""
        return ContactModel(Robot.load(model).uvms, surface)

    def contact_force(self, kinematics: Kinematics, V_E: np.ndarray) -> np.ndarray:
        """Returns 𝔉(χ, A V_E) (..., 6)."""
        if not self.surface.exerts_force:
            return super().contact_force(kinematics, V_E)
        return self.surface.force(kinematics.chi, times(kinematics.A_E, V_E))

    def contact_gradients(self, kinematics: Kinematics, V_E: np.ndarray
                          ) -> tuple[np.ndarray, np.ndarray]:
        """Returns the derivatives (..., 6, 6) of A(𝔬)ᵀ𝔉 by V_E and along motions, real."""
        if not self.surface.exerts_force:
            return super().contact_gradients(kinematics, V_E)
        return tip_force_gradients(self.surface, kinematics.chi, kinematics.A_E, V_E)
