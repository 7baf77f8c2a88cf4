"""The visuals of a robot's file: meshes that cannot be drawn give way to their bounding boxes."""

import re
import struct
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from pydrake.geometry import Mesh
from pydrake.math import RollPitchYaw

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


def bounding_box(path: Path) -> np.ndarray | None:
    """Returns the smallest and the largest corner (2, 3) of a mesh in its own unit; None if unread.

    Of STL and OBJ it is exact, of COLLADA without the transforms of its nodes.
    """
    try:
        points = {".stl": _stl_points, ".obj": _obj_points, ".dae": _dae_points}[
            path.suffix.lower()](path)
    except (KeyError, OSError, ValueError, struct.error, ElementTree.ParseError):
        return None
    if points.ndim != 2 or len(points) == 0 or not np.all(np.isfinite(points)):
        return None
    return np.array([points.min(axis=0), points.max(axis=0)])


def stl_triangles(path: Path) -> np.ndarray:
    """Returns the triangles (k, 3, 3) of an STL file, in its own unit.

    Raises:
        ValueError: It is no STL file.
    """
    return _stl_points(path).reshape(-1, 3, 3)


def _stl_points(path: Path) -> np.ndarray:
    data = path.read_bytes()
    count = struct.unpack_from("<I", data, 80)[0] if len(data) >= 84 else -1
    if len(data) == 84 + 50 * count:
        facets = np.frombuffer(data, offset=84, dtype=[
            ("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
        return facets["corners"].reshape(-1, 3).astype(float)
    return _triples(re.findall(r"vertex\s+(\S+)\s+(\S+)\s+(\S+)", data.decode("ascii", "replace")))


def _obj_points(path: Path) -> np.ndarray:
    text = path.read_text(encoding="utf-8", errors="replace")
    return _triples(re.findall(r"^\s*v\s+(\S+)\s+(\S+)\s+(\S+)", text, re.MULTILINE))


def _dae_points(path: Path) -> np.ndarray:
    root = ElementTree.parse(path).getroot()
    space = root.tag.removesuffix("COLLADA")
    unit = root.find(f"{space}asset/{space}unit")
    scale = 1.0 if unit is None else float(unit.get("meter", "1"))
    axis = root.findtext(f"{space}asset/{space}up_axis", "Y_UP").strip()
    sources = {source.get("id"): source for source in root.iter(f"{space}source")}
    points = []
    for vertices in root.iter(f"{space}vertices"):
        for entry in vertices.iter(f"{space}input"):
            source = sources.get(entry.get("source", "").removeprefix("#"))
            if entry.get("semantic") == "POSITION" and source is not None:
                points += source.findtext(f"{space}float_array", "").split()
    found = scale * np.array(points, dtype=float).reshape(-1, 3)
    return found[:, [0, 2, 1]] * [1.0, -1.0, 1.0] if axis == "Y_UP" else found


def _triples(found: list[tuple[str, ...]]) -> np.ndarray:
    return np.array(found, dtype=float).reshape(-1, 3)

def format_obj(triangles: np.ndarray) -> str:
    """Returns the text of an OBJ file of triangles (k, 3, 3), equal corners once."""
    corners, index = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)
    index = index.reshape(-1, 3) + 1
    flat = (index == np.roll(index, 1, axis=1)).any(axis=1)
    lines = [f"v {x:.7g} {y:.7g} {z:.7g}" for x, y, z in corners]
    lines += [f"f {a} {b} {c}" for a, b, c in index[~flat]]
    return "\n".join(lines) + "\n"


def mesh_volume(triangles: np.ndarray) -> float:
    """Returns the volume inside of a closed surface of triangles (k, 3, 3), in their unit cubed."""
    return float(abs(np.linalg.det(triangles).sum()) / 6.0)
