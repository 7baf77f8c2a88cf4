"""Makes an animation (GIF) of a finished run: the robot, its surface, and the force over time.

    uvms-drake run && python examples/animation.py out/girona500_contact hold.gif

It needs no browser. `--every` is the time from picture to picture, `--until` the last instant.
"""

import argparse
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

import uvms_drake as uv
from uvms_drake.report.figure_style import BLACK, GREEN, VERMILION
from uvms_drake.report.robot.robot_figure import axes_of, scene_at

PIXELS = 640  # width
FORCE = 0.24  # height of the plot of the force over that of the picture
PER_NEWTON = 0.012  # m, length of the arrow
COLORS = 96


def main() -> None:
    """Makes the animation."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, metavar="DIR", help="folder of a finished run")
    parser.add_argument("output", type=Path, metavar="FILE", help="a .gif")
    parser.add_argument("--every", type=float, default=0.2, metavar="S")
    parser.add_argument("--until", type=float, default=np.inf, metavar="S")
    parser.add_argument("--speed", type=float, default=2.0, help="times real time")
    arguments = parser.parse_args()
    record = uv.load_record(arguments.folder)
    last = min(arguments.until, record.time[-1])
    samples = np.searchsorted(record.time, np.arange(0.0, last + 1e-9, arguments.every))
    pictures = Pictures(record, samples)
    frames = [pictures.at(i) for i in samples]
    palette = frames[-1].quantize(COLORS)
    frames = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    frames[0].save(arguments.output, save_all=True, append_images=frames[1:], loop=0, optimize=True,
                   duration=round(1e3 * arguments.every / arguments.speed))
    print(f"{arguments.output}: {len(frames)} pictures, "
          f"{arguments.output.stat().st_size / 1e6:.2f} MB")


class Pictures:
    """Pictures of the instants of a run, all in the same frame."""

    def __init__(self, record: uv.Record, samples: np.ndarray):
        self._record, self._R = record, axes_of(record)
        corners = np.concatenate([scene_at(record, i).corners for i in samples[[0, -1]]])
        corners = np.concatenate([corners, record.chi[:, :3]]) @ self._R[:2].T
        self._low, self._high = corners.min(axis=0) - 0.05, corners.max(axis=0) + [0.35, 0.05]
        self._desired = float(np.linalg.norm(np.array(record.scenario.task.force[:3], float)))
        self._shown = record.time <= record.time[samples[-1]] + 1e-9

    def at(self, sample: int) -> Image.Image:
        """Returns the picture of a sample."""
        record, R, low, high = self._record, self._R, self._low, self._high
        picture = scene_at(record, sample).picture(R, low, high, PIXELS)
        height = picture.shape[0] / (1.0 - FORCE)
        figure = Figure(figsize=(PIXELS / 100.0, height / 100.0), dpi=100.0)
        axis = figure.add_axes((0.0, FORCE, 1.0, 1.0 - FORCE))
        axis.set_axis_off()
        axis.imshow(picture, origin="lower", extent=(low[0], high[0], low[1], high[1]))
        tip, force = record.chi[: sample + 1, :3] @ R[:2].T, record.force[sample, :3]
        axis.plot(*tip.T, color=VERMILION, linewidth=1.5)
        end = tip[-1] + PER_NEWTON * R[:2] @ force
        if np.linalg.norm(force) > 0.5:
            axis.annotate("", end, tip[-1], arrowprops={
                "arrowstyle": "-|>", "color": VERMILION, "linewidth": 2.0,
                "shrinkA": 0.0, "shrinkB": 0.0})
        axis.set_xlim(low[0], high[0])
        axis.set_ylim(low[1], high[1])
        axis.text(0.015, 0.97, f"t = {record.time[sample]:.1f} s", transform=axis.transAxes,
                  va="top", fontsize=11, color=BLACK)
        self._draw_force(figure, sample)
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        return Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3].copy())

    def _draw_force(self, figure: Figure, sample: int) -> None:
        """Draws the force up to a sample below the picture."""
        record, shown = self._record, self._shown
        size = np.linalg.norm(record.force[:, :3], axis=1)
        axis = figure.add_axes((0.09, 0.07, 0.89, FORCE - 0.09))
        axis.axhline(self._desired, color=GREEN, linewidth=1.2)
        axis.plot(record.time[: sample + 1], size[: sample + 1], color=VERMILION, linewidth=1.5)
        axis.set_xlim(0.0, record.time[shown][-1])
        axis.set_ylim(0.0, 1.15 * max(self._desired, size[shown].max()))
        axis.set_ylabel("force [N]", fontsize=9)
        axis.set_xlabel("t [s]", fontsize=9, labelpad=0.0)
        axis.tick_params(labelsize=8)
        axis.spines[["top", "right"]].set_visible(False)


if __name__ == "__main__":
    main()
