"""The links of a robot, each the set of bodies welded to one another.

A UVMS has n + 1 links, the vehicle and one for each joint. The bodies of a link move as one, so
their inertias, weights and drag add up. The frame of a link is that of the body that its joint
moves; the last link has the end-effector's frame Σ_E instead.

The velocity V = (v, ω) of a link is that of its frame, and a force on it acts at the origin of its
frame; both in axes of the frame and in Fossen's order. Everything here is about single links;
`UvmsModel` joins them to a chain.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, RigidBody

from uvms_drake.model.description.hydrodynamics_file import added_mass_about_origin
from uvms_drake.model.frames.spatial import cross_force, force_matrix, motion_matrix, skew, times
from uvms_drake.model.uvms import Uvms, slides


@dataclass(frozen=True)
class Links:
    """The links of a UVMS with n joints, the vehicle first."""

    X_BV: np.ndarray
    """(4, 4) pose of the first link's frame in the vehicle's, B: the same frame unless n = 0."""
    step: np.ndarray
    """(4, n, 4, 4): pose of a link in the one before, step[0] + sin q step[1] + cos q step[2]
    + q step[3]; the last is zero of a revolute joint, the two before of a prismatic one."""
    slides: np.ndarray
    """(n,) whether a joint is prismatic; its axis is then a direction, about no point."""
    joint_axis: np.ndarray
    """(n, 4, 2): a joint's axis and a point on it [m] in the link before, homogeneous."""
    inertia: np.ndarray
    """(n+1, 6, 6) I = M_RB + M_A [kg, kg m, kg m²]."""
    weight: np.ndarray
    """(n+1, 6, 3) weight less buoyancy, by gravity in axes of the link [kg, kg m]."""
    drag_points: np.ndarray
    """(6(n+1), r): velocities of all links to those that drag acts against, r of them."""
    drag_linear: np.ndarray
    """(r,) coefficients of linear drag [N s/m, N m s/rad]."""
    drag_quadratic: np.ndarray
    """(r,) coefficients of quadratic drag [N s²/m², N m s²/rad²]."""
    drag_squares: np.ndarray
    """(r, 36(n+1)): h hᵀ of every column h of `drag_points`, link by link."""
    joint_damping: np.ndarray
    """(n,) viscous damping of the joints [N m s/rad, N s/m]."""
    rotor_inertia: np.ndarray
    """(n,) inertia of the motors at the joints, N² I_rotor [kg m², kg]; 0 without a motor."""

    def links_force(self, V: np.ndarray, A: np.ndarray, g: np.ndarray) -> np.ndarray:
        """Returns f (..., n+1, 6) for a motion of the links in still water.

        f = I A + V ×* I V − weight + Σ h (D_lin + D_quad |hᵀV|) hᵀV (Kirchhoff; Fossen 2021, §6.3
        and §8.1).

        Args:
            V: Velocities (..., n+1, 6).
            A: Accelerations (..., n+1, 6), the rates of V in the turning axes.
            g: Gravity in axes of the links (..., n+1, 3).
        """
        v = self._drag_velocities(V)
        speed = np.abs(v) if v.dtype.kind == "f" else np.where(v.real < 0.0, -v, v)
        drag = (self.drag_linear + self.drag_quadratic * speed) * v @ self.drag_points.T
        return (times(self.inertia, A) + cross_force(V, times(self.inertia, V))
                - times(self.weight, g) + drag.reshape(V.shape))

    def force_gradients(self, V: np.ndarray, g: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns N and K (..., n+1, 6, 6) of ∂f = N δV + K s, real.

        N = ∂f/∂V with A changing by δV × V. K is the weight as gravity turns in a link that is
        displaced by s, by g × s.
        """
        carried = self.inertia @ motion_matrix(V)
        N = force_matrix(times(self.inertia, V)) - carried - carried.swapaxes(-1, -2)
        drag = self.drag_linear + 2.0 * self.drag_quadratic * np.abs(self._drag_velocities(V))
        N += (drag @ self.drag_squares).reshape(N.shape)
        K = np.zeros_like(N)
        K[..., 3:] = self.weight @ -skew(g)
        return N, K

    def _drag_velocities(self, V: np.ndarray) -> np.ndarray:
        """Returns the velocities that drag acts against, as rows (..., 1, r).

        Products row by row are too small for the linear algebra library to use threads, which are
        slow on a busy machine.
        """
        return V.reshape(*V.shape[:-2], 1, -1) @ self.drag_points


def links_between(base: Links, ends: Sequence[Links], shares: np.ndarray) -> Links:
    """Returns base + Σ δₖ (endₖ − base) of links that differ in inertia, weight and drag.

    Args:
        base: Links of a robot.
        ends: Those of robots of the same geometry (k).
        shares: δ (..., k); with leading dimensions the result is for stacks of motions.
    """
    def mixed(name: str) -> np.ndarray:
        first: np.ndarray = getattr(base, name)
        steps = [getattr(end, name) - first for end in ends]
        return first + np.tensordot(shares, np.array(steps), 1)

    return replace(base, inertia=mixed("inertia"), weight=mixed("weight"),
                   drag_linear=mixed("drag_linear")[..., None, :],
                   drag_quadratic=mixed("drag_quadratic")[..., None, :])


def read_links(uvms: Uvms) -> Links:
    """Returns the links of a robot in a finalized plant."""
    # The frames of the links, and of each link the sums over its welded bodies.
    plant = uvms.plant
    bodies = [uvms.vehicle, *(joint.child_body() for joint in uvms.joints)]
    frames = [*(body.body_frame() for body in bodies[:-1]), uvms.tip]
    inertia, weight, rows, coefficients = [], [], [], []
    for i, (body, frame) in enumerate(zip(bodies, frames, strict=True)):
        members = [(member, _velocity_map(_pose(plant, frame, member.body_frame())))
                   for member in plant.GetBodiesWeldedTo(body)
                   if member.model_instance() == uvms.model_instance]
        inertia.append(sum(H.T @ _inertia(uvms, member) @ H for member, H in members))
        weight.append(sum(H.T @ _weight(uvms, member) @ H[:3, :3] for member, H in members))
        for member, H in members:
            for drag in uvms.water(member).drag:
                by_link = np.zeros((6, len(bodies), 6))
                by_link[:, i] = _velocity_map(RigidTransform(np.asarray(drag.point))) @ H
                rows += list(by_link)
                coefficients += list(zip(drag.linear, drag.quadratic, strict=True))
    # Drag without a coefficient is left out.
    nonzero = [k for k, pair in enumerate(coefficients) if any(pair)]
    linear, quadratic = np.array(coefficients).reshape(-1, 2)[nonzero].T
    points = np.array(rows).reshape(-1, len(bodies), 6)[nonzero]
    step, joint_axis = _joints(uvms, frames)
    return Links(
        X_BV=_pose(plant, uvms.vehicle.body_frame(), frames[0]).GetAsMatrix4(),
        step=step,
        slides=np.array([slides(joint) for joint in uvms.joints], dtype=bool),
        joint_axis=joint_axis,
        inertia=np.array(inertia),
        weight=np.array(weight),
        drag_points=points.reshape(len(nonzero), 6 * len(bodies)).T,
        drag_linear=linear,
        drag_quadratic=quadratic,
        drag_squares=(points[..., None] * points[..., None, :]).reshape(
            len(nonzero), 36 * len(bodies)),
        joint_damping=np.array([joint.default_damping() for joint in uvms.joints]),
        rotor_inertia=np.array([
            motor.default_gear_ratio() ** 2 * motor.default_rotor_inertia()
            if (motor := uvms.motor(joint)) else 0.0 for joint in uvms.joints]),
    )


def _pose(plant: MultibodyPlant, A: Frame, B: Frame) -> RigidTransform:
    """Returns X_AB of two frames that are fixed to each other."""
    return plant.CalcRelativeTransform(plant.CreateDefaultContext(), A, B)


def _velocity_map(X_AB: RigidTransform) -> np.ndarray:
    """Returns H (6, 6) with V_B = H V_A, each in axes of its own frame."""
    R_BA = X_AB.rotation().matrix().T
    H = np.zeros((6, 6))
    H[:3, :3] = H[3:, 3:] = R_BA
    H[:3, 3:] = -R_BA @ skew(X_AB.translation())
    return H


def _joints(uvms: Uvms, frames: list[Frame]) -> tuple[np.ndarray, np.ndarray]:
    """Returns `Links.step`, X_LF X_FM(q) X_MC, and `Links.joint_axis`.

    R_FM = I + sin q S(a) + (1 − cos q) S(a)²; p_FM = q a of a prismatic joint.
    """
    steps, axes = np.zeros((4, len(uvms.joints), 4, 4)), np.zeros((len(uvms.joints), 4, 2))
    for i, joint in enumerate(uvms.joints):
        axis = joint.translation_axis() if slides(joint) else joint.revolute_axis()
        S, slide = np.zeros((2, 4, 4))
        if slides(joint):
            slide[:3, 3] = axis
        else:
            S[:3, :3] = skew(axis)
        before = _pose(uvms.plant, frames[i], joint.frame_on_parent()).GetAsMatrix4()
        after = _pose(uvms.plant, joint.frame_on_child(), frames[i + 1]).GetAsMatrix4()
        for k, part in enumerate((np.eye(4) + S @ S, S, -S @ S, slide)):
            steps[k, i] = before @ part @ after
        axes[i] = before @ np.column_stack([np.append(axis, 0.0), [0.0, 0.0, 0.0, 1.0]])
    return steps, axes


def _inertia(uvms: Uvms, body: RigidBody) -> np.ndarray:
    """Returns M_RB + M_A (6, 6) of a body about its origin in its axes."""
    spatial = body.default_spatial_inertia().CopyToFullMatrix6()  # in the order (ω, v)
    swap = [3, 4, 5, 0, 1, 2]
    return spatial[np.ix_(swap, swap)] + added_mass_about_origin(uvms.water(body).added_mass)


def _weight(uvms: Uvms, body: RigidBody) -> np.ndarray:
    """Returns weight and buoyancy of a body by gravity (6, 3), about its origin in its axes."""
    water = uvms.water(body)
    displaced = uvms.hydrodynamics.fluid_density * water.displaced_volume
    moment = (body.default_mass() * body.default_com()
              - displaced * np.asarray(water.center_of_buoyancy))
    return np.vstack([(body.default_mass() - displaced) * np.eye(3), skew(moment)])
