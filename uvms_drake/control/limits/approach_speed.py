"""Limits of a sensed contact: the tip's speed along and across n, and the tool's angle."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from uvms_drake.control.limits.limit import Limit
from uvms_drake.control.limits.radii import TubeRadii
from uvms_drake.control.plan.points import About, Points, Slopes

THETA, PSI = 4, 5
"""Indices of the tool's pitch and yaw in y."""


@dataclass
class ContactSpeed(Limit):
    """|n·𝔭̇| ≤ along, |tᵢ·𝔭̇| ≤ across, for two directions tᵢ across n."""

    name = "contact_speed"
    about: ClassVar[About] = "speed"

    axes: np.ndarray
    """Axes n and tᵢ (3, 3) in Σ_I, the rows of a rotation; n into the surface."""
    along: float
    """Largest |n·𝔭̇| [m/s]."""
    across: float
    """Largest size of each of the other two components [m/s]."""

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

    def tube_takes(self, tube: TubeRadii) -> np.ndarray | None:
        """Returns the radii of n·𝔭̇ and of 𝔭̇, if there are any."""
        if tube.tip_speed is None or tube.depth_speed is None:
            return None
        return np.array([tube.depth_speed, tube.tip_speed, tube.tip_speed])

    def unit_of(self, signal: str) -> str:
        """Returns m/s."""
        return "m/s"

    @property
    def bars(self) -> list[str]:
        """Speed into the surface, and the larger one of the others."""
        return [f"tip {axis} n  ≤ {most:.3g} m/s"
                for axis, most in zip(("along", "across"), self.upper, strict=False)]

    def bar_lengths(self, at: Points) -> np.ndarray:
        """Returns the part of n·𝔭̇ and the largest of the other two."""
        along, *across = np.moveaxis(self.used(at), -1, 0)
        return np.stack([along, np.maximum(*across)], axis=-1)


@dataclass
class ToolAngle(Limit):
    """Bound on the angle between the tool's axis, x of the end-effector, and n.

    Its value is the cosine: smooth, where the angle has a kink at zero.
    """

    name = "tool_angle"

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

    def unit_of(self, signal: str) -> str:
        """Returns the empty unit of a cosine."""
        return ""

    @property
    def bars(self) -> list[str]:
        """Angle and its bound."""
        return [f"tool off n  ≤ {_angle(self.lower)[0]:.3g} rad"]

    def bar_lengths(self, at: Points) -> np.ndarray:
        """Returns the part of the angle, not of its cosine."""
        return _angle(self.values(at)) / _angle(self.lower)

    def complaint(self, at: Points) -> str:
        """Returns the angle and its bound."""
        return ("such that the tool's angle from the contact's direction, "
                f"{_angle(self.values(at))[0]:.3g}, is within {_angle(self.lower)[0]:.3g}")


def _angle(cosine: np.ndarray) -> np.ndarray:
    return np.arccos(np.clip(cosine, -1.0, 1.0))
