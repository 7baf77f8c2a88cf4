"""Style of the figures of this package: column width, Okabe–Ito colours, lines."""

from typing import Any

from cycler import cycler

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
