"""Overview of the benchmark: the error of the force of each controller in each case, in colour."""

from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from uvms_drake.benchmark.controllers import TUBE
from uvms_drake.report.figure_style import BLACK, STYLE, VERMILION

OVERVIEW = "benchmark.png"
"""Name of the figure."""
RANGE = (0.5, 50.0)
"""Range of the colours [% of the desired force]."""
DARK = 8.0
"""Error from which on a cell's text is white [%]."""


def write_overview(summary: dict[str, Any], folder: Path) -> Path:
    """Writes the figure of a summary; returns its path."""
    path = folder / OVERVIEW
    with matplotlib.rc_context(STYLE):
        draw_overview(summary).savefig(path, dpi=200)
    return path


def relative_errors(summary: dict[str, Any], robot: str, names: list[str]) -> np.ndarray:
    """Returns the medians of the force's rms error (controllers, cases) [% of the desired force].

    They are infinite for a run that failed or never touched, and NaN without a run.
    """
    cells, desired = summary["cells"][robot], summary["desired"].get(robot, np.nan)
    return 100.0 / desired * np.array([[
        cells[case][name]["force_rms"]["median"] if cells[case][name]["runs"] else np.nan
        for case in summary["cases"]] for name in names])


def draw_overview(summary: dict[str, Any]) -> Figure:
    """Draws a matrix of controllers and cases for each robot, the tube MPC in the first row."""
    names = sorted(summary["controllers"], key=lambda name: name != TUBE)
    cases, robots = summary["cases"], summary["robots"]
    height = 1.1 + len(robots) * (0.35 + 0.19 * len(names))
    figure = Figure(figsize=(7.0, height), layout="constrained")
    axes = np.atleast_1d(figure.subplots(len(robots), 1, sharex=True))
    for axis, robot in zip(axes, robots, strict=True):
        errors = relative_errors(summary, robot, names)
        drawn = axis.imshow(np.where(np.isfinite(errors), errors, np.nan), cmap="Blues",
                            norm=LogNorm(*RANGE), aspect="auto")
        for row, name in enumerate(names):
            for column, case in enumerate(cases):
                _mark(axis, row, column, errors[row, column],
                      bool(summary["cells"][robot][case][name].get("limits")))
        axis.set_yticks(range(len(names)), [name.replace("_", " ") for name in names])
        axis.get_yticklabels()[0].set_fontweight("bold")
        axis.set_title(robot, loc="left", fontsize=8)
        axis.tick_params(length=0)
        axis.grid(visible=False)
    axes[-1].set_xticks(range(len(cases)), [case.replace("_", " ") for case in cases],
                        rotation=40, ha="right")
    figure.colorbar(drawn, ax=list(axes), shrink=0.6, pad=0.01, extend="both",
                    label="rms error of the force after settling [%]")
    figure.supxlabel("framed: a limit is broken;  –: a run failed or never touched", fontsize=7)
    return figure


def _mark(axis: Axes, row: int, column: int, error: float, broken: bool) -> None:
    """Writes the error of a cell, and frames one in which a limit is broken."""
    if np.isnan(error):
        return
    text = f"{error:.1f}" if error < 9.95 else f"{error:.0f}"
    axis.text(column, row, text if np.isfinite(error) else "–", ha="center", va="center",
              fontsize=6, color="white" if DARK < error < np.inf else BLACK)
    if broken:
        axis.add_patch(Rectangle((column - 0.44, row - 0.42), 0.88, 0.84, fill=False,
                                 edgecolor=VERMILION, linewidth=0.9))
