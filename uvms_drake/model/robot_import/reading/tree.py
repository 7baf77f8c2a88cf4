"""A robot's file as it was read: links, joints, frames and plugins, in the file's own axes.

All poses are in the frame of the model (URDF: of the root link), with every joint at zero.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from uvms_drake.common.errors import InvalidParameter, require
from uvms_drake.model.description.hydrodynamics_file import FARTHEST, require_near
from uvms_drake.model.robot_import.reading.poses import along, inverse
from uvms_drake.model.robot_import.reading.xml_node import Node

MOVING = ("revolute", "continuous", "prismatic")
"""Types of joints that an arm may have."""


@dataclass
class Shape:
    """A solid that is drawn, or that collides."""

    kind: str
    """box, cylinder, sphere, capsule, ellipsoid, mesh."""
    size: np.ndarray
    """Edges of a box, (radius, length), (radius,), half axes [m]; the scale of a mesh."""
    X: np.ndarray
    """Pose in its link; a cylinder is along its z."""
    uri: str = ""
    """URI of a mesh."""
    color: np.ndarray | None = None
    """RGBA."""


@dataclass
class Link:
    """A body, with its mass and shapes in axes of its own."""

    name: str
    X: np.ndarray
    """Pose at zero."""
    node: Node
    mass: float = 0.0
    com: np.ndarray = field(default_factory=lambda: np.zeros(3))
    inertia: np.ndarray = field(default_factory=lambda: np.zeros((3, 3)))
    """About the centre of mass [kg m²]."""
    visuals: list[Shape] = field(default_factory=list)
    collisions: list[Shape] = field(default_factory=list)
    added_mass: np.ndarray | None = None
    """`fluid_added_mass` of SDFormat (6, 6), about the link's origin."""

    def check(self) -> None:
        """Raises unless the mass, its centre and inertia are of a size that a robot's can be."""
        place = f"{self.node.place()} inertial"
        require(self.mass >= 0.0, f"{place} mass", self.mass, "zero or positive [kg]")
        require_near(f"{place} centre of mass", self.com)
        largest = float(np.max(np.abs(self.inertia)))
        require(largest <= self.mass * FARTHEST**2, f"{place} inertia", largest,
                f"that of {self.mass:g} kg within {FARTHEST:g} m (units are kg m²)")
        for shape in (*self.visuals, *self.collisions):
            require(shape.kind == "mesh" or bool(np.all(shape.size > 0.0)),
                    f"{self.node.place()} {shape.kind}", shape.size, "of positive sizes [m]")


@dataclass
class Joint:
    """A joint with its limits, drive and losses, as the file has them."""

    name: str
    kind: str
    parent: str
    child: str
    node: Node
    X: np.ndarray = field(default_factory=lambda: np.eye(4))
    """Pose of its frame at zero."""
    axis: np.ndarray = field(default_factory=lambda: np.array([1.0, 0.0, 0.0]))
    """In axes of its frame."""
    lower: float = -np.inf
    upper: float = np.inf
    effort: float | None = None
    velocity: float | None = None
    damping: float = 0.0
    friction: float = 0.0
    mimic: tuple[str, float, float] | None = None
    """Joint, multiplier and offset."""
    rotor: tuple[float, float] | None = None
    """Inertia of the motor [kg m²] and gear ratio."""


@dataclass
class Tree:
    """A robot, as a file has it."""

    name: str
    links: dict[str, Link] = field(default_factory=dict)
    joints: dict[str, Joint] = field(default_factory=dict)
    frames: dict[str, tuple[str, np.ndarray]] = field(default_factory=dict)
    """Link and pose in the model's frame, by name."""
    plugins: list[tuple[str, Node]] = field(default_factory=list)
    """Prefix of the names in it, and its element."""
    unread: list[str] = field(default_factory=list)
    """Elements that have no meaning here."""
    included: list[str] = field(default_factory=list)
    """Models of other files."""
    mended: list[str] = field(default_factory=list)
    """Elements that are not taken as the format has it, with the reason."""

    def add(self, item: Link | Joint) -> None:
        """Adds a link or joint; a name that stands twice is refused."""
        items: dict[str, Any] = self.links if isinstance(item, Link) else self.joints
        if item.name in items:
            raise InvalidParameter(f"{item.node.place()} name", item.name,
                                   f"given once: line {items[item.name].node.line} has it, too")
        if isinstance(item, Link):
            item.check()
        items[item.name] = item

    def find_link(self, prefix: str, name: str) -> Link | None:
        """Returns the link that a plugin names; None if there is none."""
        return self.links.get(prefix + name) or self.links.get(name)

    def find_joint(self, prefix: str, name: str) -> Joint | None:
        """Returns the joint that a plugin names; None if there is none."""
        return self.joints.get(prefix + name) or self.joints.get(name)

    def beyond(self, link: str) -> list[str]:
        """Returns a link and all that hangs on it."""
        found = [link]
        for name in found:
            found += [joint.child for joint in self.joints.values() if joint.parent == name]
            require(len(found) <= len(self.links), "link", link, "part of a tree: it is in a loop")
        return found

    def displace(self, joint: Joint, value: float) -> None:
        """Moves a joint to a value [rad, m], with all that hangs on it."""
        motion = joint.X @ along(joint.kind, joint.axis, value) @ inverse(joint.X)
        moved = set(self.beyond(joint.child))
        for name in moved:
            self.links[name].X = motion @ self.links[name].X
        for other in self.joints.values():
            if other.parent in moved or other is joint:
                other.X = motion @ other.X
        self.frames = {name: (link, motion @ X if link in moved else X)
                       for name, (link, X) in self.frames.items()}
