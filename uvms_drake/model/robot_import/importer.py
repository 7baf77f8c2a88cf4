"""Makes the files of a robot's folder out of a file as it is found.

They are SDFormat, water, thrusters, package and notes.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw

from uvms_drake.common.errors import require
from uvms_drake.model.robot_import.bodies import Body, lump, place_thrusters, unique, z_is_up
from uvms_drake.model.robot_import.chain import choose_chain
from uvms_drake.model.robot_import.estimates import FRESH, LAG, estimate, estimate_thrust
from uvms_drake.model.robot_import.plugins import Thruster, read_thrusters, read_water, tell_unread
from uvms_drake.model.robot_import.reading import read_file, read_robot
from uvms_drake.model.robot_import.shapes import drawn
from uvms_drake.model.robot_import.tip import place_tip
from uvms_drake.model.robot_import.tree import Notes, Shape, listed

INERTIAS = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
PLACES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


@dataclass
class Imported:
    """A robot's folder that is still to be written."""

    files: dict[str, bytes]
    """By path in the folder."""
    notes: Notes
    is_copy: bool = False
    """Whether it was a robot's folder already."""


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
    if own := _own_folder(file, name):
        notes.taken.append(f"all of the folder {file.parent}: it is a robot's already (a link "
                           "'vehicle', a frame 'tip', hydrodynamics.yaml), and copied as it is")
        return Imported(own, notes, is_copy=True)
    tree = read_robot(file, notes)
    # Plugins speak of links in their own axes, and their rotors are not joints of an arm.
    waters = read_water(tree, notes)
    thrusters, rotors = read_thrusters(tree, notes)
    tell_unread(tree, notes)
    chain = choose_chain(tree, rotors, notes)
    flips = z_is_up(tree, chain, waters, notes)
    bodies = lump(tree, chain, waters, notes, flips)
    require(sum(body.mass for body in bodies) > 0.0, "--from", str(file),
            "a robot with masses: no link has an <inertial>")
    frames = [link.name for body in bodies for link in body.links if link.mass <= 0.0]
    if frames:
        notes.changed.append(f"links without a mass, taken as frames: {listed(frames)}")
    for body in bodies[1:]:
        if body.mass <= 0.0:
            notes.ask(notes.sdf, f"link {body.name}, inertial", "no mass in the file")
    # Missing numbers are guessed from the others.
    tip = place_tip(tree, bodies, waters.density or FRESH, notes, flips)
    density = estimate(bodies, tip, waters, notes)
    placed = place_thrusters(bodies[0], thrusters, notes)
    # Pictures are spoken of last: the list begins with physics.
    pictures = drawn(bodies, name, notes)
    # The files.
    others = ["tip", *(body.name for body in bodies)]  # SDFormat has one name for one thing.
    joints = unique([joint.name for joint in chain.joints], others)
    files = {f"{name}.sdf": format_sdf(name, file.name, bodies, joints, tip, pictures.shapes),
             "hydrodynamics.yaml": format_water(name, density, bodies),
             "package.xml": format_package(name, file.name)}
    if placed:
        limit, axes = estimate_thrust(bodies[0], placed, notes)
        files["thrusters.yaml"] = format_thrusters(name, placed, axes, limit)
    else:
        notes.ask("thrusters.yaml", "thrusters", "no thruster in the file; without this one the "
                  "wrench on the vehicle has no limit")
    files["README.md"] = f"# {name}\n\nMade of `{file.name}`.\n\n{notes.format()}"
    return Imported({key: text.encode() for key, text in files.items()} | pictures.files, notes)


def _own_folder(file: Path, name: str) -> dict[str, bytes]:
    """Returns the files of the robot's folder that has a file, by a new name; none if it is none.

    Args:
        file: URDF or SDFormat.
        name: Of the new folder.
    """
    folder, found = file.parent, dict[str, bytes]()
    if not (folder / "hydrodynamics.yaml").is_file():
        return found
    names = {(node.tag, node.attributes.get("name")) for node in read_file(file).walk()}
    if not names >= {("link", "vehicle"), ("frame", "tip")}:
        return found
    package = folder / "package.xml"
    old = (read_file(package).value("name") if package.is_file() else None) or folder.name
    for path in (path for path in sorted(folder.rglob("*")) if path.is_file()):
        content = path.read_bytes()
        if path.suffix in (".sdf", ".urdf", ".xml"):
            for before in ("://{}/", "<name>{}</name>"):
                content = content.replace(before.format(old).encode(), before.format(name).encode())
        found[str(path.relative_to(folder))] = content
    found[f"{name}{file.suffix}"] = found.pop(file.name)
    return {"package.xml": format_package(name, file.name).encode()} | found


def number(value: float) -> str:
    """Returns a number in ten digits, and no −0."""
    return f"{value + 0.0:.10g}" if abs(value) > 1e-14 else "0"


def row(values: Iterable[float]) -> str:
    """Returns numbers with blanks between them, as XML has them."""
    return " ".join(number(float(value)) for value in values)


def listing(values: Iterable[float]) -> str:
    """Returns numbers as a list of YAML; with a point, as YAML reads 1e-05 as a text."""
    return "[" + ", ".join(_yaml(float(value)) for value in values) + "]"


def _yaml(value: float) -> str:
    text = number(value)
    return text if "." in text or "e" not in text else text.replace("e", ".0e")


def comment(text: str) -> str:
    """Returns a text that may stand in a comment of XML."""
    return text.replace("--", "- -")


def format_sdf(name: str, source: str, bodies: list[Body], joints: list[str], tip: RigidTransform,
               shapes: list[list[Shape]]) -> str:
    """Returns the SDFormat file.

    Args:
        name: Of the robot.
        source: Of the file from which it was made.
        bodies: Vehicle and arm, in axes of their own.
        joints: Names of the joints.
        tip: Pose of the tip in the last body.
        shapes: Drawn shapes of each body.
    """
    lines = ['<?xml version="1.0"?>',
             f"<!-- {comment(name)}, made of {comment(source)} by `uvms-drake robot` with `from`;",
             "     README.md lists numbers taken, changed and ESTIMATED. SI units. -->",
             '<sdf version="1.9" xmlns:drake="http://drake.mit.edu">',
             f'  <model name="{name}">']
    for i, body in enumerate(bodies):
        lines += _link(body, bodies[i - 1] if i else None, shapes[i])
        if body.joint is not None:
            lines += _joint(body, bodies[i - 1].name, joints[i - 1])
    lines += ["", f'    <frame name="tip" attached_to="{bodies[-1].name}">'
              "  <!-- point of contact, x along the tool -->",
              f"      <pose>{_pose(tip)}</pose>", "    </frame>", "  </model>", "</sdf>"]
    return "\n".join(lines) + "\n"


def _pose(X: RigidTransform) -> str:
    return f"{row(X.translation())} {row(RollPitchYaw(X.rotation()).vector())}"


def _link(body: Body, before: Body | None, shapes: list[Shape]) -> list[str]:
    lines = ["", f'    <link name="{body.name}">']
    names = [link.name for link in body.links]
    if names != [body.name]:
        lines.append(f"      <!-- {comment(', '.join(names))} -->")
    if before is not None:
        lines.append(f'      <pose relative_to="{before.name}">'
                     f"{_pose(before.X.inverse() @ body.X)}</pose>")
    inertia = "".join(f"<{key}>{number(body.inertia[place])}</{key}>"
                      for key, place in zip(INERTIAS, PLACES, strict=True))
    lines += ["      <inertial>", f"        <pose>{row(body.com)} 0 0 0</pose>",
              f"        <mass>{number(body.mass)}</mass>", f"        <inertia>{inertia}</inertia>",
              "      </inertial>"]
    for i, shape in enumerate(shapes):
        lines += [f'      <visual name="visual_{i + 1}">',
                  f"        <pose>{_pose(shape.X)}</pose>",
                  f"        <geometry>{_geometry(shape)}</geometry>"]
        if shape.color is not None:
            lines.append(f"        <material><diffuse>{row(shape.color)}</diffuse></material>")
        lines.append("      </visual>")
    return [*lines, "    </link>"]


def _geometry(shape: Shape) -> str:
    if shape.kind == "mesh":
        return f"<mesh><uri>{escape(shape.uri)}</uri><scale>{row(shape.size)}</scale></mesh>"
    keys = {"box": ["size"], "sphere": ["radius"], "ellipsoid": ["radii"]}.get(
        shape.kind, ["radius", "length"])
    sizes = [shape.size] if len(keys) == 1 else [shape.size[i:i + 1] for i in range(2)]
    inner = "".join(f"<{key}>{row(size)}</{key}>" for key, size in zip(keys, sizes, strict=True))
    return f"<{shape.kind}>{inner}</{shape.kind}>"


def _joint(body: Body, parent: str, name: str) -> list[str]:
    joint = body.joint
    assert joint is not None and joint.rotor is not None
    limits = [f"<{key}>{number(value)}</{key}>" for key, value in (
        ("lower", joint.lower), ("upper", joint.upper)) if np.isfinite(value)]
    limits += [f"<{key}>{number(value)}</{key}>" for key, value in (
        ("effort", joint.effort), ("velocity", joint.velocity)) if value]
    kind = "prismatic" if joint.kind == "prismatic" else "revolute"
    return ["", f'    <joint name="{name}" type="{kind}">'
            + (f"  <!-- {comment(joint.name)} -->" if joint.name != name else ""),
            f"      <parent>{parent}</parent>", f"      <child>{body.name}</child>", "      <axis>",
            f"        <xyz>{row(joint.axis / np.linalg.norm(joint.axis))}</xyz>",
            f"        <limit>{''.join(limits)}</limit>",
            f"        <dynamics><damping>{number(joint.damping)}</damping></dynamics>",
            "      </axis>",
            f"      <drake:rotor_inertia>{number(joint.rotor[0])}</drake:rotor_inertia>",
            f"      <drake:gear_ratio>{number(joint.rotor[1])}</drake:gear_ratio>", "    </joint>"]


def format_water(name: str, density: float, bodies: list[Body]) -> str:
    """Returns hydrodynamics.yaml."""
    lines = [f"# Water on {name}; README.md lists each ESTIMATE. SI units, axes",
             f"# and origins of the bodies in {name}.sdf, order (x, y, z, roll, pitch, yaw).",
             "", f"fluid_density: {_yaml(density)}  # [kg/m³]", "", "bodies:"]
    for body in bodies:
        lines += [f"  {body.name}:", f"    displaced_volume: {_yaml(body.volume or 0.0)}  # [m³]",
                  f"    center_of_buoyancy: {listing(body.center)}  # [m]", "    added_mass:"]
        for item in body.added_mass:
            M = np.asarray(item.matrix)
            off = np.max(np.abs(M - np.diag(np.diag(M))))
            rows = [listing(np.diag(M))] if off <= 1e-12 * np.max(np.abs(M)) else [
                "[" + ",\n               ".join(listing(values) for values in M) + "]"]
            lines += [f"      - matrix: {rows[0]}", f"        point: {listing(item.point)}"]
        lines.append("    drag:")
        for strip in body.drag:
            lines += [f"      - linear: {listing(strip.linear)}",
                      f"        quadratic: {listing(strip.quadratic)}",
                      f"        point: {listing(strip.point)}"]
    return "\n".join(lines) + "\n"


def format_thrusters(name: str, placed: list[Thruster],
                     undriven: list[str], force: float) -> str:
    """Returns thrusters.yaml; thrusters with the same curve and lag are of one kind.

    Args:
        name: Of the robot.
        placed: Thrusters with positions [m] and axes in the vehicle's frame.
        undriven: Axes that they do not drive.
        force: Of those whose curve is not known [N].
    """
    # Thrusters, each of a kind that is written when it first occurs.
    kinds: dict[tuple[object, ...], str] = {}
    lines = [f"# The thrusters of {name}; README.md lists each ESTIMATE. SI units, in",
             "# the vehicle's frame (FRD). An axis points to where a positive force pushes.", "",
             f"undriven: [{', '.join(undriven)}]", "", "kinds:"]
    rows = []
    for thruster in placed:
        known = thruster.force.size >= 2
        command, values = thruster.curve(force)
        key = (tuple(command), tuple(values), thruster.lag, thruster.smallest)
        if key not in kinds:
            kinds[key] = f"thruster_{len(kinds) + 1}"
            lines += [f"  {kinds[key]}:", f"    lag: {_yaml(thruster.lag or LAG)}  # [s]"
                      + ("" if thruster.lag else " ESTIMATE"),
                      *([f"    smallest: {_yaml(thruster.smallest)}  # [N], of its dead band"]
                        if thruster.smallest else []),
                      "    curves:  # command, and the force at it [N]"
                      + ("" if known else " ESTIMATE"),
                      f"      - command: {listing(command)}", f"        force: {listing(values)}"]
        rows.append(f"{{kind: {kinds[key]}, position: {listing(thruster.position)}, "
                    f"axis: {listing(thruster.axis)}}}")
    names = [f"thruster_{name}" if name[0].isdigit() else name
             for name in unique([thruster.name for thruster in placed])]
    return "\n".join([*lines, "", "thrusters:", *(
        f"  {each}: {text}" for each, text in zip(names, rows, strict=True))]) + "\n"


def format_package(name: str, source: str) -> str:
    """Returns package.xml."""
    return ('<?xml version="1.0"?>\n<package format="2">\n'
            f"  <name>{name}</name>\n  <version>0.1.0</version>\n"
            f"  <description>Made of {escape(source)}</description>\n"
            "  <license>that of the file it was made of</license>\n</package>\n")

