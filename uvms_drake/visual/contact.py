"""Contact in the picture: surface, forces, estimate, and the paint of the pressed places.

A recording keeps no change of colour (see `stage`), so a dot of the paint keeps its colour, and
another one takes its place where the force has changed.
"""

from collections.abc import Callable, Mapping
from functools import lru_cache

import numpy as np
from matplotlib import colormaps
from pydrake.geometry import Cylinder, Rgba, Sphere
from pydrake.math import RigidTransform, RotationMatrix

from uvms_drake.model.surface.law import Surface
from uvms_drake.visual.objects import GLASS, PLAN, REAL, Arrow, Mark, Polyline
from uvms_drake.visual.overlay import Readout
from uvms_drake.visual.pictures import SQUARE, label, picture, rectangle
from uvms_drake.visual.stage import NED, UP, Stage, frame_at

SIZE, SQUARES = 1.0, 10
"""Side of a wall [m], and the squares on it along that."""
FINE = 6
"""Points of a wall in a side of such a square."""
DENT = 0.05
"""Distance from its middle at which a dent is 0.6 of its depth [m]."""
SKIN, LINES = Rgba(0.70, 0.75, 0.79, 0.4), Rgba(0.16, 0.22, 0.27, 0.9)
SPRING, CONTACT = Rgba(0.3, 0.3, 0.3), Rgba(1.0, 0.9, 0.2)
REAL_TEXT, WHITE = (1.0, 0.62, 0.42), (1.0, 1.0, 1.0)
EXPLORED, ESTIMATED = (0.3, 1.0, 0.65), (1.0, 0.9, 0.2)
GLASS_OPACITY = 54.0
"""Opacity of the pane, of 255."""
ARROW = 0.3
"""Length of the arrow of the largest force expected, as a fraction of the scene's size."""
NUMBER_OFFSET = 0.07
"""Distance of the numbers from the end of the arrow, likewise."""
HEIGHT = 0.075
"""Height of a line of the numbers, likewise."""
LINE = 0.06
"""Height of a line of numbers on the board."""
COLORS = 10
"""Number of colours of the paint, each for forces of one range; in the first one, which may be a
bias of the sensor, nothing is painted."""
DOT = 0.006
"""Radius of a dot of the paint [m]."""
KNOWN = {"force_last_valid": 6, "safe_depth": 1, "contact_depth": 1, "stiffness_estimate": 1}
"""Signals of the estimate of a surface, and their sizes."""

Estimate = Mapping[str, np.ndarray]
"""Values of `KNOWN`, of an unknown surface; else empty."""


def draw_surface(stage: Stage, law: Surface, goal: np.ndarray) -> Callable[[np.ndarray], None]:
    """Draws a surface about a place (3,); returns the function that deforms it by a tip at χ.

    A wall has a dent as deep as the tip; other shapes keep theirs; one without a shape is a spring.
    """
    path, normal, count = f"{NED}/wall", law.normal, SQUARES * FINE + 1
    if normal is not None:
        x, y = SIZE * (np.indices((count, count)) / (count - 1) - 0.5)
        _draw_sheet(stage, f"{path}/depth", np.stack(
            [x, y, -np.exp(-0.5 * (x**2 + y**2) / DENT**2)], axis=-1))
        place = goal - ((goal - law.anchor) @ normal) * normal
        stage.meshcat.SetTransform(path, frame_at(place, normal))
        return lambda chi: stage.stretch(
            f"{path}/depth", 1.0, 1.0, max(float(law.penetration(chi)), 1e-4))
    points = law.patch(goal, SIZE, count)
    if points is not None:
        _draw_sheet(stage, path, points)
        return lambda chi: None
    stage.make(f"{NED}/rest", Sphere(0.02), PLAN, frame_at(law.anchor))
    spring = Polyline(stage, f"{NED}/spring", 2, SPRING, 0.01)
    return lambda chi: spring.show(np.array([law.anchor, chi[:3]]))


def _draw_sheet(stage: Stage, path: str, points: np.ndarray) -> None:
    """Draws a sheet through a grid of points (K, K, 3) [m], with lines along every `FINE`th."""
    stage.meshcat.PlotSurface(f"{path}/skin", *np.moveaxis(points, -1, 0), SKIN)
    lines = [*points[::FINE], *points.swapaxes(0, 1)[::FINE]]
    begin, end = (np.concatenate([line[part] for line in lines]).T
                  for part in (slice(None, -1), slice(1, None)))
    stage.meshcat.SetLineSegments(f"{path}/lines", begin, end, 1.0, LINES)


class Pressing:
    """The surface and the forces on it.

    Args:
        stage: Stage to draw on.
        law: The surface, as the controller knows it.
        goal: Desired position of the end-effector (3,) [m].
        force: 𝔉_des of the task (6,) [N, N m].
        unit: The scene's size [m].
        facing: Attitude of the numbers, in Meshcat's axes.
    """

    def __init__(self, stage: Stage, law: Surface, goal: np.ndarray, force: np.ndarray,
                 unit: float, facing: RotationMatrix):
        self._stage, self._unit, self._facing = stage, unit, facing
        largest = max(float(np.linalg.norm(force[:3])),
                      float(law.static_force(np.array([*goal, 0.0, 0.0, 0.0]))))
        self._newton = ARROW * unit / (largest or 1.0)
        self._deform = draw_surface(stage, law, goal)
        self._force = Arrow(stage, f"{NED}/force", 0.016 * unit, REAL)
        self._desired = Arrow(stage, f"{NED}/desired_force", 0.024 * unit, GLASS)
        self._contact = Mark(stage, f"{NED}/contact", CONTACT, 0.017 * unit)
        stage.meshcat.SetTransform("numbers", RigidTransform(facing, np.zeros(3)))
        self._numbers = {
            name: Readout(stage, f"numbers/{name}", f" N {name}", max(2.0 * largest, 100.0),
                          HEIGHT * unit, color)
            for name, color in (("real", REAL_TEXT), ("desired", WHITE))}

    def show(self, chi: np.ndarray, force: np.ndarray, desired: np.ndarray) -> None:
        """Draws surface and forces with the end-effector at χ.

        Args:
            chi: Pose χ of the end-effector (6,).
            force: 𝔉 (6,) [N, N m].
            desired: 𝔉_des (6,).
        """
        tip, real = chi[:3], force[:3]
        self._deform(chi)
        self._force.show(tip, self._newton * real)
        self._desired.show(tip, self._newton * desired[:3])
        self._contact.show(tip if np.any(real) else None)
        # The numbers, one above the other beyond the longer arrow.
        longest = max(real, desired[:3], key=np.linalg.norm)
        length = float(np.linalg.norm(longest)) or 1.0
        beyond = tip + (self._newton + NUMBER_OFFSET * self._unit / length) * longest
        for name, value, up in (("real", real, 0.55), ("desired", desired[:3], -0.55)):
            self._numbers[name].show(float(np.linalg.norm(value)))
            self._stage.move(f"numbers/{name}", frame_at(
                self._facing.inverse() @ (beyond * UP) + [0.0, 0.0, up * HEIGHT * self._unit]))


class DrawnEstimate:
    """Pane at the end of the safe region, frame at the estimated surface, three numbers.

    The pane is at n·𝔭 = x_safe + E, the largest depth of the real tip. Pane and frame are normal
    to n, at the tip; each is hidden as long as its depth is not finite.

    Args:
        stage: Stage to draw on.
        board: Path of the numbers on the stage, in the xz-plane, seen from −y.
        direction: Direction n into the wall (3,).
        margin: Largest distance E of the real tip beyond the planned one [m].
        start: Position of the tip at t = 0 (3,) [m], the origin of explored depths.
    """

    SAFE_END, WALL = f"{NED}/contact_estimator", f"{NED}/estimated_surface"
    """Paths of the pane and the frame, by which Meshcat's controls hide them."""
    SIDE, ROD = 0.6, 0.003  # m

    def __init__(self, stage: Stage, board: str, direction: np.ndarray, margin: float,
                 start: np.ndarray):
        self._stage, self._n, self._margin = stage, direction, margin
        self._origin = float(direction @ start)
        corners = self.SIDE * SQUARE
        glass = np.full((2, 2, 4), [*(255.0 * np.array(EXPLORED)), GLASS_OPACITY])
        stage.make(f"{self.SAFE_END}/size/pane", picture(corners, glass.astype(np.uint8)))
        for path, color in ((self.SAFE_END, EXPLORED), (self.WALL, ESTIMATED)):
            for i, end in enumerate(corners):
                along = corners[(i + 1) % 4] - end
                stage.make(f"{path}/size/{i}", Cylinder(self.ROD, self.SIDE + self.ROD),
                           Rgba(*color), frame_at(end + 0.5 * along, along))
        self._numbers = {}
        for i, (name, unit, color) in enumerate((
                ("measured", " N read", ESTIMATED), ("stiffness", " N/m", ESTIMATED),
                ("explored", " mm safe", EXPLORED))):
            stage.meshcat.SetTransform(f"{board}/{name}", frame_at([0.0, 0.0, -1.3 * LINE * i]))
            self._numbers[name] = Readout(
                stage, f"{board}/{name}/number", unit, 9999.0, LINE, color)

    def show(self, estimate: Estimate, tip: np.ndarray) -> None:
        """Draws the estimate with the tip at a place (3,) in Σ_I; unknown parts are hidden."""
        depths = {name: float(estimate[name][0]) if estimate else np.nan
                  for name in ("safe_depth", "contact_depth", "stiffness_estimate")}
        explored = depths["safe_depth"] + self._margin
        for path, depth in ((self.SAFE_END, explored), (self.WALL, depths["contact_depth"])):
            if np.isfinite(depth):
                self._stage.move(path, frame_at(at_depth(tip, depth, self._n), -self._n))
            self._stage.show(f"{path}/size", bool(np.isfinite(depth)))
        self._numbers["measured"].show(
            float(self._n @ estimate["force_last_valid"][:3]) if estimate else 0.0)
        self._numbers["explored"].show(1e3 * float(np.nan_to_num(explored - self._origin)))
        self._numbers["stiffness"].show(float(np.nan_to_num(depths["stiffness_estimate"])))


def at_depth(point: np.ndarray, depth: float, direction: np.ndarray) -> np.ndarray:
    """Returns the projection (3,) of a point (3,) along n (3,) onto n·𝔭 = depth [m]."""
    return point + (depth - direction @ point) * direction


class Coverage:
    """Coloured dots at the points pressed on; a point that is pressed again is painted anew.

    Args:
        stage: Stage to draw on.
        path: Path of the dots on the stage.
        legend: Path of the scale of colours, in the xz-plane, seen from −y.
        scale: Force at the end of the scale of colours [N].
        facing: Direction out of the wall (3,).
    """

    def __init__(self, stage: Stage, path: str, legend: str, scale: float, facing: np.ndarray):
        self._stage, self._path, self._scale, self._facing = stage, path, scale, facing
        width = 0.03
        stage.meshcat.SetTransform(legend, frame_at([-0.2, 0.0, -0.26]))
        for c, color in enumerate(palette()):
            stage.make(f"{legend}/{c}", rectangle(width, 0.035, (*color, 1.0)), None,
                       frame_at([(c + 0.5) * width, 0.0, 0.0]))
        stage.make(f"{legend}/text", label(f" read, up to {scale:g} N", 0.045, align="left"), None,
                   frame_at([(COLORS + 0.5) * width, 0.0, 0.0]))
        self.clear()

    def clear(self) -> None:
        """Removes all dots."""
        self._last: tuple[np.ndarray, int] | None = None  # Place and colour of the last dot.
        self._count = 0
        self._stage.meshcat.Delete(self._path)

    def show(self, chi: np.ndarray, measured: np.ndarray, law: Surface) -> None:
        """Paints the point under the tip once the measured force is more than a bias.

        Args:
            chi: Pose of the end-effector (6,).
            measured: Measured force (6,) [N, N m].
            law: The wall, on whose undeformed surface the paint is.
        """
        color = color_of(float(-self._facing @ measured[:3]), self._scale)
        if color == 0:
            return
        place = chi[:3] + float(law.penetration(chi)) * self._facing
        if self._last is not None and np.linalg.norm(place - self._last[0]) < DOT:
            if color == self._last[1]:
                return
            self._stage.show(f"{self._path}/{self._count}/size", False)  # It is painted over.
            place = self._last[0]
        self._count += 1
        dot = f"{self._path}/{self._count}"
        self._stage.make(f"{dot}/size/dot", Sphere(DOT), Rgba(*palette()[color]))
        self._stage.meshcat.SetTransform(dot, frame_at(place))
        self._stage.appear(f"{dot}/size")
        self._last = place, color


@lru_cache
def palette() -> tuple[tuple[float, float, float], ...]:
    """Returns red, green and blue of each colour, from no force to the scale's end."""
    return tuple(tuple(color[:3]) for color in colormaps["viridis"](np.linspace(0.0, 1.0, COLORS)))


def color_of(force: float, scale: float) -> int:
    """Returns the index of the colour of a force [N]; the scale's end is `scale` [N]."""
    return int(np.clip(COLORS * force / scale, 0.0, COLORS - 1.0))
