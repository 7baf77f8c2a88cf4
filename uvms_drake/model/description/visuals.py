"""The visuals of a robot's file: meshes that cannot be drawn give way to their bounding boxes."""

from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

import numpy as np
from pydrake.geometry import Mesh
from pydrake.math import RollPitchYaw

from uvms_drake.model.description.meshes import bounding_box
from uvms_drake.model.description.plausibility import Findings
from uvms_drake.model.description.xml_tree import Node, element

Locate = Callable[[str], Path]
"""The file of a URI; raises `LookupError` with the reason if there is none."""
DRAWN = (".obj", ".gltf")
"""Formats that pictures and pages are made from."""
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
    urdf, box = kind == "urdf", None
    uri, scale = mesh.name("filename" if urdf else "uri"), mesh.numbers("scale", 3, np.ones(3))
    try:
        path = locate(uri)
        reason = reason_not_drawn(path) if np.all(scale != 0.0) else "its scale is zero"
        if reason is None:
            if urdf:
                mesh.attributes["filename"] = f"file://{path.resolve()}"
            for node in mesh.all("uri"):
                node.text = f"file://{path.resolve()}"
            return True
        box = bounding_box(path)
    except LookupError as error:
        reason = str(error.args[0])
    found.notes.append(f"line {mesh.line}: visual of link {link.attributes['name']}, {uri}: "
                       f"{reason}: "
                       f"{'it is left out' if box is None else 'its bounding box is drawn'}")
    if box is None:
        return False
    # The box has the mesh's place in the visual.
    low, high = np.sort(scale * box, axis=0)
    X, center = visual.pose(), 0.5 * (low + high)
    shape.children = [element("box", mesh.line, {"size": np.maximum(high - low, THIN)}, urdf)]
    place = element("origin", visual.line, {
        "xyz": X @ center, "rpy": RollPitchYaw(X.rotation()).vector()}, urdf=True)
    if not urdf:
        frame = {} if (old := visual.find("pose")) is None else {
            key: old.attributes[key] for key in old.attributes if key == "relative_to"}
        place = Node("pose", visual.line, frame, " ".join(place.attributes.values()))
    visual.children = [place, *(child for child in visual.children if child.tag != place.tag)]
    return True


def reason_not_drawn(path: Path) -> str | None:
    """Returns why a mesh cannot be drawn, or None if it can be."""
    if not path.is_file():
        return f"{path.name} is not there"
    if path.suffix.lower() not in DRAWN:
        return f"{path.suffix or path.name} is no format that can be drawn ({', '.join(DRAWN)})"
    stamp = path.stat()
    return _fault(path, stamp.st_mtime_ns, stamp.st_size)


@lru_cache(maxsize=256)
def _fault(path: Path, changed: int, size: int) -> str | None:
    """Returns why Drake cannot read a mesh; it is read again when the file has changed."""
    try:
        Mesh(str(path)).GetConvexHull()
    except Exception as error:  # Of several types, by the reader of the format.
        return f"{path.name} cannot be read: {' '.join(str(error).split())[:120]}"
    return None
