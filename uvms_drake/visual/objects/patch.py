"""A surface that is not flat, with the grid of a wall."""

import numpy as np

from uvms_drake.visual.objects.wall import DrawnWall, grid
from uvms_drake.visual.stage import Stage
from uvms_drake.visual.textured import textured_mesh


def draw_patch(stage: Stage, path: str, points: np.ndarray) -> None:
    """Draws a part of an undeformed surface, transparent.

    Args:
        stage: Stage to draw on.
        path: Path of the patch on the stage.
        points: Grid of points of the surface (K, K, 3) [m].
    """
    count = len(points)
    along = [np.gradient(points, axis=axis) for axis in (0, 1)]
    normals = np.cross(*along).reshape(-1, 3)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    # The lines of the grid keep their distance on a patch that is smaller than a wall.
    parts = [np.mean(np.linalg.norm(step, axis=-1)) * (count - 1) / DrawnWall.SIZE
             for step in along]
    uv = np.meshgrid(*(0.5 + part * np.linspace(-0.5, 0.5, count) for part in parts), indexing="ij")
    index = np.arange(count**2).reshape(count, count)
    corners = [index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]]
    faces = np.concatenate([np.stack([corners[i] for i in triangle], axis=-1).reshape(-1, 3)
                            for triangle in ((0, 1, 2), (0, 2, 3))])
    stage.make(path, textured_mesh(points.reshape(-1, 3), np.stack(uv, axis=-1).reshape(-1, 2),
                                   faces, grid(), normals=normals))
