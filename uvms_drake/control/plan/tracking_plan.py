"""Plan of accelerations about an artificial reference that is decided with it."""

from dataclasses import dataclass

import numpy as np

from uvms_drake.control.plan.plan import DynamicPlan


@dataclass(frozen=True)
class TrackingPlan(DynamicPlan):
    """Plan about the artificial reference y_des + E a."""

    a: np.ndarray
    """Translation of the reference in Σ_I [m] and, if it may turn, its yaw [rad] (3,) or (4,)."""

    @property
    def decision(self) -> np.ndarray:
        """Decisions (N+1, 6+n): first (a, 0), then ζ̄̇."""
        out = np.zeros_like(self.zeta)
        out[0, : len(self.a)], out[1:] = self.a, self.zeta_dot
        return out

    def redone(self, start: np.ndarray, decision: np.ndarray) -> "TrackingPlan":
        """Returns the plan from another (𝔮, ζ) or with another decision."""
        a = decision[0, : len(self.a)]
        return TrackingPlan(**vars(super().redone(start, decision[1:])), a=a)
