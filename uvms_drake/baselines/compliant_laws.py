"""Impedance and admittance: the error of the force moves the set-point, or commands a velocity.

The target of the impedance is that of Antonelli, *Underwater Robots*, (8.1), with the arm's own
inertia Λ for M_d, so that no force is fed back inside: Λ ẍ̃ + D ẋ̃ + K x̃ = f⃗. The desired force
moves the set-point. The admittance is for arms with a velocity interface, as both real ones have;
without a spring along n. The measured velocity of the vehicle is subtracted, which makes it work on
a floating base.
"""

from dataclasses import dataclass

import numpy as np

from uvms_drake.baselines.law import Law, Measured, integrated


@dataclass
class ImpedanceGains:
    """Gains of the impedance and of the integral."""

    stiffness: float = 300.0
    """K_d in all directions [N/m]."""
    damping: float = 123.0
    """D_d along n, 2√(K_dΛ) [N s/m]."""
    damping_across: float = 75.0
    """D_d across n [N s/m]."""
    integral: float = 0.015
    """k_I, speed of the set-point per force [m/s/N]."""
    clamp: float = 0.15
    """Largest displacement of the set-point [m]."""
    posture: float = 2.0
    """Gain of the joints' posture, where the tip leaves it free [1/s]."""


class Impedance(Law):
    """τ_q = J_qᵀ(K(x_r − x) + D(ẋ_d − ẋ)) + posture, x_r = x_d + n z, ż = k_I (f_d − f).

    z stands still before the touch, and while a limit cuts the command.
    """

    memory = 1
    declared = ("direction", "inertia of the arm (posture)")

    def __init__(self, gains: ImpedanceGains):
        self._gains = gains

    def tau(self, now: Measured, memory: np.ndarray) -> np.ndarray:
        """See the class."""
        gains, n = self._gains, now.n
        D = gains.damping * np.outer(n, n) + gains.damping_across * now.across
        F = (gains.stiffness * (now.reference.x + n * memory[0] - now.x)
             + D @ (now.reference.v - now.v))
        out = np.zeros(now.model.size)
        out[6:] = now.J[:, 6:].T @ F + now.arm_null.T @ posture_torque(now, gains.posture)
        return out

    def updated(self, now: Measured, memory: np.ndarray, limited: bool) -> np.ndarray:
        """Returns the next z (1,) [m]."""
        if not now.reference.touched:
            return memory
        return integrated(memory, np.array([self._gains.integral * now.force_error]),
                          self._gains.clamp, limited)


def posture_torque(now: Measured, rate: float) -> np.ndarray:
    """Returns M_qq(rate² (q_des − q) − 2 rate q̇) (n,) [N m], critically damped at `rate` [1/s]."""
    q, q_dot = now.config[6:], now.zeta[6:]
    torque: np.ndarray = now.M[6:, 6:] @ (
        rate**2 * (now.task.posture - q) - 2.0 * rate * q_dot)
    return torque


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
