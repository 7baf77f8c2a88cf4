"""Estimate of an unknown surface in the picture: end of the safe region, surface, stiffness."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from pydrake.geometry import Cylinder, Rgba

from uvms_drake.visual.objects.readout import Readout
from uvms_drake.visual.stage import NED, Stage, frame_at
from uvms_drake.visual.textured import CORNERS, textured_mesh

EXPLORED, ESTIMATED = (0.3, 1.0, 0.65), (1.0, 0.9, 0.2)
FILL, RIM = 54, 240
"""Opacity of the pane and of its rim, of 255."""
LARGEST = 9999.0
"""Largest number that is shown."""
LINE = 0.06
"""Height of a line of numbers on the board."""


@dataclass(frozen=True)
class ContactSpecification:
    """Fields of a `SensedContact` that a picture needs."""

    direction: np.ndarray
    """Direction n into the wall (3,), a unit vector in Σ_I."""
    margin: float
    """Largest distance E of the real tip beyond the planned one [m]."""


@dataclass(frozen=True)
class ContactKnowledge:
    """Contact estimate at an instant; the default is that before any contact."""

    force_last_valid: np.ndarray = field(default_factory=lambda: np.zeros(6))
    """Last valid force 𝔉_s (6,) [N, N m]."""
    safe_depth: float = -np.inf
    """Largest safe depth x_safe of the planned tip [m]; −inf: nothing is explored."""
    contact_depth: float = np.nan
    """Estimated depth of the undeformed surface [m]; NaN: not touched yet."""
    stiffness_estimate: float = np.nan
    """Mean of the estimated stiffness [N/m]; NaN: not touched yet."""


KNOWN = {"force_last_valid": 6, "safe_depth": 1, "contact_depth": 1, "stiffness_estimate": 1}
"""Signals of a station that make up the estimate, and their sizes."""


def contact_knowledge_from(signals: Mapping[str, np.ndarray]) -> ContactKnowledge:
    """Returns the estimate from the values of `KNOWN`; the default if one is missing."""
    if not signals.keys() >= KNOWN.keys():
        return ContactKnowledge()
    return ContactKnowledge(signals["force_last_valid"], *(
        float(signals[name][0]) for name, size in KNOWN.items() if size == 1))


class DrawnKnowledge:
    """Pane at the end of the safe region, frame at the estimated surface, three numbers.

    The pane is at n·𝔭 = x_safe + E, the largest depth of the real tip. Pane and frame are normal
    to n, at the tip; each is hidden as long as its depth is not finite.

    Args:
        stage: Stage to draw on.
        board: Path of the numbers on the stage, in the xz-plane, seen from −y.
        specification: Specification of the contact.
        start: Position of the tip at t = 0 (3,) [m], the origin of explored depths.
    """

    SAFE_END, WALL = f"{NED}/contact_estimator", f"{NED}/estimated_surface"
    """Paths of the pane and the frame, by which Meshcat's controls hide them."""
    SIDE, ROD = 0.6, 0.003  # m

    def __init__(self, stage: Stage, board: str, specification: ContactSpecification,
                 start: np.ndarray):
        self._stage, self._specification = stage, specification
        self._origin = float(specification.direction @ start)
        half, long = 0.5 * self.SIDE, self.SIDE + self.ROD
        corners = half * np.array([[-1.0, -1.0, 0], [1.0, -1.0, 0], [1.0, 1.0, 0], [-1.0, 1.0, 0]])
        stage.make(f"{self.SAFE_END}/size/pane", textured_mesh(
            corners, CORNERS, np.array([[0, 1, 2], [0, 2, 3]]), pane()))
        for i, end in enumerate(corners):
            along = corners[(i + 1) % 4] - end
            stage.make(f"{self.WALL}/size/{i}", Cylinder(self.ROD, long), Rgba(*ESTIMATED),
                       frame_at(end + 0.5 * along, along))
        self._numbers = {}
        for i, (name, after, color) in enumerate((
                ("measured", " N measured", ESTIMATED), ("stiffness", " N/m", ESTIMATED),
                ("explored", " mm explored", EXPLORED))):
            path = f"{board}/{name}"
            stage.meshcat.SetTransform(path, frame_at([0.0, 0.0, -1.3 * LINE * i]))
            self._numbers[name] = Readout(
                stage, f"{path}/number", "", after, LARGEST, LINE, color, tenths=False)

    def show(self, known: ContactKnowledge, tip: np.ndarray) -> None:
        """Draws the estimate with the tip at a place (3,) in Σ_I."""
        explored = known.safe_depth + self._specification.margin
        self._show_at(self.SAFE_END, tip, explored)
        self._show_at(self.WALL, tip, known.contact_depth)
        self._numbers["measured"].show(
            float(self._specification.direction @ known.force_last_valid[:3]))
        self._numbers["explored"].show(1e3 * max(explored - self._origin, 0.0))
        self._numbers["stiffness"].show(float(np.nan_to_num(known.stiffness_estimate)))

    def _show_at(self, path: str, tip: np.ndarray, depth: float) -> None:
        """Shows an object normal to n at a depth [m], or hides it if that is not finite."""
        if np.isfinite(depth):
            direction = self._specification.direction
            self._stage.move(path, frame_at(at_depth(tip, depth, direction), -direction))
        self._stage.show(f"{path}/size", bool(np.isfinite(depth)))


def at_depth(point: np.ndarray, depth: float, direction: np.ndarray) -> np.ndarray:
    """Returns the projection (3,) of a point (3,) along n (3,) onto n·𝔭 = depth [m]."""
    return point + (depth - direction @ point) * direction


def pane() -> np.ndarray:
    """Returns the picture of a pane of glass with a rim, RGBA (rows, columns, 4)."""
    at = np.abs(np.arange(240.0) - 119.5)
    rim = np.maximum(at, at[:, None]) > 116.0
    picture = np.empty((*rim.shape, 4))
    picture[..., :3], picture[..., 3] = 255.0 * np.array(EXPLORED), np.where(rim, RIM, FILL)
    return picture.astype(np.uint8)
