"""Convex program of one iteration; `staged_solver` solves it, or any convex solver of Drake's.

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
from pydrake.solvers import MathematicalProgram

from uvms_drake.common.bindings import named
from uvms_drake.model.frames.spatial import times


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
    names: tuple[str, ...] = ()
    """Name of each row's limit (m,), for the bindings of `mathematical_program`."""


class NormLimit(NamedTuple):
    """Norms ‖value + C z‖₂ ≤ bound at every stage."""

    C: np.ndarray
    """Rows C of the norm (m, nx+nw), the same at every stage."""
    value: np.ndarray
    """Vectors at the plan (N+1, m)."""
    bound: np.ndarray
    """Largest norms (N+1,); infinite where there is no limit."""
    name: str = "norm"
    """Name of the limit."""

    def norms(self, z: np.ndarray | None = None) -> np.ndarray:
        """Returns the norms (N+1,) after z (N+1, nx+nw); None for none."""
        vector = self.value if z is None else self.value + z @ self.C.T
        return np.sqrt(np.einsum("ki,ki->k", vector, vector))


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


class ActiveLimits(NamedTuple):
    """Limits with a multiplier in the solution of a program, but for the terminal set."""

    upper: np.ndarray
    """Linear limits that are at their upper bounds (N+1, m)."""
    lower: np.ndarray
    """Linear limits that are at their lower bounds (N+1, m)."""
    norms: np.ndarray
    """Norm limits (number of norm limits, N+1)."""


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
    similar: ActiveLimits | None = None
    """Active limits of a similar program, where the search for those of this one begins."""

    def mathematical_program(self) -> "ConvexProgram":
        """Returns the program as Drake's `MathematicalProgram`, named by stage and limit."""
        return ConvexProgram(self)


class ConvexProgram(MathematicalProgram):
    """Staged program in full: a conic program with a quadratic cost, all limits at all stages.

    Variables are `x[k]`, `w[k]`, `s` and `v`; costs `stage_cost[k]`, `terminal_cost` and
    `penalties`; constraints `start`, `motion[k]`, `limits.NAME[k]`, `terminal_set`,
    `radius_bound[i]` and `relaxations`. k is the program's own stage: that of a `TrackingOcp` has
    one before the plan's, which moves the reference.
    """

    def __init__(self, program: StagedProgram):
        super().__init__()
        N, nx, nw = program.B.shape
        self.x = np.array([self.NewContinuousVariables(nx, f"x[{k}]") for k in range(N + 1)])
        """States x_k (N+1, nx)."""
        self.w = np.array([self.NewContinuousVariables(nw, f"w[{k}]") for k in range(N)])
        """Decisions w_k (N, nw)."""
        self.s = self.NewContinuousVariables(1, "s")
        """Slack s of the terminal set (1,)."""
        self.v = self.NewContinuousVariables(1, "v")
        """Excess v of the soft rows (1,)."""
        penalties = [program.slack_penalty, program.excess_penalty]
        relaxations = np.concatenate([self.s, self.v])
        named(self.AddLinearCost(penalties, 0.0, relaxations), "penalties")
        named(self.AddBoundingBoxConstraint(0.0, np.inf, relaxations), "relaxations")
        named(self.AddBoundingBoxConstraint(0.0, 0.0, self.x[0]), "start")
        for k in range(N):
            z = np.concatenate([self.x[k], self.w[k]])
            named(self.AddQuadraticCost(program.H[k], program.g[k], 0.0, z, is_convex=True),
                  f"stage_cost[{k}]")
            motion = np.hstack([program.A[k], program.B[k], -np.eye(nx)])
            named(self.AddLinearEqualityConstraint(
                motion, np.zeros(nx), np.concatenate([z, self.x[k + 1]])), f"motion[{k}]")
        named(self.AddQuadraticCost(
            program.H_end, program.g_end, 0.0, self.x[N], is_convex=True), "terminal_cost")
        for k in range(N + 1):
            self._add_limits(program, k)
        self._add_terminal_set(program.terminal)

    def _add_limits(self, program: StagedProgram, k: int) -> None:
        """Adds the limits of a stage; the last one has no decision."""
        linear = program.linear
        z = np.concatenate([self.x[k], self.w[k]]) if k < len(self.w) else self.x[k]
        names = np.array(linear.names or ["limits"] * len(linear.soft))
        bounded = np.isfinite(linear.lower[k]) | np.isfinite(linear.upper[k])
        for name in dict.fromkeys(names[bounded]):
            own = bounded & (names == name)
            C, soft = linear.C[k, own, : len(z)], linear.soft[own]
            lower, upper = ((bound[k] - linear.value[k])[own]
                            for bound in (linear.lower, linear.upper))
            if not soft.any():
                binding = self.AddLinearConstraint(C, lower, upper, z)
            else:
                v, none = soft[:, None].astype(float), np.full(len(C), np.inf)
                binding = self.AddLinearConstraint(
                    np.block([[C, -v], [C, v]]), np.concatenate([-none, lower]),
                    np.concatenate([upper, none]), np.concatenate([z, self.v]))
            named(binding, f"{name}[{k}]")
        for limit in program.norms:
            if np.isfinite(limit.bound[k]):
                named(self.AddLorentzConeConstraint(
                    np.pad(limit.C[:, : len(z)], ((1, 0), (0, 0))),
                    np.append(limit.bound[k], limit.value[k]), z), f"{limit.name}[{k}]")

    def _add_terminal_set(self, terminal: TerminalLimit) -> None:
        """Adds ‖value + T x_N‖ ≤ radius + s, and the radius bounds likewise."""
        bounds = terminal.radius_bounds(np.zeros(terminal.T.shape[1]))
        first = int(np.isfinite(terminal.radius))
        for i, (size, row) in enumerate(zip(bounds.size, bounds.rows, strict=True)):
            A = np.block([[row, np.ones(1)], [terminal.T, np.zeros((len(terminal.T), 1))]])
            named(self.AddLorentzConeConstraint(
                A, np.append(size, terminal.value), np.concatenate([self.x[-1], self.s])),
                f"radius_bound[{i - first}]" if i >= first else "terminal_set")


KEPT = 1e-7
"""Excess of a limit, in its own unit, that does not count: ten times the solver's tolerance."""


@dataclass
class WorkingSet:
    """Subset of the limits of a program."""

    upper: np.ndarray
    """Linear limits whose upper bound is in the set (N+1, m)."""
    lower: np.ndarray
    """Linear limits whose lower bound is in the set (N+1, m)."""
    norms: np.ndarray
    """Norm limits that are in the set (number of norm limits, N+1)."""
    terminal: bool
    """Whether the terminal set is in the set."""

    def any(self) -> bool:
        """Returns whether it is not empty."""
        return bool(self.terminal or self.upper.any() or self.lower.any() or self.norms.any())

    def soft(self, program: StagedProgram) -> bool:
        """Returns whether it has a soft limit."""
        return bool(np.any((self.upper | self.lower) & program.linear.soft))

    def __or__(self, other: "WorkingSet") -> "WorkingSet":
        return WorkingSet(self.upper | other.upper, self.lower | other.lower,
                          self.norms | other.norms, self.terminal or other.terminal)

    def without(self, other: "WorkingSet") -> "WorkingSet":
        """Returns the limits that are not in another set."""
        return WorkingSet(self.upper & ~other.upper, self.lower & ~other.lower,
                          self.norms & ~other.norms, self.terminal and not other.terminal)

    def rows(self, program: StagedProgram) -> int:
        """Returns the number of rows."""
        return int(np.count_nonzero(self.upper) + np.count_nonzero(self.lower)
                   + self.terminal * len(program.terminal.T)
                   + sum(len(limit.C) * np.count_nonzero(stages) for limit, stages in zip(
                       program.norms, self.norms, strict=True)))

    def at_all_stages(self, program: StagedProgram) -> "WorkingSet":
        """Returns the set with each limit at all stages where it has a bound."""
        linear = program.linear
        return WorkingSet(
            np.any(self.upper, axis=0) & np.isfinite(linear.upper),
            np.any(self.lower, axis=0) & np.isfinite(linear.lower),
            _by_stages(program, [np.any(stages) & np.isfinite(limit.bound) for limit, stages in zip(
                program.norms, self.norms, strict=True)]), self.terminal)

    @staticmethod
    def broken(program: StagedProgram, z: np.ndarray, excess: float) -> "WorkingSet":
        """Returns the limits that z (N+1, nx+nw) breaks, soft ones by more than `excess`."""
        linear, terminal = program.linear, program.terminal
        value = linear.value + times(linear.C, z)
        tolerance = KEPT + excess * linear.soft
        return WorkingSet(
            upper=value > linear.upper + tolerance,
            lower=value < linear.lower - tolerance,
            norms=_by_stages(
                program, [limit.norms(z) > limit.bound + KEPT for limit in program.norms]),
            terminal=terminal.excess(z[-1, : terminal.T.shape[1]]) > KEPT)

    @staticmethod
    def near(program: StagedProgram, part: float) -> "WorkingSet":
        """Returns the limits whose distance in the plan is below a part of their range."""
        linear, terminal = program.linear, program.terminal
        width = linear.upper - linear.lower
        margin = part * np.where(np.isfinite(width), width, 0.0)
        return WorkingSet(
            upper=linear.upper - linear.value < margin,
            lower=linear.value - linear.lower < margin,
            norms=_by_stages(program, [
                limit.norms() > (1.0 - part) * limit.bound for limit in program.norms]),
            terminal=terminal.nearly_left(part))


def _by_stages(program: StagedProgram, active: list[np.ndarray]) -> np.ndarray:
    """Returns which norm limits are active (limits, N+1), also of none."""
    return np.array(active, dtype=bool).reshape(len(active), len(program.linear.value))
