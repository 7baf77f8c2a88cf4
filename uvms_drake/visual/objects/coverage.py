"""Map of measured force on a wall: a dot wherever the tip has pressed, coloured by force.

A recording keeps no change of colour (see `stage`), so a dot keeps its colour, and another one
takes its place where the force has changed.
"""

from functools import lru_cache

import numpy as np
from matplotlib import colormaps
from pydrake.geometry import Rgba, Sphere

from uvms_drake.model.surface.law import Surface
from uvms_drake.visual.stage import Stage, frame_at
from uvms_drake.visual.textured import label, rectangle

COLORS = 10
"""Number of colours, each for forces of one range; in the first one, which may be a bias of the
sensor, nothing is painted."""


@lru_cache
def palette() -> tuple[tuple[float, float, float], ...]:
    """Returns red, green and blue of each colour, from no force to the scale's end."""
    return tuple(tuple(color[:3]) for color in colormaps["viridis"](np.linspace(0.0, 1.0, COLORS)))


def color_of(force: float, scale: float) -> int:
    """Returns the index of the colour of a force [N]; the scale's end is `scale` [N]."""
    return int(np.clip(COLORS * force / scale, 0.0, COLORS - 1.0))


class Coverage:
    """Coloured dots at the points pressed on; a point that is pressed again is painted anew.

    Args:
        stage: Stage to draw on.
        path: Path of the dots on the stage.
        legend: Path of the scale of colours, in the xz-plane, seen from −y.
        scale: Force at the end of the scale of colours [N].
        facing: Direction out of the wall (3,).
    """

    RADIUS = 0.006  # m

    def __init__(self, stage: Stage, path: str, legend: str, scale: float, facing: np.ndarray):
        self._stage, self._path, self._scale, self._facing = stage, path, scale, facing
        self._draw_scale(legend)
        self._count = 0
        self._last: tuple[np.ndarray, int] | None = None
        """Place and colour of the last dot."""

    def _draw_scale(self, path: str) -> None:
        """Draws the scale of colours, with its end."""
        width, height = 0.04, 0.035
        self._stage.meshcat.SetTransform(path, frame_at([-0.2, 0.0, -0.26]))
        for c, color in enumerate(palette()):
            self._stage.make(f"{path}/{c}", rectangle(width, height, (*color, 1.0)),
                             pose=frame_at([(c + 0.5) * width, 0.0, 0.0]))
        self._stage.make(f"{path}/text", label(
            f" to {self._scale:g} N, painted", 0.045, align="left"),
            pose=frame_at([(COLORS + 0.5) * width, 0.0, 0.0]))

    def clear(self) -> None:
        """Removes all dots."""
        self._last, self._count = None, 0
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
        if self._last is not None and np.linalg.norm(place - self._last[0]) < self.RADIUS:
            if color == self._last[1]:
                return
            self._stage.show(f"{self._path}/{self._count}/size", False)  # It is painted over.
            place = self._last[0]
        self._count += 1
        dot = f"{self._path}/{self._count}"
        self._stage.make(f"{dot}/size/dot", Sphere(self.RADIUS), Rgba(*palette()[color]))
        self._stage.meshcat.SetTransform(dot, frame_at(place))
        self._stage.appear(f"{dot}/size")
        self._last = place, color
