"""A robot as a file has it: links, joints, frames and plugins, in the file's own axes.

Drake's plant of it has masses, poses and axes; all else is read from the XML. `Notes` list values
taken, changed, and for the owner to give.
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Joint as DrakeJoint
from pydrake.multibody.tree import ModelInstanceIndex, RigidBody
from pydrake.systems.framework import Context

from uvms_drake.common.errors import require
from uvms_drake.model.description.xml_tree import Node

MOVING = ("revolute", "continuous", "prismatic")
"""Types of joints that an arm may have."""
SIZES = {"box": ("size",), "cylinder": ("radius", "length"), "sphere": ("radius",),
         "capsule": ("radius", "length"), "ellipsoid": ("radii",), "mesh": ()}
"""Solids, and their sizes."""

TITLES = (("taken", "Taken from the file"), ("changed", "Changed"),
          ("asked", "For you to give (the number in the files until then is an ESTIMATE)"))


@dataclass
class Shape:
    """A solid that is drawn, or that collides."""

    kind: str
    """One of `SIZES`."""
    size: np.ndarray
    """Edges of a box, (radius, length), (radius,), half axes [m]; the scale of a mesh."""
    X: RigidTransform
    """Pose in its link; a cylinder is along its z."""
    uri: str = ""
    """URI of a mesh."""
    file: Path | None = None
    """File of a mesh, if it is there."""
    color: np.ndarray | None = None
    """RGBA."""


@dataclass
class Link:
    """A body, with its mass and shapes in axes of its own."""

    name: str
    node: Node
    visuals: list[Shape] = field(default_factory=list)
    collisions: list[Shape] = field(default_factory=list)
    sensors: list[str] = field(default_factory=list)
    """Types of the sensors on it."""
    added_mass: np.ndarray | None = None
    """`fluid_added_mass` of SDFormat (6, 6), about the link's origin."""
    mass: float = 0.0
    com: np.ndarray = field(default_factory=lambda: np.zeros(3))
    body: RigidBody = field(init=False)
    """In the plant."""
    X: RigidTransform = field(default_factory=RigidTransform)
    """Pose, with the joints at `Tree.values`."""


@dataclass
class Joint:
    """A joint with its limits, drive and losses, as the file has them."""

    name: str
    kind: str
    node: Node
    lower: float = -np.inf
    upper: float = np.inf
    effort: float = 0.0
    """0: none in the file."""
    velocity: float = 0.0
    damping: float = 0.0
    friction: float = 0.0
    mimic: tuple[str, float, float] | None = None
    """Joint, multiplier and offset."""
    rotor: tuple[float, float] | None = None
    """Inertia of the motor [kg m²] and gear ratio."""
    parent: str = ""
    child: str = ""
    X: RigidTransform = field(default_factory=RigidTransform)
    """Pose of its frame, likewise."""
    axis: np.ndarray = field(default_factory=lambda: np.array([1.0, 0.0, 0.0]))
    """In axes of its frame."""
    joint: DrakeJoint = field(init=False)
    """In the plant."""


@dataclass
class Tree:
    """A robot, as a file has it."""

    links: dict[str, Link] = field(default_factory=dict)
    joints: dict[str, Joint] = field(default_factory=dict)
    frames: dict[str, tuple[str, RigidTransform]] = field(default_factory=dict)
    """Links and poses in them, by name."""
    plugins: list[tuple[str, Node]] = field(default_factory=list)
    """Scope of the names in it, and its element."""
    plant: MultibodyPlant = field(default_factory=lambda: MultibodyPlant(time_step=0.0))
    """The robot alone, without shapes."""
    values: dict[str, float] = field(default_factory=dict)
    """Values of the joints that are not at zero [rad, m]."""

    def complete(self, robot: ModelInstanceIndex) -> None:
        """Takes masses, poses and axes from the plant.

        Args:
            robot: The outermost model in it, in which others may be nested: `model::link`.
        """
        plant, outer = self.plant, self.plant.GetModelInstanceName(robot)

        def place(name: str) -> tuple[str, ModelInstanceIndex]:
            scope, _, short = name.rpartition("::")
            return short, plant.GetModelInstanceByName(f"{outer}::{scope}" if scope else outer)

        names = {}
        for link in self.links.values():
            link.body = plant.GetBodyByName(*place(link.name))
            names[link.body.index()] = link.name
            link.mass, link.com = link.body.default_mass(), link.body.default_com()
        for joint in self.joints.values():
            child = plant.GetFrameByName(*place(joint.child)).body()  # Its model has the joint.
            joint.joint = found = plant.GetJointByName(
                joint.name.rpartition("::")[2], child.model_instance())
            joint.parent = names.get(found.parent_body().index(), "world")
            joint.child = names[found.child_body().index()]
            if joint.kind in MOVING:
                joint.axis = (found.translation_axis() if joint.kind == "prismatic"
                              else found.revolute_axis())
        for name in list(self.frames):
            frame = plant.GetFrameByName(*place(name))
            if frame.body().index() in names:
                self.frames[name] = names[frame.body().index()], frame.GetFixedPoseInBodyFrame()
            else:
                del self.frames[name]
        self.hold({})

    def find_link(self, scope: str, name: str) -> Link | None:
        """Returns the link that a plugin names; None if there is none."""
        return self.links.get(scope + name) or self.links.get(name)

    def beyond(self, link: str) -> list[str]:
        """Returns a link and all that hangs on it."""
        found = [link]
        for name in found:
            found += [joint.child for joint in self.joints.values() if joint.parent == name]
            require(len(found) <= len(self.links), "link", link, "part of a tree: it is in a loop")
        return found

    def context(self, values: dict[str, float]) -> Context:
        """Returns the plant's context with joints at values, the others where they stay."""
        context, values = self.plant.CreateDefaultContext(), self.values | values
        positions = self.plant.GetPositions(context)
        for name, joint in self.joints.items():
            if joint.kind in MOVING:
                positions[joint.joint.position_start()] = values.get(name, 0.0)
        self.plant.SetPositions(context, positions)
        return context

    def pose(self, link: str, context: Context) -> RigidTransform:
        """Returns the pose of a link."""
        return self.plant.EvalBodyPoseInWorld(context, self.links[link].body)

    def hold(self, values: dict[str, float]) -> None:
        """Moves joints to values [rad, m], at which they stay."""
        self.values |= values
        context = self.context({})
        for link in self.links.values():
            link.X = self.pose(link.name, context)
        for joint in self.joints.values():
            frame = joint.joint.frame_on_child()
            joint.X = self.links[joint.child].X @ frame.GetFixedPoseInBodyFrame()


@dataclass
class Notes:
    """Lines that an import has to say, in the order in which they were found."""

    sdf: str
    """Name of the robot's file."""
    taken: list[str] = field(default_factory=list)
    changed: list[str] = field(default_factory=list)
    asked: list[str] = field(default_factory=list)

    def ask(self, file: str, key: str, question: str) -> None:
        """Asks for a number: the file and key to set, and its meaning."""
        self.asked.append(f"{file}, {key}: {question}")

    def format(self) -> str:
        """Returns the list, numbered throughout."""
        lines, number = [], 0
        for key, title in TITLES:
            items = getattr(self, key)
            lines.append(f"{title}:" if items else f"{title}: nothing.")
            for item in items:
                number += 1
                lines.append(f"{number:3}. {item}")
            lines.append("")
        return "\n".join(lines)


def listed(names: list[str], most: int = 12) -> str:
    """Returns names in one line; of many, the first ones and how many more."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more
