"""Limits of speeds: of the vehicle and of the joints, and of the end-effector along axes."""

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from uvms_drake.common.errors import vector
from uvms_drake.control.limits.limit import AbsoluteLimit, Cone, Limit
from uvms_drake.control.plan.plan import between_knots
from uvms_drake.control.plan.points import About, Points, Slopes
from uvms_drake.model.surface.surface_class import axis_names

BLOCKS = {"nu1": (slice(0, 3), "vehicle speed", "m/s"),
          "nu2": (slice(3, 6), "vehicle turn rate", "rad/s"),
          "qdot": (slice(6, None), "joint speed", "rad/s")}
"""Block of ζ of each speed, the name of its bar, and its unit."""


@dataclass
class Speed(AbsoluteLimit):
    """‖block of ζ‖₂ ≤ bound. As a convex function of ζ it keeps its bound between knots too."""

    about: ClassVar[About] = "speed"
    overshoots: ClassVar[bool] = False

    name: str
    """Name of the speed: `nu1`, `nu2` or `qdot`."""
    bound: float
    """Largest norm, of ν₁ or prismatic joints [m/s], else [rad/s]."""
    unit: str = ""
    """Unit of the speed; if left out, that of `BLOCKS`."""

    def __post_init__(self) -> None:
        self._block, title, unit = BLOCKS[self.name]
        self.radius, self.titles, self.unit = self.name, [title], self.unit or unit

    def values(self, at: Points) -> np.ndarray:
        """Returns the norm."""
        return np.linalg.norm(at.zeta[..., self._block], axis=-1)[..., None]

    def closed_form(self, size: int) -> list[Slopes]:
        """Returns the block of ζ."""
        return [Slopes(zeta=np.eye(size)[self._block])]

    def cone(self, at: Points) -> Cone:
        """Returns the norm as a cone."""
        return Cone(at.zeta[..., self._block], self.closed_form(at.model.size)[0], self.upper[0])


@dataclass
class TipVelocity(AbsoluteLimit):
    """Speeds |𝔭̇ᵢ| ≤ bound; a certificate needs the radius of 𝔭̇ in the tube."""

    name = "tip_velocity"
    about: ClassVar[About] = "speed"
    absolute = False
    unit = "m/s"
    titles = ("tip speed x", "tip speed y", "tip speed z")
    radius = "tip_speed"

    bound: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """Largest size of each component (3,) [m/s]."""

    def check(self) -> None:
        """Raises `InvalidParameter` unless the bounds are three positive numbers."""
        vector("bound", self.bound, 3)
        super().check()

    def values(self, at: Points) -> np.ndarray:
        """Returns 𝔭̇ = J_𝔭(𝔮)ζ."""
        return (at.tip_jacobian @ at.zeta[..., None])[..., 0]

    def slopes(self, at: Points) -> Slopes:
        """Returns the derivatives of 𝔭̇ = J_𝔭(𝔮)ζ."""
        return Slopes(at.tip_velocity_y, at.tip_jacobian)


@dataclass
class ContactSpeed(Limit):
    """|n·𝔭̇| ≤ along, |tᵢ·𝔭̇| ≤ across, for two directions tᵢ across n."""

    name = "contact_speed"
    about: ClassVar[About] = "speed"
    unit = "m/s"
    radius = ("depth_speed", "tip_speed", "tip_speed")

    axes: np.ndarray
    """Axes n and tᵢ (3, 3) in Σ_I, the rows of a rotation; n into the surface."""
    along: float
    """Largest |n·𝔭̇| [m/s]."""
    across: float
    """Largest size of each of the other two components [m/s]."""

    def __post_init__(self) -> None:
        self.titles = ["tip along n", *(f"tip {name}" for name in axis_names(self.axes[0]))]

    @property
    def labels(self) -> list[str]:
        """Labels by axis: n, t1 (down a wall), t2 (to port)."""
        return [f"{self.name}_{axis}" for axis in ("n", "t1", "t2")]

    def values(self, at: Points) -> np.ndarray:
        """Returns n·𝔭̇ and the tᵢ·𝔭̇."""
        return (self.axes @ (at.tip_jacobian @ at.zeta[..., None]))[..., 0]

    def slopes(self, at: Points) -> Slopes:
        """Returns the derivatives of 𝔭̇ = J_𝔭(𝔮)ζ, in these axes."""
        return Slopes(self.axes @ at.tip_velocity_y, self.axes @ at.tip_jacobian)

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Returns ∓(along, across, across)."""
        most = np.array([self.along, self.across, self.across])
        return -most, most


@dataclass
class SafeDepth(Limit):
    """Depths N·𝔭 ≤ depth of the facets N, at the knots of a plan."""

    name = "safe_depth"
    soft: ClassVar[bool] = False
    overshoots: ClassVar[bool] = False
    unit = "m"

    facets: np.ndarray
    """Facets N (m, 3) in Σ_I, all of them into the surface."""
    depth: np.ndarray
    """Largest N·𝔭 (m,) [m], tightened by the tube."""

    def values(self, at: Points) -> np.ndarray:
        """Returns the N·𝔭."""
        depths: np.ndarray = at.y[..., :3] @ self.facets.T
        return depths

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Returns −∞ and the depths."""
        return np.full(len(self.facets), -np.inf), self.depth

    def slopes(self, at: Points) -> Slopes:
        """Returns the N."""
        return Slopes(np.pad(self.facets, ((0, 0), (0, at.model.size - 3))))


@dataclass
class SafeDepthBetweenKnots(SafeDepth):
    """Depths N·𝔭 + ½h N·𝔭̇ ≤ depth of the facets N.

    Between two knots n·𝔭 is a parabola but for its third derivative, and bounds at the knots on n·𝔭
    and on n·𝔭 + ½h n·𝔭̇ hold in between, without loss where the motion just stops: see
    control/plan/theory.md#depth-between-two-knots. The remainder is at most (2/81) h³ sup|d³(n·𝔭)/
    dt³|; the depth is tightened by that (`tube.contact.tip_motion`).
    """

    name = "safe_depth_between_knots"
    about: ClassVar[About] = "speed"
    soft: ClassVar[bool] = True

    time_step: float
    """Length h of an interval of the plan [s]."""

    def values(self, at: Points) -> np.ndarray:
        """Returns the N·𝔭 + ½h N·𝔭̇."""
        v = (at.tip_jacobian @ at.zeta[..., None])[..., 0]
        return between_knots(super().values(at), v @ self.facets.T, self.time_step)

    def slopes(self, at: Points) -> Slopes:
        """Returns the derivatives of 𝔭 and of 𝔭̇ = J_𝔭(𝔮)ζ."""
        rows = 0.5 * self.time_step * self.facets
        by_y = rows @ at.tip_velocity_y
        by_y[..., :3] += self.facets
        return Slopes(by_y, rows @ at.tip_jacobian)
