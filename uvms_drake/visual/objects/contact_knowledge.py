"""What a robot that feels its way knows of a wall: how far it may go, and where the wall begins."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from pydrake.geometry import Cylinder, Rgba

from uvms_drake.visual.objects.readout import Readout
from uvms_drake.visual.stage import NED, Stage, frame_at
from uvms_drake.visual.textured import CORNERS, textured_mesh

EXPLORED, FELT = (0.3, 1.0, 0.65), (1.0, 0.9, 0.2)
FILL, RIM = 54, 240
"""Opacity of the pane and of its rim, of 255."""
LARGEST = 9999.0
"""Largest number that is shown."""
LINE = 0.06
"""Height of a line of numbers on the board."""


@dataclass(frozen=True)
class ContactSpecification:
    """The part of a `SensedContact` that a picture needs."""

    direction: np.ndarray
    """Direction n into the wall (3,), a unit vector in Σ_I."""
    margin: float
    """Distance E that the real tip may be beyond the planned one [m]."""


@dataclass(frozen=True)
class ContactKnowledge:
    """What was felt up to an instant; nothing, by default. See `ContactEstimator`."""

    force_last_valid: np.ndarray = field(default_factory=lambda: np.zeros(6))
    """Force 𝔉_s that the law takes (6,) [N, N m]."""
    safe_depth: float = -np.inf
    """Depth x_safe up to which the planned tip may go [m]; −inf: nothing is explored."""
    contact_depth: float = np.nan
    """Depth at which the wall should begin [m]; NaN: it was not touched yet."""
    slope: float = 0.0
    """Learned slope κ̂ [N/m]."""


KNOWN = {"force_last_valid": 6, "safe_depth": 1, "contact_depth": 1, "slope": 1}
"""Signals of a station that are known, and their sizes."""


def contact_knowledge_from(signals: Mapping[str, np.ndarray]) -> ContactKnowledge:
    """Returns what is known by the values of `KNOWN` at an instant; nothing if one is missing."""
    if not signals.keys() >= KNOWN.keys():
        return ContactKnowledge()
    return ContactKnowledge(signals["force_last_valid"], *(
        float(signals[name][0]) for name, size in KNOWN.items() if size == 1))


class DrawnKnowledge:
    """A pane at the end of what is explored, a frame where the wall should begin, three numbers.

    The pane is where n·𝔭 = x_safe + E: as far as the real tip may be. Pane and frame are across n,
    in front of the tip or behind it; each is hidden as long as there is none.

    Args:
        stage: Where to draw.
        board: Path of the numbers on the stage, in the xz-plane, seen from −y.
        specification: What the robot was told.
        start: Where it is at t = 0 (3,) [m]: from there on explored depths are counted.
    """

    FRONT, WALL = f"{NED}/contact_estimator", f"{NED}/believed_wall"
    """Paths of the pane and the frame, by which they are hidden in Meshcat's controls."""
    SIDE, ROD = 0.6, 0.003  # m

    def __init__(self, stage: Stage, board: str, specification: ContactSpecification, start: np.ndarray):
        self._stage, self._told = stage, specification
        self._origin = float(specification.direction @ start)
        half, long = 0.5 * self.SIDE, self.SIDE + self.ROD
        corners = half * np.array([[-1.0, -1.0, 0], [1.0, -1.0, 0], [1.0, 1.0, 0], [-1.0, 1.0, 0]])
        stage.make(f"{self.FRONT}/size/pane", textured_mesh(
            corners, CORNERS, np.array([[0, 1, 2], [0, 2, 3]]), pane()))
        for i, end in enumerate(corners):
            along = corners[(i + 1) % 4] - end
            stage.make(f"{self.WALL}/size/{i}", Cylinder(self.ROD, long), Rgba(*FELT),
                       frame_at(end + 0.5 * along, along))
        self._numbers = {}
        for i, (name, after, color) in enumerate((
                ("felt", " N felt", FELT), ("slope", " N/m", FELT),
                ("explored", " mm explored", EXPLORED))):
            path = f"{board}/{name}"
            stage.meshcat.SetTransform(path, frame_at([0.0, 0.0, -1.3 * LINE * i]))
            self._numbers[name] = Readout(
                stage, f"{path}/number", "", after, LARGEST, LINE, color, tenths=False)

    def show(self, known: ContactKnowledge, tip: np.ndarray) -> None:
        """Draws what is known with the tip at a place (3,) in Σ_I."""
        explored = known.safe_depth + self._told.margin
        self._show_at(self.FRONT, tip, explored)
        self._show_at(self.WALL, tip, known.contact_depth)
        self._numbers["felt"].show(float(self._told.direction @ known.force_last_valid[:3]))
        self._numbers["explored"].show(1e3 * max(explored - self._origin, 0.0))
        self._numbers["slope"].show(known.slope)

    def _show_at(self, path: str, tip: np.ndarray, depth: float) -> None:
        """Shows an object across n at a depth [m], or hides it if that is not finite."""
        if np.isfinite(depth):
            self._stage.move(path, frame_at(
                at_depth(tip, depth, self._told.direction), -self._told.direction))
        self._stage.show(f"{path}/size", bool(np.isfinite(depth)))


def at_depth(point: np.ndarray, depth: float, direction: np.ndarray) -> np.ndarray:
    """Returns the place (3,) beside a point (3,), across n (3,), with n·𝔭 = depth [m]."""
    return point + (depth - direction @ point) * direction


def pane() -> np.ndarray:
    """Returns the picture of a pane of glass with a rim, RGBA (rows, columns, 4)."""
    at = np.abs(np.arange(240.0) - 119.5)
    rim = np.maximum(at, at[:, None]) > 116.0
    picture = np.empty((*rim.shape, 4))
    picture[..., :3], picture[..., 3] = 255.0 * np.array(EXPLORED), np.where(rim, RIM, FILL)
    return picture.astype(np.uint8)
