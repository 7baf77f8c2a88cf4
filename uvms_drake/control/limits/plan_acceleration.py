"""Limit on the accelerations of plans, which the tube does not tighten."""

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from uvms_drake.control.limits.limit import Limit
from uvms_drake.control.limits.radii import TubeRadii
from uvms_drake.control.plan.points import About, Points, Slopes


@dataclass
class PlanAcceleration(Limit):
    """|ζ̄̇ᵢ| ≤ bound [m/s² (3), rad/s² (3 + n)], of a plan's own motion.

    A plan that accelerates is an input of the loop behind actuators with a delay, and may excite
    a roll that nothing drives; see `tube.coupled`.
    """

    name: ClassVar[str] = "plan_acceleration"  # type: ignore[misc]
    about: ClassVar[About] = "input"

    bound: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """Largest size of each entry (6+n,)."""

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Returns ∓bound."""
        bound = np.asarray(self.bound, dtype=float)
        return -bound, bound

    def values(self, at: Points) -> np.ndarray:
        """Returns ζ̄̇ = f(𝔮̄, ζ̄) + ū."""
        return at.u + at.model.drift(at.config, at.zeta)

    def slopes(self, at: Points) -> Slopes:
        """Returns the derivatives of f, and the identity by ū."""
        _, by_config, by_zeta = at.model.drift_derivatives(at.config, at.zeta)
        return Slopes(y=by_config @ at.config_y, zeta=by_zeta, u=np.eye(at.model.size))

    def tube_takes(self, tube: TubeRadii) -> np.ndarray:
        """Returns zeros: it is about plans alone."""
        return np.zeros(len(self.bound))

    def signals(self, at: Points) -> dict[str, tuple[np.ndarray, float]]:
        """Returns none: the robot may accelerate more; violations by plans are logged."""
        return {}
