"""Lumps links that are fixed to each other into the bodies of the robot, in this project's axes.

The vehicle's frame is that of its link, turned to FRD; that of an arm's body is at the joint that
moves it, so that joints have no poses of their own.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

from uvms_drake.model.description.hydrodynamics_file import AddedMass, Drag
from uvms_drake.model.robot_import.chain import Chain
from uvms_drake.model.robot_import.plugins import Thruster, Water, Waters
from uvms_drake.model.robot_import.tree import Joint, Link, Notes, Shape, Tree

FRD_FROM_FLU = RigidTransform(RotationMatrix(np.diag([1.0, -1.0, -1.0])))
"""Turn from z up to z down: half a turn about x."""
BUOYANT = 1e-3
"""Height of buoyancy over mass that tells which way is up [m]."""


@dataclass
class Body:
    """A body of the robot, in axes of its own."""

    name: str
    X: RigidTransform
    """Pose of its frame in that of the model, at zero."""
    middle: RigidTransform
    """Pose of its frame in the vehicle's, with the arm's joints in the middle of their limits."""
    joint: Joint | None
    """The joint that moves it; None of the vehicle."""
    links: list[Link]
    beyond: float = 0.0
    """Inertia of it and of all beyond about its joint, at zero [kg m²], or their mass [kg]."""
    mass: float = 0.0
    com: np.ndarray = field(default_factory=lambda: np.zeros(3))
    inertia: np.ndarray = field(default_factory=lambda: np.zeros((3, 3)))
    """About the centre of mass [kg m²]."""
    visuals: list[Shape] = field(default_factory=list)
    collisions: list[Shape] = field(default_factory=list)
    volume: float | None = None
    center: np.ndarray = field(default_factory=lambda: np.zeros(3))
    added_mass: list[AddedMass] = field(default_factory=list)
    drag: list[Drag] = field(default_factory=list)

    def of(self, link: Link) -> RigidTransform:
        """Returns the pose of a link in the body's frame."""
        return self.X.inverse() @ link.X


def z_is_up(tree: Tree, chain: Chain, waters: Waters, notes: Notes) -> bool:
    """Whether the vehicle's link has z up, as ROS and Gazebo have it; the evidence is noted."""
    name = chain.root.lower()
    if "frd" in name or "ned" in name.split("_"):
        notes.taken.append(f"axes: FRD, z down, by the name of link '{chain.root}'")
        return False
    water = waters.links.get(chain.root)
    lever = 0.0
    if water is not None and water.volume:
        lever = float(water.center[2] - tree.links[chain.root].com[2])
    if lever < -BUOYANT:
        notes.taken.append(f"axes: FRD, z down, for buoyancy is above mass by {-lever:g} m then")
        return False
    known = lever > BUOYANT
    if not known and chain.root == "vehicle" and "tip" in tree.frames:
        notes.taken.append("axes: FRD, z down, for a link 'vehicle' and a frame 'tip' make a robot "
                           "of this program's own format")
        return False
    reason = f"buoyancy is above mass by {lever:g} m then" if known else "so in ROS and Gazebo"
    if not known:
        notes.asked.append(f"the axes: nothing tells whether the z of '{chain.root}' is up. "
                           "ESTIMATE: it is, as in ROS and Gazebo. If it is down, put frd into "
                           "the name of this link in your file, and begin again")
    notes.changed.append(f"axes: z up, FLU ({reason}), turned to FRD by diag(1, -1, -1); arm and "
                         "tool turn with the vehicle")
    return True


def lump(tree: Tree, chain: Chain, waters: Waters, notes: Notes, flips: bool) -> list[Body]:
    """Returns the bodies of vehicle and arm.

    Args:
        tree: The robot, with all that is fixed where it shall be.
        chain: Vehicle and arm.
        waters: Effects of the water, by link.
        notes: Corrections are added.
        flips: Whether the vehicle is to be turned from z up to z down.
    """
    middle = tree.context({joint.name: 0.5 * (joint.lower + joint.upper) for joint in chain.joints
                           if np.isfinite([joint.lower, joint.upper]).all()})
    turn = FRD_FROM_FLU if flips else RigidTransform()
    X_WV = tree.pose(chain.root, middle) @ turn
    inertias = tree.plant.CalcMassMatrix(tree.context({}))
    names = unique(["vehicle", *(joint.child for joint in chain.joints)])
    bodies = []
    for name, group, joint in zip(names, chain.groups, [None, *chain.joints], strict=True):
        base = tree.links[chain.root if joint is None else joint.child]
        X_LB = turn if joint is None else base.X.inverse() @ joint.X
        body = Body(name, base.X @ X_LB, X_WV.inverse() @ tree.pose(base.name, middle) @ X_LB,
                    joint, [tree.links[link] for link in group])
        if joint is not None:
            row = joint.joint.velocity_start()
            body.beyond = float(inertias[row, row])
        _add_masses(body, tree, base, X_LB, notes)
        for link in body.links:
            X = body.of(link)
            for shapes, mine in ((link.visuals, body.visuals), (link.collisions, body.collisions)):
                mine += [replace(shape, X=X @ shape.X) for shape in shapes]
            if link.name in waters.links:
                _add_water(body, link, waters.links[link.name], notes)
        bodies.append(body)
    # An arm that is not in front of the vehicle's middle tells that x may not be forward.
    if len(bodies) > 1:
        p = bodies[0].of(bodies[1].links[0]).translation() - bodies[0].com
        if p[0] < abs(p[1]):
            notes.asked.append(
                f"the axes: the arm begins at ({p[0]:.2f}, {p[1]:.2f}, {p[2]:.2f}) m from the "
                "vehicle's centre of mass, and x is taken as forward. If another axis is, surge "
                "and sway are exchanged or reversed")
    return bodies


def unique(names: list[str], others: Sequence[str] = ()) -> list[str]:
    """Returns short names of letters, digits and _, all of them different, and no `others`."""
    found: list[str] = []
    for name in names:
        short = name.rsplit("::", 1)[-1].rsplit("/", 1)[-1]
        short = "".join(c if c.isascii() and c.isalnum() else "_" for c in short) or "link"
        taken, number = short, 1
        while taken in (*found, *others):
            number += 1
            taken = f"{short}_{number}"
        found.append(taken)
    return found


def _add_masses(body: Body, tree: Tree, base: Link, X_LB: RigidTransform, notes: Notes) -> None:
    """Sums masses and moments of the links, about the common centre of mass.

    Args:
        body: Takes the sums, in axes of its own.
        tree: Has the links.
        base: The link that carries the body's frame.
        X_LB: Pose of that in the link.
        notes: Asks about a moment that is none.
    """
    body.mass = sum(link.mass for link in body.links)
    if body.mass <= 0.0:
        return
    M = tree.plant.CalcSpatialInertia(tree.context({}), base.body.body_frame(),
                                      [link.body.index() for link in body.links])
    body.com = X_LB.inverse() @ M.get_com()
    about_center = M.Shift(M.get_com()).ReExpress(X_LB.rotation().inverse())
    body.inertia = about_center.CalcRotationalInertia().CopyToFullMatrix3()
    if (moments := np.linalg.eigvalsh(body.inertia))[0] <= 0.0:
        notes.ask(notes.sdf, f"link {body.name}, inertia", "principal moments "
                  f"{np.array2string(moments, precision=3)} kg m² are those of no body")


def _add_water(body: Body, link: Link, water: Water, notes: Notes) -> None:
    """Adds a link's water to its body, turned into the body's axes."""
    X = body.of(link)
    R, origin = X.rotation().matrix(), X.translation()
    if water.volume is not None:
        center, volume = X @ water.center, body.volume or 0.0
        total = volume + water.volume
        if total > 0.0:
            body.center = (volume * body.center + water.volume * center) / total
        body.volume = total
    if water.added_mass is not None:
        T = np.kron(np.eye(2), R)
        M = T @ water.added_mass @ T.T
        body.added_mass.append(AddedMass(0.5 * (M + M.T), origin))
    if water.linear is not None and water.quadratic is not None:
        squares = np.kron(np.eye(2), R**2)
        if not np.allclose(np.max(R**2, axis=0), 1.0, atol=1e-6):
            notes.changed.append(f"{link.name}: its drag is by axes at an angle to those of "
                                 f"'{body.name}': weighted by the squares of the cosines")
        body.drag.append(Drag(squares @ water.linear, squares @ water.quadratic, origin))


def place_thrusters(vehicle: Body, thrusters: list[Thruster], notes: Notes) -> list[Thruster]:
    """Returns those of the vehicle, with positions [m] and axes in its frame."""
    notes.changed += [f"thruster {thruster.name} is not on the vehicle: left out"
                      for thruster in thrusters if thruster.link not in vehicle.links]
    return [replace(thruster, position=X.translation(), axis=X.rotation() @ thruster.axis)
            for thruster in thrusters if thruster.link in vehicle.links
            for X in [vehicle.of(thruster.link)]]
