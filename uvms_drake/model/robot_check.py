"""Checks that a robot is one that the controller's model and the plant can represent.

Each check is a function of a robot in a finalized plant and yields its complaints. They come in two
rounds: as long as the links are no chain, nothing can be said about inertias and trim.
"""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from pydrake.multibody import tree

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.model.robot import Robot
from uvms_drake.model.trim import middle_posture, pose_joints, trim_of
from uvms_drake.model.uvms import Uvms, slides

Complaints = Iterator[InvalidParameter]

FLOATS = (0.8, 1.25)
"""Displaced mass over mass of a robot that can swim."""
UNSTABLE = 1e-3
"""Depth of the centre of buoyancy below that of mass that is taken as rounding [m]."""
TURNS, UNLIMITED = 6.0 * np.pi, 1e4
"""Angles that limits of a joint are between if they are degrees [rad]."""
LARGEST = 10.0
"""Radius of gyration of a body from which its inertia is in another unit [m]."""
LIGHTEST = 1e-8
"""Inertia about a joint's axis below which a joint moves nothing [kg m²]."""


def robot_complaints(robot: Robot) -> list[InvalidParameter]:
    """Returns the complaints about a robot, by file and key; empty if it is sound."""
    sdf, water = robot.files.file, robot.folder / "hydrodynamics.yaml"
    rounds: tuple[tuple[tuple[Path, Callable[[Uvms], Complaints]], ...], ...] = (
        ((sdf, bodies_are_joined), (sdf, the_tip_is_on_the_last_link), (sdf, nothing_pulls),
         (sdf, motors_drive_the_joints), (sdf, joints_turn_in_radians)),
        ((sdf, inertias_are_given), (sdf, joints_move_something), (water, the_water_carries_it),
         (water, it_is_upright)))
    for checks in rounds:
        found = [InvalidParameter(f"{file}: {complaint.key}", complaint.value, complaint.allowed)
                 for file, check in checks for complaint in check(robot.uvms)]
        if found:
            return found
    return []


def bodies_are_joined(uvms: Uvms) -> Complaints:
    """Every body hangs on the vehicle by joints, and the plant has no other and no loop."""
    plant = uvms.plant
    chain = {body.index() for link in links_of(uvms) for body in plant.GetBodiesWeldedTo(link)}
    for i in range(1, plant.num_bodies()):  # 0 is World.
        body = plant.get_body(tree.BodyIndex(i))
        if body.index() not in chain:
            yield InvalidParameter(
                "link", body.name(), "joined to the vehicle by joints, or it floats by itself: a "
                "joint of type fixed makes it a part of another link")
    if plant.num_constraints() > 0:
        yield InvalidParameter(
            "constraints", plant.num_constraints(),
            "0: the arm is a chain, without loops, mimicking joints and tendons")


def the_tip_is_on_the_last_link(uvms: Uvms) -> Complaints:
    """`tip` moves with the outermost joint, else its pose is not a function of all of them."""
    last = links_of(uvms)[-1]
    if uvms.tip.body().index() in {body.index() for body in uvms.plant.GetBodiesWeldedTo(last)}:
        return
    if not uvms.joints:
        yield InvalidParameter("frame tip", uvms.tip.body().name(),
                               f"attached to '{last.name()}', or to a body fixed to it")
        return
    mover = uvms.joints[-1].name()
    yield InvalidParameter(
        "frame tip", uvms.tip.body().name(), f"attached to '{last.name()}', which the last joint, "
        f"'{mover}', moves: joints beyond the tip, as of a gripper, are to be of type fixed")


def nothing_pulls(uvms: Uvms) -> Complaints:
    """Gravity is the only force element: the controller's model knows of no other."""
    plant = uvms.plant
    for i in range(plant.num_force_elements()):
        element = plant.get_force_element(tree.ForceElementIndex(i))
        if isinstance(element, tree.UniformGravityFieldElement):
            continue
        if isinstance(element, tree.RevoluteSpring):
            yield InvalidParameter(
                f"joint {element.joint().name()}: spring_stiffness", element.default_stiffness(),
                "0: the controller's model has no springs")
        else:
            yield InvalidParameter("force element", type(element).__name__,
                                   "left out: the controller's model knows of gravity alone")


def motors_drive_the_joints(uvms: Uvms) -> Complaints:
    """Every joint has an actuator, with which the inertia of its rotor is read."""
    for joint in uvms.joints:
        if uvms.motor(joint) is None:
            yield InvalidParameter(
                f"joint {joint.name()}: actuator", None, "there, as every joint is driven: of "
                "SDFormat its effort must not be 0, of URDF it needs a transmission")


def joints_turn_in_radians(uvms: Uvms) -> Complaints:
    """No joint that turns has limits that are plainly degrees."""
    for joint in uvms.joints:
        lower, upper = joint.position_lower_limits()[0], joint.position_upper_limits()[0]
        if not slides(joint) and TURNS < max(-lower, upper) < UNLIMITED:
            yield InvalidParameter(
                f"joint {joint.name()}: limits", [float(lower), float(upper)],
                f"in radians, up to {TURNS:.3g}, or left out")


def inertias_are_given(uvms: Uvms) -> Complaints:
    """No inertia is a default of the file format's, and each is one that a body can have."""
    for index in uvms.plant.GetBodyIndices(uvms.model_instance):
        body = uvms.plant.get_body(index)
        M, mass = body.default_spatial_inertia(), body.default_mass()
        if not M.IsPhysicallyValid():
            yield InvalidParameter(
                f"link {body.name()}: inertial", principal_moments(body),
                "physically possible: a mass, and principal moments of inertia about its centre "
                "of mass of which none exceeds the sum of the others [kg m²]")
        elif mass > 0.0 and (radius := np.sqrt(principal_moments(body)[-1] / mass)) > LARGEST:
            yield InvalidParameter(
                f"link {body.name()}: inertial, as a radius of gyration", float(f"{radius:.4g}"),
                f"{LARGEST:g} m or less: inertias are in kg m², and 1 kg m² is 10⁶ kg mm²")
        elif np.array_equal(M.CopyToFullMatrix6(), np.eye(6)):
            yield InvalidParameter(
                f"link {body.name()}: inertial", "1 kg, 1 kg m²",
                "given: these are SDFormat's defaults where a link has none; a frame needs no link")


def joints_move_something(uvms: Uvms) -> Complaints:
    """Requires an inertia about the axis of each joint, of the links beyond it or of its motor."""
    plant = uvms.plant
    context = plant.CreateDefaultContext()
    pose_joints(uvms, context, middle_posture(uvms))
    M = plant.CalcMassMatrix(context)
    for joint in uvms.joints:
        inertia = float(M[joint.velocity_start(), joint.velocity_start()])
        unit = "kg" if slides(joint) else "kg m²"
        if inertia < LIGHTEST:
            yield InvalidParameter(
                f"joint {joint.name()}: inertia about its axis", inertia,
                f"{LIGHTEST:g} {unit} or more: of the links beyond, and of its motor, by "
                "drake:rotor_inertia and drake:gear_ratio")


def the_water_carries_it(uvms: Uvms) -> Complaints:
    """Buoyancy is about the weight: a volume in litres, or a body left out, is not."""
    trim, (least, most) = trim_of(uvms, middle_posture(uvms)), FLOATS
    share = trim.displaced_mass / trim.mass if trim.mass > 0.0 else np.inf
    if not least <= share <= most:
        yield InvalidParameter(
            "displaced_volume of all bodies, as mass of water over that of the robot",
            float(f"{share:.4g}"), f"between {least:g} and {most:g} (volumes are in m³, the "
            "density in kg/m³, and a body that is not named is dry)")


def it_is_upright(uvms: Uvms) -> Complaints:
    """The centre of buoyancy is not below that of mass, as it is with z pointing up."""
    trim = trim_of(uvms, middle_posture(uvms))
    if trim.righting_lever < -UNSTABLE:
        yield InvalidParameter(
            "center_of_buoyancy of all bodies, above the centre of mass by",
            f"{trim.righting_lever:.3g} m", "zero or positive, or the vehicle turns over: axes are "
            "FRD, z down (numbers with z up are turned by diag(1, -1, -1))")


def links_of(uvms: Uvms) -> list[tree.RigidBody]:
    """Returns the vehicle and the body that each joint moves, from the vehicle outwards."""
    return [uvms.vehicle, *(joint.child_body() for joint in uvms.joints)]


def principal_moments(body: tree.RigidBody) -> np.ndarray:
    """Returns the principal moments of inertia (3,) [kg m²] about the centre of mass."""
    M = body.default_spatial_inertia()
    about_center = M.Shift(M.get_com()).CalcRotationalInertia().CopyToFullMatrix3()
    return np.linalg.eigvalsh(about_center)
