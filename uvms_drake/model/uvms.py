"""A robot in a `MultibodyPlant`: adds it, and finds its bodies, joints and frames.

A robot is a folder with `<name>.sdf` or `<name>.urdf`, `hydrodynamics.yaml` and `package.xml`, and
with `thrusters.yaml` if they are known. Its SDFormat or URDF file has a floating body `vehicle` in
FRD axes, a serial chain of revolute and prismatic joints, and a frame `tip` (the paper's Σ_E).
Further requirements are in `robot_check`.
"""

from dataclasses import dataclass
from pathlib import Path

from pydrake.multibody import tree
from pydrake.multibody.plant import MultibodyPlant

from uvms_drake.common.errors import InvalidFile
from uvms_drake.common.schema import line_of, suggestion
from uvms_drake.model.description.hydrodynamics_file import (
    BodyHydrodynamics,
    HydrodynamicParameters,
)
from uvms_drake.model.description.robot_files import (
    RobotFiles,
    model_dir,
    parse_robot,
    read_robot_files,
)
from uvms_drake.model.description.thruster_file import ThrusterParameters

MOVING = ("revolute", "prismatic")
STANDARD_GRAVITY = 9.81  # m/s², along +z of Σ_I, which is NED


@dataclass(frozen=True)
class Uvms:
    """Handles of a UVMS inside a `MultibodyPlant`."""

    plant: MultibodyPlant
    model_instance: tree.ModelInstanceIndex
    vehicle: tree.RigidBody
    joints: tuple[tree.RevoluteJoint | tree.PrismaticJoint, ...]
    """The arm's joints, from the vehicle outwards."""
    tip: tree.Frame
    hydrodynamics: HydrodynamicParameters
    thrusters: ThrusterParameters | None = None
    """None if they are not known."""

    def motor(self, joint: tree.Joint) -> tree.JointActuator | None:
        """Returns the motor of a joint; None without one."""
        motors = map(self.plant.get_joint_actuator,
                     self.plant.GetJointActuatorIndices(self.model_instance))
        return next((each for each in motors if each.joint().index() == joint.index()), None)

    def water(self, body: tree.RigidBody) -> BodyHydrodynamics:
        """Returns the parameters of a body's water; a body that is not named feels none."""
        return self.hydrodynamics.bodies.get(body.name(), BodyHydrodynamics())


def add_uvms(plant: MultibodyPlant, model: str | RobotFiles) -> Uvms:
    """Adds a robot to `plant`, sets gravity along +z (Σ_I is NED), and returns its handles.

    Args:
        plant: A plant that is not finalized; `add_uvms` does not finalize it.
        model: Name of a shipped robot, path of a robot's folder, or its files.

    Raises:
        InvalidParameter: The robot's files cannot be used.
    """
    files = model if isinstance(model, RobotFiles) else read_robot_files(model_dir(model))
    instance, warnings = parse_robot(plant, files)
    files.notes += [warning for warning in warnings if warning not in files.notes]
    plant.mutable_gravity_field().set_gravity_vector([0.0, 0.0, STANDARD_GRAVITY])
    _require_names(plant, instance, files)
    return Uvms(
        plant=plant,
        model_instance=instance,
        vehicle=plant.GetBodyByName("vehicle", instance),
        joints=_serial_joints(plant, instance, files.file),
        tip=plant.GetFrameByName("tip", instance),
        hydrodynamics=files.hydrodynamics,
        thrusters=files.thrusters,
    )


def _require_names(plant: MultibodyPlant, instance: tree.ModelInstanceIndex, files: RobotFiles
                   ) -> None:
    """Raises unless the frames are there, and the bodies that the water acts on."""
    frames = sorted(plant.get_frame(i).name() for i in plant.GetFrameIndices(instance))
    bodies = sorted(plant.get_body(i).name() for i in plant.GetBodyIndices(instance))
    missing = [f"{files.file}: must have a frame '{name}': its frames are {', '.join(frames)}"
               + suggestion(name, frames) for name in ("vehicle", "tip") if name not in frames]
    if "vehicle" in frames and "vehicle" not in bodies:
        missing.append(f"{files.file}: frame vehicle: must be a link, the floating one")
    water = files.folder / "hydrodynamics.yaml"
    missing += [f"{water}: line {line_of(water.read_text(encoding='utf-8'), f'bodies.{name}')}: "
                f"bodies = {name!r}: must be a link of {files.file.name}: {', '.join(bodies)}"
                + suggestion(name, bodies)
                for name in files.hydrodynamics.bodies if name not in bodies]
    if missing:
        raise InvalidFile(missing)


def _serial_joints(plant: MultibodyPlant, instance: tree.ModelInstanceIndex, file: Path
                  ) -> tuple[tree.RevoluteJoint | tree.PrismaticJoint, ...]:
    """Returns the joints that move, from the vehicle outwards, whatever their order in the file.

    Args:
        plant: Not finalized.
        instance: Of the robot, which has a link `vehicle` and a frame `tip`.
        file: Of the robot, for the error.

    Raises:
        InvalidFile: The vehicle is not the root, or joints stand off the chain; names them all.
    """
    joints = [plant.get_joint(index) for index in plant.GetJointIndices(instance)]
    inboard: dict[str, tree.Joint] = {}
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


def _carriers(joint: tree.Joint, inboard: dict[str, tree.Joint]) -> list[tree.Joint]:
    """Returns the joints from the root to a joint and itself, those of type fixed too."""
    path = [joint]
    while (parent := path[0].parent_body().name()) in inboard and len(path) <= len(inboard):
        path.insert(0, inboard[parent])
    return path


def _moving_carriers(joint: tree.Joint, inboard: dict[str, tree.Joint]) -> list[tree.Joint]:
    return [each for each in _carriers(joint, inboard) if each.type_name() in MOVING]


def _not_the_root(inboard: dict[str, tree.Joint]) -> str:
    """Returns the complaint about a vehicle that hangs on another link."""
    joint = _carriers(inboard["vehicle"], inboard)[0]
    root, own = joint.parent_body().name(), inboard["vehicle"]
    cause = f"link vehicle: joint {own.name()} of type {own.type_name()!r} fixes it to " \
           f"'{own.parent_body().name()}'"
    if root == joint.parent_body().name() == "world" or root == "WorldBody":
        return f"{cause}: it must be a floating body, without a joint to the world"
    return (f"{cause}, and the root is '{root}': the vehicle must be the root, a floating body: "
            f"name '{root}' vehicle, or leave it and joint {own.name()} out")


def slides(joint: tree.RevoluteJoint | tree.PrismaticJoint) -> bool:
    """Whether the joint's coordinate is a length, of a prismatic joint, not an angle."""
    return bool(joint.type_name() == "prismatic")
