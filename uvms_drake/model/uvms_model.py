"""The prediction model: kinematics and underwater dynamics of a UVMS as functions of arrays.

It holds the numbers of a `MultibodyPlant` and of a hydrodynamics file, not the plant: every
function takes stacks of any leading shape, so that a whole prediction horizon is one call, and
complex numbers, so that a derivative is one more call (see `euler`).

    M(𝔮) ζ̇ + C(𝔮, ζ) ζ + D(𝔮, ζ) ζ + g(𝔮) + J(𝔮)ᵀ𝔉(χ, χ̇) = τ                    (eq:dynamics)

A rigid body with added mass is a body with a general 6×6 inertia I = M_RB + M_A, and its equation
of motion in its own axes is f = I ν̇ + ν ×* I ν (Kirchhoff; Fossen 2021, §6.3 and §8.1). With body
Jacobians Jᵢ (νᵢ = Jᵢ ζ) the whole chain follows from virtual power: τ = Σ Jᵢᵀ fᵢ.

The water is still. All bodies hang on the vehicle's frame B, axes FRD.
"""

from typing import NamedTuple

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import RevoluteJoint, RigidBody

from uvms_drake.model.contact import SurfaceLaw
from uvms_drake.model.description import Uvms, add_uvms
from uvms_drake.model.euler import euler_angles, rate_matrix, rotation_matrix
from uvms_drake.model.hydrodynamics_data import BodyHydrodynamics, added_mass_about_origin
from uvms_drake.model.spatial import cross, cross_force, cross_motion, skew

COMPLEX_STEP = 1e-30
"""h of the complex step: there is no difference, so it can be arbitrarily small."""


class Kinematics(NamedTuple):
    """Geometry at a configuration; the last body is the end-effector's frame Σ_E."""

    R_WB: np.ndarray
    """(..., 3, 3) attitude of the vehicle."""
    chi: np.ndarray
    """(..., 6) χ = (𝔭, 𝔬)."""
    R_BL: np.ndarray
    """(..., b, 3, 3) attitude of every body in the vehicle's frame."""
    p_BL: np.ndarray
    """(..., b, 3) origin of every body in the vehicle's frame [m]."""
    axis: np.ndarray
    """(..., n, 3) joint axes in the vehicle's frame."""
    anchor: np.ndarray
    """(..., n, 3) a point on each joint axis in the vehicle's frame [m]."""
    J_bodies: np.ndarray
    """(..., b, 6, 6+n) Jᵢ: velocity of body i in its own axes, Fossen's order, by ζ."""
    J_chi: np.ndarray
    """(..., 6, 6+n) the paper's J(𝔮): χ̇ = J ζ."""


class UvmsModel:
    """Kinematics and dynamics of a UVMS in still water and in contact with a surface."""

    def __init__(self, uvms: Uvms, surface: SurfaceLaw):
        plant = uvms.plant
        context = plant.CreateDefaultContext()
        self.surface = surface
        self.num_joints = len(uvms.joints)
        self.size = 6 + self.num_joints
        """6 + n."""
        self.q_lower = np.array([joint.position_lower_limits()[0] for joint in uvms.joints])
        self.q_upper = np.array([joint.position_upper_limits()[0] for joint in uvms.joints])

        # A joint turns about an axis in F on the inner link; M and the outer link follow.
        links = [uvms.vehicle, *(joint.child_body() for joint in uvms.joints)]
        placements = [plant.CalcRelativeTransform(
            context, link.body_frame(), joint.frame_on_parent())
            for link, joint in zip(links[:-1], uvms.joints, strict=True)]
        self._R_LF = np.array([X.rotation().matrix() for X in placements]).reshape(-1, 3, 3)
        self._p_LF = np.array([X.translation() for X in placements]).reshape(-1, 3)
        after = [joint.frame_on_child().GetFixedPoseInBodyFrame().inverse()
                 for joint in uvms.joints]
        self._R_MC = np.array([X.rotation().matrix() for X in after]).reshape(-1, 3, 3)
        self._p_MC = np.array([X.translation() for X in after]).reshape(-1, 3)
        axis_F = np.array([joint.revolute_axis() for joint in uvms.joints]).reshape(-1, 3)
        self._axis_L = (self._R_LF @ axis_F[..., None])[..., 0]
        self._S_axis = skew(axis_F)
        self._joint_damping = np.array([joint.default_damping() for joint in uvms.joints])
        self._rotor_inertia = np.array([_reflected_inertia(uvms, joint) for joint in uvms.joints])

        # Bodies: each is fixed to a link (the end-effector's frame is the last, without inertia).
        bodies = [plant.get_body(index) for index in plant.GetBodyIndices(uvms.model_instance)]
        frames = [*(body.body_frame() for body in bodies), uvms.tip]
        owners = [plant.GetBodiesWeldedTo(link) for link in links]
        self._link = np.array([next(i for i, owner in enumerate(owners) if frame.body() in owner)
                               for frame in frames])
        offsets = [plant.CalcRelativeTransform(context, links[i].body_frame(), frame)
                   for i, frame in zip(self._link, frames, strict=True)]
        self._R_LB = np.array([X.rotation().matrix() for X in offsets])
        self._p_LB = np.array([X.translation() for X in offsets])
        self._carries = (np.arange(self.num_joints) < self._link[:, None]).astype(float)

        water = uvms.hydrodynamics
        wet = [water.bodies.get(body.name(), BodyHydrodynamics()) for body in bodies]
        self._inertia = np.array([_rigid_inertia(body) + added_mass_about_origin(item.added_mass)
                                  for body, item in zip(bodies, wet, strict=True)])
        masses = np.array([body.default_mass() for body in bodies])
        displaced = water.fluid_density * np.array([item.displaced_volume for item in wet])
        self._net_mass = masses - displaced
        self._net_moment = (
            masses[:, None] * np.array([body.default_com() for body in bodies])
            - displaced[:, None] * np.array([item.center_of_buoyancy for item in wet]))
        self._gravity = plant.gravity_field().gravity_vector()
        drag = [(i, element) for i, item in enumerate(wet) for element in item.drag]
        self._drag_body = np.array([i for i, _ in drag], dtype=int)
        self._drag_point = np.array([element.point for _, element in drag]).reshape(-1, 3)
        self._drag_linear = np.array([element.linear for _, element in drag]).reshape(-1, 6)
        self._drag_quadratic = np.array([element.quadratic for _, element in drag]).reshape(-1, 6)
        # Sums the drag elements of each body: (b, number of elements).
        self._drag_sum = (np.arange(len(bodies))[:, None] == self._drag_body).astype(float)

    @staticmethod
    def load(model: str, surface: SurfaceLaw) -> "UvmsModel":
        """Returns the model of a shipped robot or a robot's folder, read by a plant of its own."""
        plant = MultibodyPlant(time_step=0.1)  # Nothing is simulated with it.
        uvms = add_uvms(plant, model)
        plant.Finalize()
        return UvmsModel(uvms, surface)

    # Kinematics

    def kinematics(self, config: np.ndarray) -> Kinematics:
        """Returns the geometry at 𝔮 (..., 6+n)."""
        shape, n = config.shape[:-1], self.num_joints
        R_WB = rotation_matrix(config[..., 3:6])
        R_LM = self._R_LF @ self._joint_rotations(config[..., 6:])
        R_LC = R_LM @ self._R_MC  # each joint's step to the next link
        p_LC = self._p_LF + (R_LM @ self._p_MC[..., None])[..., 0]
        R = np.empty((*shape, n + 1, 3, 3), dtype=R_WB.dtype)  # links in B
        p = np.empty((*shape, n + 1, 3), dtype=R_WB.dtype)
        R[..., 0, :, :] = np.eye(3)
        p[..., 0, :] = 0.0
        for j in range(n):
            R[..., j + 1, :, :] = R[..., j, :, :] @ R_LC[..., j, :, :]
            p[..., j + 1, :] = p[..., j, :] + (R[..., j, :, :] @ p_LC[..., j, :, None])[..., 0]
        inner = R[..., :-1, :, :]
        axis = (inner @ self._axis_L[..., None])[..., 0]
        anchor = p[..., :-1, :] + (inner @ self._p_LF[..., None])[..., 0]
        R_BL = R[..., self._link, :, :] @ self._R_LB
        p_BL = p[..., self._link, :] + (R[..., self._link, :, :] @ self._p_LB[..., None])[..., 0]
        J_bodies = self._body_jacobians(R_BL, p_BL, axis, anchor)
        R_WE = R_WB @ R_BL[..., -1, :, :]
        position = config[..., :3] + (R_WB @ p_BL[..., -1, :, None])[..., 0]
        attitude = euler_angles(R_WE)
        J_chi = np.concatenate([R_WE @ J_bodies[..., -1, :3, :],
                                rate_matrix(attitude) @ J_bodies[..., -1, 3:, :]], axis=-2)
        chi = np.concatenate([position, attitude], axis=-1)
        return Kinematics(R_WB, chi, R_BL, p_BL, axis, anchor, J_bodies, J_chi)

    def _joint_rotations(self, angles: np.ndarray) -> np.ndarray:
        """Returns R_FM (..., n, 3, 3) = I + sin q S(a) + (1 − cos q) S(a)² (Rodrigues)."""
        sin, cos = np.sin(angles)[..., None, None], np.cos(angles)[..., None, None]
        return np.eye(3) + sin * self._S_axis + (1.0 - cos) * (self._S_axis @ self._S_axis)

    def _body_jacobians(self, R_BL: np.ndarray, p_BL: np.ndarray, axis: np.ndarray,
                        anchor: np.ndarray) -> np.ndarray:
        """Returns Jᵢ (..., b, 6, 6+n): of v + ω × p for the vehicle, a × (p − o) for the joints."""
        shape, b, n = p_BL.shape[:-2], p_BL.shape[-2], self.num_joints
        J = np.zeros((*shape, b, 6, 6 + n), dtype=R_BL.dtype)
        J[..., :3, :3] = np.eye(3)
        J[..., :3, 3:6] = -skew(p_BL)
        J[..., 3:, 3:6] = np.eye(3)
        lever = p_BL[..., :, None, :] - anchor[..., None, :, :]
        carries = self._carries[:, None, :]
        J[..., :3, 6:] = np.swapaxes(cross(axis[..., None, :, :], lever), -1, -2) * carries
        J[..., 3:, 6:] = np.swapaxes(axis, -1, -2)[..., None, :, :] * carries
        R_LB = np.swapaxes(R_BL, -1, -2)
        return np.concatenate([R_LB @ J[..., :3, :], R_LB @ J[..., 3:, :]], axis=-2)

    def task_pose(self, config: np.ndarray) -> np.ndarray:
        """Returns the extended task y = (χ, q) (..., 6+n) at 𝔮 (..., 6+n)."""
        return np.concatenate([self.kinematics(config).chi, config[..., 6:]], axis=-1)

    def task_jacobian(self, config: np.ndarray) -> np.ndarray:
        """Returns J_x (..., 6+n, 6+n) = [J(𝔮); 0 I] with ẏ = J_x ζ."""
        return self._extend(self.kinematics(config).J_chi)

    def _extend(self, J_chi: np.ndarray) -> np.ndarray:
        J_x = np.zeros((*J_chi.shape[:-2], self.size, self.size), dtype=J_chi.dtype)
        J_x[..., :6, :] = J_chi
        J_x[..., range(6, self.size), range(6, self.size)] = 1.0
        return J_x

    def task_motion(
        self, config: np.ndarray, zeta: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Returns y (..., 6+n), J_x (..., 6+n, 6+n) and J̇_x along 𝔮̇ = Γ(𝔮)ζ."""
        kinematics = self.kinematics(
            config + 1j * COMPLEX_STEP * configuration_rate(config, zeta))
        J_x = self._extend(kinematics.J_chi)
        y = np.concatenate([kinematics.chi.real, config[..., 6:]], axis=-1)
        return y, J_x.real, J_x.imag / COMPLEX_STEP

    def configuration(self, y: np.ndarray) -> np.ndarray:
        """Returns 𝔮 (..., 6+n) of the extended task y (..., 6+n), angles in (−π, π].

        The vehicle is where the arm has the end-effector at χ: X_WB = X_WE X_BE(q)⁻¹.
        """
        config = np.zeros_like(y)
        config[..., 6:] = y[..., 6:]
        at_origin = self.kinematics(config)
        R_BE, p_BE = at_origin.R_BL[..., -1, :, :], at_origin.p_BL[..., -1, :]
        R_WB = rotation_matrix(y[..., 3:6]) @ np.swapaxes(R_BE, -1, -2)
        config[..., :3] = y[..., :3] - (R_WB @ p_BE[..., None])[..., 0]
        config[..., 3:6] = euler_angles(R_WB)
        return config

    # Dynamics

    def inverse_dynamics(
        self, kinematics: Kinematics, zeta: np.ndarray, zeta_dot: np.ndarray
    ) -> np.ndarray:
        """Returns τ (..., 6+n), the generalised force at which ζ̇ is the acceleration."""
        J = kinematics.J_bodies[..., :-1, :, :]
        V = (J @ zeta[..., None, :, None])[..., 0]
        A = (J @ zeta_dot[..., None, :, None])[..., 0] + self._bias_acceleration(kinematics, zeta)
        momentum = (self._inertia @ V[..., None])[..., 0]
        force = (self._inertia @ A[..., None])[..., 0] + cross_force(V, momentum)
        force -= self._weight(kinematics) + self._drag(V)
        tau = np.sum(np.swapaxes(J, -1, -2) @ force[..., None], axis=-3)[..., 0]
        tau[..., 6:] += (self._joint_damping * zeta[..., 6:]
                         + self._rotor_inertia * zeta_dot[..., 6:])
        chi_dot = (kinematics.J_chi @ zeta[..., None])[..., 0]
        contact = self.surface.force(kinematics.chi, chi_dot)
        return tau + (np.swapaxes(kinematics.J_chi, -1, -2) @ contact[..., None])[..., 0]

    def _bias_acceleration(self, kinematics: Kinematics, zeta: np.ndarray) -> np.ndarray:
        """Returns J̇ᵢ ζ (..., b, 6): each joint's screw is carried along by the link it moves."""
        axis, anchor = kinematics.axis, kinematics.anchor
        screw = np.concatenate([cross(anchor, axis), axis], axis=-1) * zeta[..., 6:, None]
        link_velocity = zeta[..., None, :6] + np.cumsum(screw, axis=-2)
        rate = cross_motion(link_velocity, screw)
        total = self._carries[:-1] @ rate
        p, R = kinematics.p_BL[..., :-1, :], kinematics.R_BL[..., :-1, :, :]
        linear = total[..., :3] + cross(total[..., 3:], p)
        R_LB = np.swapaxes(R, -1, -2)
        return np.concatenate([(R_LB @ linear[..., None])[..., 0],
                               (R_LB @ total[..., 3:, None])[..., 0]], axis=-1)

    def _weight(self, kinematics: Kinematics) -> np.ndarray:
        """Returns weight and buoyancy (..., b, 6) about each body's origin, in its axes."""
        R_WL = kinematics.R_WB[..., None, :, :] @ kinematics.R_BL[..., :-1, :, :]
        down = np.swapaxes(R_WL, -1, -2) @ self._gravity
        return np.concatenate(
            [self._net_mass[:, None] * down, cross(self._net_moment, down)], axis=-1)

    def _drag(self, V: np.ndarray) -> np.ndarray:
        """Returns −(D_lin + D_quad |v|) v summed over each body's drag points (..., b, 6)."""
        v = V[..., self._drag_body, :].copy()
        v[..., :3] += cross(v[..., 3:], self._drag_point)
        speed = np.where(v.real < 0.0, -v, v)
        f = -(self._drag_linear + self._drag_quadratic * speed) * v
        f[..., 3:] += cross(self._drag_point, f[..., :3])
        return self._drag_sum @ f

    def mass_matrix(self, kinematics: Kinematics) -> np.ndarray:
        """Returns M (..., 6+n, 6+n) = Σ Jᵢᵀ Iᵢ Jᵢ with added mass and reflected joint inertia."""
        J = kinematics.J_bodies[..., :-1, :, :]
        IJ = self._inertia @ J
        stacked = (*J.shape[:-3], -1, self.size)
        M = np.swapaxes(J.reshape(stacked), -1, -2) @ IJ.reshape(stacked)
        M[..., range(6, self.size), range(6, self.size)] += self._rotor_inertia
        return M

    def drift(self, config: np.ndarray, zeta: np.ndarray) -> np.ndarray:
        """Returns f (..., 6+n) of (eq:func_h): the acceleration at τ = 0."""
        kinematics = self.kinematics(config)
        bias = self.inverse_dynamics(kinematics, zeta, np.zeros_like(zeta))
        return -np.linalg.solve(self.mass_matrix(kinematics), bias[..., None])[..., 0]

    def drift_derivatives(
        self, config: np.ndarray, zeta: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Returns f (m, 6+n), ∂f/∂𝔮 and ∂f/∂ζ (m, 6+n, 6+n) at m states.

        From M f + b = 0: ∂f = −M⁻¹ ∂(M ζ̇ + b) at ζ̇ = f held fixed, so no derivative of M⁻¹ is
        needed. The partial derivatives are complex steps: exact, with no step to choose.
        """
        f = self.drift(config, zeta)
        steps = 1j * COMPLEX_STEP * np.eye(self.size)
        moved = config[:, None, :] + steps
        by_config = self.inverse_dynamics(
            self.kinematics(moved), zeta[:, None, :].astype(complex), f[:, None, :])
        still = self.kinematics(config[:, None, :])
        by_zeta = self.inverse_dynamics(still, zeta[:, None, :] + steps, f[:, None, :])
        rates = np.concatenate([by_config, by_zeta], axis=1).imag / COMPLEX_STEP
        M = self.mass_matrix(Kinematics(*(item[:, 0] for item in still)))
        derivatives = -np.linalg.solve(M, np.swapaxes(rates, -1, -2))
        return f, derivatives[..., : self.size], derivatives[..., self.size:]

    def equilibrium_input(self, config: np.ndarray) -> np.ndarray:
        """Returns u_eq = −f(𝔮, 0) (..., 6+n), the input that holds 𝔮 at rest."""
        return -self.drift(config, np.zeros_like(config))


def configuration_rate(config: np.ndarray, zeta: np.ndarray) -> np.ndarray:
    """Returns 𝔮̇ = Γ(𝔮) ζ (..., 6+n), Γ = blkdiag(𝔍₁, 𝔍₂, I) (eq:kin)."""
    rpy = config[..., 3:6]
    linear = (rotation_matrix(rpy) @ zeta[..., :3, None])[..., 0]
    angular = (rate_matrix(rpy) @ zeta[..., 3:6, None])[..., 0]
    return np.concatenate([linear, angular, zeta[..., 6:]], axis=-1)


def configuration_rate_matrix(config: np.ndarray) -> np.ndarray:
    """Returns Γ(𝔮) (..., 6+n, 6+n)."""
    size = config.shape[-1]
    Gamma = np.zeros((*config.shape, size), dtype=config.dtype)
    Gamma[..., :3, :3] = rotation_matrix(config[..., 3:6])
    Gamma[..., 3:6, 3:6] = rate_matrix(config[..., 3:6])
    Gamma[..., range(6, size), range(6, size)] = 1.0
    return Gamma


def _rigid_inertia(body: RigidBody) -> np.ndarray:
    """Returns M_RB (6, 6) of a body about its origin in its axes, Fossen's order."""
    spatial = body.default_spatial_inertia().CopyToFullMatrix6()  # (ω, v) order
    swap = [3, 4, 5, 0, 1, 2]
    return spatial[np.ix_(swap, swap)]


def _reflected_inertia(uvms: Uvms, joint: RevoluteJoint) -> float:
    """Returns the motor's inertia at the joint, N² I_rotor [kg m²]; zero without an actuator."""
    for index in uvms.plant.GetJointActuatorIndices(uvms.model_instance):
        actuator = uvms.plant.get_joint_actuator(index)
        if actuator.joint().index() == joint.index():
            return actuator.default_gear_ratio() ** 2 * actuator.default_rotor_inertia()
    return 0.0
