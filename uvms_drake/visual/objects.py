"""Objects of a scene: robot, arrows, lines, trails, marks, tube, level grid.

The plan and the task are white, the real motion is coloured; they differ in lightness too. Each
object has a path of its own on the stage, and is in the frame of the path above it.
"""

import math

import numpy as np
from pydrake.geometry import Cylinder, MeshcatCone, Rgba, Role, Sphere
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.multibody.tree import RigidBody
from pydrake.systems.framework import DiagramBuilder

from uvms_drake.model.coordinates import Coordinates
from uvms_drake.model.uvms import add_uvms
from uvms_drake.visual.pictures import SQUARE, label, picture
from uvms_drake.visual.stage import NED, UP, Stage, frame_at

REAL = Rgba(0.84, 0.25, 0.0, 1.0)
PLAN = Rgba(1.0, 1.0, 1.0, 1.0)
GLASS = Rgba(1.0, 1.0, 1.0, 0.3)
GREY = Rgba(0.7, 0.7, 0.7, 1.0)
TUBE = Rgba(1.0, 1.0, 1.0, 0.2)
FAR_SIDE = 1.0
"""BackSide of three.js."""
CELL = 0.5
"""Side of a square of the level grid [m]."""


class DrawnRobot:
    """The geometry of a robot's file.

    Args:
        stage: Stage to draw on.
        name: Name of the robot on the stage.
        model: A shipped robot or a robot's folder.
        color: Colour of all of it; None: that of its file. A robot in a colour of its own shows
            its far faces only: where it coincides with another one they are behind that one's
            near faces, so that the two do not flicker; the rest of it is an outline.
    """

    def __init__(self, stage: Stage, name: str, model: str, color: Rgba | None = None):
        self._stage = stage
        plant, scene_graph = AddMultibodyPlantSceneGraph(DiagramBuilder(), time_step=0.0)
        uvms = add_uvms(plant, model)
        plant.Finalize()
        self._plant, self._coordinates = plant, Coordinates(uvms)
        self._context = plant.CreateDefaultContext()
        self._bodies: dict[str, RigidBody] = {}
        inspector = scene_graph.model_inspector()
        for index in plant.GetBodyIndices(uvms.model_instance):
            body = plant.get_body(index)
            path = f"{NED}/{name}/{body.name()}"
            for shape in inspector.GetGeometries(
                    plant.GetBodyFrameIdOrThrow(index), Role.kIllustration):
                self._bodies[path] = body
                own = inspector.GetIllustrationProperties(shape).GetPropertyOrDefault(
                    "phong", "diffuse", GREY)
                part = f"{path}/{shape.get_value()}"
                stage.make(part, inspector.GetShape(shape), color or own,
                           inspector.GetPoseInFrame(shape))
                if color is not None:
                    for key, value in (("side", FAR_SIDE), ("depthWrite", False)):
                        stage.meshcat.SetProperty(f"{part}/<object>", f"material.{key}", value)

    def show(self, config: np.ndarray) -> None:
        """Draws the robot at 𝔮 (6+n,)."""
        state = self._coordinates.to_drake(np.concatenate([config, np.zeros_like(config)]))
        self._plant.SetPositions(self._context, state[: self._plant.num_positions()])
        for path, body in self._bodies.items():
            self._stage.move(path, body.EvalPoseInWorld(self._context))


class Arrow:
    """An arrow from a point, as long as its vector."""

    HEAD = 0.08  # m

    def __init__(self, stage: Stage, path: str, radius: float, color: Rgba):
        self._stage, self._path = stage, path
        stage.make(f"{path}/shaft/body", Cylinder(radius, 1.0), color, frame_at([0.0, 0.0, 0.5]))
        stage.make(f"{path}/head/size/body", MeshcatCone(self.HEAD, 2.2 * radius, 2.2 * radius),
                   color, RigidTransform(RollPitchYaw(np.pi, 0.0, 0.0), np.zeros(3)))

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
    """A line through points."""

    def __init__(self, stage: Stage, path: str, points: int, color: Rgba, radius: float):
        self._stage = stage
        self._rods = [f"{path}/{i}" for i in range(points - 1)]
        for rod in self._rods:
            stage.make(f"{rod}/size/line", Cylinder(radius, 1.0), color, frame_at([0.0, 0.0, 0.5]))

    def show(self, points: np.ndarray) -> None:
        """Draws the line through `points` (K, 3)."""
        for rod, start, end in zip(self._rods, points[:-1], points[1:], strict=True):
            length = float(np.linalg.norm(end - start))
            if length > 1e-4:
                self._stage.move(rod, frame_at(start, end - start))
            self._stage.stretch(f"{rod}/size", 1.0, 1.0, length)


class Mark:
    """A dot that is drawn over everything, or hidden."""

    def __init__(self, stage: Stage, path: str, color: Rgba, radius: float, order: float = 2.0):
        self._stage, self._path = stage, path
        stage.make(f"{path}/size/dot", Sphere(radius), color)
        stage.see_through(f"{path}/size/dot", order)

    def show(self, place: np.ndarray | None) -> None:
        """Shows the dot at `place` (3,), or hides it."""
        if place is not None:
            self._stage.move(self._path, frame_at(place))
        self._stage.show(f"{self._path}/size", place is not None)


class Trail:
    """Path of a point: a dot after each step of fixed length; the oldest dots are reused."""

    DOTS = 200

    def __init__(self, stage: Stage, path: str, color: Rgba, radius: float):
        self._step = 3.0 * radius
        self._dots = [Mark(stage, f"{path}/{i}", color, radius, 1.0) for i in range(self.DOTS)]
        self._last: np.ndarray | None = None
        self._count = 0

    def clear(self) -> None:
        """Removes all dots."""
        self._last, self._count = None, 0
        for dot in self._dots:
            dot.show(None)

    def show(self, point: np.ndarray) -> None:
        """Extends the trail to `point` (3,)."""
        if self._last is None or np.linalg.norm(point - self._last) >= self._step:
            self._dots[self._count % self.DOTS].show(point)
            self._last, self._count = point, self._count + 1


class DrawnTube:
    """The tube at the tip to scale, and enlarged in an inset with the real tip in it.

    Args:
        stage: Stage to draw on.
        path: Path of the tube on the stage, in Σ_I.
        inset: Path of the inset, in Meshcat's own axes; its text is at the origin, all else below.
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
        stage.make(f"{path}/scale", Sphere(radius), TUBE)
        large = radius * magnification
        self._middle = np.array([0.0, 0.0, -large - height * (1 + text.count("\n"))])
        stage.make(f"{inset}/tube", Sphere(large), TUBE, frame_at(self._middle))
        stage.make(f"{inset}/nominal", Sphere(0.16 * height), PLAN, frame_at(self._middle))
        stage.make(f"{inset}/real/dot", Sphere(0.22 * height), REAL)
        stage.make(f"{inset}/text", label(text, height), None, RigidTransform(facing, np.zeros(3)))

    def show(self, tip: np.ndarray, nominal_tip: np.ndarray) -> None:
        """Draws the tube about the nominal tip (3,) and the real one (3,) in it, both in Σ_I."""
        self._stage.move(self._path, frame_at(nominal_tip))
        deviation = self._magnification * (tip - nominal_tip) * UP
        self._stage.move(f"{self._inset}/real", frame_at(self._middle + deviation))


def round_magnification(radius: float, wanted: float) -> float:
    """Returns 1, 2, 5, 10, 20, ... such that `radius` times it is at most about `wanted`."""
    if radius <= 0.0 or radius >= wanted:
        return 1.0
    exponent = math.floor(math.log10(wanted / radius))
    return max(step * 10.0**exponent for step in (1.0, 2.0, 5.0)
               if step * 10.0**exponent <= 1.25 * wanted / radius)


def draw_floor(stage: Stage, path: str, middle: np.ndarray, cells: int) -> None:
    """Draws a level grid that fades out, with so many `CELL` from its middle (3,) to an end."""
    pixels = 48  # of a square
    at = np.arange(2 * cells * pixels) + 0.5
    line = np.abs((at + 0.5 * pixels) % pixels - 0.5 * pixels) < 1.0
    far = np.abs(at / (cells * pixels) - 1.0)
    image = np.where((line | line[:, None])[..., None], [214, 226, 232, 190], [150, 158, 140, 70])
    image[..., 3] = image[..., 3] * np.clip(1.2 - 1.2 * np.hypot(far, far[:, None]), 0.0, 1.0)
    stage.make(path, picture(2.0 * cells * CELL * SQUARE, image.astype(np.uint8)), None,
               frame_at(middle))
