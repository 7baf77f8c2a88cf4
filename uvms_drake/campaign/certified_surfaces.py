"""Known surfaces that a campaign draws: of other stiffness, tilt, position and heading.

A surface of another stiffness or tilt has a certificate of its own. Position and heading make no
difference: a translation and a turn about the vertical of everything leave gravity, dynamics,
limits and tube unchanged.
"""

from dataclasses import dataclass, replace

import numpy as np
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.common.yaml import yaml_dump_typed, yaml_load_data
from pydrake.math import RotationMatrix

from uvms_drake.certificate.certificate import Certificate
from uvms_drake.certificate.certify import certified_once
from uvms_drake.common.errors import InvalidParameter
from uvms_drake.common.progress import Progress, part_of
from uvms_drake.common.schema import load_typed
from uvms_drake.control.limits import Limits, TubeRadii
from uvms_drake.control.ocp.ocp import MpcConfig
from uvms_drake.mission.steps import Mission
from uvms_drake.model.frames.euler import wrap_angle
from uvms_drake.model.surface.law import Surface
from uvms_drake.station.motions.motions import motion_of
from uvms_drake.station.scenario.scenario import Scenario

OTHER_WALLS = ((0.8, 0.0), (1.25, 0.0), (1.0, -0.1), (1.0, 0.1))
"""Stiffness over the scenario's and tilt [rad] of each other surface."""


@dataclass(frozen=True)
class CertifiedWall:
    """A surface with a certificate, as its differences from the scenario's."""

    stiffness: float
    """Stiffness over the scenario's."""
    tilt: float
    """Turn about the horizontal line in the surface [rad]."""
    tube: str
    """YAML of the certificate's radii."""
    radius: float
    """Radius ε of the terminal set at the scenario's desired force."""


def walls_of(scenario: Scenario, certificate: Certificate, progress: Progress
             ) -> tuple[CertifiedWall, ...]:
    """Returns the scenario's own surface and those of `OTHER_WALLS` that are certified.

    Only a flat surface is tilted. Without forces, and with a contact whose certificate is that of a
    whole class, it is the scenario's own alone.

    Args:
        scenario: Scenario as loaded.
        certificate: Certificate that holds for it.
        progress: Progress callback, as of `certified_once`.
    """
    certified = [(1.0, 0.0, certificate.applied_to(scenario))]
    alone = scenario.contact.draws_surface or not motion_of(scenario).has_forces
    others = () if alone else OTHER_WALLS
    for i, (stiffness, tilt) in enumerate(others):
        if tilt and scenario.surface.normal is None:
            continue
        surface, force = _other_surface(scenario.surface, scenario.task.force, stiffness, tilt)
        other = replace(scenario, surface=surface, task=replace(scenario.task, force=force))
        try:
            found = certified_once(other, part_of(progress, i / len(others), (i + 1) / len(others)))
        except InvalidParameter:  # No equilibrium in the limits, or too large a force at the start.
            continue
        if found.certified:
            certified.append((stiffness, tilt, found.applied_to(other)))
    return tuple(CertifiedWall(stiffness, tilt, yaml_dump_typed(applied.tube),
                               applied.mpc.terminal_radius)
                 for stiffness, tilt, applied in certified)


def with_wall(scenario: Scenario, wall: CertifiedWall) -> Scenario:
    """Returns the scenario with another surface, and with the tube and terminal set of that."""
    surface, force = _other_surface(
        scenario.surface, scenario.task.force, wall.stiffness, wall.tilt)
    return replace(scenario, surface=surface, task=replace(scenario.task, force=force),
                   tube=load_typed(TubeRadii, yaml_load_data(wall.tube)),
                   mpc=replace(scenario.mpc, terminal_radius=wall.radius))


def _other_surface(surface: Surface, force: np.ndarray, stiffness: float, tilt: float
                   ) -> tuple[Surface, np.ndarray]:
    """Returns the surface, stiffer and turned, and 𝔉_des (6,) turned with it."""
    surface = surface.stiffened(stiffness)
    if tilt and surface.normal is not None:
        normal, anchor = (np.asarray(each, dtype=float)
                          for each in (surface.normal, surface.anchor))
        R = RotationMatrix(AngleAxis(tilt, _horizontal_in(normal))).matrix()
        force = np.asarray(force, dtype=float).copy()
        force[:3] = R @ force[:3]
        surface = surface.moved(R, anchor - R @ anchor)
    return surface, force


def _horizontal_in(normal: np.ndarray) -> np.ndarray:
    """Returns a unit vector (3,) in a plane that is horizontal; along x in a horizontal plane."""
    line = np.cross([0.0, 0.0, 1.0], normal)
    length = float(np.linalg.norm(line))
    return line / length if length > 1e-6 else np.array([1.0, 0.0, 0.0])


def turns_freely(mpc: MpcConfig, limits: Limits, mission: Mission) -> bool:
    """Returns whether a turn about the vertical makes no difference to task and nominal MPC.

    Further limits may be along axes of Σ_I, and so are the places of a mission.
    """
    weights = [mpc.weight_y] if mpc.terminal_weight is None else [mpc.weight_y, mpc.terminal_weight]
    even = all(bool(x == y) for x, y in (np.asarray(weight, dtype=float)[:2] for weight in weights))
    return even and not limits.more and not mission.steps


def moved(scenario: Scenario, yaw: float, shift: np.ndarray) -> Scenario:
    """Returns the scenario with everything in Σ_I turned about the vertical, then shifted.

    A disturbance is in the robot's coordinates and stays; w of kinematic motion is one in Σ_I.

    Args:
        scenario: Scenario to move.
        yaw: Angle about the z-axis of Σ_I [rad].
        shift: Displacement in Σ_I (3,) [m].
    """
    R = RotationMatrix.MakeZRotation(yaw).matrix()

    def placed(pose: np.ndarray) -> np.ndarray:
        return np.concatenate([R @ pose[:3] + shift, pose[3:]])

    def turned(angles: np.ndarray) -> np.ndarray:
        return np.append(angles[:2], wrap_angle(angles[2] + yaw))

    task, error = scenario.task, scenario.surface_error
    eta, frame = (np.asarray(each, dtype=float) for each in (scenario.start.eta, task.frame))
    pose = None if task.pose is None else placed(np.asarray(task.pose, dtype=float))
    if np.any(frame):  # The pose's angles are about its axes.
        frame = turned(frame)
    elif pose is not None:
        pose[3:] = turned(pose[3:])
    force = np.asarray(task.force, dtype=float).copy()
    force[:3] = R @ force[:3]
    error = replace(error, shift=R @ np.asarray(error.shift, dtype=float),
                    turn=R @ np.asarray(error.turn, dtype=float))
    return replace(
        scenario, contact=scenario.contact.turned(R), surface=scenario.surface.moved(R, shift),
        surface_error=error,
        current=R @ np.asarray(scenario.current, dtype=float),
        waves=[replace(wave, direction=wave.direction + yaw) for wave in scenario.waves],
        start=replace(scenario.start, eta=np.append(placed(eta)[:3], turned(eta[3:]))),
        task=replace(task, force=force, pose=pose, frame=frame))
