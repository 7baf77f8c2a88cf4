"""Small multiples of the benchmark: the force over time, a panel for each case."""

from collections.abc import Sequence
from itertools import cycle
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from uvms_drake.benchmark.benchmark import SAMPLED
from uvms_drake.benchmark.cases import CASES
from uvms_drake.benchmark.controllers import CONTROLLERS, TUBE
from uvms_drake.report.figure_style import (
    BLACK,
    BLUE,
    DESIRED,
    GREEN,
    ORANGE,
    STYLE,
    VERMILION,
    legend_above,
)

COLUMNS = 3
GREY = "#777777"
LINES = [(color, style) for style in ("-", (0, (2, 1)))
         for color in (ORANGE, GREEN, VERMILION, GREY)]
"""Colours and line styles of the controllers but the tube MPC, which is blue and in front; those
of this package have the same in every figure."""


def figure_name(robot: str) -> str:
    """Returns the name of the figure of a robot."""
    return f"benchmark_{robot}.png"


def write_figures(results: Sequence[dict[str, Any]], folder: Path) -> list[Path]:
    """Writes a figure for each robot of the results; returns their paths."""
    paths = []
    for robot in dict.fromkeys(result["robot"] for result in results):
        own = [result for result in results if result["robot"] == robot and SAMPLED in result]
        if own:
            paths.append(folder / figure_name(robot))
            with matplotlib.rc_context(STYLE):
                draw(own).savefig(paths[-1], dpi=200)
    return paths


def draw(results: Sequence[dict[str, Any]]) -> Figure:
    """Draws the force along x of the first draw of every case, since the touch."""
    cases = [name for name in CASES if any(result["case"] == name for result in results)]
    names = list(dict.fromkeys(result["controller"] for result in results))
    rows = -(-len(cases) // COLUMNS)
    figure = Figure(figsize=(7.0, 0.5 + 1.35 * rows), layout="constrained")
    axes = np.atleast_1d(figure.subplots(rows, COLUMNS, sharex=True, squeeze=False)).reshape(-1)
    # One panel for each case, the tube MPC in front.
    known = [name for name in dict.fromkeys([*CONTROLLERS, *names]) if name != TUBE]
    others = dict(zip(known, cycle(LINES), strict=False))
    for axis, case in zip(axes, cases, strict=False):
        drawn = {result["controller"]: result for result in results
                 if result["case"] == case and result["index"] == 0}
        desired = next(iter(drawn.values()))["desired"] if drawn else 0.0
        axis.axhline(desired, **DESIRED)
        for name in names:
            if name not in drawn:
                continue
            result = drawn[name]
            color, style = others.get(name, (BLUE, "-"))
            time = np.array(result[SAMPLED]["time"]) - (result["touch"] or 0.0)
            axis.plot(time, result[SAMPLED]["force"], color=color, linestyle=style,
                      linewidth=1.3 if name == TUBE else 0.8, zorder=3 if name == TUBE else 2,
                      label=name.replace("_", " "))
        axis.set_title(CASES[case].text.split(":")[0], fontsize=6.5)
        axis.set_ylim(0.0, 2.0 * desired)
        axis.set_xlim(-1.0, 14.0)
        axis.set_xticks([0.0, 5.0, 10.0])
    for axis in axes[len(cases):]:
        axis.set_axis_off()
    for axis in axes[max(len(cases) - COLUMNS, 0): len(cases)]:
        axis.set_xlabel("time since the touch [s]")
        axis.tick_params(labelbottom=True)
    for axis in axes[: len(cases): COLUMNS]:
        axis.set_ylabel("force [N]", color=BLACK)
    if cases:
        legend_above(figure, axes[0], columns=5)
    return figure
