"""Prescribed performance of force and position, told nothing of the robot's dynamics.

After Heshmati-alamdari, Bechlioulis, Karras, Nikou, Dimarogonas and Kyriakopoulos, Annual Reviews
in Control 2018, and arXiv 1611.07399, of which only the abstracts could be read: the structure in
two layers is that of this family, the constants are not the papers'. An error stays in its funnel,

    |e| < ρ(t) = (ρ₀ − ρ_∞) exp(−l t) + ρ_∞,   ξ = e/ρ,   ε = ln((1 + ξ)/(1 − ξ)),

in continuous time, without a limit of the input, and from contact. Here time is sampled and the
input limited, so a funnel can be left, where ε does not exist: ξ is clamped to ±`CLAMP`, and every
exit is counted. Before the touch, which the theory does not have, the tip approaches at a constant
speed; the funnel of the force begins at the touch. A layer is −K ε; with −K ρ⁻¹ (dε/dξ) ε, which is
steeper at a funnel's edge, a sampled loop behind thrusters diverges.
"""

from dataclasses import dataclass, field

import numpy as np

from uvms_drake.baselines.law import Law, Measured

CLAMP = 0.98
"""Largest |ξ| that the law takes."""


@dataclass
class PerformanceGains:
    """Funnels and gains of both layers."""

    force: float = 3.0
    """ρ_∞ of the force [N]."""
    force_decay: float = 0.6
    """l of the force [1/s]."""
    force_gain: float = 1.27e-3
    """K₁ of the force [m/s]."""
    position: float = 0.02
    """ρ_∞ of the position across n [m]."""
    position_start: float = 0.2
    """ρ₀ of the position [m]."""
    position_gain: float = 8.0e-3
    """K₁ of the position [m/s]."""
    decay: float = 0.5
    """l of position and velocities [1/s]."""
    station: float = 0.5
    """Gain of the reference of vehicle and posture, where the task is free [1/s]."""
    velocity: np.ndarray = field(default_factory=lambda: np.ones(0))
    """ρ_∞ of each velocity (6+n,) [m/s, rad/s]."""
    velocity_gain: np.ndarray = field(default_factory=lambda: np.ones(0))
    """K₂ (6+n,) of the second layer [N, N m]; zero on an axis that is not driven."""
    wide: float = 3.0
    """ρ₀ of the velocities over their ρ_∞."""


def funnel(start: np.ndarray | float, end: np.ndarray | float, decay: float, time: float
           ) -> np.ndarray:
    """Returns ρ(t)."""
    return np.asarray(end + (np.asarray(start) - end) * np.exp(-decay * time))


def transformed(error: np.ndarray, rho: np.ndarray) -> np.ndarray:
    """Returns ε, with ξ clamped to ±`CLAMP`."""
    xi = np.clip(error / rho, -CLAMP, CLAMP)
    epsilon: np.ndarray = np.log((1.0 + xi) / (1.0 - xi))
    return epsilon


class PrescribedPerformance(Law):
    """u = −K₂ ε of ζ − ζ_r, ζ_r of the task's rate −K₁ ε, the plain form; kinematics alone.

    The first number of its memory is the number of exits of all funnels; the others are 1 for a
    funnel that its error is outside of.
    """

    declared = ("direction", "kinematics")

    def __init__(self, gains: PerformanceGains, size: int):
        self._gains, self.memory = gains, 1 + 3 + size

    def task_error(self, now: Measured) -> tuple[np.ndarray, np.ndarray]:
        """Returns errors and funnels of force along n, and position across it (3,)."""
        gains = self._gains
        error = np.append(-now.force_error, tangents(now.n) @ (now.x - now.reference.x))
        start = 1.5 * now.reference.force
        force = funnel(start, gains.force, gains.force_decay, now.time - now.reference.since)
        place = funnel(gains.position_start, gains.position, gains.decay, now.time)
        return error, np.array([force, place, place], dtype=float)

    def velocity_error(self, now: Measured) -> tuple[np.ndarray, np.ndarray]:
        """Returns ζ − ζ_r and its funnel (6+n,)."""
        gains, (error, rho) = self._gains, self.task_error(now)
        along, *across = np.array([gains.force_gain, gains.position_gain, gains.position_gain]) * (
            -transformed(error, rho))
        v = tangents(now.n).T @ np.array(across) + now.across @ now.reference.v
        v += now.n * (along if now.reference.touched else now.n @ now.reference.v)
        vehicle = now.station_velocity + gains.station * now.station_error
        J = now.J[:, 6:]
        inverse = np.linalg.pinv(J)
        free = gains.station * (now.task.posture - now.config[6:])
        joints = inverse @ (v - now.J[:, :6] @ now.zeta[:6]) + free - inverse @ (J @ free)
        return (now.zeta - np.concatenate([vehicle, joints]),
                funnel(gains.wide * gains.velocity, gains.velocity, gains.decay, now.time))

    def tau(self, now: Measured, memory: np.ndarray) -> np.ndarray:
        """See the class."""
        gains = self._gains
        return -gains.velocity_gain * transformed(*self.velocity_error(now))

    def updated(self, now: Measured, memory: np.ndarray, limited: bool) -> np.ndarray:
        """Returns the next number of exits, and which funnels are left."""
        (task, task_rho), (velocity, rho) = self.task_error(now), self.velocity_error(now)
        outside = np.concatenate([np.abs(task) >= task_rho, np.abs(velocity) >= rho])
        outside[0] &= now.reference.touched
        outside[3:] &= self._gains.velocity_gain > 0.0
        left = np.count_nonzero(outside & (memory[1:] == 0.0))
        return np.append(memory[0] + left, outside)

    def stopped(self, memory: np.ndarray) -> np.ndarray:
        """Returns the number of exits, and which funnels are left: a stop integrates nothing."""
        return memory


def tangents(n: np.ndarray) -> np.ndarray:
    """Returns two unit vectors across n as rows (2, 3)."""
    _, _, rows = np.linalg.svd(n[None])
    return rows[1:]
