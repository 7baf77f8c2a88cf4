"""A robot by itself: from starboard, ahead and a corner, with its frames and its centres."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from uvms_drake.model.trim import Trim, trim_of
from uvms_drake.model.uvms import Uvms
from uvms_drake.model.uvms_model import UvmsModel
from uvms_drake.report.figure_style import BLACK, BLUE, COLUMN_WIDTH, VERMILION, XYZ
from uvms_drake.report.robot.render import RobotScene, picture_axes

VIEWS = {"from starboard": (0.0, 1.0, 0.0), "from ahead": (1.0, 0.0, 0.0),
         "from a corner": (0.55, 0.65, -0.5)}
"""Directions to the eye in axes of the vehicle, whose z points down."""
PIXELS = 600
"""Width of a picture."""
MARGIN = 0.03
"""Margin of the picture about the robot, over the robot's size."""
ARM = 0.18
"""Length of the axes of a frame, over the robot's size."""


def draw_views(uvms: Uvms, model: str, posture: np.ndarray) -> Figure:
    """Draws a robot, level, with the frames of vehicle and tip, the joints' axes and the centres.

    Args:
        uvms: The robot, in a finalized plant.
        model: Name of a shipped robot, or a robot's folder.
        posture: Joint angles (n,) [rad].
    """
    config = np.concatenate([np.zeros(6), posture])
    scene, trim = RobotScene(model, config), trim_of(uvms, posture)
    chain = UvmsModel(uvms).kinematics(config)
    points = np.concatenate([scene.corners, np.zeros((1, 3)), chain.p_BL])
    size = float(np.max(np.ptp(points, axis=0)))
    frames = [(np.zeros(3), np.eye(3)), (chain.p_BL[-1], chain.R_BL[-1])]
    points = np.concatenate([points, *(p + 1.1 * ARM * size * R.T for p, R in frames)])
    figure = Figure(figsize=(2.0 * COLUMN_WIDTH, 1.72 * COLUMN_WIDTH))
    grid = figure.add_gridspec(2, 2, width_ratios=(1.0, 1.15), left=0.01, right=0.99, bottom=0.01,
                               top=0.96, wspace=0.03, hspace=0.12)
    places = (grid[0, 0], grid[1, 0], grid[:, 1])
    for (name, eye), place in zip(VIEWS.items(), places, strict=True):
        axis = figure.add_subplot(place)
        R = picture_axes(np.array(eye))
        corners = points @ R[:2].T
        low, high = corners.min(axis=0) - MARGIN * size, corners.max(axis=0) + MARGIN * size
        axis.set_axis_off()
        axis.imshow(scene.picture(R, low, high, PIXELS), origin="lower",
                    extent=(low[0], high[0], low[1], high[1]))
        for origin, axes in frames:
            _draw_frame(axis, R, origin, axes, ARM * size)
        names = [joint.name() if name == "from a corner" else "" for joint in uvms.joints]
        _draw_joints(axis, R, names, chain.anchor, chain.axis, 0.5 * ARM * size)
        _draw_centers(axis, R, trim)
        axis.set_title(name, fontsize=7.5)
    return figure


def _draw_frame(axis: Axes, R: np.ndarray, origin: np.ndarray, axes: np.ndarray, length: float
                ) -> None:
    """Draws the axes of a frame; one that points to the eye is left out."""
    tail = R[:2] @ origin
    for letter, direction, color in zip("xyz", axes.T, XYZ, strict=True):
        step = length * R[:2] @ direction
        if np.linalg.norm(step) < 0.2 * length:
            continue
        axis.annotate("", tail + step, tail, arrowprops={
            "arrowstyle": "-|>", "color": color, "shrinkA": 0.0, "shrinkB": 0.0,
            "mutation_scale": 7.0})
        _write(axis, tail + 1.1 * step, f"${letter}$", color, (0, 0))


def _write(axis: Axes, place: np.ndarray, text: str, color: str, offset: tuple[int, int]) -> None:
    """Writes beside a point, with a white rim; `offset` is in points."""
    where = {-1: "right", 0: "center", 1: "left"}[int(np.sign(offset[0]))]
    written = axis.annotate(text, (place[0], place[1]), offset, textcoords="offset points",
                            fontsize=6.5, color=color, ha=where, va="center")
    written.set_path_effects([withStroke(linewidth=1.8, foreground="white")])


def _draw_joints(axis: Axes, R: np.ndarray, names: list[str], anchors: np.ndarray,
                 directions: np.ndarray, length: float) -> None:
    """Draws the joints' axes as dashed lines."""
    for name, anchor, direction in zip(names, anchors, directions, strict=True):
        ends = np.array([anchor - length * direction, anchor + length * direction]) @ R[:2].T
        axis.plot(*ends.T, color=BLACK, linewidth=0.7, linestyle=(0, (4, 2)))
        _write(axis, ends[1], name, BLACK, (3, 0))


def _draw_centers(axis: Axes, R: np.ndarray, trim: Trim) -> None:
    """Draws the centres of mass and of buoyancy of the whole robot."""
    for name, center, color, up in (("mass", trim.center_of_mass, VERMILION, -3),
                                    ("buoyancy", trim.center_of_buoyancy, BLUE, 3)):
        place = R[:2] @ center
        axis.plot(*place, "o", color=color, markersize=4.5, markeredgecolor="white",
                  markeredgewidth=0.8)
        _write(axis, place, name, color, (-5, up))
