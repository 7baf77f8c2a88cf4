"""The optimal control problem of the comparison: its numbers, closed-loop cost and limits.

It moves the end-effector of `models/ocp_robot` from the paper's χ(0) to its χ_des, by the dynamics
ζ̇ = f(𝔮, ζ) + u, and into a spring.

    minimise  Σ_{k<N} h L(x_k, u_k) + V(x_N)        subject to  x_{k+1} = one RK4 step, u_k const.
    L = a‖e‖² + b‖ζ‖² + c‖u − u_eq‖²,   V = a‖e‖² + d‖ζ‖²,   e = χ(𝔮) − χ_des

    limits (of the inputs at k < N, of the states at 0 < k ≤ N):
    joint angles q,  |θ| ≤ π/2 − 0.1,  ‖ν₁‖² ≤ 2,  ‖ν₂‖² ≤ 2,  ‖q̇‖² ≤ 2,  |u_i| ≤ 2

A controller is judged by the closed loop: 60 steps, the plant is the same RK4 step.
"""

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.surface.law import check_surface
from uvms_drake.model.surface.spring import BilateralSpring

ROBOT = Path(__file__).parent / "models" / "ocp_robot"

STEP = 0.1  # h [s]
HORIZON = 7  # N
CLOSED_LOOP_STEPS = 60

CHI_DES = np.array([0.0, 0.0, 0.0, np.pi / 3, np.pi / 10, 0.0])  # [m, rad]
CHI_EQ = CHI_DES + np.array([0.05, 0.0, 0.0, 0.0, 0.0, 0.0])
"""Pose of the undeformed spring, K = I₆."""
CONFIG_START = np.array([-1.9714, 1.2019, -0.4671, -0.4135, 0.9147, -0.2439, 0.3, 0.5, -0.3, 0.0])
"""𝔮(0) [m, rad]: the end-effector is at the paper's χ(0) to within 0.1 mm."""
U_EQ = np.array([0.0112, 0.0013, 0.0088, -0.0732, 0.9786, 0.0006, -0.2768, -1.0999, -0.3431,
                 -0.0002])
"""Acceleration [m/s², rad/s²] that holds χ_des with q = (0.5758, 0.7021, −0.0983, 0.4833)."""

JOINT_LOWER = np.array([-0.52, -0.1471, -1.297, -3.14])  # [rad]
JOINT_UPPER = np.array([1.46, 1.3114, 0.73, 3.14])
PITCH_LIMIT = np.pi / 2 - 0.1  # of the vehicle [rad]
SPEED_LIMIT = np.sqrt(2.0)  # of ‖ν₁‖ [m/s], ‖ν₂‖ and ‖q̇‖ [rad/s]
SPEEDS = (slice(0, 3), slice(3, 6), slice(6, 10))
"""ν₁, ν₂ and q̇ in ζ."""


@dataclass(frozen=True)
class Problem:
    """The problem; a history is x_0, ..., x_n and u_0, ..., u_{n−1}."""

    name: str
    start: np.ndarray
    """x_0: (𝔮, ζ) (20,)."""
    task_weight: float
    """a."""
    velocity_weight: float
    """b."""
    input_weight: float
    """c."""
    terminal_velocity_weight: float
    """d."""
    input_limit: float
    """Largest |u_i| [m/s², rad/s²]."""

    def closed_loop_cost(self, states: np.ndarray, inputs: np.ndarray) -> float:
        """Returns J = Σ h L(x_k, u_k) over all steps of a history; V of the last state is not in.

        With all 60 steps the published value is J = 79.505.
        """
        e = load_model().task_pose(states[:-1, :10])[:, :6] - CHI_DES
        return STEP * float(self.task_weight * np.sum(e**2)
                            + self.velocity_weight * np.sum(states[:-1, 10:]**2)
                            + self.input_weight * np.sum((inputs - U_EQ)**2))

    def violation(self, states: np.ndarray, inputs: np.ndarray) -> float:
        """Returns the largest violation of a limit in a history [rad, m/s, rad/s, m/s²]."""
        q, pitch = states[:, 6:10], states[:, 4]
        zeta = states[:, 10:]
        excess = [JOINT_LOWER - q, q - JOINT_UPPER, np.abs(pitch) - PITCH_LIMIT,
                  np.abs(inputs) - self.input_limit,
                  *(np.linalg.norm(zeta[:, part], axis=1) - SPEED_LIMIT for part in SPEEDS)]
        return max(0.0, *(float(np.max(item)) for item in excess))


PROBLEM = Problem(name="ocp-d", start=np.concatenate([CONFIG_START, np.zeros(10)]),
                  task_weight=25.0, velocity_weight=0.5, input_weight=0.05,
                  terminal_velocity_weight=2.5, input_limit=2.0)


@cache
def load_model() -> ContactModel:
    """Returns this package's model of the robot on the spring.

    Its drag has |v| where the specification has √(v² + 10⁻⁴).
    """
    return ContactModel.load(str(ROBOT), check_surface(
        BilateralSpring(stiffness=np.eye(6), equilibrium=CHI_EQ)))
