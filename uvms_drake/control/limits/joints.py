"""Limits on the joint angles."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from uvms_drake.control.limits.limit import Limit
from uvms_drake.control.limits.radii import TubeRadii
from uvms_drake.control.plan.points import Points, Slopes

SUBSCRIPTS = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")


@dataclass
class Joints(Limit):
    """q_lower ≤ q ≤ q_upper."""

    name = "q"
    soft: ClassVar[bool] = False
    owner: ClassVar[str] = "joints"

    q_lower: np.ndarray
    """Smallest joint angles (n,) [rad]."""
    q_upper: np.ndarray
    """Largest joint angles (n,) [rad]."""
    slides: Sequence[bool] | np.ndarray = ()
    """Whether a joint is prismatic, its coordinate a length [m] (n,); none is, if left out."""

    def values(self, at: Points) -> np.ndarray:
        """Returns q."""
        return at.y[..., 6:]

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Returns q_lower and q_upper."""
        return self.q_lower, self.q_upper

    def slopes(self, at: Points) -> Slopes:
        """Returns rows of the identity."""
        return Slopes(np.eye(at.model.size)[6:])

    def tube_takes(self, tube: TubeRadii) -> np.ndarray:
        """Returns the radius of all joints, which bounds that of each."""
        return np.full(len(self.q_lower), tube.joints)

    def plan_takes(self, tube: TubeRadii) -> float:
        """Returns the joints' excess between knots [rad]."""
        return tube.joints_between or 0.0

    def closed_form(self, size: int) -> list[Slopes]:
        """Returns rows of the identity."""
        return [Slopes(row[None]) for row in np.eye(size)[6:]]

    @property
    def parts(self) -> list[str]:
        """Names q[0], q[1], ... of the joints."""
        return [f"q[{i}]" for i in range(len(self.q_lower))]

    @property
    def labels(self) -> list[str]:
        """Labels q1, q2, ... of the joints."""
        return [f"q{i + 1}" for i in range(len(self.q_lower))]

    def unit_of(self, signal: str) -> str:
        """Returns rad, or m of a joint that slides."""
        return self._unit(signal.rsplit("_", 1)[0])

    @property
    def bars(self) -> list[str]:
        """Joints and their limits."""
        return [f"{label.translate(SUBSCRIPTS)}  {lower:.2g} … {upper:.2g} {self._unit(label)}"
                for label, lower, upper in zip(self.labels, self.lower, self.upper, strict=True)]

    def _unit(self, label: str) -> str:
        return "m" if dict(zip(self.labels, self.slides, strict=False)).get(label) else "rad"

    def complaint(self, at: Points) -> str:
        """Returns the tightened range of the joints."""
        return f"within the joint limits less the tube, {self.lower} to {self.upper}"
