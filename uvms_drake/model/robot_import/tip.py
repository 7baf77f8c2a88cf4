"""Places the tip: x along the tool, at a frame of the file or at the end of the last body."""

import re

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

from uvms_drake.model.robot_import.bodies import FRD_FROM_FLU, Body
from uvms_drake.model.robot_import.sizes import Size, plausible_size, size_by_shapes
from uvms_drake.model.robot_import.tree import Notes, Tree

NAMES = tuple(re.compile(pattern, re.I) for pattern in (
    r"(^|[_/:])(tip|tcp)([_/:]|$)", r"end_?eff|(^|[_/:])ee([_/:]|$)", r"tool|standard_jaws_tool",
    r"grasp|grip.*(frame|center)"))
"""Names of frames that are the tip's, the best first."""
ALIGNED = 0.9
"""Cosine from which an axis of such a frame is the tool's."""
REACH = 0.1
"""Length of a tool of which nothing is known [m]."""


def place_tip(tree: Tree, bodies: list[Body], density: float, notes: Notes, flips: bool
              ) -> RigidTransform:
    """Returns the pose of the tip in the last body, and says where it is from.

    Args:
        tree: Of the file, which may have a frame for it.
        bodies: Vehicle and arm.
        density: Of the water [kg/m³].
        notes: The choice is added.
        flips: Whether the vehicle was turned, and a frame of the file with it.
    """
    # The end of the last body, if no frame has a tip's name.
    last = bodies[-1]
    along = _direction(last)
    found = _named(tree, last)
    if found is None:
        reach = _reach(last, plausible_size(last, density, notes), along)
        X = RigidTransform(_upright(last, along), reach * along)
        notes.ask(notes.sdf, "frame tip, pose",
                  f"no link or frame of the file is a tip by its name. ESTIMATE: the end of "
                  f"'{last.name}', {reach:.3g} m from its origin, x along the tool")
        return X
    # The axis of that frame along which it lies off the joint is the tool's.
    name, X = found
    turn = FRD_FROM_FLU if flips else RigidTransform()
    away = X.translation() - (np.zeros(3) if last.joint is not None else last.com)
    if np.linalg.norm(away) > 1e-3 and last.joint is not None:
        along = away / np.linalg.norm(away)
    axes = X.rotation().matrix()
    cosines = axes.T @ along
    axis = int(np.argmax(np.abs(cosines)))
    sign = "-" if cosines[axis] < 0.0 else ""
    # It becomes x, and the frame is turned as the vehicle is.
    if abs(cosines[axis]) < ALIGNED:
        notes.taken.append(f"tip: '{name}' of the file, with its own x")
        notes.ask(notes.sdf, "frame tip, pose", "none of the axes of "
                  f"'{name}' is along the tool; ESTIMATE: its x is the direction of pressing")
        X = X @ turn
    elif axis == 0 and not sign:
        notes.taken.append(f"tip: '{name}' of the file, x along the tool"
                           + (", turned with the vehicle" if flips else ""))
        X = X @ turn
    else:
        tool = np.sign(cosines[axis]) * axes[:, axis]
        X = RigidTransform(_upright(last, tool), X.translation())
        notes.changed.append(f"tip: '{name}' of the file, turned so that x is along the tool, "
                             f"which is its {sign}{'xyz'[axis]}")
    return X


def _named(tree: Tree, last: Body) -> tuple[str, RigidTransform] | None:
    """Returns the frame, or the link without a mass, that is the tip by its name."""
    links = {link.name for link in last.links}
    places = {name: tree.links[link].X @ X for name, (link, X) in tree.frames.items()
              if link in links}
    places |= {link.name: link.X for link in last.links if link.mass <= 0.0}
    for pattern in NAMES:
        for name, X in places.items():
            if pattern.search(name):
                return name, last.X.inverse() @ X
    return None


def _direction(body: Body) -> np.ndarray:
    """Returns the unit vector (3,) along the tool: from the joint to the middle of the body."""
    if body.joint is None:
        return np.array([1.0, 0.0, 0.0])
    size = size_by_shapes(body)
    middle = body.com if size is None else size[0].mean(axis=0)
    if np.linalg.norm(middle) < 1e-3:
        middle = body.com if np.linalg.norm(body.com) > 1e-3 else np.array([1.0, 0.0, 0.0])
    # Along the nearest axis, if there is one: links are not quite symmetric.
    axis = int(np.argmax(np.abs(middle)))
    if abs(middle[axis]) >= ALIGNED * np.linalg.norm(middle):
        middle = np.eye(3)[axis] * np.sign(middle[axis])
    return np.asarray(middle / np.linalg.norm(middle))


def _reach(body: Body, size: Size | None, along: np.ndarray) -> float:
    if size is None:
        return max(REACH, 2.0 * float(body.com @ along))
    return float(np.max(size[0] * along, axis=0).sum())


def _upright(last: Body, tool: np.ndarray) -> RotationMatrix:
    """Returns an attitude in the last body: x along the tool, z as far down as it can.

    Down is that of the vehicle, with all joints in the middle of their limits.
    """
    R_BV = last.middle.rotation().matrix().T
    down = R_BV[:, 2]
    if abs(down @ tool) > ALIGNED:  # It points down or up: the one that is level turned by pitch.
        down = -np.sign(down @ tool) * R_BV[:, 0]
    y = np.cross(down, tool)
    y /= np.linalg.norm(y)
    return RotationMatrix(np.stack([tool, y, np.cross(tool, y)], axis=1))
