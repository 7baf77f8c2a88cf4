"""A number that changes."""

import numpy as np

from uvms_drake.visual.stage import Stage, frame_at
from uvms_drake.visual.textured import label

DIGIT = 0.53
"""Width of a digit, over the height of a line."""
POINT = 0.27
"""Width of the point, likewise."""


class Readout:
    """A number between two texts: all ten digits exist at each place, one is shown.

    It is in the xz-plane, seen from −y, and begins at the origin of its path.

    Args:
        stage: Stage to draw on.
        path: Path of the number on the stage.
        before, after: Texts to its left and to its right.
        largest: Largest number that is shown.
        height: Height of a line.
        color: Colour of all of it: red, green and blue from 0 to 1.
        tenths: Whether it is shown to a tenth; every change of a digit is in the recording.
    """

    def __init__(self, stage: Stage, path: str, before: str, after: str, largest: float,
                 height: float, color: tuple[float, float, float] = (1.0, 1.0, 1.0),
                 *, tenths: bool = True):
        self._stage, self._path = stage, path
        whole = len(str(int(largest)))
        self._powers = [*range(whole, 0, -1), *([0] if tenths else [])]  # of ten, of the tenths
        self._digit = DIGIT * height
        self._largest = 10 ** (whole + 1) - 1

        def write(name: str, text: str, x: float, align: str) -> None:
            stage.make(f"{path}/{name}", label(text, height, bold=True, color=color, align=align),
                       None, frame_at([x * height, 0.0, 0.0]))

        if before:
            write("before/text", before, 0.0, "right")
        for i, power in enumerate(self._powers):
            left = (i + 0.5) * DIGIT + (0.0 if power else POINT)
            for digit in range(10):
                write(f"{power}/{digit}/text", str(digit), left, "center")
        if tenths:
            write("point", ".", whole * DIGIT + 0.5 * POINT, "center")
        write("after", after, (whole + 1) * DIGIT + POINT if tenths else whole * DIGIT, "left")

    def show(self, value: float, place: np.ndarray | None = None) -> None:
        """Shows the nearest displayable number, at `place` (3,) if given."""
        # The text before the number is close to its first digit.
        unit = 1 if self._powers[-1] == 0 else 10  # of the last digit, in tenths
        tenths = min(max(round(10.0 * value / unit) * unit, 0), self._largest)
        if place is not None:
            self._stage.move(self._path, frame_at(place))
        missing = self._powers[0] - max(len(str(tenths)) - 1, 1)
        self._stage.move(f"{self._path}/before", frame_at([missing * self._digit, 0.0, 0.0]))
        for power in self._powers:
            shown = tenths // 10**power % 10 if power < 2 or tenths >= 10**power else None
            for digit in range(10):
                self._stage.show(f"{self._path}/{power}/{digit}", digit == shown)
