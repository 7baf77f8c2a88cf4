"""Interface of a baseline's law, and all that it may read: motion and contact, and the task."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from uvms_drake.common.errors import require, unit_vector
from uvms_drake.model.uvms_model import Kinematics, UvmsModel

PERIOD = 0.01
"""Time between two updates of a memory, of integrals and contact [s]."""


@dataclass(frozen=True)
class PressTask:
    """Task of a baseline: press with a force along a direction at a place of an unknown wall."""

    direction: np.ndarray
    """Unit vector n (3,) into the wall, in Σ_I, as declared."""
    place: np.ndarray
    """Place across n at which to press (3,) in Σ_I [m]; its depth along n is not used."""
    attitude: np.ndarray
    """Euler angles of the end-effector about Σ_T (3,) [rad]."""
    posture: np.ndarray
    """Joint angles that resolve the redundancy (n,) [rad]."""
    force: float
    """Desired force along n [N]."""
    largest: float = np.inf
    """Force along n above which the press stops [N]; infinite for a press without a stop."""

    def __post_init__(self) -> None:
        unit_vector("direction", self.direction)
        require(0.0 < self.force < np.inf, "force", self.force, "a positive force")
        require(self.largest > self.force, "largest", self.largest, "above the desired force")


class Reference(NamedTuple):
    """Motion that a law follows, from the approach's state machine; 9 numbers."""

    x: np.ndarray
    """Position of the tip x_d (3,) in Σ_I [m]."""
    v: np.ndarray
    """Its velocity ẋ_d (3,) [m/s]."""
    force: float
    """Desired force f_d along n [N]."""
    touched: bool
    """Whether the tip is in contact."""
    since: float
    """Instant at which the contact began, or the motion [s]."""

    @staticmethod
    def of(values: np.ndarray) -> "Reference":
        """Returns the reference of a port's vector (9,)."""
        return Reference(values[:3], values[3:6], values[6], bool(values[7]), values[8])


@dataclass(frozen=True)
class Measured:
    """Measured state and force at an instant, with the model's quantities there."""

    model: UvmsModel
    task: PressTask
    time: float
    """Instant [s]."""
    config: np.ndarray
    """𝔮 (6+n,) [m, rad]."""
    zeta: np.ndarray
    """ζ (6+n,) [m/s, rad/s]."""
    wrench: np.ndarray
    """𝔉_s on the surface (6,) [N, N m]."""
    reference: Reference

    @cached_property
    def kinematics(self) -> Kinematics:
        """Geometry at 𝔮."""
        return self.model.kinematics(self.config)

    @cached_property
    def x(self) -> np.ndarray:
        """Position of the tip (3,) in Σ_I [m]."""
        return self.kinematics.chi[:3]

    @cached_property
    def J(self) -> np.ndarray:
        """J_p = [J_v J_q] (3, 6+n), ẋ = J_p ζ."""
        return self.kinematics.J_chi[:3]

    @cached_property
    def v(self) -> np.ndarray:
        """Velocity of the tip ẋ (3,) [m/s]."""
        return self.J @ self.zeta

    @cached_property
    def J_rate(self) -> np.ndarray:
        """J̇_p (3, 6+n) along the motion."""
        return self.model.task_jacobian_rate(self.kinematics, self.zeta)[:3]

    @cached_property
    def M(self) -> np.ndarray:
        """Mass matrix with added mass, at 𝔮 (6+n, 6+n)."""
        return self.model.mass_matrix(self.kinematics)

    @cached_property
    def arm_inverse(self) -> np.ndarray:
        """J̄_q = M_qq⁻¹J_qᵀΛ_q (n, 3): the right inverse of J_q of least kinetic energy."""
        J, inverse = self.J[:, 6:], np.linalg.inv(self.M[6:, 6:])
        return inverse @ J.T @ np.linalg.inv(J @ inverse @ J.T)

    @cached_property
    def arm_null(self) -> np.ndarray:
        """I − J̄_qJ_q (n, n): joint velocities that leave the tip where it is."""
        return np.eye(self.model.num_joints) - self.arm_inverse @ self.J[:, 6:]

    @cached_property
    def n(self) -> np.ndarray:
        """Direction n (3,)."""
        return np.asarray(self.task.direction, dtype=float)

    @cached_property
    def across(self) -> np.ndarray:
        """Q = I − nnᵀ (3, 3)."""
        return np.eye(3) - np.outer(self.n, self.n)

    @cached_property
    def force(self) -> float:
        """Measured force f along n [N]."""
        return float(self.n @ self.wrench[:3])

    @cached_property
    def force_error(self) -> float:
        """e_f = f_d − f [N]."""
        return self.reference.force - self.force

    @cached_property
    def station_error(self) -> np.ndarray:
        """Error of the vehicle to where the tip is at x_d in the task's posture (6,) [m, rad].

        Position in body axes and differences of the Euler angles, for small angles.
        """
        y = np.concatenate([self.reference.x, self.task.attitude, self.task.posture])
        error = (self.model.configuration(y) - self.config)[:6]
        turn = np.mod(error[3:] + np.pi, 2.0 * np.pi) - np.pi
        return np.concatenate([self.kinematics.R_WB.T @ error[:3], turn])

    @cached_property
    def station_velocity(self) -> np.ndarray:
        """Velocity of that place, in body axes (6,) [m/s, rad/s]."""
        return np.concatenate([self.kinematics.R_WB.T @ self.reference.v, np.zeros(3)])


class Law(ABC):
    """A law τ(measured, memory), with a memory of m numbers that is updated every `PERIOD`."""

    memory: int = 0
    """Number m of its own states, which start at zero."""
    declared: tuple[str, ...] = ()
    """Names of the data of robot and task that it is given, besides state and force."""

    @abstractmethod
    def tau(self, now: Measured, memory: np.ndarray) -> np.ndarray:
        """Returns τ (6+n,) [N, N m], the vehicle's part in body axes."""

    def updated(self, now: Measured, memory: np.ndarray, limited: bool) -> np.ndarray:
        """Returns the next memory (m,); `limited` is whether a limit cuts the sum of all laws."""
        return memory

    def stopped(self, memory: np.ndarray) -> np.ndarray:
        """Returns the memory (m,) that is left by a stop: no integral, no force fed forward."""
        return np.zeros_like(memory)


def integrated(integral: np.ndarray, rate: np.ndarray, clamp: np.ndarray | float, limited: bool
               ) -> np.ndarray:
    """Returns the next value of an integral, within ±`clamp`; while limited it only shrinks."""
    step = np.clip(integral + PERIOD * rate, -np.asarray(clamp), clamp)
    return np.where(limited & (np.abs(step) > np.abs(integral)), integral, step)
