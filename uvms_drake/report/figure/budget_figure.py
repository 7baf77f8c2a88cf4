"""Figure of a certificate's error budget: each radius by source, and the available margin.

Of the coupled linear loop, whose rows it shows likewise, by chance.
"""

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from uvms_drake.report.figure_style import (
    BLACK,
    BLUE,
    COLUMN_WIDTH,
    GREEN,
    LIMIT,
    ORANGE,
    PURPLE,
    VERMILION,
)

UNITS = {"attitude": "mrad", "joints": "mrad", "roll": "mrad", "pitch": "mrad",
         "depth_speed": "mm/s", "contact_speed": "mm/s"}
"""Units of the radii other than lengths in millimetres, and joints q₁, q₂, ... in milliradians."""
COLORS = (BLUE, VERMILION, GREEN, ORANGE, PURPLE, BLACK)
HATCHES = ("", "////", "....")
"""Hatches of successive cycles through the colours."""
VISIBLE = 0.01
"""Smallest share of a source in any radius that has an entry in the legend."""


def draw_budget(budget: Mapping[str, Mapping[str, float]], margins: Mapping[str, float]) -> Figure:
    """Draws a bar for each radius, stacked by source.

    Args:
        budget: Contributions to the radii by source, finite [m, rad, m/s].
        margins: Available margins of some radii.
    """
    figure = Figure(figsize=(2.0 * COLUMN_WIDTH, 2.6), layout="constrained")
    axes = np.atleast_1d(figure.subplots(1, len(budget)))
    sums = {name: sum(parts.values()) for name, parts in budget.items()}
    sources = [source for source in next(iter(budget.values())) if any(
        parts[source] > VISIBLE * sums[name] for name, parts in budget.items())]
    for axis, (name, parts) in zip(axes, budget.items(), strict=True):
        below = 0.0
        for i, source in enumerate(sources):
            part = 1e3 * parts[source]
            axis.bar(0.0, part, bottom=below, color=COLORS[i % len(COLORS)], alpha=0.8,
                     hatch=HATCHES[i // len(COLORS) % len(HATCHES)], edgecolor="white",
                     linewidth=0.4, label=source)
            below += part
        remainder = 1e3 * sums[name] - below
        if remainder > 0.0:  # Sources without an entry in the legend.
            axis.bar(0.0, remainder, bottom=below, color="0.8", label="all others")
        if name in margins:
            axis.axhline(1e3 * margins[name], **{**LIMIT, "label": "available margin"})
        unit = "mrad" if name[:1] == "q" and name[1:].isdigit() else UNITS.get(name, "mm")
        axis.set_title(f"{name.replace('_', ' ')} [{unit}]")
        axis.set_xticks([])
        axis.set_ylim(bottom=0.0)
    entries = {label: handle for axis in axes for handle, label in zip(
        *axis.get_legend_handles_labels(), strict=True)}
    figure.legend(list(entries.values()), list(entries), loc="outside right center")
    return figure
