"""The figures of a campaign, one idea each, at the width of a column in a paper."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from uvms_drake.figure_style import BLUE, COLUMN_WIDTH, LIMIT, ORANGE, STYLE, tube_label

RATIOS_FILE, OUTCOMES_FILE = "campaign_ratios.png", "campaign_outcomes.png"
BINS = 24


def make_campaign_figures(summary: Mapping[str, Any], folder: Path) -> list[Path]:
    """Writes the figures of the content of campaign.json and returns their paths."""
    done = [result for result in summary["results"] if result["error"] is None]
    if not done:
        return []
    paths = []
    for name, draw in ((RATIOS_FILE, draw_ratios), (OUTCOMES_FILE, draw_outcomes)):
        with matplotlib.rc_context(STYLE):
            draw(done, bool(summary["certified"])).savefig(folder / name)
        paths.append(folder / name)
    return paths


def draw_ratios(results: Sequence[Mapping[str, Any]], certified: bool) -> Figure:
    """Draws the worst deviation of each run over its two bounds, by kind of disturbance."""
    figure = Figure(figsize=(COLUMN_WIDTH, 2.6), layout="constrained")
    axis = figure.subplots()
    kinds = sorted({result["disturbance"] for result in results})
    for name, label, color, shift in (
            ("ratio_trajectory", "along the run", BLUE, 0.14),
            ("ratio_set", "set-wise", ORANGE, -0.14)):
        points = [(result[name], kinds.index(result["disturbance"]) + shift)
                  for result in results if result[name] is not None]
        if points:
            axis.plot(*np.array(points).T, "o", color=color, markersize=2.2, alpha=0.5,
                      markeredgewidth=0.0, label=label)
    axis.axvline(1.0, **{**LIMIT, "label": tube_label(certified)})
    axis.set_xlim(0.0, 1.05 * max(1.0, *axis.get_xlim()))
    axis.set_yticks(range(len(kinds)), [kind.replace("_", " ") for kind in kinds])
    axis.set_xlabel("worst deviation of a run over its bound")
    figure.legend(ncols=3, loc="outside upper center")
    return figure


def draw_outcomes(results: Sequence[Mapping[str, Any]], certified: bool) -> Figure:
    """Draws how many runs had which smallest margin, final force error and settling time."""
    del certified
    figure = Figure(figsize=(COLUMN_WIDTH, 4.2), layout="constrained")
    axes = figure.subplots(3)
    for axis, (name, label) in zip(axes, (
            ("margin", "smallest margin over its constraint's size"),
            ("force_error", "force error at the end [N]"),
            ("settling_time_s", "settling time of the force [s]")), strict=True):
        _histogram(axis, [result[name] for result in results if result[name] is not None])
        axis.set_xlabel(label)
        axis.set_ylabel("runs")
    axes[0].axvline(0.0, **LIMIT)
    return figure


def _histogram(axis: Axes, values: Sequence[float]) -> None:
    axis.hist(values, bins=BINS, color=BLUE)
    axis.yaxis.set_major_locator(MaxNLocator(4, integer=True))
