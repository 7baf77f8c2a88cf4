"""Declared unknowns: the errors of the controller's model, and the motion of the water."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from uvms_drake.plant.model_error import ModelError
from uvms_drake.plant.waves import Wave


@dataclass(frozen=True)
class Unknowns:
    """Differences of the simulated robot and water from the controller's model; none by default."""

    error: ModelError = field(default_factory=ModelError)
    """Errors of the robot."""
    current: np.ndarray = field(default_factory=lambda: np.zeros(3))
    """Velocity of the water in Σ_I (3,) [m/s]."""
    waves: Sequence[Wave] = ()
    """Waves on top of it."""

    @property
    def present(self) -> bool:
        """Whether there is one."""
        return bool(self.error.size > 0.0 or np.any(self.current) or self.waves)
