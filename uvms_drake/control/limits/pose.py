"""Limits of the pose: angles of the vehicle, pose of the end-effector, joints, tool's angle."""

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from uvms_drake.common.errors import vector
from uvms_drake.control.limits.limit import AbsoluteLimit, Limit
from uvms_drake.control.limits.radii import TubeRadii
from uvms_drake.control.plan.points import Points, Slopes

ANGLES = {"roll": 3, "pitch": 4}
"""Indices of the vehicle's angles in 𝔮."""
THETA, PSI = 4, 5
"""Indices of the end-effector's pitch and yaw in y."""
SUBSCRIPTS = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")


@dataclass
class VehicleAngle(AbsoluteLimit):
    """|φ| or |θ| of the vehicle ≤ bound."""

    unit = "rad"
    between = "attitude_between"

    name: str
    """Name of the angle: `roll` or `pitch`."""
    bound: float
    """Largest size of the angle [rad]."""

    def __post_init__(self) -> None:
        self.radius, self.titles = self.name, [f"vehicle {self.name}"]
        self._rows = slice(ANGLES[self.name], ANGLES[self.name] + 1)

    def values(self, at: Points) -> np.ndarray:
        """Returns the angle."""
        return at.config[..., self._rows]

    def slopes(self, at: Points) -> Slopes:
        """Returns a row of ∂𝔮/∂y."""
        return Slopes(at.config_y[..., self._rows, :])


class Coordinates(Limit):
    """lower ≤ some entries of y ≤ upper."""

    soft: ClassVar[bool] = False
    entries: ClassVar[slice]
    """Entries of y."""

    def values(self, at: Points) -> np.ndarray:
        """Returns the entries."""
        return at.y[..., self.entries]

    def slopes(self, at: Points) -> Slopes:
        """Returns rows of the identity."""
        return Slopes(np.eye(at.model.size)[self.entries])

    def closed_form(self, size: int) -> list[Slopes]:
        """Returns rows of the identity."""
        return [Slopes(row[None]) for row in np.eye(size)[self.entries]]


@dataclass
class TipPitch(Coordinates, AbsoluteLimit):
    """|𝔬_θ| of the end-effector ≤ bound; its turn between knots bounds the change of 𝔬_θ."""

    name = "tip_pitch"
    entries = slice(THETA, THETA + 1)
    unit = "rad"
    titles = ("tool pitch",)
    radius = "orientation"
    between = "tool_between"

    bound: float
    """Largest size of the angle [rad]."""


@dataclass
class Joints(Coordinates):
    """q_lower ≤ q ≤ q_upper."""

    name = "q"
    owner: ClassVar[str] = "joints"
    entries = slice(6, None)
    radius = "joints"  # Of all joints, which bounds that of each.
    between = "joints_between"

    q_lower: np.ndarray
    """Smallest joint angles (n,) [rad]."""
    q_upper: np.ndarray
    """Largest joint angles (n,) [rad]."""
    unit: str | list[str] = "rad"
    """Unit of the joints, or of each: m of one that slides."""

    def __post_init__(self) -> None:
        self.titles = [label.translate(SUBSCRIPTS) for label in self.labels]

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Returns q_lower and q_upper."""
        return self.q_lower, self.q_upper

    @property
    def labels(self) -> list[str]:
        """Labels q1, q2, ... of the joints."""
        return [f"q{i + 1}" for i in range(len(self.q_lower))]


@dataclass
class TipBox(Coordinates):
    """lower ≤ 𝔭 ≤ upper: a corridor for the end-effector, linear in y."""

    name = "tip"
    entries = slice(0, 3)
    unit = "m"
    titles = ("tip x", "tip y", "tip z")
    radius = "position"  # Which bounds that of each coordinate.

    lower_corner: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """Smallest 𝔭 (3,) [m]."""
    upper_corner: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """Largest 𝔭 (3,) [m]."""

    def check(self) -> None:
        """Raises `InvalidParameter` unless the corners are points in order."""
        for key in ("lower_corner", "upper_corner"):
            vector(key, getattr(self, key), 3)
        super().check()

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Returns the corners."""
        return np.asarray(self.lower_corner), np.asarray(self.upper_corner)

    @property
    def labels(self) -> list[str]:
        """Labels tip_x, tip_y, tip_z."""
        return [f"tip_{axis}" for axis in "xyz"]


@dataclass
class ToolAngle(Limit):
    """Bound on the angle between the tool's axis, x of the end-effector, and n.

    Its value is the cosine: smooth, where the angle has a kink at zero.
    """

    name = "tool_angle"
    titles = ("cosine of the tool's angle from n",)

    direction: np.ndarray
    """Unit vector n (3,) in Σ_I, into the surface."""
    bound: float
    """Largest angle [rad]."""

    def values(self, at: Points) -> np.ndarray:
        """Returns n·x_E, by the Euler angles (φ, θ, ψ) about Σ_T."""
        theta, psi = at.y[..., THETA], at.y[..., PSI]
        x_E = np.stack([np.cos(theta) * np.cos(psi), np.cos(theta) * np.sin(psi),
                        -np.sin(theta)], axis=-1)
        return (x_E @ (self.direction @ at.model.R_WT))[..., None]

    def slopes(self, at: Points) -> Slopes:
        """Returns the derivatives by θ and ψ."""
        theta, psi = at.y[..., THETA], at.y[..., PSI]
        x, y, z = self.direction @ at.model.R_WT
        along, across = x * np.cos(psi) + y * np.sin(psi), y * np.cos(psi) - x * np.sin(psi)
        by_y = np.zeros((*at.y.shape[:-1], 1, at.model.size))
        by_y[..., 0, THETA] = -np.sin(theta) * along - np.cos(theta) * z
        by_y[..., 0, PSI] = np.cos(theta) * across
        return Slopes(by_y)

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Returns the cosine of the bound, and an upper bound that is never reached."""
        return np.array([np.cos(self.bound)]), np.array([2.0 - np.cos(self.bound)])

    def tube_takes(self, tube: TubeRadii) -> np.ndarray:
        """Returns sin(bound) √2 ‖𝔬 − 𝔬̄‖.

        The axis turns by no more than √2 times the difference of the Euler angles, and the slope of
        the cosine is at most sin(bound) up to the bound.
        """
        assert tube.orientation is not None  # it is filled in
        return np.array([np.sin(self.bound) * np.sqrt(2.0) * tube.orientation])

    def plan_takes(self, tube: TubeRadii) -> float:
        """Returns sin(bound) times the end-effector's turn between knots [rad]."""
        return float(np.sin(self.bound)) * (tube.tool_between or 0.0)

    def signals(self, at: Points) -> dict[str, tuple[np.ndarray, float]]:
        """Returns the angle and its bound, not their cosines."""
        return {self.name: (_angle(self.values(at))[..., 0], float(_angle(self.lower)[0]))}

    def unit_of(self, signal: str) -> str:
        """Returns the unit of the angle."""
        return "rad"

    def complaint(self, at: Points) -> str:
        """Returns the requirement that a pose breaks, for a message."""
        return (f"such that the tool's angle from n, {_angle(self.values(at))[0]:.3g} rad, is at "
                f"most {_angle(self.lower)[0]:.3g} rad")

    @property
    def bars(self) -> list[str]:
        """Angle and its bound."""
        return [f"tool off n  ≤ {_angle(self.lower)[0]:.3g} rad"]

    def bar_lengths(self, at: Points) -> np.ndarray:
        """Returns the part of the angle, not of its cosine."""
        return _angle(self.values(at)) / _angle(self.lower)


def _angle(cosine: np.ndarray) -> np.ndarray:
    return np.arccos(np.clip(cosine, -1.0, 1.0))
