"""Reads thrusters from plugins of Gazebo, or from links that are rotors by their names.

A thruster of gz-sim pushes its link along the joint's axis; that of uuv_simulator pushes it along
the link's own x. A rotor that has no plugin is taken to push along its joint's axis.
"""

from dataclasses import dataclass, field

import numpy as np

from uvms_drake.model.description.xml_tree import Node
from uvms_drake.model.robot_import.chain import ROTOR
from uvms_drake.model.robot_import.notes import Notes, listed
from uvms_drake.model.robot_import.tree import Joint, Link, Tree

POINTS = 8
"""Number of commands on a parabola, each way."""
GZ_MOST = 1000.0
"""Size of gz-sim's commands in a file without a limit: none that is meant."""


@dataclass
class Thruster:
    """A thruster, in axes of its link, or of the vehicle once it is placed."""

    name: str
    link: Link
    axis: np.ndarray
    """Direction of a positive force."""
    position: np.ndarray = field(default_factory=lambda: np.zeros(3))
    command: np.ndarray = field(default_factory=lambda: np.zeros(0))
    force: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """The curve [N]; empty if it is not known."""
    lag: float | None = None


def read_thrusters(tree: Tree, notes: Notes) -> tuple[list[Thruster], set[str]]:
    """Returns the thrusters and the names of their joints, and says where they were found."""
    # Plugins, each of one thruster.
    found: list[Thruster] = []
    joints: set[str] = set()
    for prefix, plugin in tree.plugins:
        name = plugin.attributes.get("filename", "") + plugin.attributes.get("name", "")
        if "thruster" not in name.lower():
            continue
        joint = tree.find_joint(prefix, plugin.value("joint_name") or plugin.value("jointName")
                                or "")
        link = tree.find_link(prefix, joint.child if joint is not None
                              else plugin.value("linkName") or "")
        if link is None:
            notes.changed.append(f"thruster plugin at line {plugin.line}: its joint or link is not "
                                 "there, left out")
            continue
        gz = plugin.value("joint_name") is not None
        axis = _axis(joint, link) if gz and joint is not None else np.array([1.0, 0.0, 0.0])
        thruster = Thruster(_short(link.name), link, axis,
                            lag=plugin.known("dynamics/timeConstant"))
        (_gz_curve if gz else _uuv_curve)(plugin, thruster)
        found.append(thruster)
        joints |= {joint.name} if joint is not None else set()
    # Rotors by their names, of which plugins may have left some.
    named = [joint for joint in tree.joints.values()
             if ROTOR.search(joint.name) or ROTOR.search(joint.child)]
    rotors = [joint for joint in named if joint.kind in ("continuous", "revolute")]
    lost = [joint.name for joint in (named if found or not rotors else ())
            if joint.name not in joints and joint.child not in {item.link.name for item in found}]
    if lost:
        notes.ask("thrusters.yaml", "thrusters", f"{listed(lost)} are of rotors by their names, "
                  "but neither a plugin nor an axis says where they push: not taken")
    if found:
        notes.taken.append(f"thrusters of plugins: {listed([item.name for item in found], 16)}")
    else:
        found = [Thruster(_short(joint.child), tree.links[joint.child], _axis(
            joint, tree.links[joint.child])) for joint in rotors]
        if found:
            notes.taken.append("thrusters of rotors, which push along the axes of their joints: "
                               f"{listed([item.name for item in found], 16)}")
    return found, joints | {joint.name for joint in tree.joints.values()
                            if any(joint.child == item.link.name for item in found)}


def _short(name: str) -> str:
    return name.rsplit("::", 1)[-1].rsplit("/", 1)[-1].removesuffix("_link")


def _axis(joint: Joint, link: Link) -> np.ndarray:
    axis = (link.X.inverse() @ joint.X).rotation() @ joint.axis
    return axis / np.linalg.norm(axis)


def _gz_curve(plugin: Node, thruster: Thruster) -> None:
    """Takes the limits of gz-sim's thruster: of its force, or of its speed."""
    least = plugin.number("min_thrust_cmd", -GZ_MOST)
    most = plugin.number("max_thrust_cmd", GZ_MOST)
    if plugin.is_true("use_angvel_cmd"):
        gain = (plugin.number("thrust_coefficient", 1.0) * plugin.number("fluid_density", 1000.0)
                * plugin.number("propeller_diameter", 0.02)**4)
        if plugin.value("max_thrust_cmd"):
            _parabola(thruster, gain, least, most)
    elif -GZ_MOST < least < most < GZ_MOST:
        thruster.command = thruster.force = np.unique([least, 0.0, most])


def _uuv_curve(plugin: Node, thruster: Thruster) -> None:
    """Takes the curve of uuv_simulator's thruster between the limits of command and force."""
    kind, gain = plugin.value("conversion/type"), plugin.number("gain", 1.0) or 1.0
    least, most, weakest, strongest = (plugin.known(key) for key in (
        "clampMin", "clampMax", "thrustMin", "thrustMax"))
    share = plugin.number("thrust_efficiency", 1.0) or 1.0
    if kind == "LinearInterp" and plugin.value("conversion/inputValues"):
        thruster.command = plugin.numbers("conversion/inputValues") / gain
        thruster.force = share * plugin.numbers("conversion/outputValues")
    elif kind == "Basic":
        k = share * gain**2 * plugin.number("conversion/rotorConstant")
        if least is None and weakest is not None and strongest is not None and k > 0.0:
            least, most = (float(np.sign(f) * np.sqrt(abs(f) / k)) for f in (weakest, strongest))
        if least is not None and most is not None and k != 0.0:
            _parabola(thruster, k, least, most)
    elif kind == "Bessa" and least is not None and most is not None:
        gains = [share * plugin.number(f"conversion/rotorConstant{side}") for side in "LR"]
        d = [plugin.number(f"conversion/delta{side}") for side in "LR"]
        edge = [float(np.sign(x) * np.sqrt(abs(x))) / gain for x in d]
        x = np.unique([*np.linspace(least, edge[0], POINTS), *np.linspace(edge[1], most, POINTS)])
        square = np.abs(gain * x) * gain * x
        thruster.command = x
        thruster.force = np.where(x <= edge[0], gains[0] * (square - d[0]), np.where(
            x >= edge[1], gains[1] * (square - d[1]), 0.0))
    if thruster.force.size and weakest is not None and strongest is not None:
        inside = (thruster.force >= weakest) & (thruster.force <= strongest)
        thruster.command, thruster.force = thruster.command[inside], thruster.force[inside]


def _parabola(thruster: Thruster, gain: float, least: float, most: float) -> None:
    """Gives a thruster the curve gain |x| x; a gain below zero turns its axis."""
    if gain < 0.0:
        thruster.axis, gain = -thruster.axis, -gain
    x = np.unique([*np.linspace(min(least, 0.0), 0.0, POINTS + 1),
                   *np.linspace(0.0, max(most, 0.0), POINTS + 1)])
    thruster.command, thruster.force = x, gain * np.abs(x) * x
