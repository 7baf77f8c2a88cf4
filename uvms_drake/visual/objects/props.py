"""Arrows, paths, trails and marks.

The plan and the task are white, the real motion is coloured; they differ in lightness too.
Each of these objects has a path of its own on the stage, and the frame of the path above it.
"""

import numpy as np
from pydrake.geometry import Cylinder, MeshcatCone, Rgba, Sphere
from pydrake.math import RigidTransform, RollPitchYaw

from uvms_drake.visual.stage import Stage, frame_at

REAL = Rgba(0.84, 0.25, 0.0, 1.0)
PLAN = Rgba(1.0, 1.0, 1.0, 1.0)
GLASS = Rgba(1.0, 1.0, 1.0, 0.3)
FAINT = Rgba(1.0, 1.0, 1.0, 0.06)
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
        """Draws the arrow from `tail` (3,) along `vector` (3,) [m]; none for a zero vector."""
        length = float(np.linalg.norm(vector))
        if length > 1e-6:
            self._stage.move(self._path, frame_at(tail, vector))
        head = min(length, self.HEAD)
        size = head / self.HEAD
        self._stage.stretch(f"{self._path}/shaft", size, size, length - head)
        self._stage.move(f"{self._path}/head", frame_at([0.0, 0.0, length]))
        self._stage.stretch(f"{self._path}/head/size", size, size, size)


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
                stage.make(f"{rod}/size/tube", Cylinder(tube, 1.0), FAINT, middle)

    def show(self, points: np.ndarray) -> None:
        """Draws the line through `points` (K, 3)."""
        for rod, start, end in zip(self._rods, points[:-1], points[1:], strict=True):
            length = float(np.linalg.norm(end - start))
            if length > 1e-4:
                self._stage.move(rod, frame_at(start, end - start))
            self._stage.stretch(f"{rod}/size", 1.0, 1.0, length)


class Trail:
    """Path of a point: a dot after each step of fixed length; the oldest dots are reused.

    Args:
        stage: Stage to draw on.
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
            stage.see_through(f"{dot}/size/dot")
        self._last: np.ndarray | None = None
        self._count = 0

    def clear(self) -> None:
        """Removes all dots."""
        self._last, self._count = None, 0
        for dot in self._paths:
            self._stage.show(f"{dot}/size", False)

    def show(self, point: np.ndarray) -> None:
        """Extends the trail to `point` (3,)."""
        if self._last is not None and np.linalg.norm(point - self._last) < self._step:
            return
        dot = self._paths[self._count % self.DOTS]
        self._stage.move(dot, frame_at(point))
        self._stage.show(f"{dot}/size", True)
        self._last, self._count = point, self._count + 1


class Mark:
    """A dot that is drawn over everything, or hidden."""

    def __init__(self, stage: Stage, path: str, color: Rgba, radius: float):
        self._stage, self._path = stage, path
        stage.make(f"{path}/size/dot", Sphere(radius), color)
        stage.see_through(f"{path}/size/dot", 2.0)

    def show(self, place: np.ndarray | None) -> None:
        """Shows the dot at `place` (3,), or hides it."""
        if place is not None:
            self._stage.move(self._path, frame_at(place))
        self._stage.show(f"{self._path}/size", place is not None)
