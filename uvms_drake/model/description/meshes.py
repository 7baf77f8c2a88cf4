"""Meshes of STL, OBJ, COLLADA and glTF files.

Of glTF they are the convex hull that Drake has of it, of the others the triangles of the file.
"""

import re
import struct
from collections.abc import Iterable, Iterator
from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.geometry import Mesh, ReadObjToTriangleSurfaceMesh
from pydrake.math import RotationMatrix

Surface = tuple[np.ndarray, np.ndarray]
"""Corners (n, 3) and triangles (k, 3, 3)."""
UP = {"Z_UP": np.eye(3), "Y_UP": np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]]),
      "X_UP": np.array([[0, -1, 0], [0, 0, -1], [1, 0, 0]])}
"""Rotations to z up from the axes of a COLLADA file."""


def read_mesh(path: Path) -> Surface | None:
    """Returns the surface in a file, in its unit, but of COLLADA in m and z up; None if unread."""
    try:
        points, triangles = {".stl": _stl, ".obj": _obj, ".dae": _dae, ".gltf": _gltf}[
            path.suffix.lower()](path)
    except (KeyError, OSError, ValueError, IndexError, struct.error, RuntimeError,
            ElementTree.ParseError):  # Of readers that meet another format.
        return None
    good = points.shape[1:] == (3,) and len(points) > 0 and bool(np.all(np.isfinite(points)))
    return (points, triangles) if good else None


def bounding_box(path: Path) -> np.ndarray | None:
    """Returns the smallest and the largest corner (2, 3) of a mesh; None if unread."""
    mesh = read_mesh(path)
    return None if mesh is None else np.array([mesh[0].min(axis=0), mesh[0].max(axis=0)])


def mesh_triangles(path: Path) -> np.ndarray | None:
    """Returns the triangles (k, 3, 3) of a mesh; None if it is unread or has none."""
    mesh = read_mesh(path)
    return mesh[1] if mesh is not None and len(mesh[1]) else None


def up_axis(path: Path) -> str:
    """Returns the axis of a COLLADA file that points up: Y_UP if it does not say."""
    found = re.search(r"<up_axis>\s*(\w+)", path.read_text(encoding="utf-8", errors="replace"))
    return found[1] if found else "Y_UP"


def _stl(path: Path) -> Surface:
    data = path.read_bytes()
    count = struct.unpack_from("<I", data, 80)[0] if len(data) >= 84 else -1
    if len(data) == 84 + 50 * count:
        facets = np.frombuffer(data, offset=84, dtype=[
            ("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
        points = facets["corners"].reshape(-1, 3).astype(float)
    else:
        text = data.decode("ascii", "replace")
        points = np.array(re.findall(r"vertex\s+(\S+)\s+(\S+)\s+(\S+)", text), dtype=float)
    return points, points.reshape(-1, 3, 3)


def _obj(path: Path) -> Surface:
    mesh = ReadObjToTriangleSurfaceMesh(str(path))
    points = np.array(mesh.vertices())
    return points, points[[[item.vertex(i) for i in range(3)] for item in mesh.triangles()]]


def _gltf(path: Path) -> Surface:
    hull = Mesh(str(path)).GetConvexHull()
    points = np.array([hull.vertex(i) for i in range(hull.num_vertices())])
    faces = [hull.element(i) for i in range(hull.num_elements())]
    return points, points[_fans(np.array([face.vertex(i) for i in range(face.num_vertices())])
                                for face in faces)]


def _fans(polygons: Iterable[np.ndarray]) -> np.ndarray:
    """Returns triangles (k, 3) of convex polygons, as fans about their first corners."""
    return np.array([(loop[0], *pair) for loop in polygons for pair in pairwise(loop[1:])],
                    dtype=int).reshape(-1, 3)


def _dae(path: Path) -> Surface:
    """Returns the geometries of a scene, or without one all that are there, as they are."""
    root = ElementTree.parse(path).getroot()
    for item in root.iter():
        item.tag = item.tag.rpartition("}")[2]
    known = {f"#{item.get('id')}": item for item in root.iter()}
    unit, scene = root.find("asset/unit"), root.find("scene/instance_visual_scene")
    X = np.diag([*np.full(3, float("1" if unit is None else unit.get("meter", "1"))), 1.0])
    X[:3, :3] = UP[up_axis(path)] @ X[:3, :3]
    placed = ((item, X) for item in root.iter("geometry")) if scene is None else _geometries(
        known[scene.get("url", "")], X, known)
    parts = [(_geometry(item, known), X) for item, X in placed]
    points, triangles = (np.concatenate([each[i] @ X[:3, :3].T + X[:3, 3] for each, X in parts])
                         for i in range(2))
    return points, triangles


def _geometries(node: Element, X: np.ndarray, known: dict[str, Element]
                ) -> Iterator[tuple[Element, np.ndarray]]:
    """Yields the geometries below a COLLADA node, each with its pose and scale (4, 4)."""
    for item in node:
        if item.tag in ("matrix", "translate", "rotate", "scale"):
            X = X @ _transform(item)
        elif item.tag in ("node", "instance_node"):
            below = item if item.tag == "node" else known[item.get("url", "")]
            yield from _geometries(below, X, known)
        elif item.tag == "instance_geometry":
            yield known[item.get("url", "")], X
        elif item.tag in ("skew", "lookat", "instance_controller"):
            raise ValueError(f"<{item.tag}> is not read")


def _transform(item: Element) -> np.ndarray:
    """Returns an element of a COLLADA node as a matrix (4, 4)."""
    values, X = _numbers(item), np.eye(4)
    if item.tag == "matrix":
        return values.reshape(4, 4)
    if item.tag == "translate":
        X[:3, 3] = values
    elif item.tag == "scale":
        X[:3, :3] = np.diag(values)
    else:
        axis = values[:3] / np.linalg.norm(values[:3])
        X[:3, :3] = RotationMatrix(AngleAxis(np.deg2rad(values[3]), axis)).matrix()
    return X


def _geometry(geometry: Element, known: dict[str, Element]) -> Surface:
    """Returns the surface of a COLLADA geometry in its own axes."""
    mesh = _child(geometry, "mesh")
    source = known[_child(mesh, "vertices/input[@semantic='POSITION']").get("source", "")]
    accessor = source.find("technique_common/accessor")
    stride = 3 if accessor is None else int(accessor.get("stride", "1"))
    points = _numbers(_child(source, "float_array")).reshape(-1, stride)[:, :3]
    faces = [np.zeros((0, 3), dtype=int)]
    for kind in (item for item in mesh if item.tag in ("triangles", "polylist", "polygons")):
        first = int(_child(kind, "input[@semantic='VERTEX']").get("offset", "0"))
        width = 1 + max(int(item.get("offset", "0")) for item in kind.findall("input"))
        loops = [_numbers(p).astype(int)[first::width] for p in kind.findall("p")]
        if kind.tag == "polylist":
            ends = np.cumsum(_numbers(_child(kind, "vcount")).astype(int))
            loops = np.split(loops[0], ends[:-1])
        faces += [loop.reshape(-1, 3) for loop in loops] if kind.tag == "triangles" else [
            _fans(loops)]
    return points, points[np.concatenate(faces)]


def _child(item: Element, path: str) -> Element:
    if (found := item.find(path)) is None:
        raise ValueError(f"no {path}")
    return found


def _numbers(item: Element) -> np.ndarray:
    return np.array((item.text or "").split(), dtype=float)


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
