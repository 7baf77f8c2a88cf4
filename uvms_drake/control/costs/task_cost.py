"""Quadratic cost of the task, (eq:mpc_cost_function)."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from uvms_drake.control.costs.term import CostTerm
from uvms_drake.control.plan.points import About, Points, Slopes


@dataclass(frozen=True)
class TaskCost(CostTerm):
    """Cost ‖ξ‖²_Q + ‖u − u_ref‖²_R, ξ = (y − y_des, ζ), or y − y_des for a Q of that size."""

    about: ClassVar[About] = "input"

    Q: np.ndarray
    """Weight of ξ, diagonal."""
    R: np.ndarray
    """Weight of u − u_ref (6+n, 6+n), diagonal."""
    y_des: np.ndarray
    """Desired extended task y_des (6+n,) [m, rad]."""
    u_ref: np.ndarray
    """Input that costs nothing (6+n,)."""

    def error(self, at: Points) -> np.ndarray:
        """Returns ξ (..., its size)."""
        return np.concatenate([at.y - self.y_des, at.zeta], axis=-1)[..., : len(self.Q)]

    def residual(self, at: Points) -> np.ndarray:
        """Returns (√Q ξ, √R(u − u_ref))."""
        return np.concatenate([self.error(at) @ np.sqrt(self.Q),
                               (at.u - self.u_ref) @ np.sqrt(self.R)], axis=-1)

    def value(self, at: Points) -> float:
        """Returns the sum over the points, without roots."""
        xi, du = self.error(at), at.u - self.u_ref
        return np.sum((xi @ self.Q) * xi) + np.sum((du @ self.R) * du)

    def quadratic(self, at: Points, chain: Slopes, h: float) -> tuple[np.ndarray, np.ndarray]:
        """Returns H and g in closed form: z starts with ξ."""
        nx, u_z = len(self.Q), chain.u
        assert u_z is not None
        weighted = 2.0 * h * self.R @ u_z
        H = np.swapaxes(u_z, 1, 2) @ weighted
        H[:, :nx, :nx] += 2.0 * h * self.Q
        g = ((at.u - self.u_ref)[:, None, :] @ weighted)[:, 0]
        g[:, :nx] += 2.0 * h * self.error(at) @ self.Q
        return H, g
