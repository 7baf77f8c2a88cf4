"""Station keeping of the vehicle: PID on its velocity, the model's inertia as gain."""

from dataclasses import dataclass, field

import numpy as np

from uvms_drake.baselines.law import Law, integrated
from uvms_drake.baselines.measured import Measured


@dataclass
class HoldGains:
    """Gains of the vehicle's station keeping."""

    k: float = 1.5
    """Gain of the velocity [1/s]."""
    sigma: float = 0.8
    """Gain of the position [1/s]."""
    integral: float = 0.25
    """Gain of the integral of the velocity's error [1/s²]."""
    clamp: float = 0.3
    """Largest integral [m, rad]."""
    driven: list[bool] = field(default_factory=lambda: [True] * 6)
    """Axes that the thrusters drive, surge to yaw."""


class VehicleHold(Law):
    """τ_v = M_vv (k (ν_r − ν) + k_i ∫(ν_r − ν)), ν_r = ν_d + σ η̃.

    It is the form of the open controller of HippoCampusRobotics/uvms, with this model's M; the
    model's forces and the arm's weight come from `Compensation`.
    """

    memory = 6
    declared = ("model",)

    def __init__(self, gains: HoldGains):
        self._gains, self._driven = gains, np.array(gains.driven, dtype=float)

    def _error(self, now: Measured) -> np.ndarray:
        gains = self._gains
        return self._driven * (now.station_velocity + gains.sigma * now.station_error
                               - now.zeta[:6])

    def tau(self, now: Measured, memory: np.ndarray) -> np.ndarray:
        """See the class."""
        out = np.zeros(now.model.size)
        out[:6] = self._driven * (now.M[:6, :6] @ (
            self._gains.k * self._error(now) + self._gains.integral * memory))
        return out

    def updated(self, now: Measured, memory: np.ndarray, limited: bool) -> np.ndarray:
        """Returns the next integral of the velocity's error (6,) [m, rad]."""
        return integrated(memory, self._error(now), self._gains.clamp, limited)
