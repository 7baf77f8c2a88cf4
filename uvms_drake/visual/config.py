"""Settings of the live picture and the replay of a run."""

from dataclasses import dataclass

from uvms_drake.common.errors import require, within


@dataclass
class VisualConfig:
    """Settings of the picture of a run; the run itself does not depend on them."""

    rate: float = 25.0
    """Pictures in a second of simulated time, live and in the replay [1/s]."""
    magnification: float | None = None
    """Factor by which the deviation from the plan is enlarged, in the ghost of the nominal robot
    and in the inset with the tube; without it, the tube's radius is drawn about 10 cm large."""


def check_visual(visual: VisualConfig) -> None:
    """Raises `InvalidParameter` for the first value outside its range."""
    with within("visual"):
        require(1.0 <= visual.rate <= 100.0, "rate", visual.rate, "1 to 100 pictures in a second")
        require(visual.magnification is None or visual.magnification >= 1.0, "magnification",
                visual.magnification, "at least 1, or left out")
