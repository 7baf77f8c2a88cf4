"""Static force of a surface by the depth: linear, bilinear or hardening."""

from dataclasses import dataclass, replace
from typing import NamedTuple, Self

import numpy as np

from uvms_drake.common.errors import require
from uvms_drake.model.surface.plane import plane_load


class Ramp(NamedTuple):
    """Change of a stiffness over a range of depth."""

    ratio: float
    """Ratio of the stiffness after to that before."""
    start: float
    """Depth at which the change begins [m]."""
    width: float
    """Range of depth of the change [m]."""


@dataclass
class Linear:
    """Static force φ(δ) = k s(δ; w) at depth δ, with s of `plane_load`.

    It is zero outside, increases inside, and is twice continuously differentiable.
    """

    stiffness: float = 1000.0
    """Stiffness k of the surface pressed in beyond `transition` [N/m]."""
    transition: float = 0.002
    """Depth w over which the stiffness rises from zero to k [m]."""

    @property
    def change(self) -> Ramp:
        """Change of the stiffness at larger depth; none here."""
        return Ramp(1.0, 0.0, self.transition)

    @property
    def slopes(self) -> tuple[float, float]:
        """Smallest slope φ′ beyond `transition`, and the largest anywhere [N/m]."""
        ratio = self.change.ratio
        return self.stiffness * min(1.0, ratio), self.stiffness * max(1.0, ratio)

    @property
    def smallest(self) -> float:
        """Force at the end of the transition [N]."""
        return float(self.force(np.array(self.transition)))

    def checked(self) -> Self:
        """Returns the law, or raises."""
        for key, value in vars(self).items():
            require(bool(0.0 < value < np.inf), key, value, "positive")
        return self

    def force(self, depth: np.ndarray) -> np.ndarray:
        """Returns φ(δ) = k (s(δ; w) + (ratio − 1) s(δ − start; width)) (...) [N]."""
        ratio, start, width = self.change
        load = plane_load(depth, self.transition)
        if ratio != 1.0:
            load = load + (ratio - 1.0) * plane_load(depth - start, width)
        return self.stiffness * load

    def depth_for(self, force: float) -> float:
        """Returns the δ [m] at which φ is a force ≥ 0 [N], by bisection."""
        low, high = 0.0, force / self.slopes[0] + self.transition
        while low < (middle := 0.5 * (low + high)) < high:
            low, high = ((low, middle) if self.force(np.array(middle)) >= force else
                         (middle, high))
        return high

    def stiffened(self, factor: float) -> Self:
        """Returns the law with `factor` times the force."""
        return replace(self, stiffness=factor * self.stiffness)


@dataclass
class Bilinear(Linear):
    """Law with a knee: a soft layer on a harder one, or a layer that yields."""

    ratio: float = 3.0
    """Stiffness beyond the knee over that before."""
    knee: float = 0.01
    """Depth at which the stiffness begins to change, over another `transition` [m]."""

    @property
    def change(self) -> Ramp:
        """Change of the stiffness at the knee."""
        return Ramp(self.ratio, self.knee, self.transition)

    def checked(self) -> "Bilinear":
        """Returns the law, or raises."""
        law = super().checked()
        require(self.knee >= self.transition, "knee", self.knee,
                f"at least the transition, {self.transition:g} m")
        return law


@dataclass
class Hardening(Linear):
    """Law whose stiffness grows down to a depth, such as a fender."""

    ratio: float = 5.0
    """Stiffness from `depth` on over that close to the surface, at least 1."""
    depth: float = 0.03
    """Depth at which the stiffness is the largest [m]."""

    @property
    def change(self) -> Ramp:
        """Change of the stiffness down to `depth`."""
        return Ramp(self.ratio, 0.0, self.depth)

    def checked(self) -> "Hardening":
        """Returns the law, or raises."""
        law = super().checked()
        require(self.ratio >= 1.0, "ratio", self.ratio, "at least 1")
        require(self.depth >= self.transition, "depth", self.depth,
                f"at least the transition, {self.transition:g} m")
        return law


AnyNormalLaw = Linear | Bilinear | Hardening
"""Laws that a file may name by tag; the first is the default."""
