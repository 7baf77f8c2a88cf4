"""The texts between camera and scene that face the camera: time, limits, legend; and axes."""

from collections.abc import Sequence

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

from uvms_drake.visual.objects.bars import Bars
from uvms_drake.visual.objects.floor import draw_axes
from uvms_drake.visual.objects.readout import Readout
from uvms_drake.visual.stage import Stage, frame_at
from uvms_drake.visual.textured import label

NEAR = 0.5
"""Distance from the camera, as a fraction of that of the camera's target."""
LONGEST = 999.0  # s
TOP = 0.9
"""Height of the upper end of the table of the limits, in the plane's unit."""


class Hud:
    """A plane between camera and scene; its unit is the scene's size at the camera's target.

    Args:
        stage: Stage to draw on.
        camera, target: Position of the camera and its target (3,) [m], in Meshcat's axes.
        unit: The scene's size [m].
        limits: Texts of the limits.
        legend: Some lines.
    """

    board: str = "hud/board"
    """Path of further numbers, in the plane and its unit."""
    below: float
    """Height of the lower end of the table of the limits, in that unit."""
    inset: str
    """Path of the enlarged inset, in Meshcat's own axes; its text of two lines is at the origin."""

    def __init__(self, stage: Stage, camera: np.ndarray, target: np.ndarray, unit: float,
                 limits: Sequence[str], legend: str):
        self.facing = facing(target - camera)
        self._stage, self._scale = stage, NEAR * unit
        self._origin = camera + NEAR * (target - camera)
        X = RigidTransform(self.facing, self._origin).GetAsMatrix4()
        stage.meshcat.SetTransform("hud", X @ np.diag([*[self._scale] * 3, 1.0]))
        self._bars = Bars(stage, "hud/limits", limits)
        stage.meshcat.SetTransform("hud/limits", frame_at([0.0, 0.0, TOP]))
        self.below = TOP - self._bars.height
        self.inset = self.placed("inset", 1.22, self.below - 0.09)
        self._time = Readout(stage, "hud/time", "t = ", " s", LONGEST, 0.085)
        stage.meshcat.SetTransform("hud/time", frame_at([-1.3, 0.0, self.below - 0.13]))
        stage.meshcat.SetTransform(self.board, frame_at([0.93, 0.0, -0.42]))
        more = legend.count("\n") - 1  # lines beyond two
        stage.make("hud/legend", label(legend, 0.05), None,
                   frame_at([0.0, 0.0, -0.87 + 0.02 * more]))
        draw_axes(stage, self.placed("axes", -1.45, -0.58), 0.13 * unit, self.facing)

    def placed(self, path: str, x: float, z: float) -> str:
        """Places `path` at (x, z) in the plane, to scale and in Meshcat's own axes."""
        place = self._origin + self._scale * (self.facing @ np.array([x, 0.0, z]))
        X = RigidTransform(RotationMatrix(), place).GetAsMatrix4()
        self._stage.meshcat.SetTransform(path, X @ np.diag([NEAR, NEAR, NEAR, 1.0]))
        return path

    def show(self, time: float, used: np.ndarray, active: np.ndarray) -> None:
        """Shows the time [s] and the used parts of the limits (L,); see `Bars`."""
        self._time.show(time)
        self._bars.show(used, active)


def facing(direction: np.ndarray) -> RotationMatrix:
    """Returns the attitude whose xz-plane is upright and seen along `direction` (3,)."""
    y = direction / np.linalg.norm(direction)
    x = np.cross(y, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    return RotationMatrix(np.column_stack([x, y, np.cross(x, y)]))
