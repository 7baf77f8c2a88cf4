"""Style of the figures of this package: column width, Okabe–Ito colours, lines."""

from pathlib import Path
from typing import Any

from matplotlib import rc_params_from_file

BLACK, ORANGE, GREEN, BLUE, VERMILION = "#000000", "#E69F00", "#009E73", "#0072B2", "#D55E00"
PURPLE = "#CC79A7"
"""Colours of Okabe and Ito's palette, distinct with every kind of colour vision."""
XYZ = (BLUE, VERMILION, GREEN)
DARKER = ("#00395A", "#6B2F00", "#004F3A")
"""The same three colours, of half the lightness."""

STYLE = rc_params_from_file(
    Path(__file__).with_name("paper.mplstyle"), use_default_template=False)
"""Matplotlib's parameters."""
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
