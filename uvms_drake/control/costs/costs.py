"""Terms of the nominal MPC's cost: their interface, the task's, and the offset of a reference.

A term of one's own is a subclass of `CostTerm` with a `residual` r, in `MpcConfig.terms`: it adds
h‖r‖² at the beginning of every interval. `evaluate` has its value, the convex programs its
Gauss–Newton model about a plan. No proof covers it: with one, there is no certificate.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from uvms_drake.common.constraints import NotNegative, Positive
from uvms_drake.control.plan.points import About, Points, Slopes, slopes


class CostTerm(ABC):
    """Cost h‖r‖² at N points, the beginnings of the intervals of the time step h [s]."""

    about: ClassVar[About] = "pose"
    """Arguments that `residual` reads: `pose` for 𝔮 and y, `speed` for ζ too, `input` for u and τ
    too."""

    @abstractmethod
    def residual(self, at: Points) -> np.ndarray:
        """Returns r (..., m) of points (...); also of complex ones, without abs or norm."""

    def value(self, at: Points) -> float:
        """Returns Σ‖r‖²."""
        return float(np.sum(self.residual(at) ** 2))

    def quadratic(self, at: Points, chain: Slopes, h: float) -> tuple[np.ndarray, np.ndarray]:
        """Returns H (N, w, w) and g (N, w) of h Σ‖r‖² ≈ a constant + Σ(½ zᵀHz + gᵀz).

        Args:
            at: The points.
            chain: Derivatives of y, ζ and u there by z (w,).
            h: Time step [s].
        """
        weighted = 2.0 * h * (by_z := slopes(self.residual, at, self.about).through(chain))
        return (np.swapaxes(by_z, 1, 2) @ weighted,
                (self.residual(at)[:, None, :] @ weighted)[:, 0])


@dataclass
class LevelVehicle(CostTerm):
    """Cost weight (φ² + θ²) that keeps the vehicle level."""

    weight: Annotated[float, NotNegative] = 1.0
    """Cost of a tilt by 1 rad that lasts 1 s [1/(rad² s)]."""

    def residual(self, at: Points) -> np.ndarray:
        """Returns √weight (φ, θ)."""
        return np.sqrt(self.weight) * at.config[..., 3:5]


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


@dataclass(frozen=True)
class OffsetCost:
    """Offset cost V_o(e) = slope (√(‖e‖² + width²) − width), a norm that is smooth at zero.

    Its gradient is at most `slope`, however far the target, so the multipliers do not grow with the
    distance, and the penalties of the terminal set and of the limits can be above them. Let V(a) be
    the least of all other costs of a plan, given a. Where ∇V_o = −∇V and ‖∇V‖ < slope,

        ‖e‖ = width ‖∇V‖ / √(slope² − ‖∇V‖²),

    so the reference is at its target, to within about `width`, as soon as V rises by less than
    `slope` per metre: as exact a penalty as a norm, to within `width`.
    """

    slope: Annotated[float, Positive] = 100.0
    """Cost of a metre, far from the target, or of a radian [1/m, 1/rad]."""
    width: Annotated[float, Positive] = 1e-3
    """Distance below which the cost is quadratic [m, rad]."""

    def value(self, e: np.ndarray) -> float:
        """Returns V_o(e), e (m,) [m], or (1,) [rad]."""
        return float(self.slope * (np.sqrt(e @ e + self.width**2) - self.width))

    def quadratic(self, e: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns H (m, m) and g (m,): V_o(e + b) ≤ V_o(e) + gᵀb + ½ bᵀHb, equal at b = 0.

        A square root lies below its tangent: √(r + t) ≤ √r + t/(2√r).
        """
        weight = self.slope / np.sqrt(e @ e + self.width**2)
        return weight * np.eye(len(e)), weight * e
