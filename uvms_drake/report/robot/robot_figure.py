"""The robot at the end of a run: a still with the surface, the path of the tip and the force."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from uvms_drake.model.frames.euler import rotation_matrix
from uvms_drake.model.surface.law import check_surface
from uvms_drake.report.figure_style import BLACK, COLUMN_WIDTH, VERMILION
from uvms_drake.report.robot.render import RobotScene, picture_axes
from uvms_drake.station.problem import surface_heading, true_surface
from uvms_drake.station.record import Record

EYE = np.array([-0.35, 0.9, -0.35])
"""Direction to the eye of one who sees a wall to the north, in Σ_I, whose z points down."""
PIXELS = 1000
"""Width of the picture."""
WALL = np.array([0.80, 0.84, 0.87])
"""Colour of a wall."""
SIZE, SQUARES = 1.0, 10
"""Length of a wall [m], and the squares on it along that."""
ARROW = 0.4
"""Length of the arrow of the force [m]."""


def draw_robot(record: Record) -> Figure:
    """Draws the robot at the last sample, the surface, the path of its tip, and the force."""
    force, scene, R = record.force[-1, :3], scene_at(record, -1), axes_of(record)
    size = float(np.linalg.norm(force))
    arrow = ARROW / size * force if size > 0.0 else np.zeros(3)
    way, path = R @ arrow, record.chi[:, :3] @ R.T
    corners = np.concatenate([scene.corners @ R.T, path, path[-1:] + way])[:, :2]
    low, high = corners.min(axis=0) - 0.05, corners.max(axis=0) + [0.35, 0.05]
    picture = scene.picture(R, low, high, PIXELS)
    # On paper, with the parts without a body.
    width = 2.0 * COLUMN_WIDTH
    figure = Figure(figsize=(width, width * picture.shape[0] / picture.shape[1]))
    axis = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axis.set_axis_off()
    axis.imshow(picture, origin="lower", extent=(low[0], high[0], low[1], high[1]))
    axis.plot(*path[:, :2].T, color=VERMILION, linewidth=1.2)
    if size > 0.0:
        _arrow(axis, path[-1], way, f"{size:.3g} N", VERMILION)
    corner = np.array([high[0] - 0.3, low[1] + 0.1])
    for name, direction in zip("xyz", 0.2 * R.T, strict=True):
        _arrow(axis, corner + [0.0, 0.35], direction, f"${name}$", BLACK)
    axis.plot(corner[0] + [0.0, 0.25], corner[[1, 1]], color=BLACK, linewidth=2.0)
    axis.text(corner[0] + 0.125, corner[1] - 0.05, "0.25 m", ha="center", va="center")
    return figure


def axes_of(record: Record) -> np.ndarray:
    """Returns the axes (3, 3) of a picture of a run, see `picture_axes`; they turn with a wall."""
    turn = rotation_matrix(np.array([0.0, 0.0, surface_heading(record.scenario)]))
    return picture_axes(turn @ EYE)


def scene_at(record: Record, sample: int) -> RobotScene:
    """Returns the robot at a sample, and the wall about the last place of the tip."""
    surface = check_surface(true_surface(record.scenario))
    wall = surface.patch(record.chi[-1, :3], SIZE, SQUARES + 1)
    return RobotScene(record.scenario.model, record.config[sample],
                      [] if wall is None else wall_triangles(wall),
                      surface_heading(record.scenario))


def _arrow(axis: Axes, tail: np.ndarray, vector: np.ndarray, text: str, color: str) -> None:
    (x, y), (dx, dy) = tail[:2], vector[:2]
    axis.annotate("", (x + dx, y + dy), (x, y), arrowprops={
        "arrowstyle": "-|>", "color": color, "shrinkA": 0.0, "shrinkB": 0.0})
    beyond = 1.0 + 0.05 / max(float(np.hypot(dx, dy)), 1e-9)
    axis.text(x + beyond * dx, y + beyond * dy, text, color=color, va="center",
              ha="right" if dx < -abs(dy) else "left" if dx > abs(dy) else "center")


def wall_triangles(points: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Returns triangles (K, 3, 3) [m] and colours (3,) of the light and the dark squares of a wall.

    Args:
        points: Corners of its squares (r, c, 3) [m].
    """
    corners = [points[i: i - 1 or None, j: j - 1 or None] for i, j in (
        (0, 0), (1, 0), (1, 1), (0, 0), (1, 1), (0, 1))]
    squares = np.stack(corners, axis=2)
    parity = np.sum(np.indices(squares.shape[:2]), axis=0) % 2
    return [(squares[parity == each].reshape(-1, 3, 3), (1.0 - 0.1 * each) * WALL)
            for each in (0, 1)]
