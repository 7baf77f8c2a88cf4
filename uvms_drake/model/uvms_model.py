"""The prediction model: kinematics and underwater dynamics of a UVMS as functions of arrays.

It holds the numbers of a `MultibodyPlant` and of a hydrodynamics file (`Links`), not the plant:
every function takes stacks of any leading shape, so that a whole prediction horizon is one call,
and complex numbers, so that a derivative is one more call (see `euler`).

    M(𝔮) ζ̇ + C(𝔮, ζ) ζ + D(𝔮, ζ) ζ + g(𝔮) + J(𝔮)ᵀ𝔉 = τ                          (eq:dynamics)

A rigid body with added mass is a body with a general 6×6 inertia I = M_RB + M_A, and its equation
of motion in its own axes is f = I ν̇ + ν ×* I ν (Kirchhoff; Fossen 2021, §6.3 and §8.1). With the
links' Jacobians Jₖ (Vₖ = Jₖ ζ) the whole chain follows from virtual power: τ = Σ Jₖᵀ fₖ.

χ has the position of the tip in Σ_I and its ZYX Euler angles about the axes of Σ_T, the frame of
the task: R_TE = R_TW R_WE. The paper's Σ_T is Σ_I, where a tool that points straight down is at the
angles' singularity; where x of Σ_T is the direction into the surface, a floor is like a wall.
χ̇ = blkdiag(R_WE, T(𝔬)) V_E either way, since T takes the angular velocity in axes of Σ_E.

The water is still. All links hang on the vehicle's frame B, axes FRD. The screws of the joints are
vectors (v, ω) in axes of B about its origin (Fossen's order); Xₖ takes such a vector to link k.
"""

from typing import NamedTuple

import numpy as np

from uvms_drake.model.end_effector import pose_rate_matrix, pose_rate_matrix_rate
from uvms_drake.model.frames import euler
from uvms_drake.model.frames.spatial import (
    block_diagonal,
    cross,
    cross_force,
    cross_motion,
    motion_matrix,
    times,
)
from uvms_drake.model.links import read_links
from uvms_drake.model.robot import Robot
from uvms_drake.model.uvms import Uvms


class Kinematics(NamedTuple):
    """Geometry at a configuration; the last link has the frame of the end-effector, Σ_E."""

    R_WB: np.ndarray
    """(..., 3, 3) attitude of the vehicle."""
    chi: np.ndarray
    """(..., 6) χ = (𝔭, 𝔬): position in Σ_I, Euler angles about Σ_T."""
    A_E: np.ndarray
    """(..., 6, 6) A(𝔬) = blkdiag(R_WE, T(𝔬)): χ̇ = A V_E."""
    R_BL: np.ndarray
    """(..., n+1, 3, 3) attitude of every link in the vehicle's frame."""
    p_BL: np.ndarray
    """(..., n+1, 3) origin of every link in the vehicle's frame [m]."""
    axis: np.ndarray
    """(..., n, 3) joint axes in the vehicle's frame."""
    anchor: np.ndarray
    """(..., n, 3) a point on each joint axis in the vehicle's frame [m]."""
    screw: np.ndarray
    """(..., n, 6) sⱼ = (anchor × axis, axis); (axis, 0) of a prismatic joint."""
    J_links: np.ndarray
    """(..., n+1, 6, 6+n) Jₖ: velocity of link k in its own axes by ζ; Xₖ is its first columns."""
    J_chi: np.ndarray
    """(..., 6, 6+n) the paper's J(𝔮): χ̇ = J ζ."""

    def at(self, index: int) -> "Kinematics":
        """Returns the geometry at one configuration of a stack, or at one stack of several."""
        return Kinematics(*(item[index] for item in self))


class TipKinematics(NamedTuple):
    """Geometry of the end-effector at a configuration, without that of the other links."""

    chi: np.ndarray
    """(..., 6) χ, as of `Kinematics`."""
    A_E: np.ndarray
    """(..., 6, 6) A(𝔬), likewise."""
    J_chi: np.ndarray
    """(..., 6, 6+n) J(𝔮), likewise."""


class UvmsModel:
    """Kinematics and dynamics of a UVMS in still water.

    It has no contact, or a given force 𝔉; a `ContactModel` includes the surface.

    Args:
        uvms: The robot and its water.
        task_frame: ZYX Euler angles of Σ_T in Σ_I (3,) [rad]; zero is the paper's.
    """

    def __init__(self, uvms: Uvms, task_frame: np.ndarray = euler.WORLD):
        self.num_joints = n = len(uvms.joints)
        self.size = 6 + n
        """Size 6 + n of 𝔮 and of ζ."""
        self.q_lower = np.array([joint.position_lower_limits()[0] for joint in uvms.joints])
        self.q_upper = np.array([joint.position_upper_limits()[0] for joint in uvms.joints])
        self.joint_speed = np.array([joint.velocity_upper_limits()[0] for joint in uvms.joints])
        """Largest rates of the joints by the file (n,) [rad/s, m/s]."""
        self.joint_effort = np.array([
            np.inf if (motor := uvms.motor(joint)) is None else motor.effort_limit()
            for joint in uvms.joints])
        """Largest torques of their motors by the file (n,) [N m, N]; infinite without one."""
        self.links = read_links(uvms)
        """Geometry, inertia and drag of the links."""
        self.slides = self.links.slides
        """Whether a joint is prismatic, its coordinate a length (n,)."""
        self._sliding = [int(j) for j in np.flatnonzero(self.slides)]
        self.gravity: np.ndarray = uvms.plant.gravity_field().gravity_vector()
        """g in Σ_I (3,) [m/s²]."""
        self.R_WT = euler.rotation_matrix(np.asarray(task_frame, dtype=float))
        """Attitude of Σ_T in Σ_I (3, 3)."""
        self._own_frame = bool(np.any(task_frame))
        self.thrusters = uvms.thrusters
        """Parameters of the thrusters, if known."""
        self._joint_rows = np.eye(self.size)[6:]
        # 1 where joint j moves link k (n+1, n).
        self._moves = (np.arange(n) < np.arange(n + 1)[:, None]).astype(float)
        self._beyond = beyond_columns(n)
        self._rotor_inertia = np.concatenate([np.zeros(6), self.links.rotor_inertia])
        self._rotor_matrix = np.diag(self._rotor_inertia)
        self._joint_damping = np.concatenate([np.zeros(6), self.links.joint_damping])

    # Kinematics

    def joint_range(self) -> tuple[np.ndarray, np.ndarray]:
        """Returns the smallest and largest joint coordinates (n,) to look at [rad, m].

        They are the joints' own limits, beyond ±π too. A joint without any is looked at for half a
        turn either way of zero, one with a single limit for a turn from there.
        """
        lower, upper = self.q_lower, self.q_upper
        below, above = np.isfinite(lower), np.isfinite(upper)
        return (np.where(below, lower, np.where(above, upper - 2.0 * np.pi, -np.pi)),
                np.where(above, upper, np.where(below, lower + 2.0 * np.pi, np.pi)))

    def kinematics(self, config: np.ndarray) -> Kinematics:
        """Returns the geometry at 𝔮 (..., 6+n)."""
        X_BL = self._chain(config[..., 6:])
        R_WB, R_WE, chi = self._tip(config, X_BL[..., -1, :3, :])
        A_E = pose_rate_matrix(R_WE, chi[..., 3:])
        R_BL, p_BL = X_BL[..., :3, :3], X_BL[..., :3, 3]
        axis, anchor, screw = self._screws(X_BL)
        J_links = self._link_jacobians(R_BL, p_BL, screw, self._moves)
        J_chi = A_E @ J_links[..., -1, :, :]
        return Kinematics(R_WB, chi, A_E, R_BL, p_BL, axis, anchor, screw, J_links, J_chi)

    def tip_kinematics(self, config: np.ndarray) -> TipKinematics:
        """Returns the geometry of the end-effector alone at 𝔮 (..., 6+n), equal to `kinematics`.

        It is half the work on a large stack.
        """
        X_BL = self._chain(config[..., 6:])
        _, R_WE, chi = self._tip(config, X_BL[..., -1, :3, :])
        A_E = pose_rate_matrix(R_WE, chi[..., 3:])
        tip, (_, _, screw) = X_BL[..., -1:, :3, :], self._screws(X_BL)
        J_E = self._link_jacobians(tip[..., :3], tip[..., 3], screw, self._moves[-1:])
        return TipKinematics(chi, A_E, A_E @ J_E[..., 0, :, :])

    def _screws(self, X_BL: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Returns axes, anchors (..., n, 3) and screws (..., n, 6) of the joints in B."""
        joints = X_BL[..., :-1, :, :] @ self.links.joint_axis
        axis, anchor = joints[..., :3, 0], joints[..., :3, 1]
        screw = np.concatenate([cross(anchor, axis), axis], axis=-1)
        for j in self._sliding:
            screw[..., j, :3], screw[..., j, 3:] = axis[..., j, :], 0.0
        return axis, anchor, screw

    def _chain(self, angles: np.ndarray) -> np.ndarray:
        """Returns the links' poses X_BL (..., n+1, 4, 4) at the joints' q (..., n)."""
        fixed, by_sin, by_cos, by_length = self.links.step
        step = (fixed + np.sin(angles)[..., None, None] * by_sin
                + np.cos(angles)[..., None, None] * by_cos)
        for j in self._sliding:
            step[..., j, :, :] += angles[..., j, None, None] * by_length[j]
        X_BL = np.empty((*angles.shape[:-1], self.num_joints + 1, 4, 4), dtype=step.dtype)
        X_BL[..., 0, :, :] = self.links.X_BV
        for j in range(self.num_joints):
            np.matmul(X_BL[..., j, :, :], step[..., j, :, :], out=X_BL[..., j + 1, :, :])
        return X_BL

    def _tip(self, config: np.ndarray, X_BE: np.ndarray
             ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Returns R_WB, R_WE (..., 3, 3) and χ (..., 6); X_BE is (..., 3, 4)."""
        R_WB = euler.rotation_matrix(config[..., 3:6])
        X = R_WB @ X_BE
        R_TE = self.R_WT.T @ X[..., :3] if self._own_frame else X[..., :3]
        chi = np.concatenate([config[..., :3] + X[..., 3], euler.euler_angles(R_TE)], axis=-1)
        return R_WB, X[..., :3], chi

    def _link_jacobians(
        self, R_BL: np.ndarray, p_BL: np.ndarray, screw: np.ndarray, moves: np.ndarray
    ) -> np.ndarray:
        """Returns Jₖ = Xₖ [I, s₁ … sₖ, 0] (..., links, 6, 6+n), Xₖ = [R_LB −R_LB S(p_BL); 0 R_LB].

        `moves` (links, n) is 1 where joint j moves link k.
        """
        R_LB = R_BL.swapaxes(-1, -2)
        J = np.zeros((*p_BL.shape[:-1], 6, self.size), dtype=R_BL.dtype)
        J[..., :3, :3] = J[..., 3:, 3:6] = R_LB
        J[..., :3, 3:6] = cross(p_BL[..., None, :], R_LB)
        J[..., 6:] = (J[..., :6] @ screw.swapaxes(-1, -2)[..., None, :, :]
                      ) * moves[:, None, :]
        return J

    def task_pose(self, config: np.ndarray) -> np.ndarray:
        """Returns the extended task y = (χ, q) (..., 6+n) at 𝔮 (..., 6+n)."""
        _, _, chi = self._tip(config, self._chain(config[..., 6:])[..., -1, :3, :])
        return np.concatenate([chi, config[..., 6:]], axis=-1)

    def task_jacobian(self, config: np.ndarray) -> np.ndarray:
        """Returns J_x (..., 6+n, 6+n) = [J(𝔮); 0 I] with ẏ = J_x ζ."""
        return self.extended(self.tip_kinematics(config).J_chi)

    def extended(self, J_chi: np.ndarray) -> np.ndarray:
        """Returns J_x (..., 6+n, 6+n) = [J; 0 I] of J (..., 6, 6+n)."""
        J_x = np.empty((*J_chi.shape[:-2], self.size, self.size), dtype=J_chi.dtype)
        J_x[..., :6, :] = J_chi
        J_x[..., 6:, :] = self._joint_rows
        return J_x

    def inverse_extended(self, J_chi: np.ndarray) -> np.ndarray:
        """Returns J_x⁻¹ = [J_v⁻¹ −J_v⁻¹J_q; 0 I] (..., 6+n, 6+n) of J = [J_v J_q], real."""
        inverse = np.linalg.inv(J_chi[..., :6])
        J_x = self.extended(J_chi)
        J_x[..., :6, :6], J_x[..., :6, 6:] = inverse, -(inverse @ J_chi[..., 6:])
        return J_x

    def task_motion(
        self, config: np.ndarray, zeta: np.ndarray, kinematics: Kinematics | None = None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Returns y (..., 6+n), J_x (..., 6+n, 6+n) and J̇_x along 𝔮̇ = Γ(𝔮)ζ.

        `kinematics` is the geometry at 𝔮, if it is known already.
        """
        kinematics = kinematics or self.kinematics(config)
        y = np.concatenate([kinematics.chi, config[..., 6:]], axis=-1)
        return y, self.extended(kinematics.J_chi), self.task_jacobian_rate(kinematics, zeta)

    def task_jacobian_rate(self, kinematics: Kinematics, zeta: np.ndarray) -> np.ndarray:
        """Returns J̇_x (..., 6+n, 6+n) along 𝔮̇ = Γ(𝔮)ζ.

        J = A J_E, and a column cⱼ of J_E, the motion of joint j or of the vehicle in axes of Σ_E,
        is carried along by the joints beyond it, as these see it: ċⱼ = −Σ cᵢq̇ᵢ × cⱼ, i > j.
        """
        J_E = kinematics.J_links[..., -1, :, :]
        from_tip = (J_E[..., 6:] * zeta[..., None, 6:]) @ self._beyond
        J_E_rate = _columns(cross_motion(_columns(J_E), _columns(from_tip)))
        A_E_rate = pose_rate_matrix_rate(kinematics.A_E, times(J_E[..., 3:, :], zeta))
        J_x_rate = np.zeros((*zeta.shape, self.size), dtype=J_E_rate.dtype)
        J_x_rate[..., :6, :] = A_E_rate @ J_E + kinematics.A_E @ J_E_rate
        return J_x_rate

    def configuration(self, y: np.ndarray) -> np.ndarray:
        """Returns 𝔮 (..., 6+n) of the extended task y (..., 6+n), angles in (−π, π].

        The vehicle is where the arm has the end-effector at χ: X_WB = X_WE X_BE(q)⁻¹.
        """
        config = np.zeros_like(y)
        config[..., 6:] = y[..., 6:]
        X_BE = self._chain(config[..., 6:])[..., -1, :, :]
        R_BE, p_BE = X_BE[..., :3, :3], X_BE[..., :3, 3]
        R_TB = euler.rotation_matrix(y[..., 3:6]) @ R_BE.swapaxes(-1, -2)
        R_WB = self.R_WT @ R_TB if self._own_frame else R_TB
        config[..., :3] = y[..., :3] - times(R_WB, p_BE)
        config[..., 3:6] = euler.euler_angles(R_WB)
        return config

    # Dynamics

    def _link_velocities(self, kinematics: Kinematics, zeta: np.ndarray) -> np.ndarray:
        """Returns the velocities V_B (..., n+1, 6) of the links about the origin of B, in B."""
        return zeta[..., None, :6] + self._moves @ (kinematics.screw * zeta[..., 6:, None])

    def _motion(self, kinematics: Kinematics, zeta: np.ndarray, zeta_dot: np.ndarray) -> "_Motion":
        """Returns the motion of the links; a joint's screw moves with the link beyond it."""
        screw, q_dot, q_ddot = kinematics.screw, zeta[..., 6:, None], zeta_dot[..., 6:, None]
        V_B = self._link_velocities(kinematics, zeta)
        screw_rate = cross_motion(V_B[..., 1:, :], screw)
        A_B = zeta_dot[..., None, :6] + self._moves @ (screw * q_ddot + screw_rate * q_dot)
        X = kinematics.J_links[..., :6]
        g_B = self.gravity @ kinematics.R_WB
        g = (g_B[..., None, None, :] @ kinematics.R_BL)[..., 0, :]
        return _Motion(V_B, A_B, screw_rate, times(X, V_B), times(X, A_B), g)

    def contact_force(self, kinematics: Kinematics, V_E: np.ndarray) -> np.ndarray:
        """Returns 𝔉 (..., 6) that the end-effector exerts at its velocity V_E (..., 6): none."""
        return np.zeros_like(V_E)

    def contact_gradients(self, kinematics: Kinematics, V_E: np.ndarray
                          ) -> tuple[np.ndarray, np.ndarray]:
        """Returns the derivatives (..., 6, 6) of A(𝔬)ᵀ𝔉 by V_E and along motions, as of `tip`."""
        return np.zeros((*V_E.shape, 6)), np.zeros((*V_E.shape, 6))

    def _forces(self, kinematics: Kinematics, motion: "_Motion", contact: np.ndarray | None = None
                ) -> np.ndarray:
        """Returns fₖ (..., n+1, 6), the force that moves link k so, against water and contact."""
        force = self.links.links_force(motion.V, motion.A, motion.g)
        if contact is None:
            contact = self.contact_force(kinematics, motion.V[..., -1, :])
        force[..., -1, :] += (contact[..., None, :] @ kinematics.A_E)[..., 0, :]
        return force

    def inverse_dynamics(
        self, kinematics: Kinematics, zeta: np.ndarray, zeta_dot: np.ndarray,
        contact: np.ndarray | None = None,
    ) -> np.ndarray:
        """Returns τ (..., 6+n), the generalised force at which ζ̇ is the acceleration.

        Args:
            kinematics: The geometry at 𝔮.
            zeta: ζ (..., 6+n).
            zeta_dot: ζ̇ (..., 6+n).
            contact: 𝔉 (..., 6), if not that of `contact_force`.
        """
        force = self._forces(kinematics, self._motion(kinematics, zeta, zeta_dot), contact)
        row = force.reshape(*force.shape[:-2], 1, -1)
        tau = (row @ _stacked(kinematics.J_links))[..., 0, :]
        return tau + self._joint_damping * zeta + self._rotor_inertia * zeta_dot

    def mass_matrix(self, kinematics: Kinematics) -> np.ndarray:
        """Returns M (..., 6+n, 6+n) = Σ Jₖᵀ Iₖ Jₖ with added mass and reflected joint inertia."""
        J = kinematics.J_links
        return (_stacked(J).swapaxes(-1, -2) @ _stacked(self.links.inertia @ J)
                + self._rotor_matrix)

    def mass_matrix_rates(self, kinematics: Kinematics) -> np.ndarray:
        """Returns the derivatives ∂M/∂qⱼ (..., n, 6+n, 6+n) by the joints, real.

        Seen from the links beyond joint j, the screws before it turn: ∂sᵢ = −sⱼ × sᵢ. With these
        columns Dⱼ in axes of B and the sum over those links, ∂M = Dⱼᵀ Σ Xₖᵀ Iₖ Jₖ + its transpose.
        """
        J, screw = kinematics.J_links, kinematics.screw
        carried = J[..., :6].swapaxes(-1, -2) @ (self.links.inertia @ J)
        beyond = np.cumsum(carried[..., :0:-1, :, :], axis=-3)[..., ::-1, :, :]
        screws = np.concatenate(
            [np.broadcast_to(np.eye(6), (*screw.shape[:-2], 6, 6)), _columns(screw)], axis=-1)
        D = -(motion_matrix(screw) @ screws[..., None, :, :]) * self._beyond[:, None, :]
        rates = D.swapaxes(-1, -2) @ beyond
        return rates + rates.swapaxes(-1, -2)

    def drift(self, config: np.ndarray, zeta: np.ndarray, contact: np.ndarray | None = None
              ) -> np.ndarray:
        """Returns f (..., 6+n) of (eq:func_h): the acceleration at τ = 0.

        `contact` is 𝔉 (..., 6), if not that of `contact_force`.
        """
        return self.drift_and_inertia(self.kinematics(config), zeta, contact)[0]

    def drift_and_inertia(
        self, kinematics: Kinematics, zeta: np.ndarray, contact: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Returns f (..., 6+n), as of `drift`, at a known geometry, and M (..., 6+n, 6+n)."""
        M = self.mass_matrix(kinematics)
        bias = self.inverse_dynamics(kinematics, zeta, np.zeros_like(zeta), contact)
        return -np.linalg.solve(M, bias[..., None])[..., 0], M

    def drift_derivatives(
        self, config: np.ndarray, zeta: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Returns f (..., 6+n), ∂f/∂𝔮 and ∂f/∂ζ (..., 6+n, 6+n), real."""
        kinematics = self.kinematics(config)
        inverse = np.linalg.inv(self.mass_matrix(kinematics))
        f = -times(inverse, self.inverse_dynamics(kinematics, zeta, np.zeros_like(zeta)))
        return f, *self.drift_gradients(config, zeta, f, kinematics, inverse)

    def drift_gradients(
        self, config: np.ndarray, zeta: np.ndarray, f: np.ndarray, kinematics: Kinematics,
        inverse_mass: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Returns ∂f/∂𝔮 and ∂f/∂ζ (..., 6+n, 6+n), real, at a known drift f, geometry and M⁻¹.

        From M f + b = 0: ∂f = −M⁻¹ ∂(M ζ̇ + b) at ζ̇ = f held fixed, so no derivative of M⁻¹ is
        needed. A change of 𝔮 moves the vehicle in its own axes by Γ(𝔮)⁻¹ d𝔮.
        """
        rates = self.inverse_dynamics_derivatives(kinematics, zeta, f)
        rates[..., :6] = rates[..., :6] @ block_diagonal(
            kinematics.R_WB.swapaxes(-1, -2), euler.inverse_rate_matrix(config[..., 3:6]))
        derivatives = -(inverse_mass @ rates)
        return derivatives[..., : self.size], derivatives[..., self.size:]

    def inverse_dynamics_derivatives(
        self, kinematics: Kinematics, zeta: np.ndarray, zeta_dot: np.ndarray
    ) -> np.ndarray:
        """Returns ∂τ along motions and by ζ (..., 6+n, 2(6+n)) of `inverse_dynamics`, real.

        The first 6 + n columns are for a displacement of the vehicle along each of its own axes and
        of each joint, as by ζ dt.

        It is the closed form of Singh, Russell and Wensing (2022), "Efficient analytical
        derivatives of rigid-body dynamics using spatial vector algebra". A joint i carries all
        links beyond it. In the axes of such a link, a change of qᵢ changes V by ṡᵢ = Vᵢ × sᵢ and A
        by s̈ᵢ + ṡᵢ × V, with s̈ᵢ = Aᵢ × sᵢ + Vᵢ × ṡᵢ, and moves the link by sᵢ relative to gravity
        and to the surface. With N and K of `Links.force_gradients` and of the surface,

            ∂f = N ṡᵢ + I s̈ᵢ + K sᵢ  by qᵢ,   ∂f = N sᵢ + 2 I ṡᵢ  by q̇ᵢ;
            ∂f = K e  along e,            ∂f = N e + I (V₀ × e)  by ζ of the vehicle.

        In axes of B, moreover, f and the screws beyond joint i have turned with it, which changes
        their power fᵀsⱼ on inner joints and the vehicle only, by (sⱼ × sᵢ)ᵀ Σ f for j ≤ i.
        """
        size, J, screw = self.size, kinematics.J_links, kinematics.screw
        motion = self._motion(kinematics, zeta, zeta_dot)
        # ∂f by the velocity and by a displacement of each link; the surface acts on the last one.
        N, K = self.links.force_gradients(motion.V, motion.g)
        by_velocity, by_motion = self.contact_gradients(kinematics, motion.V[..., -1, :])
        N[..., -1, :, :] += by_velocity
        K[..., -1, :, :] += by_motion

        # The joints' second screw rates, then the motions that a change of qᵢ or q̇ᵢ gives a link.
        second = (cross_motion(motion.A_B[..., 1:, :], screw)
                  + cross_motion(motion.V_B[..., 1:, :], motion.screw_rate))  # s̈
        # V₀ × e of the vehicle, 2 ṡ and s̈ of the joints that move the link, in its axes.
        rates = J[..., :6] @ np.concatenate(
            [motion_matrix(zeta[..., :6]), 2.0 * _columns(motion.screw_rate), _columns(second)],
            axis=-1)[..., None, :, :]
        rates[..., 6:] *= np.tile(self._moves, 2)[:, None, :]
        carried = self.links.inertia @ rates
        # ∂f of every link; `rates` has 2 ṡ, of which qᵢ takes half.
        change = np.concatenate([K @ J, N @ J + carried[..., :size]], axis=-1)
        change[..., 6:size] += 0.5 * N @ rates[..., 6:size] + carried[..., size:]

        # Virtual power: Jᵀ ∂f, and the power of f on screws that have turned.
        out = _stacked(J).swapaxes(-1, -2) @ _stacked(change)
        out[..., 6:size] += self._turned(kinematics, self._forces(kinematics, motion))
        out[..., size:] += np.diag(self._joint_damping)
        return out

    def _turned(self, kinematics: Kinematics, force: np.ndarray) -> np.ndarray:
        """Returns (sⱼ × sᵢ)ᵀ Σ f (..., 6+n, n) in row j ≤ i, the sum over the links beyond i."""
        screw = kinematics.screw
        force_B = (force[..., None, :] @ kinematics.J_links[..., :6])[..., 0, :]
        turned = cross_force(screw, self._moves.T @ force_B)
        return _columns(np.concatenate([turned, np.tril(turned @ _columns(screw))], axis=-1))

    def equilibrium_input(self, config: np.ndarray) -> np.ndarray:
        """Returns u_eq = −f(𝔮, 0) (..., 6+n), the input that holds 𝔮 at rest."""
        return -self.drift(config, np.zeros_like(config))


def beyond_columns(n: int) -> np.ndarray:
    """Returns 1 where joint i is beyond a column of J_E, the vehicle's or joint j's (n, 6+n)."""
    return np.concatenate([np.ones((n, 6)), np.tri(n, k=-1)], axis=-1)


def read_uvms(model: str) -> Uvms:
    """Returns a shipped robot or a robot's folder, in a plant of its own."""
    return Robot.load(model).uvms


def configuration_rate(config: np.ndarray, zeta: np.ndarray) -> np.ndarray:
    """Returns 𝔮̇ = Γ(𝔮) ζ (..., 6+n), Γ = blkdiag(𝔍₁, 𝔍₂, I) (eq:kin)."""
    rpy = config[..., 3:6]
    linear = times(euler.rotation_matrix(rpy), zeta[..., :3])
    angular = times(euler.rate_matrix(rpy), zeta[..., 3:6])
    return np.concatenate([linear, angular, zeta[..., 6:]], axis=-1)


def configuration_rate_matrix(config: np.ndarray) -> np.ndarray:
    """Returns Γ(𝔮) (..., 6+n, 6+n)."""
    size = config.shape[-1]
    Gamma = np.zeros((*config.shape, size), dtype=config.dtype)
    Gamma[..., :3, :3] = euler.rotation_matrix(config[..., 3:6])
    Gamma[..., 3:6, 3:6] = euler.rate_matrix(config[..., 3:6])
    Gamma[..., range(6, size), range(6, size)] = 1.0
    return Gamma


class _Motion(NamedTuple):
    """Motion of the links, in B about its origin and each in its own axes."""

    V_B: np.ndarray
    """(..., n+1, 6) velocities in B."""
    A_B: np.ndarray
    """(..., n+1, 6) accelerations in B."""
    screw_rate: np.ndarray
    """(..., n, 6) ṡⱼ = Vⱼ × sⱼ in B."""
    V: np.ndarray
    """(..., n+1, 6) velocities."""
    A: np.ndarray
    """(..., n+1, 6) accelerations."""
    g: np.ndarray
    """(..., n+1, 3) gravity [m/s²]."""


def _stacked(matrices: np.ndarray) -> np.ndarray:
    """Returns the links' matrices (..., n+1, 6, c) one below the other, (..., 6(n+1), c)."""
    *stack, links, rows, columns = matrices.shape
    return matrices.reshape(*stack, links * rows, columns)


def _columns(vectors: np.ndarray) -> np.ndarray:
    """Returns vectors (..., n, 6) as the columns of a matrix (..., 6, n)."""
    return vectors.swapaxes(-1, -2)
