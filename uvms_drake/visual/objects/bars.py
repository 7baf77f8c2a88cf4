"""Bars of the used fraction of each limit."""

from collections.abc import Sequence

import numpy as np

from uvms_drake.visual.stage import Stage, frame_at
from uvms_drake.visual.textured import label, rectangle

USED, ALARM = (0.85, 0.93, 0.97, 1.0), (0.95, 0.15, 0.12, 1.0)
TROUGH, MARK = (0.02, 0.1, 0.16, 0.6), (1.0, 1.0, 1.0, 1.0)


class Bars:
    """Table of bars: as long as the used fraction of a limit, red while the limit is active.

    Args:
        stage: Stage to draw on.
        path: Path of the table on the stage; it is in the xz-plane, seen from −y, with the
            middle of its upper end at the origin.
        names: Texts of the limits.
    """

    COLUMNS = 3
    PITCH = 0.86  # of the columns
    LINE = 0.062  # from row to row
    LENGTH = 0.24  # of a limit that is used up
    height: float
    """Height of the table, which ends that far below its origin."""

    def __init__(self, stage: Stage, path: str, names: Sequence[str]):
        self._stage = stage
        rows = -(-len(names) // self.COLUMNS)
        self.height = rows * self.LINE
        used = -(-len(names) // rows) if rows else 0
        self._bars = [f"{path}/{i}" for i in range(len(names))]
        thick, middle = 0.55 * self.LINE, 0.5 * self.LENGTH
        for i, (bar, name) in enumerate(zip(self._bars, names, strict=True)):
            column, row = divmod(i, rows)
            left = (column - 0.5 * (used - 1)) * self.PITCH + 0.13
            stage.meshcat.SetTransform(bar, frame_at([left, 0.0, -(row + 0.5) * self.LINE]))
            stage.make(f"{bar}/trough", rectangle(self.LENGTH, thick, TROUGH), None,
                       frame_at([middle, 0.006, 0.0]))
            for part in (0.5, 1.0):
                stage.make(f"{bar}/mark/{part}", rectangle(0.005, (0.4 + 0.8 * part) * thick, MARK),
                           None, frame_at([part * self.LENGTH, -0.004, 0.0]))
            stage.make(f"{bar}/used/bar", rectangle(1.0, 0.7 * thick, USED), None,
                       frame_at([0.5, 0.002, 0.0]))
            stage.make(f"{bar}/active/bar", rectangle(self.LENGTH, 1.1 * thick, ALARM), None,
                       frame_at([middle, -0.002, 0.0]))
            stage.make(f"{bar}/name", label(name, 0.8 * self.LINE, align="right"), None,
                       frame_at([-0.03, 0.0, 0.0]))

    def show(self, used: np.ndarray, active: np.ndarray) -> None:
        """Draws the parts `used` (L,) of the limits, and which of them are `active` (L,)."""
        for bar, part, alarm in zip(self._bars, used, active, strict=True):
            self._stage.stretch(f"{bar}/used", self.LENGTH * min(float(part), 1.05), 1.0, 1.0)
            self._stage.show(f"{bar}/active", bool(alarm))
