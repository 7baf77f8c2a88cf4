"""Figures of a campaign, one idea each, at the width of a column in a paper."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FormatStrFormatter, LogLocator, MaxNLocator, NullLocator

from uvms_drake.report.figure_style import BLUE, COLUMN_WIDTH, LIMIT, ORANGE, STYLE, tube_label

RATIOS_FILE = "campaign_ratios.png"
MARGINS_FILE, OUTCOMES_FILE = "campaign_margins.png", "campaign_outcomes.png"
TIMING_FIGURE, WALLS_FILE = "campaign_timing.png", "campaign_walls.png"
CAMPAIGN_FIGURES = (RATIOS_FILE, MARGINS_FILE, OUTCOMES_FILE, TIMING_FIGURE)
"""Figures of every campaign; `WALLS_FILE` is that of a sensed contact."""
BINS = 24
LONG = 300.0
"""Ratio of the ends of an axis above which only decades are numbered."""
DOT: dict[str, Any] = {"markersize": 2.2, "alpha": 0.5, "markeredgewidth": 0.0, "linestyle": "",
                       "marker": "o"}

Results = Sequence[Mapping[str, Any]]


def make_campaign_figures(summary: Mapping[str, Any], times: Mapping[str, Any], folder: Path
                          ) -> list[Path]:
    """Writes the figures of the contents of campaign.json and timing.json; returns their paths."""
    done = [result for result in summary["results"] if result["error"] is None
            and result["inside"]]
    if not done:
        return []
    certified = bool(summary["certified"])
    figures = {
        RATIOS_FILE: lambda: draw_ratios(done, certified),
        MARGINS_FILE: lambda: draw_margins(done),
        OUTCOMES_FILE: lambda: draw_outcomes(done, summary["force_tolerance"]),
        TIMING_FIGURE: lambda: draw_timing(times)}
    if "walls" in summary:
        figures[WALLS_FILE] = lambda: draw_walls(done)
    paths = []
    for name, draw in figures.items():
        with matplotlib.rc_context(STYLE):
            draw().savefig(folder / name)
        paths.append(folder / name)
    return paths


def draw_ratios(results: Results, certified: bool) -> Figure:
    """Draws the worst deviation of each run over its two bounds, by disturbance."""
    figure = Figure(figsize=(COLUMN_WIDTH, 2.8), layout="constrained")
    axis = figure.subplots()
    kinds = sorted({_kind(result) for result in results})
    for name, label, color, shift in (
            ("ratio_trajectory", "along the run", BLUE, 0.14),
            ("ratio_set", "set-wise", ORANGE, -0.14)):
        points = [(result[name], kinds.index(_kind(result)) + shift)
                  for result in results if result[name] is not None]
        if points:
            axis.plot(*np.array(points).T, color=color, label=label, **DOT)
    axis.axvline(1.0, **{**LIMIT, "label": tube_label(certified)})
    low, high = axis.get_xlim()
    if high > 10.0:
        _log(axis, 0.8 * max(low, 0.1), 1.25 * high)
    else:
        axis.set_xlim(0.0, 1.05 * max(1.0, high))
    axis.set_yticks(range(len(kinds)), [kind.replace("_", " ") for kind in kinds])
    axis.set_xlabel("worst deviation of a run over its bound")
    figure.legend(ncols=3, loc="outside upper center")
    return figure


def _kind(result: Mapping[str, Any]) -> str:
    return result["disturbance"]


def draw_margins(results: Results) -> Figure:
    """Draws the smallest margin of each run to each constraint, over the constraint's size."""
    names = list(results[0]["margins"])
    names.sort(key=lambda name: -min(result["margins"][name] for result in results))
    figure = Figure(figsize=(COLUMN_WIDTH, 0.7 + 0.13 * len(names)), layout="constrained")
    axis = figure.subplots()
    for row, name in enumerate(names):
        values = [result["margins"][name] for result in results]
        axis.plot(values, np.full(len(values), row), color=BLUE, **{**DOT, "alpha": 0.25})
        axis.plot(min(values), row, color=ORANGE, marker="|", markersize=5, linestyle="",
                  label="worst run" if row == 0 else None)
    axis.axvline(0.0, **LIMIT)
    lowest = min(min(result["margins"].values()) for result in results)
    axis.set_xlim(min(1.05 * lowest, -0.02), 1.0)
    figure.legend(ncols=2, loc="outside upper center")
    axis.set_yticks(range(len(names)), [name.replace("_", " ") for name in names])
    axis.tick_params(axis="y", labelsize=5.5)
    axis.set_xlabel("smallest margin of a run over the constraint's size")
    return figure


def draw_outcomes(results: Results, tolerance: float) -> Figure:
    """Draws the histograms of final force error and settling time.

    Args:
        results: Results of the runs.
        tolerance: Force error below which the force counts as settled [N].
    """
    figure = Figure(figsize=(COLUMN_WIDTH, 2.9), layout="constrained")
    axes = figure.subplots(2)
    for axis, (name, label) in zip(axes, (
            ("force_error", "force error at the end [N]"),
            ("settling_time_s", "settling time of the force [s]")), strict=True):
        values = [result[name] for result in results if result[name] is not None]
        highest = max([*values, tolerance])
        axis.hist(values, bins=BINS, range=(0.0, 1.02 * highest), color=BLUE)
        axis.yaxis.set_major_locator(MaxNLocator(4, integer=True))
        axis.set_xlabel(f"{label}, {len(values)} of {len(results)} runs")
        axis.set_ylabel("runs")
    axes[0].axvline(tolerance, **{**LIMIT, "label": "counts as settled"})
    axes[0].legend(loc="best")
    return figure


def draw_walls(results: Results) -> Figure:
    """Draws static force and settling time on unknown surfaces over their stiffness."""
    figure = Figure(figsize=(COLUMN_WIDTH, 2.9), layout="constrained")
    axes = figure.subplots(2, sharex=True)
    walls = [result["wall"] for result in results]
    for axis, name, label in (
            (axes[0], "static", "largest static force\nover the largest allowed"),
            (axes[1], "settled_s", "from touch\nto settled [s]")):
        points = np.array([(wall["stiffness"], wall[name]) for wall in walls
                           if wall["stiffness"] is not None and wall[name] is not None])
        if len(points):
            axis.plot(*points.T, color=BLUE, **DOT)
        axis.set_ylabel(label)
    axes[0].axhline(1.0, **{**LIMIT, "label": "largest allowed"})
    axes[0].legend(loc="best")
    for axis in axes:
        axis.set_ylim(0.0, 1.05 * axis.get_ylim()[1])
    axes[1].set_xlim(0.0, 1.02 * axes[1].get_xlim()[1])
    axes[1].set_xlabel(f"largest slope of the wall's static force [N/m], {len(walls)} runs")
    return figure


def draw_timing(times: Mapping[str, Any]) -> Figure:
    """Draws the distribution of the MPC's step times."""
    figure = Figure(figsize=(COLUMN_WIDTH, 1.9), layout="constrained")
    axis = figure.subplots()
    edges, steps = np.array(times["edges_ms"]), np.array(times["steps"])
    axis.stairs(steps, edges, fill=True, color=BLUE)
    axis.set_yscale("log", nonpositive="clip")
    used = np.flatnonzero(steps)
    _log(axis, edges[used[0]], edges[used[-1] + 1])
    axis.set_ylim(bottom=0.7)
    axis.set_xlabel("wall time of a step of the nominal MPC [ms]")
    axis.set_ylabel("steps")
    return figure


def _log(axis: Axes, low: float, high: float) -> None:
    """Makes the x axis logarithmic, with plain numbers: 1, 2, 5, ... or decades if it is long."""
    axis.set_xscale("log")
    axis.set_xlim(low, high)
    subs = (1.0, 2.0, 5.0) if high < LONG * low else (1.0,)
    axis.xaxis.set_major_locator(LogLocator(subs=subs))
    axis.xaxis.set_major_formatter(FormatStrFormatter("%g"))
    axis.xaxis.set_minor_locator(NullLocator())
