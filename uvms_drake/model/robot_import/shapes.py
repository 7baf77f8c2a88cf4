"""Shapes of links: their triangles, their volumes, and those that can be drawn."""

import re
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from pydrake.geometry import Box, CalcVolume, Capsule, Cylinder, Ellipsoid, Sphere
from pydrake.math import RigidTransform

from uvms_drake.model.description import meshes
from uvms_drake.model.description.hydrodynamics_file import FARTHEST
from uvms_drake.model.description.visuals import reason_not_drawn
from uvms_drake.model.robot_import.bodies import Body
from uvms_drake.model.robot_import.tree import Notes, Shape, listed

SOLIDS = {"box": Box, "cylinder": Cylinder, "sphere": Sphere, "capsule": Capsule,
          "ellipsoid": Ellipsoid}
LATITUDES = np.pi * np.linspace(0.0, 1.0, 17)
"""Rings of a sphere, from its lower end [rad]."""
REFERENCES = re.compile(r'^(?:mtllib|map_\w+)\s+(.+?)\s*$|"uri"\s*:\s*"(?!data:)([^"]+)"', re.M)
"""Files that an OBJ, its materials or a glTF refer to, in their own folder."""


def triangles_of(shape: Shape) -> np.ndarray | None:
    """Returns triangles (k, 3, 3) of a shape in the frame in which it stands; None if unknown."""
    size, radius, height, sides = shape.size, np.sin(LATITUDES), -np.cos(LATITUDES), 40
    if shape.kind == "mesh":
        triangles = None if shape.file is None else meshes.mesh_triangles(shape.file)
    else:
        # Rings of a lathe, each joined to the next one; a box is a cylinder of four sides.
        if shape.kind in ("box", "cylinder"):
            radius, height = np.array([0.0, 1.0, 1.0, 0.0]), np.array([-0.5, -0.5, 0.5, 0.5])
        if shape.kind == "box":
            radius, sides = np.sqrt(0.5) * radius, 4
        elif shape.kind == "cylinder":
            size = size[[0, 0, 1]]
        elif shape.kind == "capsule":
            size, height = size[[0, 0, 0]], height + 0.5 * np.sign(height) * size[1] / size[0]
        ring = np.exp(2j * np.pi * (np.arange(sides) / sides + 0.125))
        a = np.stack(np.broadcast_arrays(np.outer(radius, ring.real), np.outer(radius, ring.imag),
                                         height[:, None]), axis=2)
        c = np.roll(a, -1, axis=1)
        triangles = np.stack([a[:-1], c[:-1], a[1:], a[1:], c[:-1], c[1:]], axis=2)
        triangles = triangles.reshape(-1, 3, 3)
    return None if triangles is None else (
        triangles * size @ shape.X.rotation().matrix().T + shape.X.translation())


def volume_of(shape: Shape) -> float:
    """Returns the volume of a shape [m³]; of a mesh that cannot be read it is zero."""
    if shape.kind != "mesh":
        return CalcVolume(SOLIDS[shape.kind](*shape.size))
    triangles = triangles_of(shape)
    return 0.0 if triangles is None else meshes.mesh_volume(triangles)


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
    name, file = shape.uri.rsplit("/", 1)[-1], shape.file
    box = None if file is None else meshes.bounding_box(file)
    target = "" if file is None else f"{_folder(file, out)}/{name}"
    # Kept as it is, converted, or a box; one that is not in metres is none of these.
    if box is not None and np.max(np.linalg.norm(box * shape.size, axis=1)) > FARTHEST:
        fates.setdefault(f"left out, for they reach beyond {FARTHEST:g} m, as in millimetres",
                         []).append(name)
        return None
    if file is not None and reason_not_drawn(file) is None:
        for path in (file, *_references(file)):
            out.files[f"{_folder(file, out)}/{path.relative_to(file.parent)}"] = path.read_bytes()
        fates.setdefault("kept", []).append(name)
    elif (file is not None and file.suffix.lower() == ".stl"
          and (triangles := meshes.mesh_triangles(file)) is not None):
        target += ".obj"
        out.files[target] = meshes.format_obj(triangles).encode()
        fates.setdefault("converted from STL to OBJ", []).append(name)
    else:
        fate = "left out, for they are not there or cannot be read" if box is None else \
            "that Drake does not draw, replaced by the boxes around them"
        fates.setdefault(fate, []).append(name)
        if file is None or box is None:
            return None
        if file.suffix.lower() == ".dae" and meshes.up_axis(file) != "Z_UP":
            fates.setdefault(f"of COLLADA with {meshes.up_axis(file)}, turned to z up as it says "
                             "(RViz and Gazebo do not; with Z_UP in it they stay as there)",
                             []).append(name)
        low, high = np.sort(box * shape.size, axis=0)
        X = shape.X @ RigidTransform(0.5 * (low + high))
        return Shape("box", np.maximum(high - low, 1e-3), X, color=shape.color)
    return replace(shape, uri=f"package://{robot}/{target}")


def _folder(file: Path, out: Drawn) -> str:
    """Returns the folder of a mesh in the robot's: one for each in which meshes were found."""
    number = len(out.folders) + 1
    return out.folders.setdefault(file.parent, "meshes" if number == 1 else f"meshes_{number}")


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
