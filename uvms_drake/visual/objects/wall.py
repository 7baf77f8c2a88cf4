"""A flat surface, with a grid that shows its dent."""

import numpy as np

from uvms_drake.visual.stage import Stage, frame_at
from uvms_drake.visual.textured import textured_mesh


def grid() -> np.ndarray:
    """Returns the picture of the wall: lines every 10 cm, circles every 3 cm in the middle."""
    at = np.arange(1000.0)  # Pixels are millimetres.
    line = (np.abs((at + 50.0) % 100.0 - 50.0) < 3.0) | (np.abs(at - 499.5) > 492.0)
    radius = np.hypot(at - 499.5, at[:, None] - 499.5)
    circle = (np.abs((radius + 15.0) % 30.0 - 15.0) < 4.0) & (np.abs(radius - 75.0) < 60.0)
    dark = line | line[:, None] | circle
    return np.where(dark[..., None], [40, 54, 66, 230], [186, 196, 204, 95]).astype(np.uint8)


class DrawnWall:
    """A part of a plane with a grid on it; the dent is as deep as the end-effector's penetration.

    Args:
        stage: Stage to draw on.
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
                             np.column_stack([x, y]) / self.SIZE + 0.5, faces, grid(),
                             normals=normals / np.linalg.norm(normals, axis=1)[:, None])
        stage.make(f"{path}/depth/skin", mesh)
        stage.meshcat.SetTransform(path, frame_at(point, normal))

    def show(self, penetration: float) -> None:
        """Makes the dent `penetration` [m] deep."""
        self._stage.stretch(f"{self._path}/depth", 1.0, 1.0, max(penetration, 1e-4))
