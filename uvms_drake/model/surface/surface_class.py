"""Class of unknown surfaces: bounds of stiffness, orientation, damping and friction.

The static normal force φ(𝔭) ≥ 0 of the wall on the tip at rest at 𝔭 is any function with

    φ(𝔭') ≤ φ(𝔭) + κ₊ ⟨𝔭' − 𝔭⟩₊,    ⟨m⟩ = n·m + α‖P_t m‖,    P_t = I − n nᵀ,   (·)₊ = max(·, 0),

and damping multiplies it: 1 − c₊(−δ̇)₊ ≤ F_N/φ ≤ 1 + c₊(δ̇)₊, δ̇ the rate of the depth. A monotone
static force of slope at most κ₊ over the depth, with a normal at most θ off n, is one with
α = tan θ; see `model/surface/theory.md#class-of-surfaces`.
"""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated

import numpy as np

from uvms_drake.common.constraints import Below, NotNegative, Positive, UnitVector
from uvms_drake.common.schema import check_values

STEEPEST_FLOOR = np.deg2rad(20.0)
"""Largest inclination of a floor or a ceiling to the horizontal [rad]; beyond it is a wall."""


def is_floor(direction: np.ndarray) -> bool:
    """Returns whether a direction n (3,) into a surface is that of a floor or of a ceiling."""
    return bool(abs(direction[2]) > np.cos(STEEPEST_FLOOR))


def heading_of(direction: np.ndarray) -> float:
    """Returns the heading [rad] of a robot that faces a wall, about z of Σ_I; 0 above a floor."""
    return 0.0 if is_floor(direction) else float(np.arctan2(direction[1], direction[0]))


def axis_names(direction: np.ndarray) -> tuple[str, str]:
    """Returns the names of t₁ and t₂ of `wall_axes`: down and to port, or by the compass."""
    if is_floor(direction):
        return "north", "east" if direction[2] > 0.0 else "west"
    return "down", "to port"


def wall_axes(direction: np.ndarray) -> np.ndarray:
    """Returns the rotation (3, 3) with the rows n, t₁ and t₂ = n × t₁ of a surface.

    On a wall t₁ is down, z of Σ_I projected into it, and t₂ to port as seen along n. A floor or a
    ceiling has no direction down: there t₁ is north, x of Σ_I projected into it.

    Args:
        direction: Unit vector n (3,) in Σ_I from the water into the surface.
    """
    x, _, z = np.eye(3)
    reference = x if is_floor(direction) else z
    first = reference - direction * (direction @ reference)
    first = first / np.linalg.norm(first)
    return np.array([direction, first, np.cross(direction, first)])


@dataclass(frozen=True)
class SurfaceClass:
    """All walls with these bounds."""

    direction: Annotated[np.ndarray, UnitVector] = field(
        default_factory=lambda: np.array([1.0, 0.0, 0.0]))
    """Unit vector n (3,) in Σ_I from the water into the wall."""
    stiffness: Annotated[float, Positive] = 2000.0
    """Largest slope κ₊ of the static force over the depth [N/m]."""
    angle: Annotated[float, Below(0.5 * np.pi)] = 0.0
    """Largest angle θ between n and the wall's own normal [rad]; α = tan θ."""
    dissipation: Annotated[float, NotNegative] = 0.0
    """Largest factor of damping c₊ [s/m]."""
    friction: Annotated[float, NotNegative] = 0.0
    """Largest ratio μ of tangential and normal force."""
    least_stiffness: float = 0.0
    """Smallest slope κ₋ of the static force along n past the transition [N/m]; 0: unknown."""

    def __post_init__(self) -> None:
        check_values(self)
        n = np.array(self.direction, dtype=float)
        n.setflags(write=False)
        object.__setattr__(self, "direction", n)

    @cached_property
    def tilt(self) -> float:
        """α = tan θ."""
        return float(np.tan(self.angle))

    def depth(self, point: np.ndarray) -> np.ndarray:
        """Returns the depth x = n·𝔭 (...) [m] of a position 𝔭 (..., 3)."""
        return point @ self.direction

    def lateral(self, motion: np.ndarray) -> np.ndarray:
        """Returns the tangential length ‖P_t m‖ (...) of a vector m (..., 3)."""
        across = motion @ self.tangents
        return np.sqrt((across * across).sum(axis=-1))

    @cached_property
    def axes(self) -> np.ndarray:
        """Rotation (3, 3) with the rows n, t₁, t₂, see `wall_axes`."""
        axes = wall_axes(self.direction)
        axes.setflags(write=False)
        return axes

    @cached_property
    def tangents(self) -> np.ndarray:
        """Columns t₁, t₂ (3, 2)."""
        return self.axes[1:].T

    @cached_property
    def facets(self) -> np.ndarray:
        """(4, 3) rows n + α(±t₁ ± t₂), the largest of which is n·m + α‖P_t m‖₁ ≥ ⟨m⟩.

        All at most zero: a pyramid inside of the cone ⟨m⟩ ≤ 0. One row n if α = 0.
        """
        n, first, second = self.axes
        signs = [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)] if self.tilt else [(0.0, 0.0)]
        facets = np.array([n + self.tilt * (a * first + b * second) for a, b in signs])
        facets.setflags(write=False)
        return facets

    def across(self, point: np.ndarray) -> np.ndarray:
        """Returns the tangential coordinates (t₁, t₂)·𝔭 (..., 2) [m] of a point 𝔭 (..., 3)."""
        return point @ self.tangents

    def around(self, motion: np.ndarray) -> np.ndarray:
        """Returns ‖P_t m‖₁ (...), in t₁ and t₂, of a vector m (..., 3); not less than `lateral`."""
        return np.abs(self.across(motion)).sum(axis=-1)

    def advance(self, motion: np.ndarray) -> np.ndarray:
        """Returns ⟨m⟩ (...), the largest growth of the depth by a motion m (..., 3) [m or m/s].

        ⟨m + λn⟩ = ⟨m⟩ + λ, and ⟨m + m'⟩ ≤ ⟨m⟩ + ⟨m'⟩ by the triangle inequality.
        """
        return self.depth(motion) + self.tilt * self.lateral(motion) if self.tilt else (
            self.depth(motion))

    @cached_property
    def share(self) -> float:
        """Smallest part cos θ − μ sin θ of F_N along n, with tilt and friction against it."""
        return float(np.cos(self.angle) - self.friction * np.sin(self.angle))

    @cached_property
    def largest_share(self) -> float:
        """Largest part cos β + μ sin β of F_N along n, β ≤ θ."""
        mu = self.friction
        return float(np.hypot(1.0, mu) if self.tilt >= mu else
                     np.cos(self.angle) + mu * np.sin(self.angle))

    def normal_force_bound(self, force: np.ndarray, noise: float, *, averaged: bool = False
                           ) -> np.ndarray:
        """Returns the largest F_N (...) [N] behind a reading of the tip's force 𝐅 (..., 3) [N].

        It is the lesser of ‖𝐅‖ + ν and (n·𝐅 + ν)/(cos θ − μ sin θ), the latter alone for a mean of
        forces; see `model/surface/theory.md#force-behind-a-reading`.

        Args:
            force: Reading of the force in Σ_I (..., 3) [N].
            noise: Bound ν of its error in norm [N].
            averaged: Whether the reading may be a mean of forces at several places.
        """
        bound = ((self.depth(force) + noise) / self.share if self.share > 0.0 else
                 np.full(force.shape[:-1], np.inf))
        if not averaged:
            bound = np.minimum(bound, np.linalg.norm(force, axis=-1) + noise)
        return np.maximum(bound, 0.0)

    def static_behind(self, bound: np.ndarray, retreat: np.ndarray) -> np.ndarray:
        """Returns φ⁺ (...) [N], the largest static force behind a bound of F_N (...) [N].

        φ (1 − c₊⟨−v⟩₊) ≤ F_N; infinite for a tip that retreats, ⟨−v⟩ (...) [m/s], faster than 1/c₊.
        """
        left = 1.0 - self.dissipation * np.maximum(retreat, 0.0)
        if (left > 0.0).all():
            return bound / left
        return np.where(left > 0.0, bound / np.where(left > 0.0, left, 1.0), np.inf)
