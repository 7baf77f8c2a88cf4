"""Outputs y = (η, s) of the law `tip first`: the vehicle's pose, and rows of the extended task.

An arm of n joints can control n rows. Rows that are not named are chosen for the robot: the
position, from six joints on the whole pose, and then the best conditioned rows, with the largest
geometric mean, over postures within the joint ranges, of the smallest singular value of J_sq, the
derivative of s by q, for a level vehicle (then place and heading do not matter). Of rows that
differ by rounding alone, as the tip's roll and a wrist that turns the tool about itself, the later
are taken: a joint's angle. The task of an arm of one or two joints is its joints.
"""

from functools import lru_cache
from itertools import combinations

import numpy as np

from uvms_drake.common.errors import require
from uvms_drake.control.laws.law import Outputs, Pair
from uvms_drake.model.frames.euler import pose_difference
from uvms_drake.model.frames.spatial import cross, times
from uvms_drake.model.uvms_model import UvmsModel, configuration_rate_matrix

POSE = ("x", "y", "z", "roll", "pitch", "yaw")
"""Names of the rows of χ: position in Σ_I and ZYX Euler angles of the end-effector."""
POSTURES = 400
"""Postures at which rows are compared."""
DIGITS = 6
"""Decimals of the mean logarithm by which rows are compared; the others are rounding."""
SINGULAR = 1e-9
"""Smallest singular value of a J_sq that is regular; less is rounding."""


def row_names(num_joints: int) -> tuple[str, ...]:
    """Returns the names of the rows of y = (χ, q): x, y, z, roll, pitch, yaw, q1 ... qn."""
    return (*POSE, *(f"q{j + 1}" for j in range(num_joints)))


@lru_cache(maxsize=16)
def tip_rows(model: UvmsModel, names: tuple[str, ...] = ()) -> np.ndarray:
    """Returns the indices (n,) in y of the tip's task, in ascending order.

    Args:
        model: The robot.
        names: The n rows, of `row_names`; none for those chosen for the robot.

    Raises:
        InvalidParameter: They are not n different rows.
    """
    n, known = model.num_joints, row_names(model.num_joints)
    if not names:
        return best_rows(model)
    right = len(names) == n and len(set(names)) == n and set(names) <= set(known)
    require(right, "ancillary.rows", list(names), f"{n} different ones, for {n} joints, of "
            f"{', '.join(known)}; or none, for the best")
    return np.sort([known.index(name) for name in names])


def best_rows(model: UvmsModel) -> np.ndarray:
    """Returns the indices (n,) in y of the default rows of a robot."""
    n = model.num_joints
    if n < 3:
        return np.arange(6, 6 + n)
    first = 3 if n < 6 else 6
    config = np.zeros((POSTURES, 6 + n))
    config[:, 6:] = np.random.default_rng(0).uniform(
        *model.joint_range(), (POSTURES, n))
    by_joints = model.tip_kinematics(config).J_chi[..., 6:]
    J_q = np.concatenate([by_joints, np.broadcast_to(np.eye(n), (POSTURES, n, n))], axis=1)

    def quality(rows: np.ndarray) -> float:
        smallest = np.linalg.svd(J_q[:, rows], compute_uv=False)[:, -1]
        return float(np.mean(np.log(np.maximum(smallest, SINGULAR))))

    return max((np.array([*range(first), *more])
                for more in combinations(range(first, 6 + n), n - first)),
               key=lambda rows: (round(quality(rows), DIGITS), *rows))


ROLL, PITCH = 3, 4
"""Indices of φ and θ in 𝔮, and of their rates in η̇."""


def outputs_of(now: Pair, rows: np.ndarray) -> Outputs:
    """Returns the outputs of a pair of motions; `rows` (n,) are the tip's in (χ, q)."""
    error = pose_difference(*now.config)[:6], pose_difference(*now.y)[rows]
    rate, J, bias = vehicle_motion(now.config, now.zeta)
    J_s = now.J_x[..., rows, :]
    return Outputs(
        np.concatenate(error), np.concatenate([rate, times(J_s, now.zeta)], axis=-1),
        np.concatenate([J, J_s], axis=-2),
        np.concatenate([bias, times(now.J_x_dot[..., rows, :], now.zeta)], axis=-1))


def vehicle_motion(config: np.ndarray, zeta: np.ndarray
                   ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns η̇ (..., 6), J_η (..., 6, 6+n) with η̇ = J_η ζ, and J̇_η ζ (..., 6).

    Real or complex. With η̇ = (Rν₁, Tν₂), J̇_η ζ = (R(ν₂ × ν₁), Ṫν₂).
    """
    Gamma = configuration_rate_matrix(config)[..., :6, :]
    rate, nu1, nu2 = times(Gamma, zeta), zeta[..., :3], zeta[..., 3:6]
    sin, cos = np.sin(config[..., 3:6]), np.cos(config[..., 3:6])
    sin_phi, cos_phi = sin[..., 0], cos[..., 0]
    tan, sec = np.tan(config[..., PITCH]), 1.0 / cos[..., 1]
    roll_rate, pitch_rate = rate[..., ROLL], rate[..., PITCH]
    across = cos_phi * nu2[..., 1] - sin_phi * nu2[..., 2]  # θ̇
    about = sin_phi * nu2[..., 1] + cos_phi * nu2[..., 2]  # ψ̇ cos θ
    turned = times(Gamma[..., :3, :3], cross(nu2, nu1))
    bias = np.stack([
        tan * across * roll_rate + about * sec**2 * pitch_rate, -about * roll_rate,
        sec * across * roll_rate + about * sec * tan * pitch_rate], axis=-1)
    return rate, Gamma, np.concatenate([turned, bias], axis=-1)
