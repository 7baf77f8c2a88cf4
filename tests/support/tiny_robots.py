"""Robots of a vehicle and a few joints, small enough for closed forms."""

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    PrismaticJoint,
    RevoluteJoint,
    SpatialInertia,
    UnitInertia,
)

from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.description.hydrodynamics_file import HydrodynamicParameters
from uvms_drake.model.surface.law import check_surface
from uvms_drake.model.surface.plane import UnilateralPlane
from uvms_drake.model.uvms import Uvms

INERTIA = SpatialInertia(mass=2.0, p_PScm_E=np.zeros(3), G_SP_E=UnitInertia.SolidSphere(0.2))


def tiny_robot(axes: list, anchors: list, tip: tuple, tip_rpy: tuple = (0.0, 0.0, 0.0),
               sliding: tuple[int, ...] = (), task_frame: tuple = (0.0, 0.0, 0.0)) -> ContactModel:
    """Returns the model of an arm with the given joint axes and anchors, each in its inner link.

    Args:
        axes: One for each joint.
        anchors: Of each joint in its inner link [m]; the first link is the vehicle.
        tip: Position of the tip in the last link [m].
        tip_rpy: Attitude of the tip in the last link [rad].
        sliding: Which joints slide along their axes instead of turning about them.
        task_frame: Attitude of the task's frame [rad].
    """
    plant = MultibodyPlant(time_step=0.1)
    instance = plant.AddModelInstance("tiny")
    link = vehicle = plant.AddRigidBody("vehicle", instance, INERTIA)
    joints = []
    for i, (axis, anchor) in enumerate(zip(axes, anchors, strict=True)):
        outer = plant.AddRigidBody(f"link{i + 1}", instance, INERTIA)
        place = plant.AddFrame(FixedOffsetFrame(
            f"place{i + 1}", link.body_frame(), RigidTransform(anchor), instance))
        kind = PrismaticJoint if i in sliding else RevoluteJoint
        joints.append(plant.AddJoint(kind(
            f"joint{i + 1}", place, outer.body_frame(), axis, -np.pi, np.pi)))
        link = outer
    frame = plant.AddFrame(FixedOffsetFrame(
        "tip", link.body_frame(), RigidTransform(RollPitchYaw(tip_rpy), tip), instance))
    plant.Finalize()
    uvms = Uvms(plant, instance, vehicle, tuple(joints), frame, HydrodynamicParameters())
    return ContactModel(uvms, check_surface(UnilateralPlane()), np.array(task_frame))


def turret(length: float) -> ContactModel:
    """A yaw joint at the vehicle's origin, the tip `length` [m] away from it."""
    return tiny_robot([[0.0, 0.0, 1.0]], [[0.0, 0.0, 0.0]], (length, 0.0, 0.0))


def drill() -> ContactModel:
    """A joint that turns the tool about its own axis, everything at the vehicle's origin."""
    return tiny_robot([[1.0, 0.0, 0.0]], [[0.0, 0.0, 0.0]], (0.0, 0.0, 0.0))


def drill_attitude_norm(pitch: float) -> float:
    """The norm of the drill's Euler-rate rows at a tip pitch, A(θ)[I e_x] but for rotations.

    The larger root of the quadratic equation for the eigenvalues of A Aᵀ + e_x e_xᵀ; the third
    eigenvalue is 1.
    """
    t2 = np.tan(pitch) ** 2
    trace, determinant = 3.0 + 2.0 * t2, 2.0 * (1.0 + t2)
    return float(np.sqrt(0.5 * (trace + np.sqrt(trace**2 - 4.0 * determinant))))


def oblique() -> ContactModel:
    """Two skew joints and a tip that is on neither axis: nothing about it is special."""
    return tiny_robot(
        [[0.0, 0.6, 0.8], [0.8, 0.0, 0.6]], [[0.3, 0.1, 0.2], [0.4, 0.0, -0.1]],
        (0.3, 0.1, 0.05), (0.2, -0.3, 0.4))


def telescope(sliding: int) -> ContactModel:
    """Three skew joints, of which one slides, and a tip on none of their axes."""
    return tiny_robot(
        [[0.0, 0.6, 0.8], [0.8, 0.0, 0.6], [0.48, 0.6, 0.64]],
        [[0.3, 0.1, 0.2], [0.4, 0.0, -0.1], [0.2, -0.1, 0.1]],
        (0.3, 0.1, 0.05), (0.2, -0.3, 0.4), (sliding,))
