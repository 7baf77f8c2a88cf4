"""The texts between camera and scene that face the camera: time, limits, legend; and axes."""

from collections.abc import Sequence

import numpy as np
from pydrake.geometry import Cylinder, Rgba
from pydrake.math import RigidTransform, RotationMatrix

from uvms_drake.visual.pictures import label, rectangle
from uvms_drake.visual.stage import UP, Stage, frame_at

ACTIVE = 0.98
"""Fraction of a limit from which on it counts as active."""
NEAR = 0.5
"""Distance from the camera, as a fraction of that of the camera's target."""
TOP = 0.9
"""Height of the upper end of the table of the limits, in the plane's unit."""
TIME = 0.085
"""Height of the line of the time, likewise."""
DIGIT = 0.53
"""Width of a digit, over the height of a line."""
AXES = {"x": (0.95, 0.55, 0.45), "y": (0.55, 0.9, 0.6), "z, down": (0.6, 0.8, 1.0)}
"""Colours of the axes of Σ_I."""
USED, ALARM = (0.85, 0.93, 0.97, 1.0), (0.95, 0.15, 0.12, 1.0)
TROUGH, MARK = (0.02, 0.1, 0.16, 0.6), (1.0, 1.0, 1.0, 1.0)


class Readout:
    """A number and its unit: all ten digits exist at each place, one is shown.

    It is in the xz-plane, seen from −y, and begins at the origin of its path. Every change of a
    digit is in a recording.

    Args:
        stage: Stage to draw on.
        path: Path of the number on the stage.
        unit: Text to its right.
        largest: Number with as many places as are shown.
        height: Height of a line.
        color: Colour of all of it: red, green and blue from 0 to 1.
        tenths: Whether it is shown to a tenth.
    """

    def __init__(self, stage: Stage, path: str, unit: str, largest: float, height: float,
                 color: tuple[float, float, float] = (1.0, 1.0, 1.0), *, tenths: bool = False):
        self._stage, self._path = stage, path
        text = "9" * len(str(int(largest))) + ".9" * tenths
        self._most, self._format = float(text), f"{len(text)}.{int(tenths)}f"
        self._places = [place for place, letter in enumerate(text) if letter != "."]

        def write(name: str, text: str, place: float, align: str) -> None:
            stage.make(f"{path}/{name}", label(text, height, bold=True, color=color, align=align),
                       None, frame_at([place * DIGIT * height, 0.0, 0.0]))

        for place in self._places:
            for digit in "0123456789":
                write(f"{place}/{digit}/text", digit, place + 0.5, "center")
        if tenths:
            write("point", ".", self._places[-1] - 0.5, "center")
        write("unit", unit, len(text), "left")

    def show(self, value: float) -> None:
        """Shows the nearest displayable number."""
        text = f"{min(max(value, 0.0), self._most):{self._format}}"
        for place in self._places:
            for digit in "0123456789":
                self._stage.show(f"{self._path}/{place}/{digit}", text[place] == digit)


class Overlay:
    """A plane between camera and scene; its unit is the scene's size at the camera's target.

    Args:
        stage: Stage to draw on.
        camera, target: Position of the camera and its target (3,) [m], in Meshcat's axes.
        unit: The scene's size [m].
        limits: Texts of the limits, each with a bar that is as long as its used part, and red
            while it is active.
        legend: Some lines.
    """

    board: str = "hud/board"
    """Path of further numbers, in the plane and its unit."""
    below: float
    """Height of the lower end of the table of the limits, in that unit."""
    inset: str
    """Path of the enlarged inset, in Meshcat's own axes; its text of two lines is at the origin."""

    COLUMNS = 3
    PITCH = 0.86  # of the columns
    LINE = 0.062  # from row to row
    LENGTH = 0.24  # of the bar of a limit that is used up

    def __init__(self, stage: Stage, camera: np.ndarray, target: np.ndarray, unit: float,
                 limits: Sequence[str], legend: str):
        self.facing = facing(target - camera)
        self._stage, self._scale = stage, NEAR * unit
        self._origin = camera + NEAR * (target - camera)
        X = RigidTransform(self.facing, self._origin).GetAsMatrix4()
        stage.meshcat.SetTransform("hud", X @ np.diag([*[self._scale] * 3, 1.0]))
        self._bars = [f"hud/limits/{i}" for i in range(len(limits))]
        rows = -(-len(limits) // self.COLUMNS)
        self._draw_bars(limits, rows)
        self.below = TOP - rows * self.LINE
        self.inset = self._placed("inset", 1.15, self.below - 0.09)
        self._time = Readout(stage, "hud/time", " s", 9999.0, TIME, tenths=True)
        stage.meshcat.SetTransform("hud/time", frame_at([-1.3, 0.0, self.below - 0.13]))
        stage.meshcat.SetTransform(self.board, frame_at([0.84, 0.0, -0.42]))
        more = legend.count("\n") - 1  # lines beyond two
        stage.make("hud/legend", label(legend, 0.05), None,
                   frame_at([0.0, 0.0, -0.87 + 0.02 * more]))
        self._draw_axes(self._placed("axes", -1.2, -0.55), 0.13 * unit)

    def _placed(self, path: str, x: float, z: float) -> str:
        """Places `path` at (x, z) in the plane, to scale and in Meshcat's own axes."""
        place = self._origin + self._scale * (self.facing @ np.array([x, 0.0, z]))
        X = RigidTransform(RotationMatrix(), place).GetAsMatrix4()
        self._stage.meshcat.SetTransform(path, X @ np.diag([NEAR, NEAR, NEAR, 1.0]))
        return path

    def _draw_bars(self, names: Sequence[str], rows: int) -> None:
        """Draws the table of the limits, its middle and upper end at (0, TOP)."""
        columns = -(-len(names) // rows) if rows else 0
        thick, middle = 0.55 * self.LINE, 0.5 * self.LENGTH
        for i, (bar, name) in enumerate(zip(self._bars, names, strict=True)):
            column, row = divmod(i, rows)
            left = (column - 0.5 * (columns - 1)) * self.PITCH + 0.13
            self._stage.meshcat.SetTransform(
                bar, frame_at([left, 0.0, TOP - (row + 0.5) * self.LINE]))
            for part, length, height, color, x, y in (
                    ("trough", self.LENGTH, 1.0, TROUGH, middle, 0.006),
                    ("half", 0.005, 0.8, MARK, middle, -0.004),
                    ("full", 0.005, 1.2, MARK, self.LENGTH, -0.004),
                    ("used/bar", 1.0, 0.7, USED, 0.5, 0.002),
                    ("active/bar", self.LENGTH, 1.1, ALARM, middle, -0.002),
                    ("plan/mark", 0.012, 1.3, MARK, 0.0, -0.006)):
                self._stage.make(f"{bar}/{part}", rectangle(length, height * thick, color), None,
                                 frame_at([x, y, 0.0]))
            self._stage.make(f"{bar}/name", label(name, 0.8 * self.LINE, align="right"), None,
                             frame_at([-0.03, 0.0, 0.0]))

    def _draw_axes(self, path: str, length: float) -> None:
        """Draws the axes of Σ_I with their names at `path`, in Meshcat's own axes."""
        for (name, color), axis in zip(AXES.items(), np.diag(UP), strict=True):
            self._stage.make(f"{path}/{name[0]}", Cylinder(0.03 * length, length), Rgba(*color),
                             frame_at(0.5 * length * axis, axis))
            self._stage.make(f"{path}/{name[0]}_name", label(name, 0.42 * length, color=color),
                             None, RigidTransform(self.facing, 1.35 * length * axis))

    def show(self, time: float, used: np.ndarray, planned: np.ndarray) -> None:
        """Shows the time [s] and the parts of the limits (L,) that robot and plan use."""
        self._time.show(time)
        for bar, part, plan in zip(self._bars, used, planned, strict=True):
            self._stage.stretch(f"{bar}/used", self.LENGTH * min(float(part), 1.05), 1.0, 1.0)
            self._stage.show(f"{bar}/active", bool(part >= ACTIVE))
            self._stage.move(f"{bar}/plan", frame_at(
                [self.LENGTH * min(float(plan), 1.05), 0.0, 0.0]))


def facing(direction: np.ndarray) -> RotationMatrix:
    """Returns the attitude whose xz-plane is upright and seen along `direction` (3,)."""
    y = direction / np.linalg.norm(direction)
    x = np.cross(y, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    return RotationMatrix(np.column_stack([x, y, np.cross(x, y)]))
