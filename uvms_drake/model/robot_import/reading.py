"""Reads a robot's file as it is found: a URDF, an SDFormat file, or one in a world.

Drake's parser has masses, poses and axes, with the frames and the nested and included models of the
formats. Shapes, limits, motors and plugins are taken from the XML: Drake does not read them, or not
in both formats alike.
"""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from uvms_drake.common.errors import InvalidFile, InvalidParameter, require
from uvms_drake.model.description.elements import SDFORMAT, URDF, Element
from uvms_drake.model.description.hydrodynamics_file import FARTHEST, NEAR
from uvms_drake.model.description.plausibility import check_foreign
from uvms_drake.model.description.robot_files import INCLUDED, parse
from uvms_drake.model.description.xml_tree import Node, element, read_xml, write_xml
from uvms_drake.model.robot_import import tree as robot_tree

KEPT = {"robot": "link joint frame", "sdf": "model", "model": "link joint frame model include pose",
        "link": "inertial pose", "inertial": "origin pose mass inertia",
        "joint": "origin pose parent child axis", "axis": "xyz use_parent_model_frame",
        "include": "uri name pose placement_frame"}
"""Elements that are left to Drake."""
INERTIA = ("ixx", "ixy", "ixz", "ixy", "iyy", "iyz", "ixz", "iyz", "izz")
ADDED = "xyzpqr"
"""Letters of `fluid_added_mass`."""
ENDLESS = 1e15
"""Limits that mean none."""
ROUNDED = 0.02
"""Share by which a principal moment may exceed the sum of the others by rounding."""
DEEPEST = 10
"""Depth of includes from which on a file includes itself."""
LEVELS = 6
"""Number of folders above a file in which packages and models are sought."""


def read_robot(file: Path, notes: robot_tree.Notes) -> robot_tree.Tree:
    """Returns the robot in a URDF or SDFormat file; of several in a world that of most joints.

    Raises:
        InvalidParameter: The file cannot be read, or is no robot.
    """
    root, lost = read_file(file), list[str]()
    models = sorted(_models(root, lost, 0), key=_joints, reverse=True)
    require(bool(models), "--from", str(file), "a file with a <model>")
    lost += [f"model {node.name()}, beside the robot" for each in models[1:]
             for node in ([each] if each.tag == "robot" else each.all("model"))]
    source = _Source(notes)
    text = source.take(models[0], "", 0)
    source.tree.plugins += [("", node) for node in root.all("world/plugin")]
    require(bool(source.tree.links), "--from", str(file), "a robot with links")
    source.parse(models[0], text)
    if source.names:
        notes.taken.append(f"included models: {robot_tree.listed(source.names)}")
    if lost := [*lost, *source.unread]:
        notes.changed.append(f"left out: {robot_tree.listed(lost)}")
    return source.tree


def read_file(file: Path) -> Node:
    """Returns the outermost element of a file; of a URDF without a name, by the file's.

    Raises:
        InvalidParameter: It cannot be read, or is no XML.
    """
    try:
        text = file.read_text(encoding="utf-8")
    except OSError as error:
        raise InvalidParameter("--from", str(file),
                               f"a file that can be read ({error.strerror})") from None
    except ValueError:
        raise InvalidParameter("--from", str(file), "a text in UTF-8") from None
    root = read_xml(text, file)
    require(root.tag in ("sdf", "robot", "package"), "--from", str(file),
            f"URDF (<robot>) or SDFormat (<sdf>), not <{root.tag}>" + (
                ": Stonefish has the masses of its robots from meshes and materials"
                if root.tag == "scenario" else ""))
    if root.tag == "robot":
        root.attributes.setdefault("name", file.stem)
    return root


def _models(root: Node, lost: list[str], depth: int) -> Iterator[Node]:
    """Yields the models of a file, each as a file of its own."""
    require(depth <= DEEPEST, "--from", str(root.file), "a file that does not include itself")
    if root.tag == "robot":
        yield root
    for model in (*root.all("model"), *root.all("world/model")):
        if not model.is_true("static"):
            yield replace(root, children=[model])
    for include in root.all("world/include"):
        file = _model_file(include)
        if file is None:  # A sun, a ground plane.
            lost.append(f"include {include.value('uri')}, which is not there")
        elif not include.is_true("static"):
            yield from _models(read_file(file), lost, depth + 1)


def _joints(root: Node, depth: int = 0) -> int:
    """Returns the number of joints in a file and in those that it includes."""
    files = [] if depth > DEEPEST else [
        file for node in root.walk() if node.tag == "include" and (file := _model_file(node))]
    return sum(node.tag == "joint" for node in root.walk()) + sum(
        _joints(read_file(file), depth + 1) for file in files)


class _Source:
    """A robot on its way from XML into a tree, with the text that Drake reads of it."""

    def __init__(self, notes: robot_tree.Notes):
        self.tree, self.notes = robot_tree.Tree(), notes
        self.unread: list[str] = []
        """Elements that have no meaning here."""
        self.names: list[str] = []
        """Included models."""
        self.included: dict[str, str] = {}

    def take(self, root: Node, scope: str, depth: int) -> str:
        """Takes the model of a file, in a scope of names, and returns the text for Drake."""
        kind = "urdf" if root.tag == "robot" else "sdf"
        if twins := [f"{node.tag} (line {node.line})" for node in _without_twins(root)]:
            self.notes.changed.append(
                f"there twice and equal, taken once: {robot_tree.listed(twins)}")
        for link in (node for node in root.walk() if node.tag == "link" and kind == "sdf"):
            for inertial in link.all("inertial"):
                if inertial.value("inertia") is None and inertial.value("mass") and not (
                        inertial.is_true("auto")):
                    inertial.children.append(element(
                        "inertia", inertial.line, dict.fromkeys(INERTIA, 0.0), urdf=False))
                    self.notes.changed.append(
                        f"{link.name()}: no <inertia>, for which SDFormat takes 1 kg m²; taken as "
                        f"a point of {inertial.value('mass')} kg")
        check_foreign(root, kind)
        for model in [root] if kind == "urdf" else root.all("model"):
            self._model(model, scope, depth, {
                node.name(): node for node in root.all("material") if kind == "urdf"})
        return write_xml(_kept(root, URDF if kind == "urdf" else SDFORMAT))

    def _model(self, model: Node, scope: str, depth: int, materials: dict[str, Node]) -> None:
        for node in model.all("include"):
            self._include(node, scope, depth + 1)
        for node in model.all("model"):
            self._model(node, f"{scope}{node.name()}::", depth, {})
        for node in model.all("link"):
            self._add(self.tree.links, self._link(node, scope + node.name(), materials))
        for node in list(model.all("joint")):
            self._joint(node, model, scope)
        for node in (*model.all("link"), *model.all("gazebo")):  # SDFormat's and URDF's.
            name = node.value("reference") or node.value("name") or ""
            if (link := self.tree.links.get(scope + name)) is not None:
                link.sensors += [each.value("type") or "" for each in node.all("sensor")]
        for node in model.all("transmission"):
            self._motor(node)
        self.tree.frames |= {scope + node.name(): ("", node.pose()) for node in model.all("frame")}
        self.tree.plugins += [(scope, node) for path in ("plugin", "gazebo/plugin")
                              for node in model.all(path)]

    def parse(self, root: Node, text: str) -> None:
        """Has Drake read the text of a file, and completes the tree by that.

        Raises:
            InvalidFile: Drake cannot read it.
        """
        tree = self.tree
        for name in [name for name in tree.links if name.rpartition("::")[2] == "world"]:
            del tree.links[name]  # Of a URDF: to Drake it is the world.
        kind = "urdf" if root.tag == "robot" else "sdf"
        (robot, *_), _ = parse(tree.plant, root.file, kind, text, self.included)
        try:
            tree.plant.Finalize()
        except RuntimeError as error:
            raise InvalidFile([f"{root.file}: must be a readable robot: "
                               f"{' '.join(str(error).split())}"]) from None
        tree.complete(robot)

    @staticmethod
    def _add(items: dict[str, Any], item: robot_tree.Link | robot_tree.Joint) -> None:
        if item.name in items:
            raise InvalidParameter(f"{item.node.place()} name", item.name,
                                   f"given once: line {items[item.name].node.line} has it, too")
        items[item.name] = item

    def _include(self, node: Node, scope: str, depth: int) -> None:
        uri, file = node.name("uri"), _model_file(node)
        if file is None:
            raise InvalidParameter(f"{node.place()} uri", uri, "the file of a model, in a folder "
                                   "of that name beside this file or above it")
        require(depth <= DEEPEST, f"{node.place()} uri", uri, "a file that does not include itself")
        root = read_file(file)
        model = root if root.tag == "robot" else next(root.all("model"), None)
        if model is None:
            raise InvalidParameter("--from", str(file), "a file with a <model>")
        name = node.value("name") or model.name()
        target = f"{len(self.included)}_{file.stem}.{'urdf' if model is root else 'sdf'}"
        self.included[target] = ""
        self.included[target] = self.take(
            root, scope if node.is_true("merge") else f"{scope}{name}::", depth)
        self.names.append(f"{name} ({file.parent.name}/{file.name})")
        for place in node.all("uri"):
            place.text = f"package://{INCLUDED}/{target}"

    def _link(self, node: Node, name: str, materials: dict[str, Node]) -> robot_tree.Link:
        link = robot_tree.Link(name, node)
        if (inertial := node.find("inertial")) is not None:
            if inertial.is_true("auto"):
                require(any(node.all("collision/geometry")) and not any(
                    node.all("collision/geometry/mesh")), f"{inertial.place()} auto", "true",
                        "left out, with mass and inertia given: that of a mesh, or of no collision "
                        "shape, is not computed here")
                self.notes.taken.append(f"mass and inertia of '{name}': of its collision shapes, "
                                        "as SDFormat has it (auto)")
            else:
                _check_inertial(node, inertial, self.notes)
            if (added := inertial.find("fluid_added_mass")) is not None:
                link.added_mass = np.array([[added.number(
                    ADDED[min(i, j)] + ADDED[max(i, j)]) for j in range(6)] for i in range(6)])
        for tag, shapes in (("visual", link.visuals), ("collision", link.collisions)):
            shapes += [shape for item in node.all(tag) if (shape := _shape(item, materials))]
        return link

    def _joint(self, node: Node, model: Node, scope: str) -> None:
        # A root that stands for the world is left out, and the joint that joins it to the robot.
        kind, urdf = node.name("type"), model.tag == "robot"
        parent = node.value("parent/link") or node.value("parent") or ""
        above = self.tree.links.get(scope + parent)
        inner = urdf and any(joint.value("child/link") == parent for joint in model.all("joint"))
        if (parent == "world" or kind == "floating") and not inner and (
                above is None or above.node.find("inertial") is None):
            model.children.remove(node)
            if above is None:
                self.unread.append(f"joint {scope}{node.name()} to the world")
            else:
                self.notes.changed.append(f"dummy root '{parent}' and its joint '{node.name()}' "
                                          f"({kind}): left out, the vehicle floats by itself")
            return
        # Its numbers, where the format has them; URDF takes 0 for one of two limits.
        joint = robot_tree.Joint(scope + node.name(), kind, node)
        axis = node if urdf else node.find("axis")
        if axis is not None and not node.mistakes:
            one = 0.0 if urdf and (axis.value("limit/lower") or axis.value("limit/upper")
                                   ) else np.inf
            if kind != "continuous":
                bounds = [axis.number("limit/lower", 0.0 - one, np.inf),
                          axis.number("limit/upper", one, np.inf)]
                joint.lower, joint.upper = (
                    bound if abs(bound) < ENDLESS else np.copysign(np.inf, bound)
                    for bound in bounds)
                require(bounds[0] <= bounds[1], f"{node.place()} limit", bounds,
                        "lower, then upper")
            effort = axis.number("limit/effort", 0.0, np.inf)
            joint.effort = effort if 0.0 < effort <= ENDLESS else 0.0
            joint.velocity = max(axis.number("limit/velocity", 0.0, np.inf), 0.0)
            joint.damping = axis.number("dynamics/damping")
            joint.friction = axis.number("dynamics/friction")
            if axis.number("dynamics/spring_stiffness"):
                self.notes.changed.append(f"spring of joint {joint.name} left out: there is none "
                                          "here")
        if not urdf and kind == "revolute" and not np.isfinite([joint.lower, joint.upper]).any():
            joint.kind = "continuous"
        for path in ("mimic", "axis/mimic", "drake:mimic"):
            if (mimic := node.find(path)) is not None:
                joint.mimic = (scope + mimic.name("joint"), mimic.number("multiplier", 1.0),
                               mimic.number("offset"))
        if node.value("drake:rotor_inertia"):
            joint.rotor = (node.number("drake:rotor_inertia"), node.number("drake:gear_ratio", 1.0))
        if kind not in robot_tree.MOVING:  # It is fixed in any case.
            node.attributes["type"] = "fixed"
        joint.child = scope + (node.value("child/link") or node.name("child"))
        self._add(self.tree.joints, joint)

    def _motor(self, transmission: Node) -> None:
        """Takes the motor of a joint, where Drake has it in a URDF."""
        joint = self.tree.joints.get(transmission.value("joint/name") or "")
        if joint is not None and transmission.value("actuator/drake:rotor_inertia"):
            joint.rotor = (transmission.number("actuator/drake:rotor_inertia"),
                           transmission.number("actuator/drake:gear_ratio", 1.0))


def _without_twins(root: Node) -> list[Node]:
    """Takes out of an element all below it that are there twice and equal, and returns them."""
    twins: list[Node] = []
    for node in root.walk():
        kept: dict[object, Node] = {}
        for child in node.children:
            if kept.setdefault(child.meaning(), child) is not child:
                twins.append(child)
        node.children = list(kept.values())
    return twins


def _kept(node: Node, table: dict[str, Element]) -> Node:
    """Returns an element with the parts that are left to Drake."""
    if any(inertial.is_true("auto") for inertial in node.all("inertial")):
        return replace(node, children=[child for child in node.children if child.tag in (
            "pose", "inertial", "collision")])
    given = {key: text for key, text in node.attributes.items()
             if key in table[node.tag].attributes.split() and key != "auto"}
    return replace(node, attributes=given, children=[
        _kept(child, table) for child in node.children if child.tag in table and (
            node.tag not in KEPT or child.tag in KEPT[node.tag].split())])


def _check_inertial(link: Node, inertial: Node, notes: robot_tree.Notes) -> None:
    """Raises unless mass and inertia are of a size that a robot's can be, and mends the latter.

    No principal moment of a body exceeds the sum of the others: the others are raised by the least,
    as Drake would take another inertia else.
    """
    place, mass = f"{link.place()} inertial", inertial.number("mass")
    (node,) = inertial.all("inertia")
    inertia = np.array([node.number(key) for key in INERTIA]).reshape(3, 3)
    require(mass >= 0.0, f"{place} mass", mass, "zero or positive [kg]")
    NEAR.check(f"{place} centre of mass", inertial.pose().translation())
    largest = float(np.max(np.abs(inertia)))
    require(largest <= mass * FARTHEST**2, f"{place} inertia", largest,
            f"that of {mass:g} kg within {FARTHEST:g} m (units are kg m²)")
    # Principal moments that can be.
    moments, axes = np.linalg.eigh(inertia)
    possible = np.maximum(moments, 0.0)
    excess = possible[2] - possible[0] - possible[1]
    if moments[0] >= 0.0 and excess <= 1e-12 * largest:
        return
    if excess > 0.0:
        possible[:2] += 0.5 * excess * 1.000001
    if moments[0] > 0.0 and excess <= ROUNDED * moments[2]:
        notes.changed.append(f"{link.name()}: the largest principal moment of inertia exceeds the "
                             f"sum of the others by {excess:.3g} kg m², as by rounding: they are "
                             "raised")
    else:
        notes.ask(notes.sdf, f"link {link.name()}, inertial", "principal moments "
                  f"{np.array2string(moments, precision=3)} kg m² are those of no body. ESTIMATE: "
                  "the smaller ones are raised")
    inertia = (axes * possible) @ axes.T
    mended = element("inertia", node.line, dict(zip(INERTIA, inertia.ravel(), strict=True)),
                     bool(node.attributes))
    node.attributes, node.children = mended.attributes, mended.children


def _shape(node: Node, materials: dict[str, Node]) -> robot_tree.Shape | None:
    """Returns a solid; None if it is of a kind that is not known."""
    frame = getattr(node.find("pose"), "attributes", {}).get("relative_to", "")
    require(not frame, f"{node.place()} pose relative_to", frame,
            "left out: a pose in the axes of the link")
    color = None
    for item in node.all("material"):
        for material in (item, materials.get(item.value("name") or "", item)):
            for path in ("color/rgba", "diffuse"):
                if color is None and material.value(path):
                    values = material.numbers(path)
                    color = values if len(values) == 4 else np.append(values[:3], 1.0)
    for solid in node.all("geometry"):
        for item in solid.children:
            kind = item.tag
            if kind == "mesh":
                uri = item.value("filename") or item.value("uri") or ""
                return robot_tree.Shape(kind, np.ones(3) * item.numbers("scale", None, 1.0),
                                        node.pose(), uri, resolve(uri, item.file), color)
            if kind in robot_tree.SIZES:
                size = [item.numbers(key, 3 if key in ("size", "radii") else 1)
                        for key in robot_tree.SIZES[kind]]
                return robot_tree.Shape(kind, np.concatenate(size), node.pose(), color=color)
    return None


def resolve(uri: str, file: Path) -> Path | None:
    """Returns the file or folder that a URI names, by the rules of ROS and Gazebo; None without it.

    Args:
        uri: `package://NAME/...`, `model://NAME/...`, `file://...` or a path.
        file: The file that refers to it; packages and models are sought near it.
    """
    scheme, mark, rest = uri.partition("://")
    if not mark:
        places: Iterator[Path] = iter([file.parent / uri])
    elif scheme == "file":
        places = iter([Path(rest), file.parent / rest])
    else:
        name, _, path = rest.partition("/")
        places = (folder / path for folder in _packages(name, file))
    return next((place for place in places if place.exists()), None)


def _packages(name: str, file: Path) -> Iterator[Path]:
    """Yields the folders that a package or model of this name may be."""
    for folder in list(file.resolve().parents)[:LEVELS]:
        package = folder / "package.xml"
        text = package.read_text("utf-8", "replace") if package.is_file() else ""
        if folder.name == name or f"<name>{name}</name>" in text:
            yield folder
        yield folder / name
        yield folder / "models" / name


def _model_file(include: Node) -> Path | None:
    """Returns the file of an included model: itself, or the newest one in its folder."""
    place = resolve(include.value("uri") or "", include.file)
    if place is None or place.is_file():
        return place
    return next((file for name in ("model.sdf", f"{place.name}.sdf", f"{place.name}.urdf")
                 if (file := place / name).is_file()), None)
