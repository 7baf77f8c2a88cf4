"""Declared unknowns: differences of the simulated robot and water from the controller's model."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import BodyIndex

from uvms_drake.common.constraints import Below, Between, Constraint, Vector
from uvms_drake.common.errors import require, within
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
COEFFICIENTS = ("added_mass", "linear_drag", "quadratic_drag")
"""Fields of `AxisFactors`."""
BODIES = ("vehicle", "arm")
"""Fields of a `ModelError` that are `AxisFactors`."""
ROUNDED = 1e-6
"""Negative eigenvalue of an added mass over its largest entry that is taken as rounding."""
LEAST_FACTOR, LARGEST_FACTOR = 0.1, 10.0
"""Bounds of factors."""
Factor = Annotated[float, Between(LEAST_FACTOR, LARGEST_FACTOR)]
BY_AXIS = Constraint(
    f"1 number, or 6 of x, y, z, roll, pitch, yaw, from {LEAST_FACTOR} to {LARGEST_FACTOR}",
    lambda x: np.shape(x) in ((1,), (6,)) and np.all((x >= LEAST_FACTOR) & (x <= LARGEST_FACTOR)))
ByAxis = Annotated[np.ndarray, BY_AXIS]


@dataclass
class AxisFactors:
    """Factors of the water's coefficients by axis of a body, (6,) or (1,) for all axes."""

    added_mass: ByAxis = field(default_factory=lambda: np.ones(1))
    """Factors of added masses; an entry between two axes has the mean of theirs."""
    linear_drag: ByAxis = field(default_factory=lambda: np.ones(1))
    """Factors of the coefficients of linear drag."""
    quadratic_drag: ByAxis = field(default_factory=lambda: np.ones(1))
    """Factors of the coefficients of quadratic drag."""


@dataclass
class ModelError:
    """Difference of the simulated robot from the controller's model; factors are 1 without."""

    mass: Factor = 1.0
    """Factor of masses, inertias and displaced volumes: a robot is trimmed before it dives."""
    added_mass: Factor = 1.0
    """Factor of the added masses."""
    drag: Factor = 1.0
    """Factor of the drag coefficients."""
    buoyancy_lever: Factor = 1.0
    """Factor of each body's distance from the centre of mass to that of buoyancy."""
    buoyancy: Factor = 1.0
    """Factor of the displaced volumes alone: a robot that is not trimmed."""
    buoyancy_shift: Annotated[np.ndarray, Vector(3)] = field(default_factory=lambda: np.zeros(3))
    """Displacement of the vehicle's centre of buoyancy, in its axes [m]; as an unknown, each
    component is of either sign."""
    vehicle: AxisFactors | None = None
    """Factors by axis of the body `vehicle`, in addition to those of all bodies."""
    arm: AxisFactors | None = None
    """The same of all other bodies, each in its own axes."""
    payload: Payload = field(default_factory=Payload)
    """Payload in the hand."""
    joint_friction: JointFriction = field(default_factory=JointFriction)
    """Dry friction of the joints."""
    share: Annotated[float, Below(1)] = 0.0
    """Fraction of d̃ reserved for the effect of the error, of a current and of waves, not for the
    disturbance."""

    def by_axis(self, body: str, name: str) -> np.ndarray:
        """Returns the factors (6,) of one of `BODIES` and one of `COEFFICIENTS`."""
        factors = getattr(self, body) or AxisFactors()
        return np.broadcast_to(np.asarray(getattr(factors, name), dtype=float), 6)

    @property
    def size(self) -> float:
        """Largest error, relative or in its own unit; zero if there is none."""
        return max(*(abs(getattr(self, name) - 1.0) for name in FACTORS),
                   *(float(np.max(np.abs(self.by_axis(body, name) - 1.0)))
                     for body in BODIES for name in COEFFICIENTS),
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


def simulated_uvms(robot: Robot | str, error: ModelError | None) -> Uvms:
    """Returns the simulated robot, as of `add_simulated_uvms`, in a finalized plant of its own."""
    plant = MultibodyPlant(time_step=0.0)
    uvms = add_simulated_uvms(plant, robot, error)
    plant.Finalize()
    return uvms


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
    plant, parameters, bodies = uvms.plant, uvms.hydrodynamics, {}
    for name, body in parameters.bodies.items():
        part = "vehicle" if name == uvms.vehicle.name() else "arm"
        com = plant.GetBodyByName(name, uvms.model_instance).default_com()
        with within(f"model_error.{part}"):
            bodies[name] = _scaled(body, error, part, com)
    vehicle = uvms.vehicle.name()
    if vehicle in bodies:
        bodies[vehicle] = replace(bodies[vehicle], center_of_buoyancy=(
            bodies[vehicle].center_of_buoyancy + np.asarray(error.buoyancy_shift, dtype=float)))
    return replace(parameters, bodies=bodies)


def _scaled(body: BodyHydrodynamics, error: ModelError, part: str, com: np.ndarray
            ) -> BodyHydrodynamics:
    lever = np.asarray(body.center_of_buoyancy, dtype=float) - com
    added, linear, quadratic = (error.by_axis(part, name) for name in COEFFICIENTS)
    return replace(
        body, displaced_volume=error.buoyancy * error.mass * body.displaced_volume,
        center_of_buoyancy=com + error.buoyancy_lever * lever,
        added_mass=[replace(item, matrix=error.added_mass * scaled_added_mass(
            item.matrix, added)) for item in body.added_mass],
        drag=[replace(item, linear=error.drag * linear * np.asarray(item.linear, dtype=float),
                      quadratic=error.drag * quadratic * np.asarray(item.quadratic, dtype=float))
              for item in body.drag])


def scaled_added_mass(matrix: np.ndarray, factors: np.ndarray) -> np.ndarray:
    """Returns ½(FM + MF), F = diag(factors), for M (6, 6) or its diagonal (6,).

    It is linear in the factors, and its diagonal is F times that of M.

    Raises:
        InvalidParameter: No body has such an added mass, by entries between axes.
    """
    M = np.asarray(matrix, dtype=float)
    if M.ndim == 1:
        return factors * M
    out: np.ndarray = 0.5 * (factors[:, None] + factors) * M
    require(bool(np.linalg.eigvalsh(out)[0] >= -ROUNDED * np.max(np.abs(M))), "added_mass",
            factors, "factors by which the matrix stays positive semidefinite: nearer to another")
    return out


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
