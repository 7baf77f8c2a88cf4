"""The visuals of a robot's file: meshes that cannot be drawn give way to their bounding boxes."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RigidTransform, RollPitchYaw

from uvms_drake.model.description.meshes import bounding_box, reason_not_drawn
from uvms_drake.model.description.plausibility import Findings
from uvms_drake.model.description.xml_tree import Node

Locate = Callable[[str], Path]
"""The file of a URI; raises `LookupError` with the reason if there is none."""
THIN = 1e-3
"""Least side of a box that stands for a mesh, as of a flat one [m]."""


def settle_visuals(root: Node, kind: str, locate: Locate, found: Findings) -> None:
    """Leaves in a file only visuals that can be drawn, and their meshes by absolute paths.

    Args:
        root: Of the file; changed.
        kind: "urdf" or "sdf".
        locate: Of the robot's folder.
        found: Takes a line for every mesh that is not drawn.
    """
    for link in (node for node in root.walk() if node.tag == "link"):
        kept = []
        for child in link.children:
            shape = child.find("geometry") if child.tag == "visual" else None
            mesh = None if shape is None else shape.find("mesh")
            drawn = child.tag != "visual" or (shape is not None and bool(shape.children))
            if shape is not None and mesh is not None:
                drawn = _settle_mesh(link, child, shape, mesh, kind, locate, found)
            if drawn:
                kept.append(child)
        link.children = kept


def _settle_mesh(link: Node, visual: Node, shape: Node, mesh: Node, kind: str, locate: Locate,
                 found: Findings) -> bool:
    """Makes a mesh one that can be drawn; returns whether anything is left to draw."""
    urdf, uri_node = kind == "urdf", mesh.find("uri")
    uri = mesh.attributes["filename"] if urdf or uri_node is None else uri_node.text.strip()
    scale_node = mesh.find("scale")
    text = mesh.attributes.get("scale") if urdf or scale_node is None else scale_node.text
    scale = np.array((text or "1 1 1").split(), dtype=float)
    box = None
    try:
        path = locate(uri)
        reason = reason_not_drawn(path) if np.all(scale != 0.0) else "its scale is zero"
        if reason is None:
            if urdf or uri_node is None:
                mesh.attributes["filename"] = f"file://{path.resolve()}"
            else:
                uri_node.text = f"file://{path.resolve()}"
            return True
        box = bounding_box(path)
    except LookupError as error:
        reason = str(error.args[0])
    found.notes.append(f"line {mesh.line}: visual of link {link.attributes['name']}, {uri}: "
                       f"{reason}: "
                       f"{'it is left out' if box is None else 'its bounding box is drawn'}")
    if box is None:
        return False
    low, high = np.sort(scale * box, axis=0)
    shape.children = [_box(np.maximum(high - low, THIN), urdf, mesh.line)]
    _place(visual, 0.5 * (low + high), urdf)
    return True


def _box(size: np.ndarray, urdf: bool, line: int) -> Node:
    if urdf:
        return Node("box", line, {"size": _text(size)})
    return Node("box", line, children=[Node("size", line, text=_text(size))])


def _place(visual: Node, center: np.ndarray, urdf: bool) -> None:
    """Moves a visual's origin to a point of its own frame (3,) [m]."""
    tag = "origin" if urdf else "pose"
    place = visual.find(tag)
    if place is None:
        place = Node(tag, visual.line)
        visual.children.insert(0, place)
    if urdf:
        X = RigidTransform(RollPitchYaw(_numbers(place.attributes.get("rpy", "0 0 0"))),
                           _numbers(place.attributes.get("xyz", "0 0 0")))
        place.attributes["xyz"] = _text(X @ center)
        return
    X = _pose(place)
    rpy = RollPitchYaw(X.rotation()).vector()
    for name in ("degrees", "rotation_format"):
        place.attributes.pop(name, None)
    place.text = _text(np.concatenate([X @ center, rpy]))


def _pose(node: Node) -> RigidTransform:
    values = _numbers(node.text or "0 0 0 0 0 0")
    if node.attributes.get("rotation_format") == "quat_xyzw":
        x, y, z, w = values[3:] / np.linalg.norm(values[3:])
        return RigidTransform(Quaternion(w, x, y, z), values[:3])
    turn = np.pi / 180.0 if node.attributes.get("degrees") in ("true", "1") else 1.0
    return RigidTransform(RollPitchYaw(turn * values[3:]), values[:3])


def _numbers(text: str) -> np.ndarray:
    return np.array(text.split(), dtype=float)


def _text(values: np.ndarray) -> str:
    return " ".join(repr(float(value)) for value in values)
