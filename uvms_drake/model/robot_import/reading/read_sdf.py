"""Reads an SDFormat file, with the models that it nests and includes."""

from pathlib import Path

import numpy as np

from uvms_drake.common.errors import InvalidParameter, require
from uvms_drake.model.robot_import.reading.files import model_file, resolve
from uvms_drake.model.robot_import.reading.poses import inverse, pose, quaternion_matrix, rpy_matrix
from uvms_drake.model.robot_import.reading.read_urdf import moved, read_urdf
from uvms_drake.model.robot_import.reading.spelling import require_spelled
from uvms_drake.model.robot_import.reading.tree import Joint, Link, Shape, Tree
from uvms_drake.model.robot_import.reading.xml_node import Node, read_xml

ENDLESS = 1e15
"""Limits that mean none."""
DEEPEST = 10
"""Depth of includes from which on a file includes itself."""
ADDED = ("x", "y", "z", "p", "q", "r")
"""Letters of `fluid_added_mass`."""
MODEL = "__model__"


def read_sdf(sdf: Node) -> Tree:
    """Returns the tree of the robot in an `<sdf>`, or in its world.

    Raises:
        InvalidParameter: Something in it is no SDFormat, or an included file is missing.
    """
    version = sdf.attributes.get("version", "1.6")
    models = [item for item in (*sdf.all("model"), *sdf.all("world/model"),
                                *sdf.all("world/include"))
              if item.words("static") not in ("true", "1")]
    found = []
    for node in models:
        tree = Tree(node.attributes.get("name", node.file.stem))
        model = _Model(node, tree, "", version, 0) if node.tag == "model" else None
        if model is None:
            _include(node, tree, "", 0, None)
        else:
            model.read()
        found.append(tree)
    require(bool(found), "--from", str(sdf.file), "a file with a <model>")
    found.sort(key=lambda tree: -len(tree.joints))
    best = found[0]
    best.unread += [f"model {tree.name}, beside the robot" for tree in found[1:]]
    best.plugins += [("", node) for node in sdf.all("world/plugin")]
    return best


class _Model:
    """A model on its way into a tree: its frames wait until another one asks for them."""

    def __init__(self, node: Node, tree: Tree, prefix: str, version: str, depth: int):
        self.node, self.tree, self.prefix, self.version = node, tree, prefix, version
        self.depth = depth
        self.poses: dict[str, np.ndarray] = {MODEL: np.eye(4)}
        """Poses in the model's frame that are known, by names as they are in here."""
        self.waiting: dict[str, Node] = {
            item.name(): item for tag in ("link", "joint", "frame", "model") for item in
            node.all(tag)}

    def read(self) -> None:
        """Adds links, joints, frames and plugins to the tree, in axes of this model."""
        for item in self.node.all("include"):
            _include(item, self.tree, self.prefix, self.depth + 1, self)
        for item in self.node.all("model"):
            self._nested(item)
        for item in self.node.all("link"):
            self.tree.add(_link(item, self.prefix + item.name(), self.pose_of(item.name()),
                                self.tree))
        for item in self.node.all("frame"):
            link = self._link_of(item)
            if link is not None:
                self.tree.frames[self.prefix + item.name()] = (link, self.pose_of(item.name()))
        for item in self.node.all("joint"):
            self._joint(item)
        self.tree.plugins += [(self.prefix, item) for item in self.node.all("plugin")]

    def pose_of(self, name: str) -> np.ndarray:
        """Returns the pose of a link, joint, frame or nested model in the model's frame."""
        if name in self.poses:
            return self.poses[name]
        if name not in self.waiting:
            raise InvalidParameter(f"{self.node.place()} frame", name, "a frame of the model")
        node = self.waiting.pop(name)
        place, X = node.find("pose"), _pose(node)
        default = {"joint": node.words("child"), "frame": node.attributes.get("attached_to")}
        relative = (place.attributes.get("relative_to") if place is not None else None) \
            or default.get(node.tag) or MODEL
        self.poses[name] = self.pose_of(relative) @ X
        return self.poses[name]

    def _link_of(self, frame: Node) -> str | None:
        """Returns the link that a frame is attached to, None for the model itself."""
        nodes = {item.name(): item for item in self.node.all("frame")}
        joints = {item.name(): item for item in self.node.all("joint")}
        name, seen = frame.attributes.get("attached_to", ""), {frame.name()}
        while name in nodes and name not in seen:
            seen.add(name)
            name = nodes[name].attributes.get("attached_to", "")
        name = joints[name].words("child") or "" if name in joints else name
        found = self.tree.find_link(self.prefix, name)
        if found is None and self.prefix + name in self.tree.frames:
            return self.tree.frames[self.prefix + name][0]
        return None if found is None else found.name

    def _nested(self, node: Node) -> None:
        inner = Tree(node.name())
        model = _Model(node, inner, f"{self.prefix}{node.name()}::", self.version, self.depth)
        model.read()
        placement = node.attributes.get("placement_frame")
        X = self.pose_of(node.name())
        if placement:
            X = X @ inverse(model.pose_of(placement))
        _take(inner, self.tree, X)
        self.poses |= {f"{node.name()}::{name}": X @ pose for name, pose in model.poses.items()}

    def _joint(self, node: Node) -> None:
        parent, child = (node.words(tag) or "" for tag in ("parent", "child"))
        ends = ["world" if name == "world" else self._end(node, tag, name)
                for tag, name in (("parent", parent), ("child", child))]
        joint = Joint(self.prefix + node.name(), node.attribute("type"), ends[0], ends[1], node)
        if ends[0] == "world":
            self.tree.unread.append(f"joint {joint.name} to the world")
            return
        joint.X = self.pose_of(node.name())
        if (axis := node.find("axis")) is not None:
            self._axis(axis, joint)
        if joint.kind == "revolute" and not np.isfinite([joint.lower, joint.upper]).any():
            joint.kind = "continuous"
        inertia = node.number("drake:rotor_inertia")
        if inertia is not None:
            joint.rotor = (inertia, node.number("drake:gear_ratio", 1.0) or 1.0)
        if (mimic := node.find("drake:mimic")) is not None:
            joint.mimic = (mimic.attribute("joint"), float(mimic.numbers_of(
                "multiplier", 1, [1.0])[0]), float(mimic.numbers_of("offset", 1, [0.0])[0]))
        self.tree.add(joint)

    def _end(self, node: Node, tag: str, name: str) -> str:
        link = self.tree.find_link(self.prefix, name)
        if link is not None:
            return link.name
        frame = self.tree.frames.get(self.prefix + name)
        require(frame is not None, f"{node.place()} {tag}", name, "a link of the model")
        return frame[0] if frame else ""

    def _axis(self, node: Node, joint: Joint) -> None:
        if (xyz := node.find("xyz")) is not None:
            joint.axis = xyz.numbers(3)
            require(bool(np.any(joint.axis)), xyz.place(), joint.axis, "not zero")
            frame = xyz.attributes.get("expressed_in")
            old = float(".".join(self.version.split(".")[:2])) < 1.45
            if node.words("use_parent_model_frame") in ("1", "true") or old:
                frame = MODEL
            if frame:
                R = joint.X[:3, :3].T @ self.pose_of(frame)[:3, :3]
                joint.axis = R @ joint.axis
        lower, upper, effort, velocity = (node.number(f"limit/{key}", most=np.inf) for key in (
            "lower", "upper", "effort", "velocity"))
        joint.lower = -np.inf if lower is None or lower < -ENDLESS else lower
        joint.upper = np.inf if upper is None or upper > ENDLESS else upper
        require(joint.lower <= joint.upper, f"{joint.node.place()} limit",
                [joint.lower, joint.upper], "lower, then upper")
        joint.effort = None if effort is None or effort < 0.0 or effort > ENDLESS else effort
        joint.velocity = None if velocity is None or velocity < 0.0 else velocity
        joint.damping = node.number("dynamics/damping", 0.0) or 0.0
        joint.friction = node.number("dynamics/friction", 0.0) or 0.0
        if (mimic := node.find("mimic")) is not None:
            joint.mimic = (mimic.attribute("joint"), mimic.number("multiplier", 1.0) or 0.0,
                           mimic.number("offset", 0.0) or 0.0)


def _include(node: Node, tree: Tree, prefix: str, depth: int, outer: _Model | None) -> None:
    """Adds an included model to a tree, and its frames to those of the model that includes it."""
    # The file, near the one that names it.
    uri = node.words("uri") or ""
    place = resolve(uri, node.file)
    file = None if place is None else model_file(place)
    if file is None and outer is None:  # Of a world: a sun, a ground plane.
        tree.unread.append(f"include {uri}, which is not there")
        return
    if file is None:
        raise InvalidParameter(f"{node.place()} uri", uri, "the file of a model, in a folder of "
                               "that name beside this file or above it")
    require(depth <= DEEPEST, f"{node.place()} uri", uri, "a file that does not include itself")
    # The model in it, in axes of its own.
    root = read_xml(file)
    require_spelled(root)
    merges = node.attributes.get("merge") in ("true", "1")
    inner = Tree(file.stem)
    if root.tag == "robot":
        inner, frames = read_urdf(root), {MODEL: np.eye(4)}
        name = node.words("name") or inner.name
        frames |= {link.name: link.X for link in inner.links.values()}
        inner = inner if merges else _prefixed(inner, f"{prefix}{name}::")
    else:
        top = next(iter([*root.all("model")]), None)
        require(top is not None, "--from", str(file), "a file with a <model>")
        assert top is not None
        name = node.words("name") or top.name()
        model = _Model(top, inner, prefix if merges else f"{prefix}{name}::",
                       root.attributes.get("version", "1.6"), depth)
        model.read()
        frames = model.poses
    # Its pose among the frames of the model that includes it, which learns its frames.
    placed, placement = node.find("pose"), node.words("placement_frame")
    relative = placed.attributes.get("relative_to") if placed is not None else None
    X = _pose(node) if outer is None else outer.pose_of(relative or MODEL) @ _pose(node)
    if placement:
        require(placement in frames, f"{node.place()} placement_frame", placement,
                f"a frame of {file.name}")
        X = X @ inverse(frames[placement])
    _take(inner, tree, X)
    tree.included.append(f"{name} ({file.parent.name}/{file.name})")
    if outer is not None and merges:
        outer.poses |= {key: X @ frame for key, frame in frames.items() if key != MODEL}
    elif outer is not None:
        outer.poses |= {f"{name}::{key}": X @ frame for key, frame in frames.items()}
        outer.poses[name] = X


def _take(inner: Tree, tree: Tree, X: np.ndarray) -> None:
    """Moves the elements of a tree into another one, at a pose."""
    moved(inner, X)
    items: list[Link | Joint] = [*inner.links.values(), *inner.joints.values()]
    for item in items:
        tree.add(item)
    tree.frames |= inner.frames
    tree.plugins += inner.plugins
    tree.unread += inner.unread
    tree.included += inner.included
    tree.mended += inner.mended


def _prefixed(tree: Tree, prefix: str) -> Tree:
    """Returns a tree all of whose names have a prefix."""
    for joint in tree.joints.values():
        joint.name, joint.parent, joint.child = (
            prefix + name for name in (joint.name, joint.parent, joint.child))
        if joint.mimic is not None:
            joint.mimic = (prefix + joint.mimic[0], *joint.mimic[1:])
    for link in tree.links.values():
        link.name = prefix + link.name
    return Tree(tree.name, {link.name: link for link in tree.links.values()},
                {joint.name: joint for joint in tree.joints.values()},
                {prefix + name: (prefix + link, X) for name, (link, X) in tree.frames.items()},
                [(prefix, node) for _, node in tree.plugins], tree.unread, tree.included,
                tree.mended)


def _pose(node: Node) -> np.ndarray:
    place = node.find("pose")
    if place is None or not place.text.strip():
        return np.eye(4)
    if place.attributes.get("rotation_format") == "quat_xyzw":
        values = place.numbers(7)
        return pose(values[:3], quaternion_matrix(values[3:]))
    values = place.numbers(6)
    degrees = place.attributes.get("degrees") in ("true", "1")
    return pose(values[:3], rpy_matrix(np.radians(values[3:]) if degrees else values[3:]))


def _given(node: Node, key: str) -> float:
    """Returns a number that has to be there: SDFormat would take 1."""
    value = node.number(key)
    if value is None:
        raise InvalidParameter(f"{node.place()} {key}", None, "given, for SDFormat would take 1")
    return value


def _link(node: Node, name: str, X: np.ndarray, tree: Tree) -> Link:
    link = Link(name, X, node)
    if (inertial := node.find("inertial")) is not None:
        link.mass, X_C = _given(inertial, "mass"), _pose(inertial)
        inertia = inertial.find("inertia")
        entries = dict.fromkeys(("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), 0.0)
        if inertia is not None:
            entries |= {key: _given(inertia, key) if key[1] == key[2] else
                        inertia.number(key, 0.0) or 0.0 for key in entries}
        elif link.mass > 0.0:
            tree.mended.append(f"{name}: no <inertia>, for which SDFormat takes 1 kg m²; taken as "
                               f"a point of {link.mass:g} kg")
        link.com = X_C[:3, 3]
        link.inertia = X_C[:3, :3] @ np.array([
            [entries[f"i{min(i, j)}{max(i, j)}"] for j in "xyz"] for i in "xyz"]) @ X_C[:3, :3].T
        if (added := inertial.find("fluid_added_mass")) is not None:
            link.added_mass = np.array([[
                added.number(ADDED[min(i, j)] + ADDED[max(i, j)], 0.0) or 0.0
                for j in range(6)] for i in range(6)])
    for tag, shapes in (("visual", link.visuals), ("collision", link.collisions)):
        for item in node.all(tag):
            shape = _shape(item)
            if shape is not None:
                shapes.append(shape)
    return link


def _shape(node: Node) -> Shape | None:
    geometry = node.find("geometry")
    color = node.find("material/diffuse")
    rgba = None if color is None else color.numbers(None)
    rgba = rgba if rgba is None or len(rgba) == 4 else np.append(rgba[:3], 1.0)
    if geometry is None:
        return None
    for item in geometry.children:
        X = _pose(node)
        if item.tag == "mesh":
            scale = item.find("scale")
            return Shape("mesh", np.ones(3) if scale is None else scale.numbers(3), X,
                         item.words("uri") or "", rgba)
        keys = {"box": ("size",), "cylinder": ("radius", "length"), "sphere": ("radius",),
                "capsule": ("radius", "length"), "ellipsoid": ("radii",)}.get(item.tag)
        if keys:
            count = 3 if item.tag in ("box", "ellipsoid") else 1
            values = [part.numbers(count) for key in keys if (part := item.find(key)) is not None]
            if len(values) < len(keys):
                raise InvalidParameter(item.place(), None, f"given by {', '.join(keys)}")
            return Shape(item.tag, np.concatenate(values), X, color=rgba)
    return None


def is_sdf(root: Node, file: Path) -> bool:
    """Whether a file is SDFormat; one that is neither that nor URDF is an error.

    Raises:
        InvalidParameter: Its root element is neither `<sdf>` nor `<robot>`.
    """
    require(root.tag in ("sdf", "robot"), "--from", str(file),
            f"URDF (<robot>) or SDFormat (<sdf>), not <{root.tag}>")
    return root.tag == "sdf"
