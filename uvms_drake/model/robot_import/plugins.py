"""Reads plugins of Gazebo: the water of each link, and thrusters.

gz-sim's Hydrodynamics has Fossen's derivatives: M_A = −X_u̇ and D = −X_u, so that they are negative
(its first version had +X_u̇, as some files still have). uuv_simulator's has M_A itself, and damping
as derivatives, D = −(X_u + X_u|u| |u|). Both act at the link's origin, and so does SDFormat's
`fluid_added_mass`, which is M_A; their axes are in `sources`. Here they are turned into the link's
axes, with the physical signs: M_A and D are positive. The centre of buoyancy of uuv_simulator is
seen from the centre of mass: Gazebo's `AddForceAtRelativePosition` counts from there.

A thruster pushes its link along the joint's axis, and so does a rotor that has no plugin. Early
versions of uuv_simulator's, for Gazebo before 8, pushed along the link's own x.
"""

import re
from dataclasses import dataclass, field

import numpy as np

from uvms_drake.common.errors import InvalidParameter, require
from uvms_drake.model.description.plausibility import check_foreign
from uvms_drake.model.description.thruster_file import AXES
from uvms_drake.model.description.xml_tree import Node
from uvms_drake.model.robot_import.chain import ROTOR
from uvms_drake.model.robot_import.sources import GZ, SDF, UUV, Source
from uvms_drake.model.robot_import.tree import Joint, Link, Notes, Tree, listed

FORCES, RATES = "xyzkmn", "UVWPQR"
"""SNAME's letters of forces and velocities, as gz-sim has them."""
ROUNDED = 0.01
"""Share of the largest entry of a matrix that may be rounding, or a digit mistyped."""
SEA = 1028.0
"""Density of uuv_simulator's water where a file has none [kg/m³]."""
POINTS = 8
"""Number of commands on a parabola, each way."""
GZ_MOST = 1000.0
"""Size of gz-sim's commands in a file without a limit: none that is meant."""
NUMBERS = re.compile(r"(?=.*[1-9])([-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?(\s+|$))+", re.I | re.S)
"""Numbers that are not all zero."""
JUMP = 1e-6
"""Share of a dead band over which the force rises to that of its edge."""


@dataclass
class Water:
    """The water's forces on a link, about its origin in its axes; None is not known."""

    volume: float | None = None
    center: np.ndarray = field(default_factory=lambda: np.zeros(3))
    added_mass: np.ndarray | None = None
    linear: np.ndarray | None = None
    quadratic: np.ndarray | None = None


@dataclass
class Waters:
    """The water of all links, as a file has it."""

    links: dict[str, Water] = field(default_factory=dict)
    density: float | None = None
    shapes_float: bool = False
    """Whether it is for gz-sim, where collision shapes displace water."""
    sources: set[Source] = field(default_factory=set)
    """Whose conventions the matrices of the file had."""


def read_water(tree: Tree, notes: Notes) -> Waters:
    """Returns the water in plugins and links, and says where it was found."""
    waters = Waters()
    for prefix, plugin in tree.plugins:
        kind = _kind(plugin)
        if kind == "gz":
            _read_gz(tree, prefix, plugin, waters, notes)
        elif kind == "uuv":
            _read_uuv(tree, prefix, plugin, waters, notes)
        elif kind == "buoyancy":
            waters.density = plugin.known("uniform_fluid_density") or waters.density
        waters.shapes_float |= kind in ("gz", "buoyancy")
    for link in tree.links.values():
        if link.added_mass is not None:
            water = waters.links.setdefault(link.name, Water())
            M = symmetric(f"{link.name}: fluid_added_mass", link.added_mass, notes)
            water.added_mass = SDF.in_link(M)
            notes.taken.append(f"added mass of '{link.name}': fluid_added_mass")
            waters.sources.add(SDF)
    notes.taken += [f"axes of matrices of {source.name}: {source.axes}"
                    for source in (GZ, UUV, SDF) if source in waters.sources]
    return waters


def tell_unread(tree: Tree, notes: Notes) -> None:
    """Says which plugins, and which numbers in the others, were not read."""
    plugins = sorted({plugin.attributes.get("filename", "?") for _, plugin in tree.plugins
                      if not _kind(plugin)})
    if plugins:
        notes.changed.append(f"plugins without a meaning here, left out: {listed(plugins)}")
    lost: dict[str, list[int]] = {}
    for _, plugin in tree.plugins:
        for node in plugin.walk() if _kind(plugin) else ():
            if not node.used and NUMBERS.fullmatch(node.text.strip()) and not (
                    node.tag.endswith("ID")):
                lost.setdefault(f"{node.tag} = {' '.join(node.text.split())}", []).append(node.line)
    if lost:
        notes.changed.append("numbers of these plugins left out: " + listed([
            f"{said} (line {lines[0]}{f' and {len(lines) - 1} more' if lines[1:] else ''})"
            for said, lines in lost.items()], 40))


def _kind(plugin: Node) -> str:
    """Returns the meaning of a plugin: water, buoyancy, a thruster, or a pilot that limits it."""
    name = f"{plugin.attributes.get('filename', '')} {plugin.attributes.get('name', '')}".lower()
    if "hydrodynamics" in name and plugin.value("link_name") is not None:
        return "gz"
    if "underwater_object" in name or any(plugin.all("link/hydrodynamic_model")):
        return "uuv"
    return next((kind for word, kind in (("buoyancy", "buoyancy"), ("thruster", "thruster"),
                                         ("ardupilot", "pilot")) if word in name), "")


def _link(tree: Tree, prefix: str, name: str, plugin: Node, notes: Notes) -> Link | None:
    link = tree.find_link(prefix, name)
    if link is None:
        notes.changed.append(f"plugin at line {plugin.line} is for link '{name}', which is not "
                             "there: left out")
    return link


def _read_gz(tree: Tree, prefix: str, plugin: Node, waters: Waters, notes: Notes) -> None:
    """Reads gz-sim's Hydrodynamics, of one link."""
    link = _link(tree, prefix, plugin.value("link_name") or "", plugin, notes)
    if link is None:
        return
    waters.density = plugin.number("water_density", plugin.number("waterDensity", 998.0))
    waters.sources.add(GZ)
    key = f"{link.name}: Hydrodynamics (line {plugin.line})"
    # Derivatives, by SNAME's letters.
    M = np.array([[plugin.number(f"{f}Dot{v}") for v in RATES] for f in FORCES])
    linear = np.array([[plugin.number(f"{f}{v}") for v in RATES] for f in FORCES])
    squares = [f"{f}{v}abs{v}" if plugin.value(f"{f}{v}abs{v}") is not None else f"{f}{v}{v}"
               for f, v in zip(FORCES, RATES, strict=True)]
    quadratic = np.diag([plugin.number(square) for square in squares])
    if not np.any(M > 0.0) or np.trace(M) < 0.0:
        M = -M
    else:
        notes.changed.append(f"{key}: xDotU and its like are positive, as old files have them; "
                             "taken as added mass")
    # As positive numbers, and all that is left out.
    water = waters.links.setdefault(link.name, Water())
    if np.any(M):
        water.added_mass = GZ.in_link(symmetric(f"{key}: added mass", M, notes))
    _take_damping(key, water, GZ.in_link(-linear), GZ.in_link(-quadratic), notes)
    notes.taken.append(f"water of '{link.name}': plugin Hydrodynamics of gz-sim, line {plugin.line}"
                       + _missing(water))


def _read_uuv(tree: Tree, prefix: str, plugin: Node, waters: Waters, notes: Notes) -> None:
    """Reads uuv_simulator's underwater object, of several links."""
    waters.density = plugin.number("fluid_density", SEA)
    for node in plugin.all("link"):
        link = _link(tree, prefix, node.name(), plugin, notes)
        if link is None:
            continue
        key = f"{link.name}: underwater object (line {node.line})"
        water = waters.links.setdefault(link.name, Water())
        if node.is_true("neutrally_buoyant"):
            water.volume = link.mass / (waters.density or SEA)
        elif volume := node.number("volume"):  # That of a template is 0.
            water.volume = volume
        water.center = link.com + node.numbers("center_of_buoyancy", 3, np.zeros(3))
        if (model := node.find("hydrodynamic_model")) is not None:
            _read_fossen(key, model, water, notes)
            waters.sources.add(UUV)
        notes.taken.append(f"water of '{link.name}': plugin of uuv_simulator, line {node.line}"
                           + _missing(water))


def _read_fossen(key: str, model: Node, water: Water, notes: Notes) -> None:
    check_foreign(model, "sdf")
    kind = model.value("type") or "fossen"
    if kind != "fossen":
        notes.changed.append(f"{key}: the model '{kind}' is not read, only 'fossen'")
        return
    if (added := model.find("added_mass")) is not None:
        water.added_mass = UUV.in_link(symmetric(f"{key}: added_mass", _square(added), notes))
    damping = []
    for name in ("linear_damping", "quadratic_damping"):
        node = model.find(name)
        damping.append(UUV.in_link(-_square(node)) if node is not None else np.zeros((6, 6)))
    _take_damping(key, water, damping[0], damping[1], notes)
    if np.any(model.numbers("linear_damping_forward_speed", None, 0.0)):
        notes.changed.append(f"{key}: linear_damping_forward_speed left out: drag is by axis here")


def _square(node: Node) -> np.ndarray:
    """Returns a matrix (6, 6) of 36 numbers, or of its diagonal."""
    values = node.numbers()
    if len(values) not in (6, 36):
        raise InvalidParameter(node.place(), f"{len(values)} numbers", "6 or 36 numbers")
    return np.diag(values) if len(values) == 6 else values.reshape(6, 6)


def _take_damping(key: str, water: Water, linear: np.ndarray, quadratic: np.ndarray, notes: Notes
                  ) -> None:
    """Takes the diagonals of drag, with the sign that slows down, and notes the other entries."""
    taken = []
    for name, D in (("linear", linear), ("quadratic", quadratic)):
        d = np.diag(D).copy()
        off = D - np.diag(d)
        if np.any(off):
            notes.changed.append(f"{key}: {np.count_nonzero(off)} entries of {name} drag off "
                                 f"the diagonal left out, the largest {np.max(np.abs(off)):g}")
        if np.all(d <= 0.0) and np.any(d):
            notes.changed.append(f"{key}: {name} drag that would speed up by its sign: turned")
            d = -d
        for i in np.flatnonzero(d < 0.0):
            notes.changed.append(f"{key}: {name} drag in {AXES[i]} would speed up: turned")
        taken.append(np.abs(d))
    if np.any(taken):
        water.linear, water.quadratic = taken


def symmetric(key: str, M: np.ndarray, notes: Notes) -> np.ndarray:
    """Returns the symmetric part of an added mass (6, 6) that is positive semidefinite.

    Differences of the size of rounding are corrected and noted, by entry; others are refused.

    Raises:
        InvalidParameter: It is no added mass.
    """
    scale = float(np.max(np.abs(M)))
    i, j = np.unravel_index(np.argmax(np.abs(M - M.T)), M.shape)
    off = abs(M[i, j] - M[j, i])
    require(off <= ROUNDED * max(scale, 1e-300), f"{key}[{i + 1}][{j + 1}]", float(M[i, j]),
            f"that of [{j + 1}][{i + 1}], {M[j, i]:g}: the matrix is symmetric")
    if off > 0.0:
        notes.changed.append(f"{key}: made symmetric; [{i + 1}][{j + 1}] is {M[i, j]:g}, "
                             f"[{j + 1}][{i + 1}] is {M[j, i]:g}")
    M = 0.5 * (M + M.T)
    values, vectors = np.linalg.eigh(M)
    require(bool(values[0] >= -ROUNDED * scale), key, f"smallest eigenvalue {values[0]:.3g}",
            "positive: the water would accelerate the body")
    if values[0] < -1e-9 * scale:
        notes.changed.append(f"{key}: its smallest eigenvalue, {values[0]:.3g}, set to zero")
        M = (vectors * np.maximum(values, 0.0)) @ vectors.T
    return 0.5 * (M + M.T)


def _missing(water: Water) -> str:
    """Returns the parts that a plugin does not give, as the end of a line."""
    parts = [name for name, value in (("added mass", water.added_mass), ("drag", water.linear))
             if value is None]
    return f"; it has no {' and no '.join(parts)}" if parts else ""


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
    smallest: float = 0.0
    """Force at the edge of its dead band [N]."""
    lag: float | None = None
    is_one_sided: bool = False
    """Whether one of two limits is missing, and estimated by the other."""

    def limit(self, least: float | None, most: float | None) -> tuple[float, float] | None:
        """Returns the ends of a range, of which one may be missing; None without any."""
        if least is not None and most is not None:
            return least, most
        known = [abs(end) for end in (least, most) if end is not None]
        self.is_one_sided |= bool(known)
        return (-known[0], known[0]) if known else None

    def cut(self, least: float, most: float) -> None:
        """Takes commands outside of a range out of the curve."""
        x = np.clip([least, most], self.command[0], self.command[-1])
        inside = self.command[(self.command > x[0]) & (self.command < x[1])]
        inside = np.unique([x[0], *inside, x[1]])
        self.command, self.force = inside, np.interp(inside, self.command, self.force)

    def curve(self, force: float) -> tuple[np.ndarray, np.ndarray]:
        """Returns commands and forces [N], none in the dead band, at whose edges it jumps.

        Args:
            force: Largest force [N], if the curve is not known.
        """
        if self.force.size < 2:
            self.command = self.force = max(force, 2.0 * self.smallest) * np.array([-1.0, 0.0, 1.0])
        x, f, band = self.command, self.force, self.smallest
        if band == 0.0:
            return x, f
        edges, still = np.interp([-band, band], f, x), np.interp(0.0, f, x)
        inner = still + (1.0 - JUMP) * (edges - still)
        steep = np.unique(np.round([*x, *edges, *inner], 9))
        force_of = np.interp(steep, x, f)
        return steep, np.where(np.abs(force_of) < (1.0 - 0.5 * JUMP) * band, 0.0, force_of)


def read_thrusters(tree: Tree, notes: Notes) -> tuple[list[Thruster], set[str]]:
    """Returns the thrusters and the names of their joints, and says where they were found."""
    # Plugins, each of one thruster.
    found: list[Thruster] = []
    joints: set[str] = set()
    pilot = _pilot_limits(tree, notes)
    for prefix, plugin in tree.plugins:
        if _kind(plugin) != "thruster":
            continue
        name = plugin.value("joint_name") or plugin.value("jointName") or ""
        joint = tree.joints.get(prefix + name) or tree.joints.get(name)
        link = tree.find_link(prefix, joint.child if joint is not None
                              else plugin.value("linkName") or "")
        if link is None:
            notes.changed.append(f"thruster plugin at line {plugin.line}: its joint or link is not "
                                 "there, left out")
            continue
        gz, x = plugin.value("joint_name") is not None, np.array([1.0, 0.0, 0.0])
        axis = _axis(joint, link) if joint is not None else x
        if not gz and np.linalg.norm(axis - x) > ROUNDED:
            notes.changed.append(f"thruster {_short(link.name)}: pushes along the axis of its "
                                 f"joint, {np.array2string(axis, precision=2)} in its link; before "
                                 "Gazebo 8 uuv_simulator had x")
        thruster = Thruster(_short(link.name), link, axis,
                            lag=plugin.known("dynamics/timeConstant"))
        if gz:
            _gz_curve(plugin, thruster, pilot.get(joint.name if joint is not None else name))
        else:
            _uuv_curve(plugin, thruster)
        found.append(thruster)
        joints |= {joint.name} if joint is not None else set()
    if alone := [item.name for item in found if item.is_one_sided and item.force.size]:
        notes.ask("thrusters.yaml", "kinds.*.curves", f"one limit alone of {listed(alone, 16)} in "
                  "the file. ESTIMATE: the other way the same")
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


def _pilot_limits(tree: Tree, notes: Notes) -> dict[str, tuple[float, float]]:
    """Returns the ends of the commands that ArduPilotPlugin gives the thruster of each joint.

    A channel has multiplier · (x + offset), x from 0 to 1 between the ends of its pulse.
    """
    limits: dict[str, tuple[float, float]] = {}
    for prefix, plugin in tree.plugins:
        for control in plugin.all("control") if _kind(plugin) == "pilot" else ():
            name = control.value("jointName") or ""
            joint = tree.joints.get(prefix + name) or tree.joints.get(name.rpartition("::")[2])
            if joint is None or control.value("type") != "COMMAND":
                continue
            ends = control.number("multiplier", 1.0) * (
                control.number("offset") + np.array([0.0, 1.0]))
            limits[joint.name] = float(np.min(ends)), float(np.max(ends))
            _ = control.value("servo_min"), control.value("servo_max")
    if limits:
        notes.taken.append(f"limits of commands of ArduPilotPlugin: {listed(list(limits), 16)}")
    return limits


def _gz_curve(plugin: Node, thruster: Thruster, pilot: tuple[float, float] | None) -> None:
    """Takes the limits of gz-sim's thruster, of its force or of its speed, and its dead band.

    Args:
        plugin: Its element.
        thruster: Takes the curve.
        pilot: Smallest and largest command that it is given, if they are known.
    """
    gain = (plugin.number("thrust_coefficient", 1.0) * plugin.number("fluid_density", 1000.0)
            * plugin.number("propeller_diameter", 0.02)**4)
    turns = plugin.is_true("use_angvel_cmd")
    thruster.smallest = max(plugin.number("deadband"), 0.0)
    ends = [plugin.known(key) for key in ("min_thrust_cmd", "max_thrust_cmd")]
    limits = thruster.limit(*(end if end is not None and (turns or abs(end) < GZ_MOST) else None
                              for end in ends)) or pilot
    if limits is None:
        return
    least, most = limits
    require(least < most, f"{plugin.place()} min_thrust_cmd, max_thrust_cmd", [least, most],
            "lower, then upper")
    if turns:
        _parabola(thruster, gain, least, most)
    else:
        thruster.command = thruster.force = np.unique([least, 0.0, most])
    if pilot is not None:
        thruster.cut(*pilot)
    require(bool(max(-thruster.force[0], thruster.force[-1]) > thruster.smallest),
            f"{plugin.place()} deadband", thruster.smallest, "below the largest force")


def _uuv_curve(plugin: Node, thruster: Thruster) -> None:
    """Takes the curve of uuv_simulator's thruster between the limits of command and force."""
    kind, gain = plugin.value("conversion/type"), plugin.number("gain", 1.0) or 1.0
    clamps, thrusts = (thruster.limit(plugin.known(f"{key}Min"), plugin.known(f"{key}Max"))
                       for key in ("clamp", "thrust"))
    # A least one that is not the smaller is no limit there.
    clamps, thrusts = (each if each is not None and each[0] < each[1] else None
                       for each in (clamps, thrusts))
    share = plugin.number("thrust_efficiency", 1.0) or 1.0
    if kind == "LinearInterp" and plugin.value("conversion/inputValues"):
        thruster.command = plugin.numbers("conversion/inputValues") / gain
        thruster.force = share * plugin.numbers("conversion/outputValues")
    elif kind == "Basic":
        k = share * gain**2 * plugin.number("conversion/rotorConstant")
        if k < 0.0 and thrusts is not None:  # The axis is turned, see `_parabola`.
            thrusts = (-thrusts[1], -thrusts[0])
        if clamps is None and thrusts is not None and k != 0.0:
            clamps = tuple(np.sign(thrusts) * np.sqrt(np.abs(thrusts) / abs(k)))
        if clamps is not None and k != 0.0:
            _parabola(thruster, k, *clamps)
    elif kind == "Bessa" and clamps is not None:
        gains = [share * plugin.number(f"conversion/rotorConstant{side}") for side in "LR"]
        d = [plugin.number(f"conversion/delta{side}") for side in "LR"]
        edge = [float(np.sign(x) * np.sqrt(abs(x))) / gain for x in d]
        x = np.unique([*np.linspace(clamps[0], edge[0], POINTS),
                       *np.linspace(edge[1], clamps[1], POINTS)])
        square = np.abs(gain * x) * gain * x
        thruster.command = x
        thruster.force = np.where(x <= edge[0], gains[0] * (square - d[0]), np.where(
            x >= edge[1], gains[1] * (square - d[1]), 0.0))
    if thruster.force.size and clamps is not None:
        thruster.cut(*clamps)
    if thruster.force.size and thrusts is not None:
        thruster.cut(*np.interp(thrusts, thruster.force, thruster.command))


def _parabola(thruster: Thruster, gain: float, least: float, most: float) -> None:
    """Gives a thruster the curve gain |x| x; a gain below zero turns its axis."""
    if gain < 0.0:
        thruster.axis, gain = -thruster.axis, -gain
    x = np.unique([*np.linspace(min(least, 0.0), 0.0, POINTS + 1),
                   *np.linspace(0.0, max(most, 0.0), POINTS + 1)])
    thruster.command, thruster.force = x, gain * np.abs(x) * x
