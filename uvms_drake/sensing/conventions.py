"""Conventions of a robot's measurements, declared once in `signals.yaml`, and their conversion.

Here the world is NED, the vehicle's axes are FRD, the attitude is ZYX Euler angles, and a force
acts on the surface. With C_W and C_B the rotations from the declared axes to these, R the measured
attitude, and v a vector in the body,

    R_WB = C_W R C_Bᵀ,   p_WB = C_W p,   v_B = C_B v.                                           (1)
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RotationMatrix

from uvms_drake.common.constraints import Constraint, OneOf, Vector
from uvms_drake.common.errors import require
from uvms_drake.common.schema import load_file
from uvms_drake.model.end_effector import force_of_tip
from uvms_drake.model.frames.euler import euler_angles, rotation_matrix
from uvms_drake.model.frames.spatial import block_diagonal
from uvms_drake.model.uvms import STANDARD_GRAVITY
from uvms_drake.model.uvms_model import UvmsModel
from uvms_drake.sensing.wrist_sensor import transfer

WORLDS = {"NED": np.eye(3), "ENU": np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])}
"""C_W by the declared axes of the world."""
BODIES = {"FRD": np.eye(3), "FLU": np.diag([1.0, -1.0, -1.0])}
"""C_B by the declared axes of the vehicle."""
TURNS = ("roll", "pitch", "yaw")
Sign = Constraint("1 or -1 each", lambda x: np.abs(x) == 1.0)
TILT = np.deg2rad(15.0)
"""Largest angle between measured and expected gravity at rest [rad]."""
TURNED = np.deg2rad(3.0)
"""Smallest turn about an axis that shows its sense [rad]."""


@dataclass
class Conventions:
    """Conventions of measurements, in SI units and radians."""

    world: Annotated[str, OneOf(*WORLDS)] = "NED"
    """Axes of the world."""
    body: Annotated[str, OneOf(*BODIES)] = "FRD"
    """Axes of the vehicle, of its velocities and of its IMU."""
    attitude: Annotated[str, OneOf("rpy", "wxyz", "xyzw")] = "rpy"
    """ZYX Euler angles (roll, pitch, yaw), or a quaternion in this order, of body in world."""
    velocity: Annotated[str, OneOf("body", "world")] = "body"
    """Axes of the linear velocity; the angular velocity is in body axes."""
    joint_signs: Annotated[np.ndarray, Sign] = field(default_factory=lambda: np.ones(1))
    """1 or −1 for each joint (n,), or (1,) for all: sense of its angle to the model's."""
    joint_offsets: np.ndarray = field(default_factory=lambda: np.zeros(1))
    """Angle of the model where the measured one is zero (n,), or (1,) for all [rad]."""
    force: Annotated[str, OneOf("on_surface", "on_sensor")] = "on_surface"
    """Body that the measured force acts on."""
    mounting: Annotated[np.ndarray, Vector(6)] = field(default_factory=lambda: np.zeros(6))
    """Pose of the force sensor's axes in those of the end-effector [m, rad]."""

    def rotation(self, attitude: np.ndarray) -> np.ndarray:
        """Returns R_WB (3, 3) of a measured attitude (3,) or (4,)."""
        attitude = np.asarray(attitude, dtype=float)
        wxyz = np.roll(attitude, 1) if self.attitude == "xyzw" else attitude
        R = rotation_matrix(attitude) if self.attitude == "rpy" else RotationMatrix(
            Quaternion(wxyz / np.linalg.norm(wxyz))).matrix()
        return np.asarray(WORLDS[self.world] @ R @ BODIES[self.body].T)

    def state(self, position: np.ndarray, attitude: np.ndarray, joints: np.ndarray,
              velocity: np.ndarray, turning: np.ndarray, joint_rates: np.ndarray) -> np.ndarray:
        """Returns (𝔮, ζ) (2(6+n),) by (1), in the order and axes of the model.

        Args:
            position: Origin of the body in the world (3,) [m].
            attitude: Its attitude (3,) [rad] or (4,).
            joints: Angles (n,) [rad].
            velocity: Linear velocity of that origin (3,) [m/s].
            turning: Angular velocity in body axes (3,) [rad/s].
            joint_rates: Rates (n,) [rad/s].
        """
        C_W, C_B, R_WB = WORLDS[self.world], BODIES[self.body], self.rotation(attitude)
        p, v, w = (np.asarray(each, dtype=float) for each in (position, velocity, turning))
        return np.concatenate([
            C_W @ p, euler_angles(R_WB), self.joint_signs * joints + self.joint_offsets,
            C_B @ v if self.velocity == "body" else R_WB.T @ C_W @ v, C_B @ w,
            self.joint_signs * joint_rates])

    def contact_force(self, model: UvmsModel, state: np.ndarray, wrench: np.ndarray) -> np.ndarray:
        """Returns 𝔉_s (6,) of a tared wrench (6,) in the sensor's axes [N, N m].

        Args:
            model: Supplies the pose of the end-effector.
            state: (𝔮, ζ) (2(6+n),).
            wrench: Force and torque about the sensor's origin, without the tool's weight.
        """
        sign = 1.0 if self.force == "on_surface" else -1.0
        force = force_of_tip(model.task_pose(state[: model.size])[:6],
                             sign * transfer(self.mounting) @ wrench)
        return np.asarray(block_diagonal(model.R_WT, np.eye(3)) @ force)

    def wrench(self, tau: np.ndarray) -> np.ndarray:
        """Returns τ_v (6,) in the declared axes of the body, for the wrench (6,) [N, N m]."""
        return np.ravel(tau[:6].reshape(2, 3) @ BODIES[self.body])


def load_conventions(path: str | Path) -> Conventions:
    """Returns the conventions of a file `signals.yaml`, or raises in one line."""
    return load_file(Path(path), Conventions)


def check_frames(conventions: Conventions, time: np.ndarray, attitude: np.ndarray,
                 specific_force: np.ndarray, turning: np.ndarray) -> str:
    """Returns the axes whose sense the samples have shown; raises for one that is contradicted.

    A vehicle starts upright. At rest an accelerometer reads −g, up. And a turn of the attitude
    between the first and the last sample is, for small turns, the integral of the angular velocity.

    Args:
        conventions: The declared conventions.
        time: Times of the samples (K,) [s].
        attitude: Measured attitudes (K, 3) or (K, 4).
        specific_force: Accelerometer in the declared body axes (K, 3) [m/s²].
        turning: Gyro likewise (K, 3) [rad/s].

    Raises:
        InvalidParameter: Gravity or a turn contradict the declared axes.
    """
    C_B, declared = BODIES[conventions.body], f"{conventions.body} in {conventions.world}"
    R = np.array([conventions.rotation(each) for each in attitude])
    up = np.mean(R @ C_B @ np.asarray(specific_force)[..., None], axis=0)[:, 0]
    size = float(np.linalg.norm(up))
    tilt = float(np.arccos(np.clip(-up[2] / max(size, 1e-9), -1.0, 1.0)))
    # The turn by the gyro, and that of the attitude, in axes of the body at the first sample.
    rates = np.asarray(turning) @ C_B.T
    sensed = np.sum(0.5 * (rates[1:] + rates[:-1]) * np.diff(time)[:, None], axis=0)
    turn = RotationMatrix(R[0].T @ R[-1]).ToAngleAxis()
    seen = turn.angle() * turn.axis()
    largest = np.maximum(np.abs(seen), np.abs(sensed))
    for holds, why in (
            (R[0, 2, 2] > 0.0, "the vehicle would be upside down"),
            (tilt < TILT and 0.5 < size / STANDARD_GRAVITY < 1.5, f"at rest the accelerometer has "
             f"{size:.3g} m/s2, {np.rad2deg(tilt):.0f} degrees off up"),
            *((most <= TURNED or abs(by_attitude - by_gyro) < 0.5 * most, f"the attitude turns by "
               f"{by_attitude:.2g} rad in {axis} where the gyro turns by {by_gyro:.2g} rad")
              for axis, by_attitude, by_gyro, most in zip(TURNS, seen, sensed, largest,
                                                          strict=True))):
        require(bool(holds), "signals.yaml", declared, f"other axes: {why}")
    return ", ".join(np.array(TURNS)[largest > TURNED]) or "none but up"
