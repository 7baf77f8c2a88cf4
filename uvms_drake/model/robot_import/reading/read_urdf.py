"""Reads a URDF file, or one that xacro has expanded."""

import numpy as np

from uvms_drake.common.errors import InvalidParameter, require
from uvms_drake.model.robot_import.reading.poses import pose, rpy_matrix
from uvms_drake.model.robot_import.reading.tree import Joint, Link, Shape, Tree
from uvms_drake.model.robot_import.reading.xml_node import Node


def read_urdf(robot: Node) -> Tree:
    """Returns the tree of a `<robot>`.

    Raises:
        InvalidParameter: Something in it is no URDF; by file, line and element.
    """
    _require_expanded(robot)
    tree = Tree(robot.attributes.get("name", robot.file.stem))
    colors = {node.name(): node for node in robot.all("material")}
    for node in robot.all("link"):
        tree.add(_link(node, colors))
    for node in robot.all("joint"):
        tree.add(_joint(node, tree))
    place_links(tree)
    for node in robot.all("frame"):  # Drake's own.
        link = node.attribute("link")
        require(link in tree.links, f"{node.place()} link", link, "a link of the file")
        tree.frames[node.name()] = (link, tree.links[link].X @ _pose(node))
    for node in robot.all("transmission"):
        _transmission(node, tree)
    for gazebo in robot.all("gazebo"):
        tree.plugins += [("", plugin) for plugin in gazebo.all("plugin")]
    return tree


def place_links(tree: Tree) -> None:
    """Turns the poses of joints in their parents into poses in the root's frame, and of links."""
    children = {joint.child for joint in tree.joints.values()}
    placed = {name: link.X for name, link in tree.links.items() if name not in children}
    waiting = list(tree.joints.values())
    while waiting:
        ready = [joint for joint in waiting if joint.parent in placed]
        if not ready:
            raise InvalidParameter(f"{waiting[0].node.place()}", waiting[0].child,
                                   "a part of a tree: its links are in a loop")
        for joint in ready:
            joint.X = placed[joint.parent] @ joint.X
            tree.links[joint.child].X = placed[joint.child] = joint.X
            waiting.remove(joint)


def _require_expanded(robot: Node) -> None:
    for node in robot.children:
        require(not node.tag.startswith("xacro:"), node.place(), node.tag,
                "expanded: `xacro FILE > robot.urdf` comes first")


def _pose(node: Node | None) -> np.ndarray:
    if node is None:
        return np.eye(4)
    return pose(node.numbers_of("xyz", 3, np.zeros(3)),
                rpy_matrix(node.numbers_of("rpy", 3, np.zeros(3))))


def _link(node: Node, colors: dict[str, Node]) -> Link:
    link = Link(node.name(), np.eye(4), node)
    if (inertial := node.find("inertial")) is not None:
        mass, inertia = inertial.find("mass"), inertial.find("inertia")
        if mass is None or inertia is None:
            raise InvalidParameter(inertial.place(), None, "one with <mass> and <inertia>")
        link.mass = float(mass.numbers_of("value", 1)[0])
        X = _pose(inertial.find("origin"))
        xx, yy, zz = (float(inertia.numbers_of(key, 1)[0]) for key in ("ixx", "iyy", "izz"))
        xy, xz, yz = (_number(inertia, key, 0.0) for key in ("ixy", "ixz", "iyz"))
        link.com = X[:3, 3]
        link.inertia = X[:3, :3] @ np.array(
            [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ X[:3, :3].T
    for tag, shapes in (("visual", link.visuals), ("collision", link.collisions)):
        for item in node.all(tag):
            shape = _shape(item, colors)
            if shape is not None:
                shapes.append(shape)
    return link


def _shape(node: Node, colors: dict[str, Node]) -> Shape | None:
    X = _pose(node.find("origin"))
    geometry = node.find("geometry")
    if geometry is None or not geometry.children:
        raise InvalidParameter(node.place(), None, "a shape with a <geometry>")
    kinds = {"box": ("size",), "cylinder": ("radius", "length"), "sphere": ("radius",),
             "capsule": ("radius", "length")}
    solid = next((item for item in geometry.children if item.tag in {*kinds, "mesh"}), None)
    if solid is None:
        return None
    material = node.find("material")
    color = None if material is None else material.find("color")
    if material is not None and color is None:
        known = colors.get(material.attributes.get("name", ""))
        color = None if known is None else known.find("color")
    rgba = None if color is None else color.numbers_of("rgba", 4)
    if solid.tag == "mesh":
        uri = solid.attributes.get("filename") or solid.attribute("uri")
        scale = solid.attributes.get("scale", "1 1 1").split()
        size = np.ones(3) * solid.numbers_of("scale", len(scale) if len(scale) == 3 else 1, 1.0)
        return Shape("mesh", size, X, uri, rgba)
    if solid.tag == "box":
        return Shape("box", solid.numbers_of("size", 3), X, color=rgba)
    size = np.concatenate([solid.numbers_of(key, 1) for key in kinds[solid.tag]])
    return Shape(solid.tag, size, X, color=rgba)


def _joint(node: Node, tree: Tree) -> Joint:
    ends = []
    for tag in ("parent", "child"):
        end = node.find(tag)
        link = "" if end is None else end.attribute("link")
        require(link in tree.links, f"{node.place()} {tag}", link, "a link of the file")
        ends.append(link)
    kind = node.attribute("type")
    joint = Joint(node.name(), kind, ends[0], ends[1], node, _pose(node.find("origin")))
    if (axis := node.find("axis")) is not None:
        joint.axis = axis.numbers_of("xyz", 3, joint.axis)
    require(bool(np.any(joint.axis)), f"{node.place()} axis", joint.axis, "not zero")
    if (limit := node.find("limit")) is not None:
        if kind != "continuous" and {"lower", "upper"} & set(limit.attributes):
            joint.lower, joint.upper = (_number(limit, key, 0.0) for key in ("lower", "upper"))
            require(joint.lower <= joint.upper, limit.place(), [joint.lower, joint.upper],
                    "lower, then upper")
        joint.effort = _number(limit, "effort", 0.0)
        joint.velocity = _number(limit, "velocity", 0.0)
    if (dynamics := node.find("dynamics")) is not None:
        joint.damping = _number(dynamics, "damping", 0.0)
        joint.friction = _number(dynamics, "friction", 0.0)
    if (mimic := node.find("mimic")) is not None:
        joint.mimic = (mimic.attribute("joint"), _number(mimic, "multiplier", 1.0),
                       _number(mimic, "offset", 0.0))
    return joint


def _number(node: Node, key: str, default: float) -> float:
    return float(node.numbers_of(key, 1, [default], np.inf)[0])


def _transmission(node: Node, tree: Tree) -> None:
    """Takes the motor of a joint, as Drake reads it."""
    named = node.find("joint")
    joint = tree.joints.get(named.attributes.get("name", "")) if named is not None else None
    actuator = node.find("actuator")
    if joint is None or actuator is None:
        return
    inertia, gear = (actuator.find(f"drake:{key}") for key in ("rotor_inertia", "gear_ratio"))
    if inertia is not None:
        joint.rotor = (_number(inertia, "value", 0.0),
                       1.0 if gear is None else _number(gear, "value", 1.0))


def moved(tree: Tree, X: np.ndarray) -> None:
    """Moves a whole tree by X (4, 4)."""
    items: list[Link | Joint] = [*tree.links.values(), *tree.joints.values()]
    for item in items:
        item.X = X @ item.X
    tree.frames = {name: (link, X @ frame) for name, (link, frame) in tree.frames.items()}
