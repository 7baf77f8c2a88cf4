"""Offset cost of an artificial reference (Limon et al. 2018)."""

from dataclasses import dataclass

import numpy as np

from uvms_drake.common.errors import require


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

    slope: float = 100.0
    """Cost of a metre, far from the target, or of a radian [1/m, 1/rad]."""
    width: float = 1e-3
    """Distance below which the cost is quadratic [m, rad]."""

    def check(self) -> None:
        """Raises `InvalidParameter` for the first parameter that has no meaning."""
        for key in ("slope", "width"):
            require(0.0 < getattr(self, key) < np.inf, key, getattr(self, key), "positive")

    def value(self, e: np.ndarray) -> float:
        """Returns V_o(e), e (m,) [m], or (1,) [rad]."""
        return float(self.slope * (np.sqrt(e @ e + self.width**2) - self.width))

    def quadratic(self, e: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns H (m, m) and g (m,): V_o(e + b) ≤ V_o(e) + gᵀb + ½ bᵀHb, equal at b = 0.

        A square root lies below its tangent: √(r + t) ≤ √r + t/(2√r).
        """
        weight = self.slope / np.sqrt(e @ e + self.width**2)
        return weight * np.eye(len(e)), weight * e
