"""A plan of accelerations about a reference that is part of the plan."""

from dataclasses import dataclass

import numpy as np

from uvms_drake.control.plan import DynamicPlan


@dataclass(frozen=True)
class TrackingPlan(DynamicPlan):
    """A `DynamicPlan` about the task y_des + E a, moved by a translation a of its position."""

    a: np.ndarray
    """Translation a (3,) in Σ_I [m]."""

    @property
    def decision(self) -> np.ndarray:
        """(N+1, 6+n): first (a, 0), then ζ̄̇."""
        return np.concatenate([np.zeros_like(self.zeta[:1]), self.zeta_dot]) + np.pad(
            self.a[None], ((0, len(self.zeta_dot)), (0, self.zeta.shape[1] - 3)))

    def redone(self, start: np.ndarray, decision: np.ndarray) -> "TrackingPlan":
        """Returns the plan from another (𝔮, ζ) or with another decision."""
        return TrackingPlan(**vars(super().redone(start, decision[1:])), a=decision[0, :3])
