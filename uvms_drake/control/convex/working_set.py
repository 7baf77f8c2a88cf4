"""Working set: the limits of a staged program that a conic program contains."""

from dataclasses import dataclass

import numpy as np

from uvms_drake.control.convex.staged_program import StagedProgram
from uvms_drake.model.frames.spatial import times

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
