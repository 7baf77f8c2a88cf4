"""Limits of a problem in arrays: all that no plan changes is computed once.

A stack has the limits that are rows, those of the inputs before those at the knots, and those that
are cones. Values and slopes of a plan fill its arrays; a limit's own object computes them for all
points at once. A limit that is replaced may change its bounds alone (`with_bounds`).
"""

from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np

from uvms_drake.control.convex.staged_program import LinearLimits, NormLimit
from uvms_drake.control.limits import Limit
from uvms_drake.control.plan.points import Points, Slopes


class Inputs(NamedTuple):
    """Beginnings of all intervals, then their ends."""

    points: Points
    """Points, with their inputs ū."""
    y_z: np.ndarray
    """Derivatives ∂y/∂z by the interval's z (K, 6+n, size of z)."""
    zeta_z: np.ndarray
    """Derivatives ∂ζ/∂z, likewise."""
    u_z: np.ndarray
    """Derivatives ∂u/∂z, likewise."""


class Values(NamedTuple):
    """Limited values of a plan."""

    rows: np.ndarray
    """Values of the rows (N+1, m); zero where there is none."""
    cones: list[np.ndarray]
    """Vectors of the cones (N+1, r)."""


@dataclass(frozen=True)
class Entry:
    """Limit and its place in the arrays."""

    limit: Limit
    columns: slice
    """Columns of its rows; empty for a cone."""
    constant: bool = True
    """Whether its slopes are the same at all points."""

    @property
    def name(self) -> str:
        """Name in a program."""
        return f"limits.{self.limit.name}"

    @property
    def is_input(self) -> bool:
        """Whether it limits the input."""
        return self.limit.about == "input"

    @property
    def has_own_excess(self) -> bool:
        """Whether its excess is not that of its row or cone."""
        return type(self.limit).excess is not Limit.excess


class LimitStack:
    """Stack of limits.

    Args:
        limits: Limits by name.
        at: Two points with velocity and input, in whose form the limits are asked for theirs.
        stages: Number N + 1 of knots.
        width: Size of z, which starts with y and ζ.
    """

    def __init__(self, limits: Mapping[str, Limit], at: Points, stages: int, width: int):
        self._stages, self._size = stages, at.model.size
        self._rows: list[Entry] = []
        self._cones: list[Entry] = []
        self._norm_rows: list[np.ndarray] = []
        self._norm_bounds: list[np.ndarray] = []
        # Every limit is a cone or has rows, of an input at both ends of an interval.
        bounds: list[tuple[np.ndarray, np.ndarray]] = []
        count = 0
        for limit in sorted(limits.values(), key=lambda limit: limit.about != "input"):
            cone = limit.cone(at) if limit.about != "input" else None
            if cone is not None:
                C = np.zeros((1, cone.value.shape[-1], width))
                self._fill(C, slice(None), cone.slopes)
                self._norm_rows.append(C[0])
                self._norm_bounds.append(np.append(np.inf, np.full(stages - 1, cone.bound)))
                self._cones.append(Entry(limit, slice(0)))
                continue
            own, slopes = limit.row_bounds(at), limit.row_slopes(at)
            end = count + len(own[0]) * (2 if limit.about == "input" else 1)
            self._rows.append(Entry(limit, slice(count, end), limit.about != "input" and all(
                each is None or each.ndim == 2 for each in slopes)))
            bounds.append(own)
            count = end
        # Their arrays; slopes that are constant are written once.
        shape = stages, count
        self._C, self._soft = np.zeros((*shape, width)), np.zeros(count, dtype=bool)
        self._lower, self._upper = np.full(shape, -np.inf), np.full(shape, np.inf)
        for entry, own in zip(self._rows, bounds, strict=True):
            self._soft[entry.columns] = entry.limit.soft
            self._bound(entry, *own)
            if entry.constant:
                self._fill(self._C, entry.columns, entry.limit.row_slopes(at))
        self._names = tuple(entry.name for entry in self._rows
                            for _ in range(entry.columns.stop - entry.columns.start))

    def is_of(self, limits: Mapping[str, Limit], stages: int) -> bool:
        """Returns whether the stack is that of these limits, for a number of knots."""
        known = {id(entry.limit) for entry in self._entries}
        return (stages == self._stages and len(known) == len(limits)
                and all(id(each) in known for each in limits.values()))

    def with_bounds(self, limits: Mapping[str, Limit]) -> Self | None:
        """Returns the stack with other bounds, or None if it has not the limits' names and types.

        Args:
            limits: Its limits, or others that are rows at the knots with the same slopes.
        """
        by_name = {entry.limit.name: entry for entry in self._entries}
        if by_name.keys() != limits.keys():
            return None
        out = copy(self)
        out._lower, out._upper = self._lower.copy(), self._upper.copy()
        out._rows = list(self._rows)
        for name, limit in limits.items():
            entry = by_name[name]
            if entry.limit is limit:
                continue
            if type(limit) is not type(entry.limit) or entry not in self._rows:
                return None
            new = Entry(limit, entry.columns, entry.constant)
            out._rows[self._rows.index(entry)] = new
            out._bound(new, limit.lower, limit.upper)
        return out

    @property
    def row_limits(self) -> tuple[Entry, ...]:
        """Limits that are rows; of an input both ends of an interval are side by side."""
        return tuple(self._rows)

    @property
    def _entries(self) -> list[Entry]:
        return [*self._rows, *self._cones]

    def values(self, knots: Points, ends: Points) -> Values:
        """Returns the limited values of a plan.

        Args:
            knots: The N+1 knots.
            ends: Beginnings of the intervals, then their ends.
        """
        rows = np.zeros(self._lower.shape)
        for entry in self._rows:
            value = entry.limit.row_values(ends if entry.is_input else knots)
            if entry.is_input:
                value = self._side_by_side(value)
            rows[: len(value), entry.columns] = value
        cones = []
        for entry in self._cones:
            cone = entry.limit.cone(knots)
            assert cone is not None
            cones.append(cone.value)
        return Values(rows, cones)

    def excess(self, values: Values, knots: Points) -> np.ndarray:
        """Returns all excesses, negative within, in no particular order.

        Args:
            values: Values of a plan.
            knots: Its knots.
        """
        over = np.maximum(values.rows - self._upper, self._lower - values.rows)
        parts = []
        for entry in self._rows:
            if entry.has_own_excess:
                over[:, entry.columns] = -np.inf
                parts.append(entry.limit.excess(knots)[1:])
        for entry, value, bound in zip(
                self._cones, values.cones, self._norm_bounds, strict=True):
            parts.append(entry.limit.excess(knots)[1:] if entry.has_own_excess
                         else np.sqrt(np.sum(value**2, axis=1)) - bound)
        return np.concatenate([over.ravel(), *(part.ravel() for part in parts)])

    def linear(self, knots: Points, values: Values, inputs: Inputs) -> LinearLimits:
        """Returns the limits that are rows of a convex program.

        Args:
            knots: The N+1 knots.
            values: Values of the plan.
            inputs: Its inputs.
        """
        C, (points, *chain) = self._C.copy(), inputs
        for entry in self._rows:
            if entry.constant:
                continue
            at = points if entry.is_input else knots
            slopes = entry.limit.row_slopes(at)
            if entry.is_input:
                by_z = self._side_by_side(slopes.through(Slopes(*chain)))
                C[: len(by_z), entry.columns] = by_z
            else:
                self._fill(C, entry.columns, slopes)
        return LinearLimits(C, values.rows, self._lower, self._upper, self._soft, self._names)

    def norms(self, values: Values) -> tuple[NormLimit, ...]:
        """Returns the limits that are norms of a convex program."""
        return tuple(map(NormLimit, self._norm_rows, values.cones, self._norm_bounds,
                         [entry.name for entry in self._cones]))

    @staticmethod
    def _side_by_side(value: np.ndarray) -> np.ndarray:
        """Returns values (N, 2m, ...) of the intervals from those of their ends (2N, m, ...)."""
        return np.concatenate(np.split(value, 2), axis=1)

    def _fill(self, C: np.ndarray, columns: slice, slopes: Slopes) -> None:
        """Writes slopes by y and ζ at the knots; z starts with them."""
        for slope, place in ((slopes.y, slice(self._size)),
                             (slopes.zeta, slice(self._size, 2 * self._size))):
            if slope is not None:
                C[:, columns, place] = slope

    def _bound(self, entry: Entry, lower: np.ndarray, upper: np.ndarray) -> None:
        """Writes the bounds of a limit's rows: the state at the first knot is given."""
        if entry.is_input:
            self._lower[:-1, entry.columns] = np.tile(lower, 2)
            self._upper[:-1, entry.columns] = np.tile(upper, 2)
        else:
            self._lower[1:, entry.columns], self._upper[1:, entry.columns] = lower, upper
