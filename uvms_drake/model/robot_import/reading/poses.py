"""Poses as 4×4 matrices, X_AB: of frame B in frame A."""

import numpy as np


def rpy_matrix(rpy: np.ndarray) -> np.ndarray:
    """Returns R (3, 3) = R_z(yaw) R_y(pitch) R_x(roll), as URDF and SDFormat have it [rad]."""
    (sr, sp, sy), (cr, cp, cy) = np.sin(rpy), np.cos(rpy)
    return np.array([
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr]])


def matrix_rpy(R: np.ndarray) -> np.ndarray:
    """Returns the angles (3,) of `rpy_matrix` [rad]; at a pitch of ±π/2 yaw is zero."""
    pitch = np.arctan2(-R[2, 0], np.hypot(R[0, 0], R[1, 0]))
    if np.hypot(R[0, 0], R[1, 0]) < 1e-9:
        return np.array([np.arctan2(-R[1, 2], R[1, 1]), pitch, 0.0])
    return np.array([np.arctan2(R[2, 1], R[2, 2]), pitch, np.arctan2(R[1, 0], R[0, 0])])


def quaternion_matrix(xyzw: np.ndarray) -> np.ndarray:
    """Returns R (3, 3) of a quaternion (x, y, z, w), of any length."""
    x, y, z, w = xyzw / np.linalg.norm(xyzw)
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])


def pose(position: np.ndarray, R: np.ndarray | None = None) -> np.ndarray:
    """Returns X (4, 4) of a position [m] and an attitude."""
    X = np.eye(4)
    X[:3, 3] = position
    if R is not None:
        X[:3, :3] = R
    return X


def inverse(X: np.ndarray) -> np.ndarray:
    """Returns X⁻¹ (4, 4)."""
    return pose(-X[:3, :3].T @ X[:3, 3], X[:3, :3].T)


def along(kind: str, axis: np.ndarray, value: float) -> np.ndarray:
    """Returns the motion (4, 4) of a joint by a value [rad, m]: about its axis, or along it."""
    axis = axis / np.linalg.norm(axis)
    if kind == "prismatic":
        return pose(value * axis)
    x, y, z = axis
    S = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return pose(np.zeros(3), np.eye(3) + np.sin(value) * S + (1.0 - np.cos(value)) * S @ S)
