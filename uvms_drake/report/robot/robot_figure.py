"""The robot at the end of a run: a still that needs neither a browser nor a graphics card.

It is seen by parallel rays, so that its scale is the same everywhere; nearer parts hide
farther ones pixel by pixel, and a face is the lighter the more it is turned to the light.
"""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from uvms_drake.model.surface.law import Surface, check_surface
from uvms_drake.report.figure_style import BLACK, COLUMN_WIDTH, VERMILION
from uvms_drake.report.robot.solids import robot_triangles
from uvms_drake.station.problem import true_surface
from uvms_drake.station.record import Record

EYE, LIGHT = (np.array(v) / np.linalg.norm(v) for v in ([-0.35, 0.9, -0.35], [-0.4, 0.5, -0.8]))
"""Directions to the eye and to the light in Σ_I, whose z points down."""
PIXELS = 2000
"""Width of the picture before it is reduced to half of it."""
WALL = np.array([0.80, 0.84, 0.87])
"""Colour of a wall."""
SIZE, SQUARES = 1.0, 10
"""Length of a wall [m], and the squares on it along that."""
ARROW = 0.4
"""Length of the arrow of the force [m]."""


def draw_robot(record: Record) -> Figure:
    """Draws the robot at the last sample, the surface, the path of its tip, and the force."""
    scenario, tip, force = record.scenario, record.chi[-1, :3], record.force[-1, :3]
    solids = [(triangles[normals_of(triangles) @ EYE > 0.0], color)
              for triangles, color in robot_triangles(scenario.model, record.config[-1])]
    wall = wall_points(check_surface(true_surface(scenario)), tip)
    if wall is not None:
        solids += wall_triangles(wall)
    size = float(np.linalg.norm(force))
    arrow = ARROW / size * force if size > 0.0 else np.zeros(3)
    # The picture's axes in Σ_I: to the right, up, and to the eye.
    right = np.cross(EYE, [0.0, 0.0, 1.0]) / np.hypot(*EYE[:2])
    R = np.array([right, np.cross(EYE, right), EYE])
    way, path = R @ arrow, record.chi[:, :3] @ R.T
    corners = np.concatenate([*(triangles.reshape(-1, 3) @ R.T for triangles, _ in solids),
                              path, path[-1:] + way])[:, :2]
    low, high = corners.min(axis=0) - 0.05, corners.max(axis=0) + [0.35, 0.05]
    scale = PIXELS / (high - low)[0]
    picture = rasterised([((triangles @ R.T - [*low, 0.0]) * scale, shaded(triangles, color))
                          for triangles, color in solids], (high - low) * scale)
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


def _arrow(axis: Axes, tail: np.ndarray, vector: np.ndarray, text: str, color: str) -> None:
    (x, y), (dx, dy) = tail[:2], vector[:2]
    axis.annotate("", (x + dx, y + dy), (x, y), arrowprops={
        "arrowstyle": "-|>", "color": color, "shrinkA": 0.0, "shrinkB": 0.0})
    beyond = 1.0 + 0.05 / max(float(np.hypot(dx, dy)), 1e-9)
    axis.text(x + beyond * dx, y + beyond * dy, text, color=color, va="center",
              ha="right" if dx < -abs(dy) else "left" if dx > abs(dy) else "center")


def wall_points(surface: Surface, tip: np.ndarray) -> np.ndarray | None:
    """Returns points (SQUARES+1, SQUARES+1, 3) of a wall next to the tip (3,) [m], if it is one."""
    if surface.normal is None:
        return surface.patch(tip, SIZE, SQUARES + 1)
    along = np.cross(surface.normal, np.eye(3)[np.argmin(np.abs(surface.normal))])
    along /= np.linalg.norm(along)
    axes = np.array([along, np.cross(surface.normal, along)])
    middle = tip - ((tip - surface.anchor) @ surface.normal) * surface.normal
    sides = [SIZE * np.linspace(-0.5, 0.5, SQUARES + 1)] * 2
    out: np.ndarray = middle + np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1) @ axes
    return out


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


def normals_of(triangles: np.ndarray) -> np.ndarray:
    """Returns the unit normals (K, 3) of triangles (K, 3, 3); zero where one has no area."""
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    return normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)


def shaded(triangles: np.ndarray, color: np.ndarray, eye: np.ndarray = EYE) -> np.ndarray:
    """Returns the colours (K, 3) of triangles (K, 3, 3), on the side that is seen from `eye`."""
    normal = normals_of(triangles)
    lit = np.maximum(np.sign(normal @ eye) * (normal @ LIGHT), 0.0)
    return np.minimum((0.6 + 0.45 * lit)[:, None] * color, 1.0)


def rasterised(solids: list[tuple[np.ndarray, np.ndarray]], size: np.ndarray) -> np.ndarray:
    """Returns a picture (h, w, 4), lowest row first, at half of the size (2,) [pixels].

    Args:
        solids: Triangles (K, 3, 3) in pixels to the right, up and to the eye, and colours (K, 3).
        size: Width and height before the picture is reduced.
    """
    w, h = 2 * np.ceil(0.5 * size).astype(int)
    image, nearest = np.zeros((h, w, 4)), np.full((h, w), -np.inf)
    for triangles, colors in solids:
        for triangle, color in zip(triangles, colors, strict=True):
            x0, y0 = np.maximum(np.floor(triangle[:, :2].min(axis=0)).astype(int), 0)
            x1, y1 = np.ceil(triangle[:, :2].max(axis=0)).astype(int) + 1
            (ux, vx), (uy, vy) = (triangle[1:, :2] - triangle[0, :2]).T
            area = ux * vy - vx * uy
            if abs(area) < 1e-9:
                continue
            x, y = np.meshgrid(np.arange(x0, min(x1, w)), np.arange(y0, min(y1, h)))
            dx, dy = x - triangle[0, 0], y - triangle[0, 1]
            b, c = (vy * dx - vx * dy) / area, (ux * dy - uy * dx) / area
            depth = triangle[0, 2] + b * (triangle[1, 2] - triangle[0, 2]) + c * (
                triangle[2, 2] - triangle[0, 2])
            box = np.s_[y0: y0 + len(x), x0: x0 + x.shape[1]]
            seen = (b >= 0.0) & (c >= 0.0) & (b + c <= 1.0) & (depth > nearest[box])
            nearest[box][seen] = depth[seen]
            image[box][seen] = [*color, 1.0]
    picture = image.reshape(h // 2, 2, w // 2, 2, 4).sum(axis=(1, 3))
    picture[..., :3] /= np.maximum(picture[..., 3:], 1.0)
    picture[..., 3] /= 4.0
    return picture
