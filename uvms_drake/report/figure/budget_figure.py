"""The figure of a certificate's budget: who takes how much of each radius, and what is left."""

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

UNITS = {"attitude": "mrad", "joints": "mrad", "depth_speed": "mm/s", "contact_speed": "mm/s"}
"""Units of the radii that are no lengths in millimetres."""
COLORS = (BLUE, VERMILION, GREEN, ORANGE, PURPLE, BLACK)
HATCHES = ("", "////", "....")
"""One for each time that the colours are used again."""
VISIBLE = 0.01
"""Part of the largest share of any radius from which on a source has a name in the legend."""


def draw_budget(budget: Mapping[str, Mapping[str, float]], room: Mapping[str, float]) -> Figure:
    """Draws a bar for each radius, the parts of its sources one on top of the other.

    Args:
        budget: Parts of radii by source, finite.
        room: What limits leave of some of them.
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
        rest = 1e3 * sums[name] - below
        if rest > 0.0:
            axis.bar(0.0, rest, bottom=below, color="0.8", label="all others")
        if name in room:
            axis.axhline(1e3 * room[name], **{**LIMIT, "label": "what limits leave"})
        axis.set_title(f"{name.replace('_', ' ')} [{UNITS.get(name, 'mm')}]")
        axis.set_xticks([])
        axis.set_ylim(bottom=0.0)
    entries = {label: handle for axis in axes for handle, label in zip(
        *axis.get_legend_handles_labels(), strict=True)}
    figure.legend(list(entries.values()), list(entries), loc="outside right center")
    return figure
