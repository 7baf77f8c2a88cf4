"""A robot in a `MultibodyPlant`: adds it, and finds its bodies, joints and frames.

A robot is a folder with `<name>.sdf` or `<name>.urdf`, `hydrodynamics.yaml` and `package.xml`, and
with `thrusters.yaml` if they are known. Its SDFormat or URDF file has a floating body `vehicle` in
FRD axes, a serial chain of revolute and prismatic joints, and a frame `tip` (the paper's Σ_E).
Further requirements are in `robot_check`.
"""

from dataclasses import dataclass

from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    Frame,
    ModelInstanceIndex,
    PrismaticJoint,
    RevoluteJoint,
    RigidBody,
)

from uvms_drake.common.errors import InvalidFile
from uvms_drake.common.schema import line_of, suggestion
from uvms_drake.model.description.hydrodynamics_file import HydrodynamicParameters
from uvms_drake.model.description.robot_files import RobotFiles, parse_robot, read_robot_files
from uvms_drake.model.description.robot_folder import model_dir
from uvms_drake.model.description.serial_chain import serial_joints
from uvms_drake.model.description.thruster_file import ThrusterParameters

STANDARD_GRAVITY = 9.81  # m/s², along +z of Σ_I, which is NED


@dataclass(frozen=True)
class Uvms:
    """Handles of a UVMS inside a `MultibodyPlant`."""

    plant: MultibodyPlant
    model_instance: ModelInstanceIndex
    vehicle: RigidBody
    joints: tuple[RevoluteJoint | PrismaticJoint, ...]
    """The arm's joints, from the vehicle outwards."""
    tip: Frame
    hydrodynamics: HydrodynamicParameters
    thrusters: ThrusterParameters | None = None
    """None if they are not known."""


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
        joints=serial_joints(plant, instance, files.file),
        tip=plant.GetFrameByName("tip", instance),
        hydrodynamics=files.hydrodynamics,
        thrusters=files.thrusters,
    )


def _require_names(plant: MultibodyPlant, instance: ModelInstanceIndex, files: RobotFiles) -> None:
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


def slides(joint: RevoluteJoint | PrismaticJoint) -> bool:
    """Whether the joint's coordinate is a length, of a prismatic joint, not an angle."""
    return bool(joint.type_name() == "prismatic")
