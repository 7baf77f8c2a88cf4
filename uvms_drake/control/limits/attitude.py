"""Limits on roll and pitch of the vehicle and on the pitch of the end-effector."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from uvms_drake.control.limits.limit import AbsoluteLimit
from uvms_drake.control.limits.radii import TubeRadii
from uvms_drake.control.plan.points import Points, Slopes

ANGLES = {"roll": 3, "pitch": 4}
"""Indices of the angles in 𝔮."""
TIP_PITCH = 4
"""Index of the angle in y."""


@dataclass
class VehicleAngle(AbsoluteLimit):
    """|φ| or |θ| of the vehicle ≤ bound."""

    name: str
    """Name of the angle: `roll` or `pitch`."""
    bound: float
    """Largest size of the angle [rad]."""

    def values(self, at: Points) -> np.ndarray:
        """Returns the angle."""
        index = ANGLES[self.name]
        return at.config[..., index: index + 1]

    def slopes(self, at: Points) -> Slopes:
        """Returns a row of ∂𝔮/∂y."""
        index = ANGLES[self.name]
        return Slopes(at.config_y[..., index: index + 1, :])

    def tube_takes(self, tube: TubeRadii) -> np.ndarray:
        """Returns the radius of the angle."""
        return np.array([getattr(tube, self.name)])

    def plan_takes(self, tube: TubeRadii) -> float:
        """Returns the vehicle's turn between knots [rad]."""
        return tube.attitude_between or 0.0

    def unit_of(self, signal: str) -> str:
        """Returns rad."""
        return "rad"

    @property
    def bars(self) -> list[str]:
        """Angle and its limit."""
        return [f"vehicle {self.name}  ≤ {self.upper[0]:.3g} rad"]

    def complaint(self, at: Points) -> str:
        """Returns the angle and its limit."""
        return (f"such that the vehicle's {self.name}, {self.values(at)[0]:.3g}, is within "
                f"±{self.upper[0]:.3g}")


@dataclass
class TipPitch(AbsoluteLimit):
    """|𝔬_θ| of the end-effector ≤ bound."""

    name = "tip_pitch"
    soft: ClassVar[bool] = False

    bound: float
    """Largest size of the angle [rad]."""

    def values(self, at: Points) -> np.ndarray:
        """Returns 𝔬_θ."""
        return at.y[..., TIP_PITCH: TIP_PITCH + 1]

    def slopes(self, at: Points) -> Slopes:
        """Returns a row of the identity."""
        return self.closed_form(at.model.size)[0]

    def tube_takes(self, tube: TubeRadii) -> np.ndarray:
        """Returns the radius of the Euler angles."""
        return np.array([tube.orientation])

    def plan_takes(self, tube: TubeRadii) -> float:
        """Returns the end-effector's turn between knots [rad], which bounds the change of 𝔬_θ."""
        return tube.tool_between or 0.0

    def closed_form(self, size: int) -> list[Slopes]:
        """Returns a row of the identity."""
        return [Slopes(np.eye(size)[TIP_PITCH: TIP_PITCH + 1])]

    def unit_of(self, signal: str) -> str:
        """Returns rad."""
        return "rad"

    @property
    def bars(self) -> list[str]:
        """Angle and its limit."""
        return [f"tool pitch  ≤ {self.upper[0]:.3g} rad"]

    def complaint(self, at: Points) -> str:
        """Returns the angle and its limit."""
        return (f"such that the tip's pitch, {self.values(at)[0]:.3g}, is within "
                f"±{self.upper[0]:.3g}")
