"""Feed-forward of the model's forces: weight, buoyancy, drag and Coriolis, without contact."""

import numpy as np

from uvms_drake.baselines.law import Law
from uvms_drake.baselines.measured import Measured


class Compensation(Law):
    """τ = C(𝔮, ζ)ζ + D(𝔮, ζ)ζ + g(𝔮): the vehicle's part has the arm's weight on it."""

    declared = ("model",)

    def tau(self, now: Measured, memory: np.ndarray) -> np.ndarray:
        """See the class."""
        return now.model.inverse_dynamics(
            now.kinematics, now.zeta, np.zeros(now.model.size), np.zeros(6))


class Gravity(Law):
    """τ = g(𝔮): weight and buoyancy alone."""

    declared = ("weight and buoyancy",)

    def tau(self, now: Measured, memory: np.ndarray) -> np.ndarray:
        """See the class."""
        still = np.zeros(now.model.size)
        return now.model.inverse_dynamics(now.kinematics, still, still, np.zeros(6))
