"""Shapes of links: the boxes around them, their volumes, and those that can be drawn."""

import re
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from pydrake.math import RigidTransform

from uvms_drake.model.description.visuals import (
    bounding_box,
    format_obj,
    mesh_volume,
    reason_not_drawn,
    stl_triangles,
)
from uvms_drake.model.robot_import.bodies import Body
from uvms_drake.model.robot_import.tree import Notes, Shape, listed

CORNERS = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
REFERENCES = re.compile(r'^(?:mtllib|map_\w+)\s+(.+?)\s*$|"uri"\s*:\s*"(?!data:)([^"]+)"', re.M)
"""Files that an OBJ, its materials or a glTF refer to, in their own folder."""


def edges(shape: Shape) -> np.ndarray:
    """Returns the edges (3,) [m] of the box around a shape that is no mesh."""
    size = shape.size
    if shape.kind == "box":
        return size
    if shape.kind in ("sphere", "ellipsoid"):
        return 2.0 * np.broadcast_to(size, 3)
    ends = 2.0 * size[0] if shape.kind == "capsule" else 0.0
    return np.array([2.0 * size[0], 2.0 * size[0], size[1] + ends])


def volume_of(shape: Shape) -> float:
    """Returns the volume of a shape [m³]; of a mesh, if it is an STL that is there."""
    size = shape.size
    if shape.kind == "mesh":
        if shape.file is None or shape.file.suffix.lower() != ".stl":
            return 0.0
        return mesh_volume(stl_triangles(shape.file) * shape.size)
    if shape.kind == "box":
        return float(np.prod(size))
    if shape.kind in ("sphere", "ellipsoid"):
        return float(4.0 / 3.0 * np.pi * np.prod(np.broadcast_to(size, 3)))
    ball = 4.0 / 3.0 * np.pi * size[0] ** 3 if shape.kind == "capsule" else 0.0
    return float(np.pi * size[0] ** 2 * size[1] + ball)


def corners_of(shape: Shape) -> np.ndarray | None:
    """Returns points (k, 3) around a shape, in the frame in which it stands; None if unknown."""
    if shape.kind == "mesh":
        box = None if shape.file is None else bounding_box(shape.file)
        if box is None:
            return None
        points = (box.mean(axis=0) + CORNERS * np.ptp(box, axis=0)) * shape.size
    else:
        points = CORNERS * edges(shape)
    return (shape.X @ points.T).T


def box_of(body: Body) -> tuple[np.ndarray, np.ndarray] | None:
    """Returns the least and the largest corner (3,) [m] of a body's shapes; None without any."""
    found = [points for shape in (*body.collisions, *body.visuals)
             if (points := corners_of(shape)) is not None]
    if not found:
        return None
    points = np.concatenate(found)
    return points.min(axis=0), points.max(axis=0)


@dataclass
class Drawn:
    """The shapes of all bodies that are drawn, and the files of their meshes."""

    shapes: list[list[Shape]] = field(default_factory=list)
    files: dict[str, bytes] = field(default_factory=dict)
    """By path in the robot's folder."""
    folders: dict[Path, str] = field(default_factory=dict)
    """Folders of meshes in the robot's, by where they were found."""


def drawn(bodies: list[Body], robot: str, notes: Notes) -> Drawn:
    """Returns the shapes of the bodies that are drawn, and notes the treatment of meshes."""
    out = Drawn()
    fates: dict[str, list[str]] = {}
    for body in bodies:
        shapes = [shape if shape.kind != "mesh" else _mesh(shape, robot, out, fates)
                  for shape in body.visuals]
        out.shapes.append([shape for shape in shapes if shape is not None])
    for fate, names in fates.items():
        (notes.taken if fate == "kept" else notes.changed).append(
            f"meshes {fate}: {listed(sorted(set(names)))}")
    count = sum(len(body.collisions) for body in bodies)
    if count:
        notes.changed.append(f"collision shapes left out, for nothing here collides: {count}")
    return out


def _mesh(shape: Shape, robot: str, out: Drawn, fates: dict[str, list[str]]) -> Shape | None:
    """Returns a mesh as it is drawn; None if nothing is known of it."""
    name = shape.uri.rsplit("/", 1)[-1]
    file = shape.file
    target = "" if file is None else f"{_folder(file, out)}/{name}"
    if file is not None and reason_not_drawn(file) is None:
        for path in (file, *_references(file)):
            out.files[f"{_folder(file, out)}/{path.relative_to(file.parent)}"] = path.read_bytes()
        fates.setdefault("kept", []).append(name)
    elif file is not None and file.suffix.lower() == ".stl" and (text := _as_obj(file)):
        target += ".obj"
        out.files[target] = text.encode()
        fates.setdefault("converted from STL to OBJ", []).append(name)
    else:
        box = None if file is None else bounding_box(file)
        fate = "left out, for they are not there or cannot be read" if box is None else \
            "that Drake does not draw, replaced by the boxes around them"
        fates.setdefault(fate, []).append(name)
        if box is None:
            return None
        low, high = np.sort(box * shape.size, axis=0)
        X = shape.X @ RigidTransform(0.5 * (low + high))
        return Shape("box", np.maximum(high - low, 1e-3), X, color=shape.color)
    return replace(shape, uri=f"package://{robot}/{target}")


def _folder(file: Path, out: Drawn) -> str:
    """Returns the folder of a mesh in the robot's: one for each in which meshes were found."""
    number = len(out.folders) + 1
    return out.folders.setdefault(file.parent, "meshes" if number == 1 else f"meshes_{number}")


def _as_obj(file: Path) -> str:
    try:
        return format_obj(stl_triangles(file))
    except ValueError:
        return ""


def _references(file: Path) -> list[Path]:
    """Returns the files below a mesh's folder that it needs: materials, buffers, pictures."""
    found: list[Path] = []
    waiting = [file]
    while waiting:
        text = waiting.pop().read_text(encoding="utf-8", errors="replace")
        for names in REFERENCES.findall(text):
            path = file.parent / (names[0] or names[1])
            inside = path.resolve().is_relative_to(file.parent.resolve())
            if path.is_file() and inside and path not in found:
                found.append(path)
                waiting += [path] if path.suffix == ".mtl" else []
    return found
