"""Figures of the benchmark: errors of the force in colour, and the force over time."""

from collections.abc import Sequence
from itertools import cycle
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from uvms_drake.benchmark.benchmark import SAMPLED
from uvms_drake.benchmark.cases import CASES
from uvms_drake.benchmark.controllers import CONTROLLERS, FACTORY, TUBE
from uvms_drake.report import figure_style as style

OVERVIEW = "benchmark.png"
RANGE = (0.5, 50.0)
"""Range of the colours [% of the desired force]."""
DARK = 8.0
"""Error from which on a cell's text is white [%]."""
COLUMNS = 3
GREY = "#777777"
LINES = [(color, dash) for dash in ("-", (0, (2, 1)), (0, (4, 1, 1, 1)))
         for color in (style.ORANGE, style.GREEN, style.VERMILION, GREY)]
"""Colours and line styles of the controllers but the tube MPC, which is blue and in front; those
of this package have the same in every figure."""

Results = Sequence[dict[str, Any]]


def title_of(name: str) -> str:
    """Returns the name of a controller in a figure: without the folder of a file of one's own."""
    return Path(name).name.removesuffix(f":{FACTORY}").replace("_", " ")


def figure_name(robot: str) -> str:
    """Returns the name of the figure of a robot."""
    return f"benchmark_{robot}.png"


def write_figures(results: Results, summary: dict[str, Any], folder: Path) -> None:
    """Writes the overview of a summary, and the figure of each robot with samples."""
    own = {robot: [result for result in results if result["robot"] == robot and SAMPLED in result]
           for robot in summary["robots"]}
    with matplotlib.rc_context(style.STYLE):
        if not all(CASES[case].outside for case in summary["cases"]):
            draw_overview(summary).savefig(folder / OVERVIEW, dpi=200)
        for robot, sampled in own.items():
            if sampled:
                draw_forces(sampled).savefig(folder / figure_name(robot), dpi=200)


def relative_errors(summary: dict[str, Any], robot: str, names: list[str]) -> np.ndarray:
    """Returns the medians of the force's rms error (controllers, cases) [% of the desired force].

    They are of the cases within the declared class, infinite for a run that failed or never
    touched, and NaN without a run.
    """
    cells, desired = summary["cells"][robot], summary["desired"].get(robot, np.nan)
    return 100.0 / desired * np.array([[
        cells[case][name]["force_rms"]["median"] if cells[case][name]["runs"] else np.nan
        for case in _inside(summary)] for name in names])


def _inside(summary: dict[str, Any]) -> list[str]:
    """Returns the cases in which a force is to be held."""
    return [case for case in summary["cases"] if not CASES[case].outside]


def draw_overview(summary: dict[str, Any]) -> Figure:
    """Draws a matrix of controllers and cases for each robot, the tube MPC in the first row."""
    names = sorted(summary["controllers"], key=lambda name: name != TUBE)
    cases, robots = _inside(summary), summary["robots"]
    height = 1.1 + len(robots) * (0.35 + 0.19 * len(names))
    figure = Figure(figsize=(7.0, height), layout="constrained")
    axes = figure.subplots(len(robots), 1, sharex=True, squeeze=False)[:, 0]
    for axis, robot in zip(axes, robots, strict=True):
        errors = relative_errors(summary, robot, names)
        drawn = axis.imshow(np.where(np.isfinite(errors), errors, np.nan), cmap="Blues",
                            norm=LogNorm(*RANGE), aspect="auto")
        for (row, column), error in np.ndenumerate(errors):
            cell = summary["cells"][robot][cases[column]][names[row]]
            _mark(axis, row, column, error, bool(cell.get("limits")))
        axis.set_yticks(range(len(names)), [title_of(name) for name in names])
        axis.get_yticklabels()[0].set_fontweight("bold")
        axis.set_title(robot, loc="left", fontsize=8)
        axis.tick_params(length=0)
        axis.grid(visible=False)
    axes[-1].set_xticks(range(len(cases)), [case.replace("_", " ") for case in cases],
                        rotation=40, ha="right")
    figure.colorbar(drawn, ax=list(axes), pad=0.01, extend="both",
                    label="rms error of the force\nin the last seconds [%]")
    figure.supxlabel("framed: a limit is broken;  –: half of the runs failed or never touched",
                     fontsize=7)
    return figure


def _mark(axis: Axes, row: int, column: int, error: float, broken: bool) -> None:
    """Writes the error of a cell, and frames one in which a limit is broken."""
    if np.isnan(error):
        return
    text = f"{error:.1f}" if error < 9.95 else f"{error:.0f}"
    axis.text(column, row, text if np.isfinite(error) else "–", ha="center", va="center",
              fontsize=6, color="white" if DARK < error < np.inf else style.BLACK)
    if broken:
        axis.add_patch(Rectangle((column - 0.44, row - 0.42), 0.88, 0.84, fill=False,
                                 edgecolor=style.VERMILION, linewidth=0.9))


def draw_forces(results: Results) -> Figure:
    """Draws the force along x of the first draw of every case, since its event, or the touch."""
    cases = [name for name in CASES if any(result["case"] == name for result in results)]
    names = list(dict.fromkeys(result["controller"] for result in results))
    rows = -(-len(cases) // COLUMNS)
    figure = Figure(figsize=(7.0, 0.5 + 1.35 * rows), layout="constrained")
    axes = figure.subplots(rows, COLUMNS, sharex=True, squeeze=False).reshape(-1)
    known = [name for name in dict.fromkeys([*CONTROLLERS, *names]) if name != TUBE]
    lines = dict(zip(known, cycle(LINES), strict=False)) | {TUBE: (style.BLUE, "-")}
    # A panel for each case; the tube MPC is in front of all others.
    for axis, case in zip(axes, cases, strict=False):
        first = {result["controller"]: result for result in results
                 if result["case"] == case and result["index"] == 0}
        desired = max((result["desired"] for result in first.values()), default=0.0)
        axis.axhline(desired, **style.DESIRED)
        for name in (name for name in names if name in first):
            curve, is_tube = first[name][SAMPLED], name == TUBE
            color, dash = lines[name]
            begun = first[name].get("event") or first[name]["touch"] or 0.0
            axis.plot(np.array(curve["time"]) - begun, curve["force"],
                      color=color, linestyle=dash, linewidth=1.3 if is_tube else 0.8,
                      zorder=3 if is_tube else 2, label=title_of(name))
        axis.set_title(CASES[case].text.split(":")[0], fontsize=6.5)
        axis.set(ylim=(0.0, 2.0 * desired), xlim=(-1.0, 14.0), xticks=[0.0, 5.0, 10.0])
    for axis in axes[len(cases):]:
        axis.set_axis_off()
    for axis in axes[max(len(cases) - COLUMNS, 0): len(cases)]:
        axis.set_xlabel("time since touch or event [s]")
        axis.tick_params(labelbottom=True)
    for axis in axes[: len(cases): COLUMNS]:
        axis.set_ylabel("force [N]", color=style.BLACK)
    figure.legend(*axes[0].get_legend_handles_labels(), ncols=5, loc="outside upper center")
    return figure
