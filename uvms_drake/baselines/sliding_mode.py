"""Parallel force/position control by sliding modes, decoupled and coupled.

After Barbalata, Dunnigan and Petillot, JMSE 6(3):96, 2018, of which only the abstract could be
read: the equations are those of the textbook, and their gains are not the paper's. Both terms act
on all axes, and the force wins along n by its integral (parallel composition):

    ẋ_s = ẋ_d + Λ_x (x_d − x) + n (k_fp e_f + k_fi ∫e_f),    s = ẋ_s − ẋ.

The switching function is sat(s/Φ). Inside its layer |s| ≤ Φ the law is linear with the rate k; its
size kΦ times the inertia has to exceed the error of the model. The rate of e_f is left out of ẍ_s:
it is not measured.
"""

from dataclasses import dataclass, field

import numpy as np

from uvms_drake.baselines.compliant_laws import posture_torque
from uvms_drake.baselines.law import Law, Measured, integrated


@dataclass
class SlidingGains:
    """Gains of the sliding modes."""

    position: float = 3.0
    """Λ_x of the tip, and of the posture [1/s]."""
    force: float = 0.002
    """k_fp, velocity per force [m/s/N]."""
    integral: float = 0.005
    """k_fi, velocity per integral of the force [m/s²/N]."""
    clamp: float = 0.5
    """Largest velocity of the integral [m/s]."""
    rate: float = 15.0
    """k, rate inside the layer of the joints, or of the tip if coupled [1/s]."""
    layer: float = 0.1
    """Φ of the joints [rad/s], or of the tip if coupled [m/s]."""
    station: float = 0.8
    """Λ_v of the vehicle [1/s]."""
    switching: np.ndarray = field(default_factory=lambda: np.zeros(6))
    """K_v of the vehicle (6,) [N, N m]; zero on an axis that is not driven."""
    station_layer: np.ndarray = field(default_factory=lambda: np.ones(6))
    """Φ_v of the vehicle (6,) [m/s, rad/s]."""


def saturated(s: np.ndarray, layer: np.ndarray | float) -> np.ndarray:
    """Returns sat(s/Φ), the switching function with a boundary layer."""
    return np.clip(s / layer, -1.0, 1.0)


class SlidingTip(Law):
    """Sliding variable of the tip, common to the laws of the arm and of the whole robot."""

    memory = 1
    declared = ("direction", "model")

    def __init__(self, gains: SlidingGains):
        self.gains = gains

    def sliding_velocity(self, now: Measured, memory: np.ndarray) -> np.ndarray:
        """Returns ẋ_s (3,) [m/s]."""
        gains = self.gains
        v = now.reference.v + gains.position * (now.reference.x - now.x)
        return v + now.n * (memory[0] + gains.force * self._force_error(now))

    def sliding_acceleration(self, now: Measured) -> np.ndarray:
        """Returns ẍ_s − J̇ζ (3,) [m/s²], without the derivative of the force."""
        gains = self.gains
        return (gains.position * (now.reference.v - now.v)
                + now.n * gains.integral * self._force_error(now) - now.J_rate @ now.zeta)

    @staticmethod
    def _force_error(now: Measured) -> float:
        return now.force_error if now.reference.touched else 0.0

    def updated(self, now: Measured, memory: np.ndarray, limited: bool) -> np.ndarray:
        """Returns the next k_fi ∫e_f (1,) [m/s]."""
        return integrated(memory, np.array([self.gains.integral * self._force_error(now)]),
                          self.gains.clamp, limited)


class DecoupledArm(SlidingTip):
    """τ_q = M_qq (q̈_s + k Φ sat(s_q/Φ)) + J_qᵀ n f, s_q = q̇_s − q̇; the arm alone."""

    def surface(self, now: Measured, memory: np.ndarray) -> np.ndarray:
        """Returns s_q (n,) [rad/s]."""
        v = self.sliding_velocity(now, memory) - now.J[:, :6] @ now.zeta[:6]
        s: np.ndarray = now.arm_inverse @ v + now.arm_null @ (
            self.gains.position * (now.task.posture - now.config[6:])) - now.zeta[6:]
        return s

    def tau(self, now: Measured, memory: np.ndarray) -> np.ndarray:
        """See the class."""
        gains = self.gains
        rate = gains.rate * gains.layer * saturated(self.surface(now, memory), gains.layer)
        rate += now.arm_inverse @ self.sliding_acceleration(now) - now.arm_null @ (
            gains.position * now.zeta[6:])
        out = np.zeros(now.model.size)
        out[6:] = now.M[6:, 6:] @ rate + now.J[:, 6:].T @ now.n * now.force
        return out


class DecoupledVehicle(Law):
    """τ_v = M_vv ν̇_r + K_v sat(s_v/Φ_v), s_v = ν_r − ν, ν_r = ν_d + Λ_v η̃; the vehicle alone."""

    declared = ("model",)

    def __init__(self, gains: SlidingGains):
        self._gains = gains

    def tau(self, now: Measured, memory: np.ndarray) -> np.ndarray:
        """See the class."""
        gains = self._gains
        driven = gains.switching > 0.0
        slower = now.station_velocity - now.zeta[:6]
        s = slower + gains.station * now.station_error
        out = np.zeros(now.model.size)
        out[:6] = driven * (now.M[:6, :6] @ (driven * gains.station * slower)) + (
            gains.switching * saturated(s, gains.station_layer))
        return out


class Coupled(SlidingTip):
    """τ = Jᵀ(Λ(ẍ_s − J̇ζ + k Φ sat(s/Φ)) + f⃗) + (I − JᵀJ̄ᵀ)τ₀, of the whole robot.

    τ₀ keeps vehicle and posture in place, in the null space of the tip. The reaction of the force
    goes through the thrusters, whose lag destabilises it on a light vehicle.
    """

    def surface(self, now: Measured, memory: np.ndarray) -> np.ndarray:
        """Returns s (3,) [m/s]."""
        return self.sliding_velocity(now, memory) - now.v

    def tau(self, now: Measured, memory: np.ndarray) -> np.ndarray:
        """See the class."""
        gains, J = self.gains, now.J
        inverse = np.linalg.inv(now.M)
        inertia = np.linalg.inv(J @ inverse @ J.T)
        F = inertia @ (self.sliding_acceleration(now) + gains.rate * gains.layer * saturated(
            self.surface(now, memory), gains.layer)) + now.wrench[:3]
        station = gains.station * now.station_error + now.station_velocity - now.zeta[:6]
        kept = now.M @ np.concatenate([
            2.0 * gains.station * station, np.zeros(now.model.num_joints)])
        kept[6:] += posture_torque(now, gains.station)
        out: np.ndarray = J.T @ F + kept - J.T @ (inertia @ (J @ (inverse @ kept)))
        out[:6] *= gains.switching > 0.0
        return out
