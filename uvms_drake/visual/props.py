"""Drawings beside the robot: arrows, numbers, paths, the wall, the tube, bars for limits.

The plan and the task are white, the real motion is coloured; they differ in lightness too.
Each of these objects has a path of its own on the stage, and the frame of the path above it.
"""

import math
from collections.abc import Sequence

import numpy as np
from pydrake.geometry import Box, Cylinder, MeshcatCone, Rgba, Sphere
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from uvms_drake.visual.stage import Stage, frame_at
from uvms_drake.visual.textured import label, textured_mesh

REAL = Rgba(0.84, 0.25, 0.0, 1.0)
PLAN = Rgba(1.0, 1.0, 1.0, 1.0)
GLASS = Rgba(1.0, 1.0, 1.0, 0.3)
ALARM = Rgba(0.9, 0.05, 0.1, 1.0)
FLIPPED = RigidTransform(RollPitchYaw(np.pi, 0.0, 0.0), np.zeros(3))


class Arrow:
    """An arrow from a point, as long as its vector."""

    HEAD = 0.08  # m

    def __init__(self, stage: Stage, path: str, radius: float, color: Rgba):
        self._stage, self._path = stage, path
        stage.make(f"{path}/shaft/body", Cylinder(radius, 1.0), color, frame_at([0.0, 0.0, 0.5]))
        stage.make(f"{path}/head/size/body", MeshcatCone(self.HEAD, 2.2 * radius, 2.2 * radius),
                   color, FLIPPED)

    def show(self, tail: np.ndarray, vector: np.ndarray) -> None:
        """Draws the arrow from `tail` (3,) along `vector` (3,) [m]; none, if it has no length."""
        length = float(np.linalg.norm(vector))
        if length > 1e-6:
            self._stage.move(self._path, frame_at(tail, vector))
        head = min(length, self.HEAD)
        size = head / self.HEAD
        self._stage.stretch(f"{self._path}/shaft", size, size, length - head)
        self._stage.move(f"{self._path}/head", frame_at([0.0, 0.0, length]))
        self._stage.stretch(f"{self._path}/head/size", size, size, size)


class Number:
    """A whole number with a unit: every one of them is made, and one is shown."""

    def __init__(self, stage: Stage, path: str, largest: int, text: str, height: float,
                 facing: RotationMatrix):
        self._stage, self._path, self._largest = stage, path, largest
        for i in range(largest + 1):
            stage.make(f"{path}/{i}/text", label(text.format(i), height, bold=True), None,
                       RigidTransform(facing, np.zeros(3)))

    def show(self, place: np.ndarray, value: float) -> None:
        """Shows the number nearest to `value` at `place` (3,)."""
        nearest = min(max(round(value), 0), self._largest)
        self._stage.move(self._path, frame_at(place))
        for i in range(self._largest + 1):
            self._stage.show(f"{self._path}/{i}", i == nearest)


class Polyline:
    """A line through points, with a tube about it to scale."""

    def __init__(self, stage: Stage, path: str, points: int, color: Rgba, radius: float,
                 tube: float = 0.0):
        self._stage = stage
        self._rods = [f"{path}/{i}" for i in range(points - 1)]
        middle = frame_at([0.0, 0.0, 0.5])
        for rod in self._rods:
            stage.make(f"{rod}/size/line", Cylinder(radius, 1.0), color, middle)
            if tube > radius:
                stage.make(f"{rod}/size/tube", Cylinder(tube, 1.0), GLASS, middle)

    def show(self, points: np.ndarray) -> None:
        """Draws the line through `points` (K, 3)."""
        for rod, start, end in zip(self._rods, points[:-1], points[1:], strict=True):
            length = float(np.linalg.norm(end - start))
            if length > 1e-4:
                self._stage.move(rod, frame_at(start, end - start))
            self._stage.stretch(f"{rod}/size", 1.0, 1.0, length)


class Trail:
    """The way a point has gone: a dot wherever it was a step further; the oldest ones are reused.

    Args:
        stage: Where to draw.
        path: Path of the trail on the stage.
        color: Colour of the dots.
        radius: Radius of the dots [m].
    """

    DOTS = 200

    def __init__(self, stage: Stage, path: str, color: Rgba, radius: float):
        self._stage, self._step = stage, 3.0 * radius
        self._paths = [f"{path}/{i}" for i in range(self.DOTS)]
        for dot in self._paths:
            stage.make(f"{dot}/size/dot", Sphere(radius), color)
            # To be seen through the arm, which follows its tip.
            for name, value in (("material.depthTest", False), ("renderOrder", 1.0)):
                stage.meshcat.SetProperty(f"{dot}/size/dot/<object>", name, value)
        self._last: np.ndarray | None = None
        self._count = 0

    def clear(self) -> None:
        """Takes all dots away."""
        self._last, self._count = None, 0
        for dot in self._paths:
            self._stage.show(f"{dot}/size", False)

    def show(self, point: np.ndarray) -> None:
        """Goes on to `point` (3,)."""
        if self._last is not None and np.linalg.norm(point - self._last) < self._step:
            return
        dot = self._paths[self._count % self.DOTS]
        self._stage.move(dot, frame_at(point))
        self._stage.show(f"{dot}/size", True)
        self._last, self._count = point, self._count + 1


class DrawnWall:
    """A part of a plane with a grid on it; the dent is as deep as the end-effector is inside.

    Args:
        stage: Where to draw.
        path: Path of the wall on the stage.
        point: Point of the plane, in the middle of the dent (3,) [m].
        normal: Normal of the plane, towards the robot (3,).
    """

    SIZE = 1.0  # m
    DENT = 0.05  # m, where it is 0.6 of its depth
    MESH = 64

    def __init__(self, stage: Stage, path: str, point: np.ndarray, normal: np.ndarray):
        self._stage, self._path = stage, path
        line = np.linspace(-0.5, 0.5, self.MESH + 1)
        u, v = (axis.ravel() for axis in np.meshgrid(line, line))
        # Finer in the middle, where the dent is.
        x, y = (self.SIZE * (0.35 * s + 2.6 * s**3) for s in (u, v))
        depth = np.exp(-0.5 * (x**2 + y**2) / self.DENT**2)
        slope = depth / self.DENT**2
        normals = np.column_stack([-slope * x, -slope * y, np.ones_like(x)])
        corner = (np.arange(self.MESH)[:, None] * (self.MESH + 1) + np.arange(self.MESH)).ravel()
        below = corner + self.MESH + 1
        faces = np.concatenate([np.column_stack([corner, corner + 1, below]),
                                np.column_stack([corner + 1, below + 1, below])])
        mesh = textured_mesh(np.column_stack([x, y, -depth]),
                             np.column_stack([x, y]) / self.SIZE + 0.5, faces, self._grid(),
                             normals=normals / np.linalg.norm(normals, axis=1)[:, None])
        stage.make(f"{path}/depth/skin", mesh)
        stage.meshcat.SetTransform(path, frame_at(point, normal))

    @staticmethod
    def _grid() -> np.ndarray:
        """Returns the picture of the wall: lines every 10 cm, circles every 3 cm in the middle."""
        at = np.arange(1000.0)  # Pixels are millimetres.
        line = (np.abs((at + 50.0) % 100.0 - 50.0) < 3.0) | (np.abs(at - 499.5) > 492.0)
        radius = np.hypot(at - 499.5, at[:, None] - 499.5)
        circle = (np.abs((radius + 15.0) % 30.0 - 15.0) < 4.0) & (np.abs(radius - 75.0) < 60.0)
        dark = line | line[:, None] | circle
        return np.where(dark[..., None], [40, 54, 66, 230], [186, 196, 204, 95]).astype(np.uint8)

    def show(self, penetration: float) -> None:
        """Makes the dent `penetration` [m] deep."""
        self._stage.stretch(f"{self._path}/depth", 1.0, 1.0, max(penetration, 1e-4))


class DrawnTube:
    """The tube at the tip to scale, and enlarged in an inset with the real tip in it.

    Args:
        stage: Where to draw.
        path: Path of the tube on the stage, in Σ_I.
        inset: Path of the inset, in Meshcat's own axes.
        radius: Radius of the tube in position [m].
        magnification: Magnification of the inset.
        text: Caption of the inset.
        height: Height of a line of the text [m].
        facing: Attitude of the text.
    """

    def __init__(self, stage: Stage, path: str, inset: str, radius: float, magnification: float,
                 text: str, height: float, facing: RotationMatrix):
        self._stage, self._path, self._inset = stage, path, inset
        self._magnification = magnification
        stage.make(f"{path}/scale", Sphere(radius), GLASS)
        large = radius * magnification
        stage.make(f"{inset}/tube", Sphere(large), Rgba(1.0, 1.0, 1.0, 0.22))
        stage.make(f"{inset}/nominal", Sphere(0.16 * height), PLAN)
        stage.make(f"{inset}/real/dot", Sphere(0.22 * height), REAL)
        above = large + height * (1 + text.count("\n"))
        stage.make(f"{inset}/text", label(text, height), None,
                   RigidTransform(facing, [0.0, 0.0, above]))

    def show(self, tip: np.ndarray, nominal_tip: np.ndarray) -> None:
        """Draws the tube about the nominal tip (3,) and the real one (3,) in it, both in Σ_I."""
        self._stage.move(self._path, frame_at(nominal_tip))
        deviation = self._magnification * (tip - nominal_tip) * [1.0, -1.0, -1.0]
        self._stage.move(f"{self._inset}/real", frame_at(deviation))


class Bars:
    """A row of bars, one for each limit: as high as it is used, and a red one in front if active.

    Args:
        stage: Where to draw.
        path: Path of the row on the stage; it is in the xz-plane, seen from −y, centred above it.
        names: Names of the limits.
    """

    WIDTH = 1.45  # of the row
    HEIGHT = 0.16  # of a limit that is used up

    def __init__(self, stage: Stage, path: str, names: Sequence[str]):
        self._stage = stage
        pitch = self.WIDTH / len(names)
        self._bars = [f"{path}/{i}" for i in range(len(names))]
        thick, half = 0.55 * pitch, 0.5 * self.HEIGHT
        for i, (bar, name) in enumerate(zip(self._bars, names, strict=True)):
            left = (i - 0.5 * (len(names) - 1)) * pitch
            stage.meshcat.SetTransform(bar, frame_at([left, 0.0, 0.0]))
            stage.make(f"{bar}/frame", Box(thick, 0.004, self.HEIGHT), Rgba(0.02, 0.1, 0.16, 0.55),
                       frame_at([0.0, 0.02, half]))
            stage.make(f"{bar}/mark", Box(1.3 * thick, 0.012, 0.006), PLAN,
                       frame_at([0.0, 0.0, self.HEIGHT]))
            stage.make(f"{bar}/used/bar", Box(0.8 * thick, 0.008, 1.0), Rgba(0.75, 0.86, 0.93),
                       frame_at([0.0, 0.0, 0.5]))
            stage.make(f"{bar}/active/bar", Box(1.35 * thick, 0.03, self.HEIGHT), ALARM,
                       frame_at([0.0, 0.0, half]))
            stage.make(f"{bar}/name", label(name, 0.05), None, frame_at([0.0, 0.0, -0.045]))

    def show(self, used: np.ndarray, active: np.ndarray) -> None:
        """Draws the parts `used` (L,) of the limits, and which of them are `active` (L,)."""
        for bar, part, alarm in zip(self._bars, used, active, strict=True):
            self._stage.stretch(f"{bar}/used", 1.0, 1.0, self.HEIGHT * min(float(part), 1.05))
            self._stage.show(f"{bar}/active", bool(alarm))


def round_magnification(radius: float, wanted: float) -> float:
    """Returns 1, 2, 5, 10, 20, ... such that `radius` times it is at most about `wanted`."""
    if radius <= 0.0 or radius >= wanted:
        return 1.0
    exponent = math.floor(math.log10(wanted / radius))
    return max(step * 10.0**exponent for step in (1.0, 2.0, 5.0)
               if step * 10.0**exponent <= 1.25 * wanted / radius)
