"""What is known of a wall that nobody measured: a bound of its stiffness, and where it faces.

The static normal force φ(𝔭) ≥ 0 of the wall on the tip at rest at 𝔭 is any function with

    φ(𝔭') ≤ φ(𝔭) + κ₊ ⟨𝔭' − 𝔭⟩₊,    ⟨m⟩ = n·m + α‖P_t m‖,    P_t = I − n nᵀ,   (·)₊ = max(·, 0),

and a tip that moves feels it times a factor of damping: 1 − c₊(−δ̇)₊ ≤ F_N/φ ≤ 1 + c₊(δ̇)₊, δ̇ the
rate of its depth. Hunt and Crossley's 1 + cδ̇ with 0 ≤ c ≤ c₊ is one, 1/(1 − cδ̇) for δ̇ < 0 too.

*Which walls are in it.* Let s be the depth in the wall and φ = f(s), f monotone of slope ≤ κ₊ (a
spring, soft on hard, a layer that yields; with a sprung tool, κ₊ is at most the tool's stiffness),
‖∇s‖ ≤ 1 and ∇s nowhere more than θ off n (tilt, curvature). Then α = tan θ: between 𝔭 and 𝔭' there
is a gradient with s(𝔭') − s(𝔭) = ∇s·m = ‖∇s‖ cos β (n·m + tan β ‖P_t m‖ cos γ), β ≤ θ, which is at
most ⟨m⟩₊, and f grows by at most κ₊ of that.

*Not in it*: a wall that moves, one that is adhesive, damping without load (F = κδ + dδ̇). What a
drifting navigation makes of a wall at rest moves, too.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from uvms_drake.common.errors import require, vector


@dataclass(frozen=True)
class SurfaceClass:
    """All walls with these bounds; a controller that knows no more is safe on each of them."""

    direction: np.ndarray = field(default_factory=lambda: np.array([1.0, 0.0, 0.0]))
    """n (3,), unit vector in Σ_I from the water into the wall."""
    stiffness: float = 2000.0
    """κ₊, largest slope of the static force over the depth [N/m]."""
    angle: float = 0.0
    """θ, largest angle between n and the wall's own normal [rad]; α = tan θ."""
    dissipation: float = 0.0
    """c₊, largest factor of damping [s/m]."""
    friction: float = 0.0
    """μ, largest ratio of tangential and normal force."""
    least_stiffness: float = 0.0
    """κ₋, smallest slope of the static force along n past the transition [N/m]; 0: unknown."""

    def __post_init__(self):
        n = vector("direction", self.direction, 3)
        require(bool(abs(np.linalg.norm(n) - 1.0) < 1e-6), "direction", n, "a unit vector")
        n.setflags(write=False)
        object.__setattr__(self, "direction", n)
        require(0.0 < self.stiffness < np.inf, "stiffness", self.stiffness, "positive")
        require(0.0 <= self.angle < 0.5 * np.pi, "angle", self.angle, "from 0 to below π/2")
        for key in ("dissipation", "friction"):
            value = getattr(self, key)
            require(0.0 <= value < np.inf, key, value, "zero or positive")

    @cached_property
    def tilt(self) -> float:
        """α = tan θ."""
        return float(np.tan(self.angle))

    def depth(self, point: np.ndarray) -> np.ndarray:
        """Returns x = n·𝔭 (...) [m], what the tip's position 𝔭 (..., 3) is along n."""
        return point @ self.direction

    def lateral(self, motion: np.ndarray) -> np.ndarray:
        """Returns ‖P_t m‖ (...), the part across n of a vector m (..., 3)."""
        return np.linalg.norm(motion - self.depth(motion)[..., None] * self.direction, axis=-1)

    @cached_property
    def axes(self) -> np.ndarray:
        """(3, 3) n and two directions t₁, t₂ across it, the rows of a rotation."""
        n = self.direction
        first = np.cross(n, np.eye(3)[np.argmin(np.abs(n))])
        first = first / np.linalg.norm(first)
        axes = np.array([n, first, np.cross(n, first)])
        axes.setflags(write=False)
        return axes

    @cached_property
    def facets(self) -> np.ndarray:
        """(4, 3) rows n + α(±t₁ ± t₂), the largest of which is n·m + α‖P_t m‖₁ ≥ ⟨m⟩.

        Where all are at most zero is a pyramid inside of the cone ⟨m⟩ ≤ 0. One row n if α = 0.
        """
        n, first, second = self.axes
        signs = [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)] if self.tilt else [(0.0, 0.0)]
        facets = np.array([n + self.tilt * (a * first + b * second) for a, b in signs])
        facets.setflags(write=False)
        return facets

    def across(self, point: np.ndarray) -> np.ndarray:
        """Returns (t₁, t₂)·𝔭 (..., 2) [m], where a point 𝔭 (..., 3) is across n."""
        places: np.ndarray = point @ self.axes[1:].T
        return places

    def around(self, motion: np.ndarray) -> np.ndarray:
        """Returns ‖P_t m‖₁ (...), in t₁ and t₂, of a vector m (..., 3); not less than `lateral`."""
        return np.sum(np.abs(self.across(motion)), axis=-1)

    def advance(self, motion: np.ndarray) -> np.ndarray:
        """Returns ⟨m⟩ (...), the most that the depth can grow by a motion m (..., 3) [m or m/s].

        ⟨m + λn⟩ = ⟨m⟩ + λ, and ⟨m + m'⟩ ≤ ⟨m⟩ + ⟨m'⟩ by the triangle inequality.
        """
        return self.depth(motion) + self.tilt * self.lateral(motion)

    @cached_property
    def share(self) -> float:
        """Cos θ − μ sin θ, the least part of F_N that is along n, tilt and friction against it."""
        return float(np.cos(self.angle) - self.friction * np.sin(self.angle))

    def normal_force_bound(self, force: np.ndarray, noise: float, *, averaged: bool = False
                           ) -> np.ndarray:
        """Returns the largest F_N (...) [N] behind a reading of the tip's force 𝐅 (..., 3) [N].

        The tip gives the wall F_N along the wall's normal, which is off n by β ≤ θ, and at most
        μF_N across it; the reading is off by at most ν in norm. Then ‖𝐅‖ + ν ≥ F_N, and
        n·𝐅 + ν ≥ F_N (cos β − μ sin β) ≥ F_N (cos θ − μ sin θ), which says something if it is
        positive. Both hold; the lesser counts. F_N ≥ 0, for a wall does not pull.

        The second is linear in 𝐅, so that it holds for a mean of forces and the least F_N of them,
        too. The first does not: at an edge, or where friction turns, forces cancel in a mean.

        Args:
            force: What the sensor reads, in Σ_I.
            noise: ν, bound of its error in norm [N]: noise, bias, the weight and drag of what is
                behind the sensor, and what errors of position and speed make of the force.
            averaged: Whether the reading may be a mean of forces at several places.
        """
        bounds = [np.full(force.shape[:-1], np.inf)]
        if self.share > 0.0:
            bounds.append((self.depth(force) + noise) / self.share)
        if not averaged:
            bounds.append(np.linalg.norm(force, axis=-1) + noise)
        return np.maximum(np.min(bounds, axis=0), 0.0)

    def static_force_bound(self, force: np.ndarray, velocity: np.ndarray, noise: float, *,
                           averaged: bool = False) -> np.ndarray:
        """Returns φ⁺ (...) [N], the largest static force behind a reading of a tip that moves.

        φ (1 − c₊(−δ̇)₊) ≤ F_N, and −δ̇ ≤ ⟨−v⟩ for a velocity v. A tip that retreats faster than
        1/c₊ may feel nothing at any φ: then φ⁺ is infinite.

        Args:
            force: See `normal_force_bound` (..., 3).
            velocity: Of the tip in Σ_I (..., 3) [m/s].
            noise: See `normal_force_bound`.
            averaged: See `normal_force_bound`.
        """
        left = 1.0 - self.dissipation * np.maximum(self.advance(-velocity), 0.0)
        bound = self.normal_force_bound(force, noise, averaged=averaged)
        return np.where(left > 0.0, bound / np.where(left > 0.0, left, 1.0), np.inf)
