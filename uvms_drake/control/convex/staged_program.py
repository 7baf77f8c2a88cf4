"""Convex program of one iteration; `staged_solver` solves it.

A plan is changed by x_k (state) and w_k (decision), z_k = (x_k, w_k):

    min  Σ_{k<N} (½ z_kᵀ H_k z_k + g_kᵀ z_k) + ½ x_NᵀH_N x_N + g_Nᵀx_N + ρ_s s + ρ_v v
    s.t. x_0 = 0,  x_{k+1} = A_k x_k + B_k w_k
         lower ≤ value + C_k z_k ≤ upper       (widened by v ≥ 0 where a row is soft)
         ‖value + C z_k‖₂ ≤ bound
         ‖value + T x_N‖₂ ≤ radius + s,  s ≥ 0,  and ≤ size + rowᵀx_N + s for each `RadiusBound`
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np


class LinearLimits(NamedTuple):
    """Rows lower ≤ value + C z ≤ upper of every stage; infinite bounds where there is none."""

    C: np.ndarray
    """Rows C of the limits (N+1, m, nx+nw); at the last stage w is zero."""
    value: np.ndarray
    """Values at the plan (N+1, m)."""
    lower: np.ndarray
    """Lower bounds of the values (N+1, m)."""
    upper: np.ndarray
    """Upper bounds of the values (N+1, m)."""
    soft: np.ndarray
    """Whether v relaxes a row (m,)."""


def stacked(parts: list[LinearLimits]) -> LinearLimits:
    """Returns all rows of several limits."""
    def rows(name: str, axis: int = 1) -> np.ndarray:
        return np.concatenate([getattr(part, name) for part in parts], axis=axis)

    return LinearLimits(rows("C"), rows("value"), rows("lower"), rows("upper"), rows("soft", 0))


class NormLimit(NamedTuple):
    """Norms ‖value + C z‖₂ ≤ bound at every stage."""

    C: np.ndarray
    """Rows C of the norm (m, nx+nw), the same at every stage."""
    value: np.ndarray
    """Vectors at the plan (N+1, m)."""
    bound: np.ndarray
    """Largest norms (N+1,); infinite where there is no limit."""


class RadiusBound(NamedTuple):
    """Bounds of the terminal radius: the least of size + rows x_N."""

    size: np.ndarray
    """Sizes at the plan (m,)."""
    rows: np.ndarray
    """Gradients by x_N (m, nx)."""


class TerminalLimit(NamedTuple):
    """Terminal set ‖value + T x_N‖₂ ≤ radius + s, and at most each of `radius_bound` + s."""

    T: np.ndarray
    value: np.ndarray
    radius: float
    radius_bound: RadiusBound | None = None
    """Further bounds of the radius, if there are any."""

    def radius_bounds(self, x: np.ndarray) -> RadiusBound:
        """Returns all finite bounds of the norm, less s, about x_N (nx,)."""
        size, rows = np.array([self.radius]), np.zeros((1, len(x)))
        if self.radius_bound is not None:
            size = np.append(size, self.radius_bound.size + self.radius_bound.rows @ x)
            rows = np.concatenate([rows, self.radius_bound.rows])
        finite = np.isfinite(size)
        return RadiusBound(size[finite], rows[finite])

    def excess(self, x: np.ndarray) -> float:
        """Returns the excess of the end over the set for x_N (nx,); negative inside."""
        more = self.radius_bound
        least = np.inf if more is None else np.min(more.size + more.rows @ x)
        return float(np.linalg.norm(self.value + self.T @ x) - min(self.radius, least))

    def nearly_left(self, part: float) -> bool:
        """Returns whether the plan is within this part of the radius from the boundary."""
        least = np.inf if self.radius_bound is None else np.min(self.radius_bound.size)
        return bool(np.linalg.norm(self.value) > (1.0 - part) * min(self.radius, least))


@dataclass(frozen=True)
class StagedProgram:
    """Convex program of N stages with nx states and nw decisions."""

    A: np.ndarray
    """∂x_{k+1}/∂x_k (N, nx, nx)."""
    B: np.ndarray
    """∂x_{k+1}/∂w_k (N, nx, nw)."""
    H: np.ndarray
    """Hessians of the stage costs (N, nx+nw, nx+nw); semidefinite, and definite in w."""
    g: np.ndarray
    """Gradients of the stage costs (N, nx+nw)."""
    H_end: np.ndarray
    """Hessian of the cost of the end (nx, nx)."""
    g_end: np.ndarray
    """Gradient of the cost of the end (nx,)."""
    linear: LinearLimits
    norms: tuple[NormLimit, ...]
    terminal: TerminalLimit
    slack_penalty: float
    """Penalty ρ_s of the slack s."""
    excess_penalty: float
    """Penalty ρ_v of the excess v."""
