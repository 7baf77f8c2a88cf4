"""Cost of roll and pitch of the vehicle, which the task's cost leaves free."""

from dataclasses import dataclass

import numpy as np

from uvms_drake.common.errors import require
from uvms_drake.control.costs.term import CostTerm
from uvms_drake.control.plan.points import Points


@dataclass
class LevelVehicle(CostTerm):
    """Cost weight (φ² + θ²) that keeps the vehicle level."""

    weight: float = 1.0
    """Cost of a tilt by 1 rad that lasts 1 s [1/(rad² s)]."""

    def residual(self, at: Points) -> np.ndarray:
        """Returns √weight (φ, θ)."""
        require(0.0 <= self.weight < np.inf, "weight", self.weight, "zero or positive")
        return np.sqrt(self.weight) * at.config[..., 3:5]
