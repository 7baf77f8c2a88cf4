"""Settings of the live picture and the replay of a run."""

from dataclasses import dataclass
from typing import Annotated

from uvms_drake.common.constraints import AtLeast, Between


@dataclass
class VisualConfig:
    """Settings of the picture of a run; the run itself does not depend on them."""

    rate: Annotated[float, Between(1, 100, " pictures in a second")] = 25.0
    """Pictures in a second of simulated time, live and in the replay [1/s]."""
    magnification: Annotated[float, AtLeast(1)] | None = None
    """Factor by which the deviation from the plan is enlarged, in the ghost of the nominal robot
    and in the inset with the tube; without it, the tube's radius is drawn about 10 cm large."""
