"""Admittance in velocity: the force error commands a velocity of the tip to the joints' servos.

It is for arms with a velocity interface, as both real ones have; without a spring along n. The
measured velocity of the vehicle is subtracted, which makes it work on a floating base.
"""

from dataclasses import dataclass

import numpy as np

from uvms_drake.baselines.law import Law, integrated
from uvms_drake.baselines.measured import Measured


@dataclass
class AdmittanceGains:
    """Gains of the admittance and of the servos."""

    force: float = 0.002
    """k_f, velocity along n per force [m/s/N]; k_f K_e is the loop's rate."""
    speed: float = 0.04
    """Largest velocity along n in contact [m/s]."""
    position: float = 3.0
    """Gain of the tip's position across n, and of the posture [1/s]."""
    servo: float = 15.0
    """Gain of the joints' velocity [1/s]."""
    integral: float = 4.0
    """Gain of the integral of its error [1/s]."""
    joint_speed: float = 0.5
    """Largest commanded ‖q̇‖₂ [rad/s]."""


class Admittance(Law):
    """τ_q = M_qq k_v (q̇_r − q̇ + k_i ∫(q̇_r − q̇)), q̇_r = J̄_q(ẋ_r − J_v ν) + posture.

    ẋ_r is k_f (f_d − f) along n in contact, and ẋ_d + k_x (x_d − x) otherwise.
    """

    declared = ("direction", "inertia of the arm (servos)")

    def __init__(self, gains: AdmittanceGains, num_joints: int):
        self._gains, self.memory = gains, num_joints

    def _rate_error(self, now: Measured) -> np.ndarray:
        gains, n = self._gains, now.n
        v = now.reference.v + gains.position * (now.reference.x - now.x)
        if now.reference.touched:
            along = np.clip(gains.force * now.force_error, -gains.speed, gains.speed)
            v = now.across @ v + n * along
        rates = now.arm_inverse @ (v - now.J[:, :6] @ now.zeta[:6]) + now.arm_null @ (
            gains.position * (now.task.posture - now.config[6:]))
        rates *= min(1.0, gains.joint_speed / max(float(np.linalg.norm(rates)), 1e-9))
        error: np.ndarray = rates - now.zeta[6:]
        return error

    def tau(self, now: Measured, memory: np.ndarray) -> np.ndarray:
        """See the class."""
        out = np.zeros(now.model.size)
        out[6:] = now.M[6:, 6:] @ (self._gains.servo * (self._rate_error(now) + memory))
        return out

    def updated(self, now: Measured, memory: np.ndarray, limited: bool) -> np.ndarray:
        """Returns the next integral k_i ∫(q̇_r − q̇) (n,) [rad/s]."""
        return integrated(memory, self._gains.integral * self._rate_error(now), 5.0, limited)
