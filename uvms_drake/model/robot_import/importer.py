"""Makes the files of a robot's folder out of a file as it is found."""

from dataclasses import dataclass
from pathlib import Path

from uvms_drake.common.errors import require
from uvms_drake.model.description.thruster_file import undriven_axes
from uvms_drake.model.robot_import.bodies import (
    ask_for_forward_axis,
    lump,
    place_thrusters,
    unique,
    z_is_up,
)
from uvms_drake.model.robot_import.chain import choose_chain
from uvms_drake.model.robot_import.estimates import (
    FRESH,
    ask_for_trim,
    estimate_motors,
    estimate_water,
    take_collisions,
    thrust_limit,
)
from uvms_drake.model.robot_import.notes import Notes, listed
from uvms_drake.model.robot_import.reading import read_robot
from uvms_drake.model.robot_import.shapes import drawn
from uvms_drake.model.robot_import.thrust import Thruster, read_thrusters
from uvms_drake.model.robot_import.tip import place_tip
from uvms_drake.model.robot_import.tree import Tree
from uvms_drake.model.robot_import.water import is_water, read_water
from uvms_drake.model.robot_import.write import (
    LAG,
    format_package,
    format_sdf,
    format_thrusters,
    format_water,
)


@dataclass
class Imported:
    """A robot's folder that is still to be written."""

    files: dict[str, bytes]
    """By path in the folder."""
    notes: Notes


def import_robot(file: Path, name: str) -> Imported:
    """Returns the folder of a robot, made of a URDF or SDFormat file.

    Args:
        file: Of the robot, as it was found.
        name: Of the folder.

    Raises:
        InvalidParameter: The file cannot be read, or is no robot.
    """
    # The file, and its robot: bodies of a vehicle and its arm.
    notes = Notes(f"{name}.sdf")
    tree = read_robot(file, notes)
    _tell_unread(tree, notes)
    # Plugins speak of links in their own axes, and their rotors are not joints of an arm.
    waters = read_water(tree, notes)
    thrusters, rotors = read_thrusters(tree, notes)
    chain = choose_chain(tree, rotors, notes)
    flips = z_is_up(tree, chain, waters, notes)
    bodies = lump(tree, chain, waters, notes, flips)
    ask_for_forward_axis(bodies, notes)
    require(sum(body.mass for body in bodies) > 0.0, "--from", str(file),
            "a robot with masses: no link has an <inertial>")
    frames = [link.name for body in bodies for link in body.links if link.mass <= 0.0]
    if frames:
        notes.changed.append(f"links without a mass, taken as frames: {listed(frames)}")
    for body in bodies[1:]:
        if body.mass <= 0.0:
            notes.ask(notes.sdf, f"link {body.name}, inertial", "no mass in the file")
    # Missing numbers are guessed from the others.
    tip = place_tip(tree, bodies, notes, flips)
    density = waters.density or FRESH
    if waters.shapes_float:
        take_collisions(bodies, density, notes)
    estimate_water(bodies, tip, waters, notes)
    ask_for_trim(bodies, density, notes)
    estimate_motors(bodies, notes)
    placed = place_thrusters(bodies[0], thrusters, notes)
    # Pictures are spoken of last: the list begins with physics.
    pictures = drawn(bodies, name, notes)
    # The files.
    joints = unique([joint.name for joint in chain.joints])
    files = {f"{name}.sdf": format_sdf(name, file.name, bodies, joints, tip, pictures.shapes),
             "hydrodynamics.yaml": format_water(name, density, bodies),
             "package.xml": format_package(name, file.name)}
    if placed:
        limit = thrust_limit(bodies[0])
        axes = _undriven(placed, limit, notes)
        files["thrusters.yaml"] = format_thrusters(name, placed, axes, limit)
    else:
        notes.ask("thrusters.yaml", "thrusters", "no thruster in the file; without this one the "
                  "wrench on the vehicle has no limit")
    files["README.md"] = f"# {name}\n\nMade of `{file.name}`.\n\n{notes.format()}"
    return Imported({key: text.encode() for key, text in files.items()} | pictures.files, notes)


def _tell_unread(tree: Tree, notes: Notes) -> None:
    """Says which plugins and elements have no meaning here."""
    plugins = sorted({plugin.attributes.get("filename", "?") for _, plugin in tree.plugins
                      if not is_water(plugin) and "thruster" not in (plugin.attributes.get(
                          "filename", "") + plugin.attributes.get("name", "")).lower()})
    if plugins:
        notes.changed.append(f"plugins without a meaning here, left out: {listed(plugins)}")


def _undriven(placed: list[Thruster], limit: float, notes: Notes) -> list[str]:
    """Returns the axes that no thruster drives, and asks for the unknown numbers of thrusters."""
    unknown = [thruster.name for thruster in placed if thruster.force.size < 2]
    if unknown:
        notes.ask("thrusters.yaml", "kinds.*.curves", f"no limit of {listed(unknown)} in the file. "
                  f"ESTIMATE: ±{limit:g} N, with which one alone moves the vehicle at 1 m/s")
    if any(thruster.lag is None for thruster in placed):
        notes.ask("thrusters.yaml", "kinds.*.lag", f"the file has none. ESTIMATE: {LAG:g} s")
    axes = undriven_axes([(thruster.position, thruster.axis) for thruster in placed])
    if axes:
        notes.taken.append(f"axes that the thrusters do not drive: {', '.join(axes)}")
    return axes
