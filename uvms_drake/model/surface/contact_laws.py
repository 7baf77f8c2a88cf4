"""Laws of a contact: static force by the depth, damping, and friction.

The friction is Coulomb's without a jump, as in Drake's continuous contact, for one coefficient μ.
On a tip that slides at the speed v it is μ ρ(v/v_s) times the normal force, where ρ(x) =
x³(10 − 15x + 6x²) for x < 1 and 1 beyond: twice continuously differentiable. It implies creep: a
sticking tip moves at up to v_s, since ρ grows from zero at rest.
"""

from dataclasses import dataclass, replace
from typing import Annotated, NamedTuple, Self

import numpy as np

from uvms_drake.common.constraints import AtLeast, Positive
from uvms_drake.common.errors import require

STEEPEST = 1.875
"""Largest ρ′, at x = 1/2."""


def plane_load(depth: np.ndarray, transition: float) -> np.ndarray:
    """Returns s(δ) [m], a twice continuously differentiable max(δ, 0).

    With x = δ/w: s = 0 for x ≤ 0, w(x³ − x⁴/2) for 0 < x < 1, δ − w/2 for x ≥ 1, so that the
    stiffness s'(δ) rises from 0 to 1 as the smooth step 3x² − 2x³.
    """
    x = depth / transition
    if isinstance(depth, float):  # One depth.
        return np.float64(0.0 if x <= 0.0 else depth - 0.5 * transition if x >= 1.0 else
                          transition * x**3 * (1.0 - 0.5 * x))
    return np.where(x.real <= 0.0, 0.0,
                    np.where(x.real < 1.0, transition * x**3 * (1.0 - 0.5 * x),
                             depth - 0.5 * transition))


def dissipation_factor(z: np.ndarray) -> np.ndarray:
    """Returns ψ(z) = 1 + z for z ≥ 0, 1/(1 − z) for z < 0: positive, continuously differentiable.

    Hunt and Crossley's factor 1 + aδ̇ goes negative on fast withdrawal (the surface would pull)
    and clipping it at zero, as is usual, has a kink; ψ agrees with it to first order at rest.
    """
    if isinstance(z, float):  # One rate.
        return np.float64(1.0 / (1.0 - z) if z < 0.0 else 1.0 + z)
    retreat = np.where(z.real < 0.0, z, 0.0)
    return np.where(z.real < 0.0, 1.0 / (1.0 - retreat), 1.0 + z)


def slip_factor(slip: np.ndarray) -> np.ndarray:
    """Returns ρ(x)/x (...) at the slip x = v/v_s ≥ 0 (...); zero at rest."""
    if slip.size == 1 and slip.dtype.kind == "f":
        return slip**2 * (10.0 + slip * (6.0 * slip - 15.0)) if slip < 1.0 else 1.0 / slip
    fast = np.where(slip.real < 1.0, 1.0, slip)
    return np.where(slip.real < 1.0, slip**2 * (10.0 + slip * (6.0 * slip - 15.0)), 1.0 / fast)


def coulomb(velocity: np.ndarray, friction: float, creep: float) -> np.ndarray:
    """Returns the force per normal force (..., 3) of a tip on the surface along which it slides.

    Args:
        velocity: Tangential velocity of the tip (..., 3) [m/s].
        friction: Coefficient μ.
        creep: Creep velocity v_s [m/s].
    """
    slip = np.sqrt(np.add.reduce(velocity * velocity, axis=-1, keepdims=True)) / creep
    return friction / creep * slip_factor(slip) * velocity


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

    stiffness: Annotated[float, Positive] = 1000.0
    """Stiffness k of the surface pressed in beyond `transition` [N/m]."""
    transition: Annotated[float, Positive] = 0.002
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

    ratio: Annotated[float, Positive] = 3.0
    """Stiffness beyond the knee over that before."""
    knee: Annotated[float, Positive] = 0.01
    """Depth at which the stiffness begins to change, over another `transition` [m]."""

    @property
    def change(self) -> Ramp:
        """Change of the stiffness at the knee."""
        return Ramp(self.ratio, self.knee, self.transition)

    def check(self) -> None:
        """Raises `InvalidParameter` for a knee in the transition."""
        require(self.knee >= self.transition, "knee", self.knee,
                f"at least the transition, {self.transition:g} m")


@dataclass
class Hardening(Linear):
    """Law whose stiffness grows down to a depth, such as a fender."""

    ratio: Annotated[float, Positive, AtLeast(1)] = 5.0
    """Stiffness from `depth` on over that close to the surface, at least 1."""
    depth: Annotated[float, Positive] = 0.03
    """Depth at which the stiffness is the largest [m]."""

    @property
    def change(self) -> Ramp:
        """Change of the stiffness down to `depth`."""
        return Ramp(self.ratio, 0.0, self.depth)

    def check(self) -> None:
        """Raises `InvalidParameter` for a depth in the transition."""
        require(self.depth >= self.transition, "depth", self.depth,
                f"at least the transition, {self.transition:g} m")


AnyNormalLaw = Linear | Bilinear | Hardening
"""Laws that a file may name by tag; the first is the default."""
