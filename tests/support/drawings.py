"""What a figure shows, read from its data."""

import numpy as np

from uvms_drake.report.drawing import Drawing, Panel


def panels_of(drawing: Drawing) -> list[Panel]:
    """Returns the panels of a figure, column by column."""
    return [panel for column in drawing.columns for panel in column]


def shown(panel: Panel, label: str) -> list[np.ndarray]:
    """Returns the lines of a panel with a label."""
    return [np.asarray(each.y) for each in panel.series
            if each.upper is None and each.style.get("label") == label]


def levels(panel: Panel, label: str) -> list[float]:
    """Returns the levels of a panel with a label, the lowest first."""
    return sorted(float(y) for y in shown(panel, label))


def bands(panel: Panel, label: str) -> list[tuple[float, float]]:
    """Returns the ends of the bands of a panel whose label has a text."""
    return [(float(np.nanmin(each.y)), float(np.nanmax(each.upper))) for each in panel.series
            if each.upper is not None and label in each.style.get("label", "")]
