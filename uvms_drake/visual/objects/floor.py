"""A level grid and the axes of Σ_I, which show the vertical and distances."""

import numpy as np
from pydrake.geometry import Cylinder, Rgba
from pydrake.math import RigidTransform, RotationMatrix

from uvms_drake.visual.stage import Stage, frame_at
from uvms_drake.visual.textured import label, textured_mesh

AXES = {"x": (0.95, 0.55, 0.45), "y": (0.55, 0.9, 0.6), "z": (0.6, 0.8, 1.0)}
"""Colours of the axes."""


class Floor:
    """A level grid of squares of half a metre that fades out.

    Args:
        stage: Stage to draw on.
        path: Path of the grid on the stage, below Σ_I.
        middle: Middle of the grid (3,) [m] in Σ_I.
        cells: Number of squares from the middle to an end.
    """

    CELL = 0.5  # m

    def __init__(self, stage: Stage, path: str, middle: np.ndarray, cells: int):
        half = cells * self.CELL
        corners = half * np.array([[-1.0, -1.0, 0], [1.0, -1.0, 0], [1.0, 1.0, 0], [-1.0, 1.0, 0]])
        uv = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
        stage.make(path, textured_mesh(corners, uv, np.array([[0, 1, 2], [0, 2, 3]]),
                                       self._picture(cells)), None, frame_at(middle))

    @staticmethod
    def _picture(cells: int) -> np.ndarray:
        """Returns light lines on a darker ground, both less opaque farther out."""
        pixels = 48  # of a square
        at = np.arange(2 * cells * pixels) + 0.5
        line = np.abs((at + 0.5 * pixels) % pixels - 0.5 * pixels) < 1.0
        far = np.abs(at / (cells * pixels) - 1.0)
        fade = np.clip(1.2 - 1.2 * np.hypot(far, far[:, None]), 0.0, 1.0)
        grid = line | line[:, None]
        picture = np.where(grid[..., None], [214, 226, 232, 190], [150, 158, 140, 70])
        picture[..., 3] = picture[..., 3] * fade
        return picture.astype(np.uint8)


def draw_axes(stage: Stage, path: str, length: float, facing: RotationMatrix) -> None:
    """Draws the axes of Σ_I with their names at `path`, a path in Meshcat's own axes.

    Args:
        stage: Stage to draw on.
        path: Path of the axes on the stage.
        length: Length of an axis [m].
        facing: Attitude of the names.
    """
    for name, color, axis in zip(AXES, AXES.values(), np.diag([1.0, -1.0, -1.0]), strict=True):
        stage.make(f"{path}/{name}", Cylinder(0.03 * length, length), Rgba(*color),
                   frame_at(0.5 * length * axis, axis))
        text = "z, down" if name == "z" else name
        stage.make(f"{path}/{name}_name", label(text, 0.42 * length, color=color), None,
                   RigidTransform(facing, 1.35 * length * axis))
