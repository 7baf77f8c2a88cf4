"""Where the robots live, and how one is put into a `MultibodyPlant`.

A robot is a folder with `<name>.sdf` or `<name>.urdf`, `hydrodynamics.yaml` and `package.xml`, and
with `thrusters.yaml` if they are known. Its SDFormat or URDF file has a floating body `vehicle` in
FRD axes, a serial chain of revolute and prismatic joints, and a frame `tip` (the paper's Σ_E).
What else it may say is in `robot_check`.
"""

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    Frame,
    ModelInstanceIndex,
    PrismaticJoint,
    RevoluteJoint,
    RigidBody,
)

from uvms_drake.common.errors import InvalidParameter, require
from uvms_drake.common.program import FOLDER
from uvms_drake.model.description import thruster_file
from uvms_drake.model.description.hydrodynamics_file import (
    HydrodynamicParameters,
    load_hydrodynamics,
)
from uvms_drake.model.description.thruster_file import ThrusterParameters, load_thrusters

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


def models_dir() -> Path:
    """Returns the folder of the robots: inside an installed package, or beside it in a checkout."""
    package = FOLDER
    installed = package / "models"
    return installed if installed.is_dir() else package.parent / "models"


def shipped_robots() -> list[str]:
    """Returns the names of the robots that come with the package."""
    return sorted(path.parent.name for path in models_dir().glob("*/package.xml"))


def model_dir(model: str) -> Path:
    """Returns the folder of a robot, given the name of a shipped one or a path."""
    shipped = shipped_robots()
    folder = models_dir() / model if model in shipped else Path(model)
    complete = all(file.is_file() for file in (
        robot_file(folder), folder / "hydrodynamics.yaml", folder / "package.xml"))
    require(complete, "model", model, f"one of {', '.join(shipped)}, or a folder with <name>.sdf "
            "or <name>.urdf, hydrodynamics.yaml and package.xml")
    return folder


def robot_file(folder: Path) -> Path:
    """Returns the file of the dry robot in its folder: SDFormat, or else URDF."""
    sdf, urdf = (folder / f"{folder.name}.{kind}" for kind in ("sdf", "urdf"))
    return urdf if urdf.is_file() and not sdf.is_file() else sdf


def add_uvms(plant: MultibodyPlant, model: str, sdf: str | None = None) -> Uvms:
    """Adds a robot to `plant`, sets gravity along +z (Σ_I is NED), and returns its handles.

    Args:
        plant: A plant that is not finalized; `add_uvms` does not finalize it.
        model: Name of a shipped robot or path of a robot's folder.
        sdf: Text that stands for that of the robot's file, if any, and is of the same format.

    Raises:
        InvalidParameter: The robot's files cannot be used.
    """
    folder = model_dir(model)
    instance = _parse(plant, folder, sdf)
    plant.mutable_gravity_field().set_gravity_vector([0.0, 0.0, STANDARD_GRAVITY])
    for name in ("vehicle", "tip"):
        frames = sorted(plant.get_frame(i).name() for i in plant.GetFrameIndices(instance))
        require(name in frames, "model", model, f"a robot with a frame '{name}': those of "
                f"{robot_file(folder).name} are {', '.join(frames)}")
    hydrodynamics = load_hydrodynamics(folder / "hydrodynamics.yaml")
    for name in hydrodynamics.bodies:
        require(plant.HasBodyNamed(name, instance), f"{folder / 'hydrodynamics.yaml'}: bodies",
                name, f"a body of {robot_file(folder).name}")
    thrusters = folder / thruster_file.FILE
    return Uvms(
        plant=plant,
        model_instance=instance,
        vehicle=plant.GetBodyByName("vehicle", instance),
        joints=_serial_joints(plant, instance),
        tip=plant.GetFrameByName("tip", instance),
        hydrodynamics=hydrodynamics,
        thrusters=load_thrusters(thrusters) if thrusters.is_file() else None,
    )


def slides(joint: RevoluteJoint | PrismaticJoint) -> bool:
    """Whether the joint's coordinate is a length, of a prismatic joint, not an angle."""
    return bool(joint.type_name() == "prismatic")


def _parse(plant: MultibodyPlant, folder: Path, text: str | None) -> ModelInstanceIndex:
    file = robot_file(folder)
    parser = Parser(plant)
    try:
        parser.package_map().AddPackageXml(str(folder / "package.xml"))
        with _inertias_as_given(file):
            (instance,) = (parser.AddModels(str(file)) if text is None
                           else parser.AddModelsFromString(text, file.suffix[1:]))
    except RuntimeError as reason:
        raise InvalidParameter(
            "model", str(file), f"a readable robot: {_one_line(reason)}") from None
    return instance


@contextmanager
def _inertias_as_given(file: Path) -> Iterator[None]:
    """Raises `InvalidParameter` if Drake's parser takes another inertia than the file has.

    It does so for one that no body can have, and says so in its log only.
    """
    said: list[str] = []
    logger = logging.getLogger("drake")
    level = logger.level

    def heard(record: logging.LogRecord) -> bool:
        text = record.getMessage()
        if "inertia" in text:
            said.append(text)
        return "inertia" not in text and record.levelno >= level

    logger.addFilter(heard)
    logger.setLevel(min(level, logging.WARNING))
    try:
        yield
    finally:
        logger.setLevel(level)
        logger.removeFilter(heard)
    if said:
        raise InvalidParameter(
            str(file), "an inertia that Drake replaces", "one that a body can have, its principal "
            "moments about the centre of mass positive and none above the sum of the others: "
            + " ".join(" ".join(said).split()))


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())


def _serial_joints(
    plant: MultibodyPlant, instance: ModelInstanceIndex
) -> tuple[RevoluteJoint | PrismaticJoint, ...]:
    """Returns the joints that move, in the order of the file, each of which must carry the next."""
    joints = [plant.get_joint(index) for index in plant.GetJointIndices(instance)]
    for joint in joints:
        require(joint.type_name() in ("weld", "revolute", "prismatic"),
                f"joint {joint.name()}", joint.type_name(), "revolute, prismatic or a weld")
    welds = {joint.child_body().name(): joint.parent_body().name()
             for joint in joints if joint.type_name() == "weld"}
    require("vehicle" not in welds, "vehicle", "welded", "a floating body")
    chain = tuple(joint for joint in joints if joint.type_name() != "weld")
    outermost = "vehicle"
    for joint in chain:
        parent = joint.parent_body().name()
        while parent in welds:
            parent = welds[parent]
        if parent != outermost:
            raise InvalidParameter(
                "joint", joint.name(), f"carried by '{outermost}': the arm must be a serial chain")
        outermost = joint.child_body().name()
    return chain
