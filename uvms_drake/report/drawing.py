"""Figures as data: columns of panels, panels of series; `draw` is the one function that draws.

A figure of a run is a function from its `Record` to a `Drawing` of signals with their units and
styles; of Matplotlib it knows the styles of lines alone.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FormatStrFormatter, LogLocator, MaxNLocator, NullLocator

from uvms_drake.report.figure_style import COLUMN_WIDTH, LIMIT, NOMINAL, REAL, STYLE, TIGHTENED

HEADROOM = 1.12
"""End of an axis that begins at zero, over the highest value."""
TIME = "time [s]"


@dataclass(frozen=True)
class Series:
    """Curve, level or band of a panel."""

    y: np.ndarray | float
    """Values (T,); a number is a level."""
    style: Mapping[str, Any] = field(default_factory=dict)
    """Colour, line, label, ...: keywords of Matplotlib."""
    upper: np.ndarray | float | None = None
    """Upper end of a band whose lower one is `y`; None: a line."""
    x: np.ndarray | None = None
    """Values (T,) of the abscissa, of a curve; None: the panel's."""
    extends: bool = True
    """Whether the ordinate extends to all of it."""


@dataclass(frozen=True)
class Instant:
    """Thin line at an instant, with a word."""

    time: float
    """The instant [s]."""
    text: str
    align: str = "left"
    """Side of the word, above the panel, that is at the line; `inside`: upright in the panel."""


@dataclass(frozen=True)
class Panel:
    """Axes with their series."""

    label: str
    """Label of the ordinate, with its unit."""
    x: np.ndarray
    """Abscissa of the series (T,)."""
    series: Sequence[Series]
    title: str = ""
    scale: str = "free"
    """Ordinate: `free`, from `zero`, or `log`."""
    limits: tuple[float, float] | None = None
    """Ends of the ordinate; None: as the scale has them."""
    window: tuple[float, float] | None = None
    """Ends of the abscissa; None: shared with the neighbours, and all of the series."""
    x_label: str = TIME
    legend: int = 0
    """Number of columns of a legend of its own, above it; 0: none."""
    instants: Sequence[Instant] = ()
    rows: Sequence[str] | None = None
    """Names of the values 0, −1, −2, ... of the ordinate, in place of numbers."""
    height: float = 1.0
    """Height relative to the other panels."""


@dataclass(frozen=True)
class Drawing:
    """Figure as data."""

    columns: Sequence[Sequence[Panel]]
    """Columns of panels from the left, each from the top; each is as wide as a paper's."""
    height: float
    """Height of the figure [in]."""
    legend: int = 4
    """Number of columns of the legend on top."""
    key: Sequence[Series] | None = None
    """Series that it explains; None: those of the first panel."""


def line(y: np.ndarray | float, style: Mapping[str, Any] = REAL, *, x: np.ndarray | None = None,
         **changes: Any) -> Series:
    """Returns a curve (T,) or a level in a style with changes; `x` replaces the panel's."""
    return Series(y, {**style, **changes}, x=x)


def band(lower: np.ndarray | float, upper: np.ndarray | float, *, extends: bool = True,
         x: np.ndarray | None = None, **style: Any) -> Series:
    """Returns the band between curves (T,) or levels."""
    return Series(lower, style, upper, x, extends)


def pair(real: np.ndarray, nominal: np.ndarray) -> list[Series]:
    """Returns a real and a nominal signal (T,)."""
    return [line(real), line(nominal, NOMINAL)]


def levels(limit: float, tightened: float) -> list[Series]:
    """Returns a limit, full and tightened; nothing if it is infinite."""
    return [line(limit, LIMIT), line(tightened, TIGHTENED)] if np.isfinite(limit) else []


def draw(drawing: Drawing) -> Figure:
    """Returns a drawing as a figure of Matplotlib."""
    rows, columns = max(map(len, drawing.columns)), len(drawing.columns)
    figure = Figure(figsize=(COLUMN_WIDTH * columns, drawing.height), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, height_ratios=[
        panel.height for panel in max(drawing.columns, key=len)])
    for axis_column, column in zip(axes.T, drawing.columns, strict=True):
        for axis in axis_column[len(column):]:
            axis.set_visible(False)
        for axis, panel in zip(axis_column, column, strict=False):
            axis.xaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))
            axis.yaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 2.5, 5, 10]))
            _draw_panel(axis, panel)
        _share_abscissa(axis_column[:len(column)], column)
    entries = drawing.columns[0][0].series if drawing.key is None else drawing.key
    if found := handles(entries):
        figure.legend(handles=found, ncols=drawing.legend, loc="outside upper center")
    return figure


def save(drawing: Drawing, path: Path) -> None:
    """Writes a drawing as a file, in the package's style."""
    with matplotlib.rc_context(STYLE):
        draw(drawing).savefig(path)


def handles(series: Iterable[Series]) -> list[Artist]:
    """Returns the entries of a legend: each label once."""
    named = {each.style["label"]: each for each in series if each.style.get("label")}
    return [Line2D([], [], **each.style) if each.upper is None
            else Patch(linewidth=0, **each.style) for each in named.values()]


def _draw_panel(axis: Axes, panel: Panel) -> None:
    for each in sorted(panel.series, key=lambda each: not each.extends):
        limits = axis.get_ylim()
        _draw_series(axis, panel.x if each.x is None else each.x, each)
        if not each.extends:
            axis.set_ylim(*limits)
    axis.set_ylabel(panel.label)
    axis.set_title(panel.title)
    _scale(axis, panel)
    for mark in panel.instants:
        inside = mark.align == "inside"
        axis.axvline(mark.time, color="0.35", linewidth=0.5)
        axis.annotate(
            mark.text, (mark.time, 1.0), (1.0, -1.0) if inside else (0.0, 1.0), color="0.35",
            xycoords=axis.get_xaxis_transform(), textcoords="offset points",
            fontsize=5 if inside else 6, rotation=90 if inside else 0,
            va="top" if inside else "bottom", ha="left" if inside else mark.align)
    if panel.legend:
        axis.legend(handles=handles(panel.series), ncols=panel.legend, loc="lower right",
                    bbox_to_anchor=(1.0, 1.0))


def _draw_series(axis: Axes, x: np.ndarray, series: Series) -> None:
    y, upper, style = series.y, series.upper, series.style
    if upper is not None and np.ndim(y) == np.ndim(upper) == 0:
        axis.axhspan(float(y), float(upper), linewidth=0, **style)
    elif upper is not None:
        axis.fill_between(x, y, upper, linewidth=0, **style)
    elif np.ndim(y) == 0:
        axis.axhline(float(y), **style)
    else:
        axis.plot(x, y, **style)


def _scale(axis: Axes, panel: Panel) -> None:
    """Applies scale, limits and rows of a panel to its ordinate."""
    if panel.scale == "log":
        axis.set_yscale("log")
    if panel.scale == "log" and panel.limits is None:  # A decade or two, in plain numbers.
        axis.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.yaxis.set_major_formatter(FormatStrFormatter("%g"))
        axis.yaxis.set_minor_locator(NullLocator())
    if panel.scale == "zero":
        highest = max(float(np.nanmax(np.append(each.y, 0.0))) for each in panel.series
                      if each.upper is None)
        axis.set_ylim(0.0, HEADROOM * highest or 1.0)
        if highest == 0.0:
            axis.set_yticks([0.0])
    if panel.limits is not None:
        axis.set_ylim(*panel.limits)
    if panel.rows is not None:
        axis.set_yticks(-np.arange(len(panel.rows)), panel.rows)
        axis.grid(visible=False, axis="y")


def _share_abscissa(axes: Sequence[Axes], column: Sequence[Panel]) -> None:
    """Labels the abscissa below the last of the neighbours that share it."""
    for i, (axis, panel) in enumerate(zip(axes, column, strict=True)):
        last = i + 1 == len(column) or (
            (panel.window, panel.x_label) != (column[i + 1].window, column[i + 1].x_label))
        axis.tick_params(labelbottom=last)
        axis.set_xlabel(panel.x_label if last else "")
        if not last:
            axis.sharex(axes[i + 1])
        if panel.window is not None:
            axis.set_xlim(*panel.window)
