"""The paper's coordinates (𝔮, ζ) and Drake's (q, v), and the one map between them.

𝔮 = (x, y, z, φ, θ, ψ, q₁ … q_n): vehicle pose in Σ_I (NED) by ZYX Euler angles, joint angles.
ζ = (ν₁, ν₂, q̇): velocity of the vehicle's origin and angular velocity, both in FRD body axes.

Drake's floating body has a quaternion and position, and velocities (ω_WB_W, v_WBo_W); so
v = T(𝔮) ζ with an orthogonal T, and a generalised force keeps its power: τ_Drake = T(𝔮) τ.
"""

import math

import numpy as np
from pydrake.math import RollPitchYaw

from uvms_drake.common.errors import require
from uvms_drake.model.frames.spatial import cross
from uvms_drake.model.uvms import Uvms


class Coordinates:
    """Map between the paper's order and that of a finalized `MultibodyPlant` with one UVMS."""

    def __init__(self, uvms: Uvms):
        vehicle = uvms.vehicle
        self._attitude = slice(vehicle.floating_positions_start(),
                               vehicle.floating_positions_start() + 4)
        self._position = slice(self._attitude.stop, self._attitude.stop + 3)
        start = vehicle.floating_velocities_start_in_v()
        self._angular = slice(start, start + 3)
        self._linear = slice(start + 3, start + 6)
        self._joint_positions = np.array(
            [joint.position_start() for joint in uvms.joints], dtype=int)
        self._joint_velocities = np.array(
            [joint.velocity_start() for joint in uvms.joints], dtype=int)
        self.num_positions = uvms.plant.num_positions()
        self.num_velocities = uvms.plant.num_velocities()
        self.size = 6 + len(uvms.joints)
        """6 + n, the size of 𝔮 and of ζ."""
        require(self.num_velocities == self.size, "plant", f"{self.num_velocities} velocities",
                f"the UVMS alone, with {self.size}")

    def from_drake(self, state: np.ndarray) -> np.ndarray:
        """Returns (𝔮, ζ) of a plant state (q, v); |θ| ≤ π/2, φ and ψ in (−π, π]."""
        q, v = state[: self.num_positions], state[self.num_positions:]
        R_WB = self._rotation(q)
        (R_xx, *_), (R_yx, *_), (R_zx, R_zy, R_zz) = R_WB.tolist()
        out = np.empty(2 * self.size)
        out[:3] = q[self._position]
        out[3] = math.atan2(R_zy, R_zz)
        out[4] = math.atan2(-R_zx, math.hypot(R_zy, R_zz))
        out[5] = math.atan2(R_yx, R_xx)
        out[6: self.size] = q[self._joint_positions]
        zeta = out[self.size:]
        zeta[:3] = v[self._linear] @ R_WB
        zeta[3:6] = v[self._angular] @ R_WB
        zeta[6:] = v[self._joint_velocities]
        return out

    def to_drake(self, state: np.ndarray) -> np.ndarray:
        """Returns the plant state (q, v) of (𝔮, ζ)."""
        R_WB = RollPitchYaw(state[3:6]).ToRotationMatrix()
        out = np.empty(self.num_positions + self.num_velocities)
        q, v = out[: self.num_positions], out[self.num_positions:]
        q[self._attitude] = R_WB.ToQuaternion().wxyz()
        q[self._position] = state[:3]
        q[self._joint_positions] = state[6: self.size]
        v[:] = self._to_drake_order(R_WB.matrix(), state[self.size:])
        return out

    def vector_to_drake(self, state: np.ndarray, vector: np.ndarray) -> np.ndarray:
        """Returns T(𝔮) w in Drake's order, for a velocity, acceleration or force w (6+n,).

        Args:
            state: Plant state (q, v).
            vector: w in the paper's order; for an acceleration, the part beyond Ṫζ.
        """
        return self._to_drake_order(self._rotation(state[: self.num_positions]), vector)

    def acceleration_from_drake(self, state: np.ndarray, v_dot: np.ndarray) -> np.ndarray:
        """Returns ζ̇ (6+n,) = Tᵀ(v̇ − Ṫζ) of an acceleration v̇ (nv,) in Drake's order.

        ν₁ turns with the vehicle: ν̇₁ = Rᵀ(v̇_WBo − ω × v_WBo), ν̇₂ = Rᵀω̇, all but R in World.

        Args:
            state: Plant state (q, v).
            v_dot: v̇ [rad/s², m/s²].
        """
        q, v = state[: self.num_positions], state[self.num_positions:]
        R_WB = self._rotation(q)
        out = np.empty(self.size)
        out[:3] = (v_dot[self._linear] - cross(v[self._angular], v[self._linear])) @ R_WB
        out[3:6] = v_dot[self._angular] @ R_WB
        out[6:] = v_dot[self._joint_velocities]
        return out

    def _to_drake_order(self, R_WB: np.ndarray, vector: np.ndarray) -> np.ndarray:
        out = np.empty(self.num_velocities)
        out[self._linear] = R_WB @ vector[:3]
        out[self._angular] = R_WB @ vector[3:6]
        out[self._joint_velocities] = vector[6:]
        return out

    def _rotation(self, q: np.ndarray) -> np.ndarray:
        """Returns R_WB (3, 3) of a quaternion of any length but zero, by plain numbers."""
        w, x, y, z = q[self._attitude].tolist()
        s = 2.0 / (w * w + x * x + y * y + z * z)
        return np.array([
            [1.0 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y)],
            [s * (x * y + w * z), 1.0 - s * (x * x + z * z), s * (y * z - w * x)],
            [s * (x * z - w * y), s * (y * z + w * x), 1.0 - s * (x * x + y * y)]])
