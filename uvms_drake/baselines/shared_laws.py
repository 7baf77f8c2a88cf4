"""Laws that several baselines share: station keeping, model's forces, and the desired force."""

from dataclasses import dataclass, field

import numpy as np

from uvms_drake.baselines.law import PERIOD, Law, Measured, integrated

RISE = 0.5
"""Time constant by which it rises after the touch [s]: thrusters lag, and a vehicle that is pushed
before the arm presses drives on the wall."""


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

    def stopped(self, memory: np.ndarray) -> np.ndarray:
        """Returns the integral, which a stop leaves: it has the weight in it."""
        return memory

    def updated(self, now: Measured, memory: np.ndarray, limited: bool) -> np.ndarray:
        """Returns the next integral of the velocity's error (6,) [m, rad]."""
        return integrated(memory, self._error(now), self._gains.clamp, limited)


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


class ForceFeedforward(Law):
    """τ_v = J_vᵀ n f_d in contact, smoothed; zero before the touch.

    Without it the vehicle's station keeping yields to the force. Without an integral or a measured
    force in the arm's law the joints yield too, and take J_qᵀ n f_d.
    """

    memory = 1

    def __init__(self, *, joints: bool = False):
        self._joints = joints

    def tau(self, now: Measured, memory: np.ndarray) -> np.ndarray:
        """See the class."""
        out: np.ndarray = now.J.T @ now.n * memory[0]
        if not self._joints:
            out[6:] = 0.0
        return out

    def updated(self, now: Measured, memory: np.ndarray, limited: bool) -> np.ndarray:
        """Returns the next force that is fed forward (1,) [N]."""
        wanted = now.reference.force if now.reference.touched else 0.0
        return memory + PERIOD / RISE * (wanted - memory)
