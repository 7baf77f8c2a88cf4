"""Declared unknowns: differences of the simulated robot and water from the controller's model."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import BodyIndex

from uvms_drake.common.constraints import Below, Between, Vector
from uvms_drake.common.errors import require
from uvms_drake.model.description.hydrodynamics_file import (
    BodyHydrodynamics,
    HydrodynamicParameters,
)
from uvms_drake.model.description.robot_files import RobotFiles, model_dir, read_robot_files
from uvms_drake.model.robot import Robot
from uvms_drake.model.uvms import Uvms, add_uvms
from uvms_drake.plant.joint_friction import JointFriction
from uvms_drake.plant.payload import Payload, with_payload
from uvms_drake.plant.waves import Wave

INERTIAL = re.compile(r"<(mass|i[xyz][xyz])>\s*([^<]*?)\s*</\1>")
"""An element of SDFormat that is scaled."""
URDF_INERTIAL = re.compile(r"<(?:mass|inertia)\s[^>]*>")
"""A tag of URDF of which attributes are scaled."""
URDF_NUMBER = re.compile(r"\b(value|i[xyz][xyz])(\s*=\s*)([\"'])\s*([^\"']*?)\s*\3")
"""Such an attribute."""
FACTORS = ("mass", "added_mass", "drag", "buoyancy_lever", "buoyancy")


@dataclass
class ModelError:
    """Difference of the simulated robot from the controller's model; factors are 1 without."""

    mass: Annotated[float, Between(0.1, 10)] = 1.0
    """Factor of masses, inertias and displaced volumes: a robot is trimmed before it dives."""
    added_mass: Annotated[float, Between(0.1, 10)] = 1.0
    """Factor of the added masses."""
    drag: Annotated[float, Between(0.1, 10)] = 1.0
    """Factor of the drag coefficients."""
    buoyancy_lever: Annotated[float, Between(0.1, 10)] = 1.0
    """Factor of each body's distance from the centre of mass to that of buoyancy."""
    buoyancy: Annotated[float, Between(0.1, 10)] = 1.0
    """Factor of the displaced volumes alone: a robot that is not trimmed."""
    buoyancy_shift: Annotated[np.ndarray, Vector(3)] = field(default_factory=lambda: np.zeros(3))
    """Displacement of the vehicle's centre of buoyancy, in its axes [m]."""
    payload: Payload = field(default_factory=Payload)
    """Payload in the hand."""
    joint_friction: JointFriction = field(default_factory=JointFriction)
    """Dry friction of the joints."""
    share: Annotated[float, Below(1)] = 0.0
    """Fraction of d̃ reserved for the effect of the error, of a current and of waves, not for the
    disturbance."""

    @property
    def size(self) -> float:
        """Largest error, relative or in its own unit; zero if there is none."""
        return max(*(abs(getattr(self, name) - 1.0) for name in FACTORS),
                   float(np.max(np.abs(self.buoyancy_shift))), self.payload.mass,
                   self.payload.displaced, self.joint_friction.largest)


def add_simulated_uvms(plant: MultibodyPlant, robot: Robot | str, error: ModelError | None
                       ) -> Uvms:
    """Adds the simulated robot to `plant` as `add_uvms` adds that of the controller's model.

    The friction of its joints is left to the caller.

    Raises:
        InvalidParameter: The robot's files cannot be used, or they give an inertia in a way other
            than by the numbers that are scaled, as SDFormat does by leaving it out.
    """
    files = robot.files if isinstance(robot, Robot) else read_robot_files(model_dir(robot))
    if error is None or error.size == 0.0:
        return add_uvms(plant, files)
    if error.mass == 1.0:
        uvms = add_uvms(plant, files)
    else:  # Drake can change an inertia in a Context, but not a plant's default.
        uvms = add_uvms(plant, scaled_files(files, error.mass))
        _check_scaled(plant, files, error.mass)
    uvms = replace(uvms, hydrodynamics=scaled_hydrodynamics(uvms, error))
    return with_payload(plant, uvms, error.payload) if error.payload.present else uvms


def _check_scaled(plant: MultibodyPlant, files: RobotFiles, factor: float) -> None:
    """Raises unless the inertias of all bodies are those of the robot's files, scaled."""
    known = MultibodyPlant(plant.time_step())
    add_uvms(known, files)
    for i in range(1, known.num_bodies()):  # 0 is World.
        body = known.get_body(BodyIndex(i))
        before, after = (each.default_spatial_inertia().CopyToFullMatrix6()
                         for each in (body, plant.get_body(BodyIndex(i))))
        scaled = np.allclose(after, factor * before, rtol=0.0, atol=1e-9 * np.max(abs(before)))
        require(scaled, "model_error.mass", factor,
                f"1 for this robot: its file does not give the mass and the inertia of "
                f"'{body.name()}' by numbers of its own")


def scaled_files(files: RobotFiles, factor: float) -> RobotFiles:
    """Returns the files of a robot with its masses and inertias multiplied, included ones too."""
    def scaled(text: str, name: str) -> str:
        return (scaled_urdf if name.endswith(".urdf") else scaled_inertias)(text, factor)

    return replace(files, text=scaled(files.text, files.file.name.lower()), included={
        name: scaled(text, name) for name, text in files.included.items()})


def scaled_inertias(sdf: str, factor: float) -> str:
    """Returns the text of an SDFormat file with its masses and inertias multiplied."""
    return INERTIAL.sub(
        lambda found: f"<{found[1]}>{float(factor * float(found[2]))!r}</{found[1]}>", sdf)


def scaled_urdf(urdf: str, factor: float) -> str:
    """Returns the text of a URDF file with its masses and inertias multiplied."""
    def scaled(found: re.Match[str]) -> str:
        name, equals, quote, number = found.groups()
        return f"{name}{equals}{quote}{float(factor * float(number))!r}{quote}"

    return URDF_INERTIAL.sub(lambda tag: URDF_NUMBER.sub(scaled, tag[0]), urdf)


def scaled_hydrodynamics(uvms: Uvms, error: ModelError) -> HydrodynamicParameters:
    """Returns the true parameters of the water; `uvms` has the controller's."""
    plant, parameters = uvms.plant, uvms.hydrodynamics
    bodies = {name: _scaled(body, error,
                            plant.GetBodyByName(name, uvms.model_instance).default_com())
              for name, body in parameters.bodies.items()}
    vehicle = uvms.vehicle.name()
    if vehicle in bodies:
        bodies[vehicle] = replace(bodies[vehicle], center_of_buoyancy=(
            bodies[vehicle].center_of_buoyancy + np.asarray(error.buoyancy_shift, dtype=float)))
    return replace(parameters, bodies=bodies)


def _scaled(body: BodyHydrodynamics, error: ModelError, com: np.ndarray) -> BodyHydrodynamics:
    lever = np.asarray(body.center_of_buoyancy, dtype=float) - com
    return replace(
        body, displaced_volume=error.buoyancy * error.mass * body.displaced_volume,
        center_of_buoyancy=com + error.buoyancy_lever * lever,
        added_mass=[replace(item, matrix=error.added_mass * np.asarray(item.matrix, dtype=float))
                    for item in body.added_mass],
        drag=[replace(item, linear=error.drag * np.asarray(item.linear, dtype=float),
                      quadratic=error.drag * np.asarray(item.quadratic, dtype=float))
              for item in body.drag])


@dataclass(frozen=True)
class Unknowns:
    """Differences of the simulated robot and water from the controller's model; none by default."""

    error: ModelError = field(default_factory=ModelError)
    """Errors of the robot."""
    current: np.ndarray = field(default_factory=lambda: np.zeros(3))
    """Velocity of the water in Σ_I (3,) [m/s]."""
    waves: Sequence[Wave] = ()
    """Waves on top of it."""

    @property
    def present(self) -> bool:
        """Whether there is one."""
        return bool(self.error.size > 0.0 or np.any(self.current) or self.waves)
