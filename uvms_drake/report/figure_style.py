"""Style of the figures of this package: column width, Okabe–Ito colours, one legend on top."""

from collections.abc import Sequence
from typing import Any

from cycler import cycler
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

BLACK, ORANGE, GREEN, BLUE, VERMILION = "#000000", "#E69F00", "#009E73", "#0072B2", "#D55E00"
PURPLE = "#CC79A7"
"""Colours of Okabe and Ito's palette, distinct with every kind of colour vision."""
XYZ = (BLUE, VERMILION, GREEN)
DARKER = ("#00395A", "#6B2F00", "#004F3A")
"""The same three colours, of half the lightness."""

STYLE: dict[Any, Any] = {
    "axes.grid": True,
    "axes.labelsize": 8,
    "axes.linewidth": 0.6,
    "axes.prop_cycle": cycler(color=XYZ),
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlelocation": "left",
    "axes.titlesize": 7.5,
    "axes.xmargin": 0.0,
    "font.family": "serif",
    "font.serif": ["STIXGeneral"],
    "font.size": 8,
    "grid.alpha": 0.35,
    "grid.linewidth": 0.4,
    "legend.borderaxespad": 0.2,
    "legend.columnspacing": 1.2,
    "legend.fontsize": 7,
    "legend.frameon": False,
    "legend.handlelength": 1.7,
    "legend.handletextpad": 0.5,
    "lines.linewidth": 1.1,
    "mathtext.fontset": "stix",
    "savefig.dpi": 300,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
}
COLUMN_WIDTH = 3.5  # inches, of a two-column paper
REAL: dict[str, Any] = {"color": BLUE, "label": "real"}
NOMINAL: dict[str, Any] = {"color": ORANGE, "linestyle": (0, (3, 1.5)), "label": "nominal"}
DESIRED: dict[str, Any] = {"color": PURPLE, "linewidth": 0.9, "linestyle": (0, (5, 1.5, 1, 1.5)),
                           "label": "desired"}
LIMIT: dict[str, Any] = {
    "color": BLACK, "linewidth": 0.9, "linestyle": "-", "label": "limit"}
TIGHTENED: dict[str, Any] = {**LIMIT, "color": VERMILION, "linestyle": (0, (1, 1.5)),
                             "label": "tightened"}


def tube_label(certified: bool) -> str:
    """Returns the label of the tube in every figure."""
    return "certified tube" if certified else "tube declared, not certified"


def panels(rows: int, height: float, columns: int = 1, sharex: bool = True,
           ratios: Sequence[float] | None = None) -> tuple[Figure, Any]:
    """Returns a figure with axes (rows, columns) over time, each column as wide as a paper's.

    Args:
        rows: Number of rows.
        height: Height of the figure [in].
        columns: Number of columns.
        sharex: Whether all axes show the same time.
        ratios: Relative heights of the rows; equal if left out.
    """
    figure = Figure(figsize=(COLUMN_WIDTH * columns, height), layout="constrained")
    axes = figure.subplots(rows, columns, sharex=sharex, squeeze=False, height_ratios=ratios)
    for axis in axes.flat:
        axis.xaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))
        axis.yaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 2.5, 5, 10]))
    for axis in axes[-1]:
        axis.set_xlabel("time [s]")
    return figure, axes if columns > 1 else axes[:, 0]


def legend_above(figure: Figure, source: Axes, columns: int = 4) -> None:
    """Puts one legend for all panels on top; its entries come from the axes `source`."""
    entries = dict(zip(*reversed(source.get_legend_handles_labels()), strict=True))
    figure.legend(list(entries.values()), list(entries), ncols=columns, loc="outside upper center")
