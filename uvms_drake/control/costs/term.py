"""Interface of a term of the nominal MPC's stage cost.

A term of one's own is a subclass with a `residual` r, in `MpcConfig.terms`: it adds h‖r‖² at the
beginning of every interval. `evaluate` has its value, the convex programs its Gauss–Newton model
about a plan. No proof covers it: with one, there is no certificate.
"""

from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np

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
