"""Estimates of the numbers that a file does not give; the notes ask for each, with its key.

They are of the right size for a robot that swims: neutral, upright, a box of a vehicle and an arm
of cylinders.
"""

from itertools import pairwise

import numpy as np
from pydrake.math import RigidTransform

from uvms_drake.common.errors import require
from uvms_drake.model.description.hydrodynamics_file import (
    AddedMass,
    Drag,
    added_mass_about_origin,
)
from uvms_drake.model.description.thruster_file import AXES, undriven_axes
from uvms_drake.model.description.water_center import center_of_water
from uvms_drake.model.robot_import.bodies import Body
from uvms_drake.model.robot_import.plugins import Thruster, Waters
from uvms_drake.model.robot_import.shapes import volume_of
from uvms_drake.model.robot_import.sizes import plausible_size
from uvms_drake.model.robot_import.tree import Notes, listed

FRESH = 1000.0
"""Density of water that a file does not give [kg/m³]."""
FLOATS = (0.8, 1.25)
"""Displaced mass over mass of shapes that can be those of a robot that swims."""
ARM_FLOATS = 0.6
"""Displaced mass over mass of a link of an arm."""
SPARE = 1.002
"""Displaced mass over mass of a robot that comes up by itself."""
LEVER = 0.1
"""Height of buoyancy over mass, over the edge of a cube of the vehicle's volume."""
DRAG = 1.1
"""C_D of boxes, and of cylinders across."""
GEAR = 100.0
"""Ratio in which the inertia of an unknown motor is written."""
LEAST_MOTOR = 0.05
"""Least inertia of a motor as its joint feels it [kg m², kg]."""
OF_LARGEST = 0.02
"""Least inertia of a motor, over that of the load of the arm's strongest one."""
SLENDER = 3.0
"""Ratio of two shadows, or of two added masses, from which a body is slender."""
SPEED = 1.0
"""Speed that thrusters of unknown force are to reach [m/s]."""
LAG = 0.15
"""Time constant of a thruster that a file does not give [s]."""
WATER = "hydrodynamics.yaml"


def estimate(bodies: list[Body], tip: RigidTransform, waters: Waters, notes: Notes) -> float:
    """Fills in all that a file does not give, thrusters apart; returns the water's density [kg/m³].

    Args:
        bodies: Vehicle and arm, changed.
        tip: Pose of the tip in the last body.
        waters: Water of the file.
        notes: Ask for each number.
    """
    density = waters.density or FRESH
    require(density > 0.0, "fluid density of the plugins", density, "positive [kg/m³]")
    known = [body for body in bodies if body.added_mass]
    if waters.shapes_float:
        _take_collisions(bodies, density, notes)
    _estimate_water(bodies, tip, waters, notes)
    # Another volume of the vehicle is asked for if the robot is far from neutral.
    mass = sum(body.mass for body in bodies)
    displaced = density * sum(body.volume or 0.0 for body in bodies)
    if abs(displaced - mass) > 0.02 * mass:
        volume = (bodies[0].volume or 0.0) + (SPARE * mass - displaced) / density
        notes.ask(WATER, "bodies.vehicle.displaced_volume",
                  f"the robot weighs {mass:.4g} kg and displaces {displaced:.4g} kg of water; with "
                  f"floats or ballast for neutral trim: {volume:.6g} m³")
    for body in known:
        line, fits = center_of_water(added_mass_about_origin(body.added_mass),
                                     body.volume or 0.0, body.center, density)
        if not fits:
            notes.ask(WATER, f"bodies.{body.name}.added_mass", line)
    _estimate_motors(bodies, notes)
    return density


def estimate_thrust(vehicle: Body, placed: list[Thruster], notes: Notes) -> tuple[float, list[str]]:
    """Returns the force [N] of thrusters without a curve, and the axes that no thruster drives."""
    # The force that pulls the vehicle at `SPEED` forward or sideways, as far as they push so.
    axes = undriven_axes([(thruster.position, thruster.axis) for thruster in placed])
    drag = sum((strip.linear + strip.quadratic * SPEED for strip in vehicle.drag), np.zeros(6))
    pulls = SPEED * drag[[axis not in axes for axis in AXES[:2]] + 4 * [False]]
    limit = float(f"{np.max(pulls, initial=1.0):.2g}")
    unknown = [thruster.name for thruster in placed if thruster.force.size < 2]
    if unknown:
        notes.ask("thrusters.yaml", "kinds.*.curves", f"no limit of {listed(unknown)} in the file. "
                  f"ESTIMATE: ±{limit:g} N, with which one alone moves the vehicle at 1 m/s")
    if any(thruster.lag is None for thruster in placed):
        notes.ask("thrusters.yaml", "kinds.*.lag", f"the file has none. ESTIMATE: {LAG:g} s")
    notes.ask("thrusters.yaml", "dead_time", "no file of this kind has it. ESTIMATE: 0 s, where "
              "those that were measured are 0.05 to 0.11 s")
    if axes:
        notes.taken.append(f"axes that the thrusters do not drive: {', '.join(axes)}")
    return limit, axes


def _take_collisions(bodies: list[Body], density: float, notes: Notes) -> None:
    """Takes volumes from collision shapes, as Gazebo does, if those are of a robot that swims."""
    unknown = [body for body in bodies if body.volume is None]
    found = {}
    for body in unknown:
        parts = [(volume_of(shape), shape.X.translation()) for shape in body.collisions]
        found[body.name] = sum(volume for volume, _ in parts), sum(
            (volume * center for volume, center in parts), np.zeros(3))
    known = sum(body.volume or 0.0 for body in bodies)
    share = density * (known + sum(volume for volume, _ in found.values())) / sum(
        body.mass for body in bodies)
    if not FLOATS[0] <= share <= FLOATS[1]:
        notes.changed.append(f"collision shapes displace {share:.3g} times the robot's mass of "
                             "water, so that they are not its volume: not used for that")
        return
    for body in unknown:
        volume, moment = found[body.name]
        body.volume = volume
        body.center = moment / volume if volume > 0.0 else body.com
    notes.taken.append("volumes of collision shapes, as Gazebo takes them: "
                       f"{listed([body.name for body in unknown], 20)}")


def _estimate_water(bodies: list[Body], tip: RigidTransform, waters: Waters, notes: Notes) -> None:
    """Fills in volumes, added mass and drag of all bodies that have none."""
    density = waters.density or FRESH
    if waters.density is None:
        notes.ask(WATER, "fluid_density", f"none in the file. ESTIMATE: {FRESH:g} kg/m³, fresh; "
                  "the sea has 1025")
    ends: list[np.ndarray | None] = [None]  # Of each body; a vehicle is a box.
    if len(bodies) > 1:
        ends += [(body.X.inverse() @ after.X).translation()
                 for body, after in pairwise(bodies[1:])] + [tip.translation()]
    guesses: dict[str, list[str]] = {}
    for body in bodies[1:]:
        if body.volume is None:
            body.volume, body.center = ARM_FLOATS * body.mass / density, body.com
            guesses.setdefault("displaced_volume", []).append(body.name)
    if bodies[0].volume is None:
        _float(bodies, density, notes)
    for body, end in zip(bodies, ends, strict=True):
        if not body.added_mass:
            body.added_mass = [_added_mass(body, end, density)]
            guesses.setdefault("added_mass", []).append(body.name)
        if not body.drag:
            body.drag = (_shadow_drag(body, density, notes) if end is None
                         else _rod_drag(body, end, density))
            guesses.setdefault("drag", []).append(body.name)
    reasons = {"displaced_volume": f"{ARM_FLOATS:g} of the volume that carries its mass",
               "added_mass": "the displaced water of the vehicle; of links, a cylinder across",
               "drag": "the shadows of the vehicle's shapes, or a cylinder across in three strips, "
                       f"with C_D = {DRAG:g}"}
    for key, names in guesses.items():
        notes.ask(WATER, f"bodies.*.{key}", f"of {listed(names, 20)}. ESTIMATE: {reasons[key]}")


def _estimate_motors(bodies: list[Body], notes: Notes) -> None:
    """Gives a motor to each joint that has none, and asks for efforts and limits."""
    motors, efforts, limits, friction = [], [], [], []
    # Inertias that the motors have to move.
    least = max([LEAST_MOTOR, *(OF_LARGEST * body.beyond for body in bodies[1:])])
    # Each joint, and the numbers that it lacks.
    for body in bodies[1:]:
        joint = body.joint
        assert joint is not None
        if joint.rotor is None:
            joint.rotor = (float(f"{max(body.beyond, least):.2g}") / GEAR**2, GEAR)
            motors.append(joint.name)
        if not joint.effort:
            efforts.append(joint.name)
        if not np.isfinite([joint.lower, joint.upper]).all() and joint.kind != "continuous":
            limits.append(joint.name)
        if joint.friction:
            friction.append(f"{joint.name} {joint.friction:g}")
    if motors:
        notes.ask(notes.sdf, "drake:rotor_inertia, drake:gear_ratio", f"of {listed(motors, 20)}. "
                  "ESTIMATE: gear² times rotor is the inertia of all that is beyond the joint, "
                  f"{least:.2g} kg m² at least")
    if efforts:
        notes.ask(notes.sdf, "axis/limit/effort", f"of {listed(efforts, 20)}: none, or 0, in the "
                  "file; without it a motor has no limit [N m, N]")
    if limits:
        notes.ask(notes.sdf, "axis/limit/lower, upper",
                  f"of {listed(limits, 20)}: none in the file")
    if friction:
        notes.changed.append(f"friction of joints ({listed(friction)}) left out: it is a part of "
                             "the disturbance, or `model_error.joint_friction` of a scenario")


def _float(bodies: list[Body], density: float, notes: Notes) -> None:
    """Gives the vehicle the volume and centre by which the robot is neutral, level and upright.

    Level it is with its arm in the middle of the joints' limits.
    """
    vehicle = bodies[0]
    mass = sum(body.mass for body in bodies)
    volume = SPARE * mass / density - sum(body.volume or 0.0 for body in bodies[1:])
    vehicle.volume = max(volume, 0.5 * vehicle.mass / density)
    moment, displaced, water = np.zeros(3), density * vehicle.volume, np.zeros(3)
    for body in bodies:
        moment += body.mass * (body.middle @ body.com)
        if body is not vehicle:
            own = density * (body.volume or 0.0)
            displaced, water = displaced + own, water + own * (body.middle @ body.center)
    center = (moment / mass * displaced - water) / (density * vehicle.volume)
    center[2] -= LEVER * vehicle.volume ** (1.0 / 3.0)
    vehicle.center = center
    notes.ask(WATER, "bodies.vehicle.displaced_volume, center_of_buoyancy",
              "ESTIMATE: the robot is neutral, level with its arm in the middle of its limits, and "
              "upright")


def _rod(body: Body, end: np.ndarray) -> tuple[np.ndarray, float]:
    """Returns the direction (3,) and length [m] of a link that ends at a frame."""
    length = float(np.linalg.norm(end))
    if length < 1e-3:
        size = (body.volume or 1e-6) ** (1.0 / 3.0)
        return np.array([1.0, 0.0, 0.0]), size
    return end / length, length


def _added_mass(body: Body, end: np.ndarray | None, density: float) -> AddedMass:
    """Returns an added mass: of a box, or of a cylinder across."""
    water = density * (body.volume or 0.0)
    if end is None:
        return AddedMass(np.diag([*[water] * 3, *np.diag(body.inertia)]), body.center)
    direction, length = _rod(body, end)
    across = np.eye(3) - np.outer(direction, direction)
    M = np.zeros((6, 6))
    M[:3, :3], M[3:, 3:] = water * across, water * length**2 / 12.0 * across
    return AddedMass(M, body.center)


def _shadow_drag(body: Body, density: float, notes: Notes) -> list[Drag]:
    """Returns the drag across the shadows of a body, which turn about the middle of the volume.

    ½ ρ C_D A, and ½ ρ C_D A e³ / 32 of the larger of two faces of length e across the axis; without
    shapes, of a cube.
    """
    cube, size = (body.volume or 1e-3) ** (1.0 / 3.0), plausible_size(body, density, notes)
    edge = np.full(3, cube) if size is None else np.ptp(size[0], axis=0)
    areas = np.full(3, cube**2) if size is None else size[1]
    added = np.diag(added_mass_about_origin(body.added_mass))[:3]
    thin, light = np.argmin(areas), np.argmin(added)
    if areas[light] > SLENDER * areas[thin] and added[thin] > SLENDER * added[light]:
        notes.ask(WATER, f"bodies.{body.name}.added_mass", "by its added mass the body is slender "
                  f"along {'xyz'[light]}, by the shadows of its shapes along {'xyz'[thin]}: one of "
                  "them is in other axes")
    turning = np.maximum(areas[[1, 2, 0]] * edge[[2, 0, 1]] ** 3,
                         areas[[2, 0, 1]] * edge[[1, 2, 0]] ** 3)
    quadratic = 0.5 * density * DRAG * np.concatenate([areas, turning / 32.0])
    return [Drag(0.1 * quadratic, quadratic, body.center)]


def _rod_drag(body: Body, end: np.ndarray, density: float) -> list[Drag]:
    """Returns the drag of a cylinder across its axis, in three strips."""
    direction, length = _rod(body, end)
    radius = np.sqrt((body.volume or 0.0) / (np.pi * length))
    across = 1.0 - direction**2
    strip = 0.5 * density * DRAG * 2.0 * radius * length / 3.0 * across
    quadratic = np.concatenate([strip, np.zeros(3)])
    return [Drag(np.zeros(6), quadratic, share * length * direction)
            for share in (1.0 / 6.0, 0.5, 5.0 / 6.0)]
