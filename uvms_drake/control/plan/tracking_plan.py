"""A plan of accelerations about a reference that is part of the plan."""

from dataclasses import dataclass

import numpy as np

from uvms_drake.control.plan.plan import DynamicPlan


@dataclass(frozen=True)
class TrackingPlan(DynamicPlan):
    """A `DynamicPlan` about the task y_des + E a, moved by a."""

    a: np.ndarray
    """a: a translation in Σ_I [m], and if there may be one a turn about the vertical [rad]."""

    @property
    def decision(self) -> np.ndarray:
        """(N+1, 6+n): first (a, 0), then ζ̄̇."""
        return np.concatenate([np.zeros_like(self.zeta[:1]), self.zeta_dot]) + np.pad(
            self.a[None], ((0, len(self.zeta_dot)), (0, self.zeta.shape[1] - len(self.a))))

    def redone(self, start: np.ndarray, decision: np.ndarray) -> "TrackingPlan":
        """Returns the plan from another (𝔮, ζ) or with another decision."""
        a = decision[0, : len(self.a)]
        return TrackingPlan(**vars(super().redone(start, decision[1:])), a=a)
