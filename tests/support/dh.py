"""The Girona 500 with its ARM 5E Micro by the paper's table, written a second time for the tests.

Nothing here comes from the package: a pose is a product of elementary homogeneous matrices.
"""

from collections.abc import Iterator

import numpy as np

# The paper's table: standard Denavit-Hartenberg parameters of links 1 to 4 [m, rad].
A = (0.10, 0.26, 0.09, 0.0)
D = (0.0, 0.0, 0.0, 0.29)
ALPHA = (-np.pi / 2, 0.0, np.pi / 2, 0.0)
ARM_BASE = (0.53, 0.0, 0.36)
LOWER = (-0.52, -0.1471, -1.297, -3.14)
UPPER = (1.46, 1.3114, 0.73, 3.14)


def rotation(axis: str, angle: float) -> np.ndarray:
    """Returns an elementary rotation as a homogeneous matrix (4, 4)."""
    c, s = np.cos(angle), np.sin(angle)
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    X = np.eye(4)
    X[i, i] = X[j, j] = c
    X[i, j], X[j, i] = -s, s
    return X


def translation(x: float, y: float, z: float) -> np.ndarray:
    """Returns a translation as a homogeneous matrix (4, 4)."""
    X = np.eye(4)
    X[:3, 3] = x, y, z
    return X


def vehicle(eta: np.ndarray) -> np.ndarray:
    """Returns the pose of the vehicle in Σ_I (4, 4)."""
    return (translation(*eta[:3]) @ rotation("z", eta[5]) @ rotation("y", eta[4])
            @ rotation("x", eta[3]))


def chain(X_WB: np.ndarray, q: np.ndarray) -> dict[str, np.ndarray]:
    """Returns the poses in Σ_I of vehicle, arm and tip, for a vehicle at X_WB (4, 4)."""
    poses = {"vehicle": X_WB}
    X = poses["arm_base"] = X_WB @ translation(*ARM_BASE)
    for i in range(4):
        X = (X @ rotation("z", q[i]) @ translation(0, 0, D[i]) @ translation(A[i], 0, 0)
             @ rotation("x", ALPHA[i]))
        poses[f"link{i + 1}"] = X
    poses["tip"] = X @ rotation("y", -np.pi / 2)
    return poses


def pose_vector(X: np.ndarray) -> np.ndarray:
    """Returns position and ZYX Euler angles (6,) of a homogeneous matrix."""
    return np.array([*X[:3, 3], np.arctan2(X[2, 1], X[2, 2]), -np.arcsin(X[2, 0]),
                     np.arctan2(X[1, 0], X[0, 0])])


def chi(config: np.ndarray) -> np.ndarray:
    """Returns the end-effector's χ (6,) at 𝔮 (10,)."""
    return pose_vector(chain(vehicle(config[:6]), config[6:])["tip"])


def random_configurations(
    seed: int, count: int, tip_pitch: float = np.pi / 2
) -> Iterator[np.ndarray]:
    """Yields 𝔮 (10,) of any attitude within joint limits, |tip pitch| below `tip_pitch` [rad]."""
    rng = np.random.default_rng(seed)
    while count > 0:
        attitude = rng.uniform([-np.pi, -1.4, -np.pi], [np.pi, 1.4, np.pi])
        config = np.concatenate([rng.normal(size=3), attitude, rng.uniform(LOWER, UPPER)])
        if abs(chi(config)[4]) < tip_pitch:
            count -= 1
            yield config
