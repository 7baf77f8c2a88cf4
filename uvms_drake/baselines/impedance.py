"""Operational-space impedance of the arm, with an outer integral of the force error.

The target is that of Antonelli, *Underwater Robots*, (8.1), with the arm's own inertia Λ for M_d,
so that no force is fed back inside: Λ ẍ̃ + D ẋ̃ + K x̃ = f⃗. The desired force moves the set-point.
"""

from dataclasses import dataclass

import numpy as np

from uvms_drake.baselines.law import Law, integrated
from uvms_drake.baselines.measured import Measured


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
