"""The serial chain of a robot's joints, from the vehicle to the tip, and the joints off it."""

from pathlib import Path

from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Joint, ModelInstanceIndex, PrismaticJoint, RevoluteJoint

from uvms_drake.common.errors import InvalidFile

MOVING = ("revolute", "prismatic")


def serial_joints(plant: MultibodyPlant, instance: ModelInstanceIndex, file: Path
                  ) -> tuple[RevoluteJoint | PrismaticJoint, ...]:
    """Returns the joints that move, from the vehicle outwards, whatever their order in the file.

    Args:
        plant: Not finalized.
        instance: Of the robot, which has a link `vehicle` and a frame `tip`.
        file: Of the robot, for the error.

    Raises:
        InvalidFile: The vehicle is not the root, or joints stand off the chain; names them all.
    """
    joints = [plant.get_joint(index) for index in plant.GetJointIndices(instance)]
    inboard: dict[str, Joint] = {}
    for joint in joints:
        child = joint.child_body().name()
        if (other := inboard.setdefault(child, joint)) is not joint:
            raise InvalidFile([f"{file}: link {child}: hangs on two joints, {other.name()} and "
                               f"{joint.name()}: it must hang on one, as links form no loops"])
    if "vehicle" in inboard:
        raise InvalidFile([f"{file}: {_not_the_root(inboard)}"])
    strange = [joint for joint in joints if joint.type_name() not in ("weld", *MOVING)]
    if strange:
        raise InvalidFile([f"{file}: joint {joint.name()}: type = {joint.type_name()!r}: must be "
                           "revolute, continuous, prismatic or fixed" for joint in strange])
    moving = [joint for joint in joints if joint.type_name() in MOVING
              and _carriers(joint, inboard)[0].parent_body().name() == "vehicle"]
    depth = {joint.name(): len(_moving_carriers(joint, inboard)) for joint in moving}
    moving.sort(key=lambda joint: depth[joint.name()])
    if len(set(depth.values())) == len(moving):
        return tuple(moving)
    tip = plant.GetFrameByName("tip", instance).body().name()
    onward = [] if tip not in inboard else _moving_carriers(inboard[tip], inboard)
    chain = [joint.name() for joint in onward]
    listed = " → ".join(["vehicle", *chain, f"tip on {tip}"])
    raise InvalidFile([
        f"{file}: joint {joint.name()}: must be of type fixed, as '{joint.child_body().name()}' "
        f"is not in the chain {listed}" for joint in moving if joint.name() not in chain])


def _carriers(joint: Joint, inboard: dict[str, Joint]) -> list[Joint]:
    """Returns the joints from the root to a joint and itself, those of type fixed too."""
    path = [joint]
    while (parent := path[0].parent_body().name()) in inboard and len(path) <= len(inboard):
        path.insert(0, inboard[parent])
    return path


def _moving_carriers(joint: Joint, inboard: dict[str, Joint]) -> list[Joint]:
    return [each for each in _carriers(joint, inboard) if each.type_name() in MOVING]


def _not_the_root(inboard: dict[str, Joint]) -> str:
    """Returns the complaint about a vehicle that hangs on another link."""
    joint = _carriers(inboard["vehicle"], inboard)[0]
    root, own = joint.parent_body().name(), inboard["vehicle"]
    cause = f"link vehicle: joint {own.name()} of type {own.type_name()!r} fixes it to " \
           f"'{own.parent_body().name()}'"
    if root == joint.parent_body().name() == "world" or root == "WorldBody":
        return f"{cause}: it must be a floating body, without a joint to the world"
    return (f"{cause}, and the root is '{root}': the vehicle must be the root, a floating body: "
            f"name '{root}' vehicle, or leave it and joint {own.name()} out")
