"""A robot's files read a second time: by ElementTree, PyYAML and NumPy, after the two formats.

Nothing of the package and of Drake is in it. A file that is not what its format says raises.
"""

import re
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import yaml

NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?|[-+]?inf")
NAMES = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")


@dataclass
class Reading:
    """What the files say."""

    bodies: dict[str, tuple[float, np.ndarray, np.ndarray]]
    """Mass, centre of mass (3,) and inertia about it (3, 3) in the axes of the link, by name."""
    added: dict[str, np.ndarray]
    """M_A (6, 6) about the origin of the link, by name."""
    buoyancy: dict[str, np.ndarray]
    """Mass of displaced water and its centre (4,), by name."""
    joints: list[tuple[str, float, float, float, float]]
    """Name, lower, upper, damping and inertia of the motor at the joint, from the vehicle on."""
    thrusters: list[tuple[str, np.ndarray, np.ndarray, dict]]
    """Name, position (3,), direction (3,) and the data of the kind."""
    poses: dict[str, np.ndarray]
    """X_VL (4, 4) of the links where all joints are at zero, in axes of the vehicle."""
    axes: dict[str, tuple[np.ndarray, np.ndarray, bool]]
    """Axis and a point on it (3,) there, by joint, and whether it slides."""
    tip_at_zero: np.ndarray
    """X_VT (4, 4) there."""

    def tip(self, q: np.ndarray) -> np.ndarray:
        """Returns X_VT (4, 4) at the joints' q (n,), by the product of exponentials."""
        X = np.eye(4)
        for (name, *_), angle in zip(self.joints, q, strict=True):
            axis, point, slides = self.axes[name]
            step = np.eye(4)
            if slides:
                step[:3, 3] = angle * axis
            else:
                S = skew(axis)
                step[:3, :3] += np.sin(angle) * S + (1.0 - np.cos(angle)) * S @ S
                step[:3, 3] = point - step[:3, :3] @ point
            X = X @ step
        return X @ self.tip_at_zero


def numbers(text: str | None, count: int, default: str | None = None) -> np.ndarray:
    """Returns the numbers of a text; raises if it has others."""
    words = (default if text is None else text or default or "").split()
    if len(words) != count or not all(NUMBER.fullmatch(word) for word in words):
        raise ValueError(f"{text!r} is not {count} numbers")
    return np.array(words, dtype=float)


def pose(xyz: np.ndarray, rpy: np.ndarray) -> np.ndarray:
    """Returns X (4, 4) of a place and of angles about fixed axes."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy), np.sin(rpy)
    X = np.eye(4)
    X[:3, :3] = [[cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
                 [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr], [-sp, cp * sr, cp * cr]]
    X[:3, 3] = xyz
    return X


def read_robot(folder: Path) -> Reading:
    """Returns what a robot's folder says."""
    (file,) = [*folder.glob(f"{folder.name}.sdf"), *folder.glob(f"{folder.name}.urdf")]
    root = ElementTree.fromstring(re.sub(r"drake:", "", file.read_text(encoding="utf-8")))
    bodies, joints, poses, axes, tip = (
        _read_sdf if file.suffix == ".sdf" else _read_urdf)(root)
    water = _yaml(folder / "hydrodynamics.yaml") or {}
    density = float(water.get("fluid_density", 1000.0))
    added, buoyancy = {}, {}
    for name, body in (water.get("bodies") or {}).items():
        if name not in bodies:
            raise ValueError(name)
        buoyancy[name] = np.array([density * float(body.get("displaced_volume", 0.0)),
                                   *map(float, body.get("center_of_buoyancy", np.zeros(3)))])
        added[name] = sum((_added(item) for item in body.get("added_mass", [])), np.zeros((6, 6)))
    thrusters, path = [], folder / "thrusters.yaml"
    if path.is_file():
        data = _yaml(path)
        for name, item in data["thrusters"].items():
            axis = np.array(item["axis"], dtype=float)
            thrusters.append((name, np.array(item.get("position", np.zeros(3)), dtype=float),
                              axis / np.linalg.norm(axis), data["kinds"][item["kind"]]))
    return Reading(bodies, added, buoyancy, joints, thrusters, poses, axes, tip)


class _Loader(yaml.SafeLoader):
    """Raises for a key that a mapping has twice."""

    def construct_mapping(self, node, deep=False):
        keys = [self.construct_object(key) for key, _ in node.value]
        if len(set(keys)) < len(keys):
            raise ValueError(f"{keys} twice")
        return super().construct_mapping(node, deep)


def _yaml(path: Path) -> dict:
    return yaml.load(path.read_text(encoding="utf-8"), _Loader)


def words(folder: Path) -> set[tuple[str, ...]]:
    """Returns what a robot's files are written in, as far as it is no name and no number.

    These are elements and attributes, each with the element that it is in; elements that stand
    there several times; keys of YAML.
    """
    found: set[tuple[str, ...]] = set()
    for path in folder.glob("*.yaml"):
        waiting = [(path.name, _yaml(path))]
        while waiting:
            above, data = waiting.pop()
            entries = data.items() if isinstance(data, dict) else [
                ("item", each) for each in data] if isinstance(data, list) else []
            for key, value in entries:
                named = above in ("bodies", "kinds", "thrusters") or key == "item"
                found.add((path.name, above, "" if named else str(key)))
                waiting.append((f"{above}." if named else str(key), value))
    for path in (*folder.glob("*.urdf"), *folder.glob("*.sdf")):
        root = ElementTree.fromstring(re.sub("drake:", "", path.read_text(encoding="utf-8")))
        for node in root.iter():
            tags = [child.tag for child in node]
            found |= {(node.tag, tag) for tag in tags}
            found |= {(node.tag, "", key) for key in node.attrib}
            found |= {(node.tag, tag, "twice") for tag in tags if tags.count(tag) > 1}
    return found


def _added(item: dict) -> np.ndarray:
    M = np.array(item.get("matrix", np.zeros(6)), dtype=float)
    M, H = np.diag(M) if M.ndim == 1 else M, np.eye(6)
    H[:3, 3:] = -skew(np.array(item.get("point", np.zeros(3)), dtype=float))
    total = H.T @ M @ H
    return 0.5 * (total + total.T)


def skew(vector: np.ndarray) -> np.ndarray:
    """Returns S(v) (3, 3)."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def inertia_of(values: list[float], R: np.ndarray) -> np.ndarray:
    """Returns an inertia (3, 3) of its numbers by `NAMES`, in axes that R turns to."""
    xx, yy, zz, xy, xz, yz = values
    return R @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ R.T


def origin(node) -> np.ndarray:
    """Returns the pose (4, 4) of a URDF's element in its parent; None is at the parent's."""
    place = None if node is None else node.find("origin")
    given = {} if place is None else place.attrib
    return pose(numbers(given.get("xyz"), 3, "0 0 0"), numbers(given.get("rpy"), 3, "0 0 0"))


def _read_urdf(root):
    bodies, motors = {}, {}
    for link in root.findall("link"):
        inertial = link.find("inertial")
        mass, com, moments = 0.0, np.zeros(3), np.zeros((3, 3))
        if inertial is not None:
            X, inertia = origin(inertial), inertial.find("inertia")
            (mass,), com = numbers(inertial.find("mass").get("value"), 1), X[:3, 3]
            moments = inertia_of([float(numbers(inertia.get(name), 1, "0")[0]) for name in NAMES],
                               X[:3, :3])
        bodies[link.get("name")] = (float(mass), com, moments)
    for transmission in root.findall("transmission"):
        actuator = transmission.find("actuator")
        rotor, gear = (actuator.find(name) for name in ("rotor_inertia", "gear_ratio"))
        (J,) = numbers(None if rotor is None else rotor.get("value"), 1, "0")
        (N,) = numbers(None if gear is None else gear.get("value"), 1, "1")
        motors[transmission.find("joint").get("name")] = N**2 * J
    found = {}
    for joint in root.findall("joint"):
        limit, dynamics, axis = (joint.find(name) for name in ("limit", "dynamics", "axis"))
        given = {} if limit is None else limit.attrib
        found[joint.find("child").get("link")] = (
            joint.get("name"), joint.get("type"), joint.find("parent").get("link"), origin(joint),
            numbers(None if axis is None else axis.get("xyz"), 3, "1 0 0"),
            float(numbers(given.get("lower"), 1, "-inf")[0]),
            float(numbers(given.get("upper"), 1, "inf")[0]),
            float(numbers(None if dynamics is None else dynamics.get("damping"), 1, "0")[0]))
    (frame,) = [node for node in root.findall("frame") if node.get("name") == "tip"]
    poses = {"vehicle": np.eye(4)}

    def place(name):
        if name not in poses:
            poses[name] = place(found[name][2]) @ found[name][3]
        return poses[name]

    for name in bodies:
        place(name)
    axes = {each[0]: (poses[child][:3, :3] @ each[4] / np.linalg.norm(each[4]),
                      poses[child][:3, 3], each[1] == "prismatic") for child, each in found.items()}
    inboard = {child: each[2] for child, each in found.items()}
    joints = [(each[0], *each[5:], motors[each[0]]) for child, each in sorted(
        found.items(), key=lambda item: _depth(item[0], inboard)) if each[1] != "fixed"]
    X = pose(numbers(frame.get("xyz"), 3), numbers(frame.get("rpy"), 3))
    return bodies, joints, poses, axes, poses[frame.get("link")] @ X


def _depth(name: str, inboard: dict[str, str]) -> int:
    return 0 if name not in inboard else 1 + _depth(inboard[name], inboard)


def _read_sdf(root):
    model = root.find("model")

    def text(node, *path, default=None):
        for name in path:
            node = None if node is None else node.find(name)
        return default if node is None else (node.text or "").strip() or default

    def own_pose(node):
        place = None if node is None else node.find("pose")
        values = numbers(None if place is None else (place.text or "").strip(), 6, "0 0 0 0 0 0")
        if place is not None and place.get("degrees") in ("true", "1"):
            values[3:] = np.deg2rad(values[3:])
        return pose(values[:3], values[3:]), None if place is None else place.get("relative_to")

    frames = {node.get("name"): node for kind in ("link", "joint", "frame")
              for node in model.findall(kind)}
    poses: dict[str, np.ndarray] = {"__model__": np.eye(4)}

    def place(name):
        if name not in poses:
            node = frames[name]
            X, relative = own_pose(node)
            default = {"link": "__model__", "joint": text(node, "child"),
                       "frame": node.get("attached_to", "__model__")}[node.tag]
            poses[name] = place(relative or default) @ X
        return poses[name]

    bodies = {}
    for link in model.findall("link"):
        inertial = link.find("inertial")
        X, _ = own_pose(inertial)
        values = [float(numbers(text(inertial, "inertia", name), 1,
                                "0" if name[1] != name[2] else "1")[0]) for name in NAMES]
        (mass,) = numbers(text(inertial, "mass"), 1, "1")
        bodies[link.get("name")] = (float(mass), X[:3, 3], inertia_of(values, X[:3, :3]))
    axes, rows, inboard = {}, [], {}
    for joint in model.findall("joint"):
        name, axis = joint.get("name"), joint.find("axis")
        inboard[text(joint, "child")] = text(joint, "parent")
        if joint.get("type") == "fixed":
            continue
        direction = numbers(text(axis, "xyz"), 3, "0 0 1")
        expressed = axis.find("xyz").get("expressed_in") or name
        slides = joint.get("type") == "prismatic"
        axes[name] = (place(expressed)[:3, :3] @ direction / np.linalg.norm(direction),
                      place(name)[:3, 3], slides)
        lower, upper = (float(numbers(text(axis, "limit", key), 1, default)[0])
                        for key, default in (("lower", "-inf"), ("upper", "inf")))
        (damping,) = numbers(text(axis, "dynamics", "damping"), 1, "0")
        (J,) = numbers(text(joint, "rotor_inertia"), 1, "0")
        (N,) = numbers(text(joint, "gear_ratio"), 1, "1")
        rows.append((text(joint, "child"), (name, lower, upper, float(damping), N**2 * J)))
    rows.sort(key=lambda row: _depth(row[0], inboard))
    X_V = np.linalg.inv(place("vehicle"))
    axes = {name: (X_V[:3, :3] @ axis, (X_V @ np.append(point, 1.0))[:3], slides)
            for name, (axis, point, slides) in axes.items()}
    return (bodies, [row for _, row in rows], {name: X_V @ place(name) for name in bodies}, axes,
            X_V @ place("tip"))
