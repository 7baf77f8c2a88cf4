"""The interface of a limit: bounds on some values of a motion, and all questions about them.

A limit of one's own is a subclass with a `name`, `values` and `bounds`, and what the tube takes of
it (`tube_takes`), in `Limits.more`: the nominal MPC keeps it by linearised rows, softened like
those of roll and pitch, the terminal set is searched for a state that breaks it, and tables, bars
and the certificate have it. What is linear in (y, ζ), or a norm of what is linear, says so by
`closed_form`. To have it in YAML files, put it into `settings.AnyLimit`.
"""

from abc import ABC, abstractmethod
from copy import copy
from typing import ClassVar, NamedTuple, Self

import numpy as np

from uvms_drake.common.errors import require
from uvms_drake.control.limits.radii import TubeRadii
from uvms_drake.control.plan.points import About, Points, Slopes, slopes


class Rows(NamedTuple):
    """lower ≤ value + slopes · change ≤ upper."""

    value: np.ndarray
    """Values at the points (..., m)."""
    slopes: Slopes
    """Derivatives of the values."""
    lower: np.ndarray
    """Lower bounds (m,)."""
    upper: np.ndarray
    """Upper bounds (m,)."""


class Cone(NamedTuple):
    """‖value + slopes · change‖₂ ≤ bound."""

    value: np.ndarray
    """Vectors at the points (..., r)."""
    slopes: Slopes
    """Derivatives of the vectors, the same at all points (r, 6+n)."""
    bound: float


class Limit(ABC):
    """Bounds on m values of a motion, lower ≤ values ≤ upper.

    A bound on an absolute value or a norm has lower = −upper.
    """

    name: str
    """Key below `limits`, unlike every other limit's."""
    about: ClassVar[About] = "pose"
    """Arguments that `values` reads. A limit about pose or speed holds at the knots of a plan,
    one about the input at both ends of every interval."""
    soft: ClassVar[bool] = True
    """Whether the convex program may relax it, as is best for a limit that is not linear."""
    overshoots: ClassVar[bool] = True
    """Whether the values may go beyond their bounds between two knots that keep them."""
    owner: ClassVar[str] = "pose"
    """Part of a task or start that is to blame for breaking it: `pose`, `joints` or `force`."""
    margin: np.ndarray | float = 0.0
    """Margin that has been taken off both bounds (m,) or ()."""
    between_knots_margin: np.ndarray | float = 0.0
    """Part of the margin that is for what a plan does between its knots (m,) or ()."""

    @abstractmethod
    def values(self, at: Points) -> np.ndarray:
        """Returns the values (..., m); also of complex points, where `slopes` is not overridden."""

    @abstractmethod
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Returns the lower and the upper bounds (m,) of the real motion."""

    def tube_takes(self, tube: TubeRadii) -> np.ndarray | None:
        """Returns by how much the values may differ (m,) inside the tube.

        None, as by default: that is not known. Then there is no certificate, and a plan keeps the
        whole limit, which the real motion may exceed.

        Args:
            tube: With all blocks filled in.
        """
        return None

    def plan_takes(self, tube: TubeRadii) -> np.ndarray | float:
        """Returns how far a plan may be beyond bounds between knots that keep them (m,) or ().

        Zero, as by default, if it is not beyond them, or if that is not known.

        Args:
            tube: With all blocks filled in.
        """
        return 0.0

    def closed_form(self, size: int) -> list[Slopes] | None:
        """Returns for each value G (r, 6+n): it changes by at most ‖G d(y, ζ)‖₂, the same anywhere.

        None, as by default: there is no such thing, and the terminal set checks it at samples.

        Args:
            size: 6 + n.
        """
        return None

    def cone(self, at: Points) -> Cone | None:
        """Returns the limit as a cone, if it is one for the convex program; then `rows` are not."""
        return None

    def slopes(self, at: Points) -> Slopes:
        """Returns the derivatives of the values, by complex steps if nothing better is known."""
        return slopes(self.values, at, self.about)

    def row_values(self, at: Points) -> np.ndarray:
        """Returns the values that the limit has as rows of a convex program (..., m)."""
        return self.values(at)

    def rows(self, at: Points) -> Rows:
        """Returns the limit as rows of a convex program about the points `at`."""
        return Rows(self.row_values(at), self.slopes(at), self.lower, self.upper)

    def check(self) -> None:
        """Raises `InvalidParameter` for the first parameter that has no meaning."""
        name = getattr(self, "name", None)
        require(isinstance(name, str), "name", name, "the limit's key, such as `tip_height`")
        lower, upper = self.bounds()
        require(np.ndim(lower) == 1 and np.shape(lower) == np.shape(upper), "bounds",
                [lower, upper], "two arrays (m,) for m values")
        require(bool(np.all(lower < upper)), "bounds", [lower, upper], "in order")

    # What follows from these ----------------------------------------------------------------------

    @property
    def lower(self) -> np.ndarray:
        """Lower bounds, raised by the margin (m,)."""
        return self.bounds()[0] + self.margin

    @property
    def upper(self) -> np.ndarray:
        """Upper bounds, lowered by the margin (m,)."""
        return self.bounds()[1] - self.margin

    @property
    def half(self) -> np.ndarray:
        """(m,) how far the bounds are from their middle."""
        return 0.5 * (self.upper - self.lower)

    def excess(self, at: Points) -> np.ndarray:
        """Returns by how much the values are beyond their bounds (..., m); negative within."""
        values = self.values(at)
        return np.maximum(values - self.upper, self.lower - values)

    def used(self, at: Points) -> np.ndarray:
        """Returns the part of the way from the middle to a bound (..., m)."""
        off = self.values(at) - 0.5 * (self.lower + self.upper)
        return np.where(off.real < 0.0, -off, off) / self.half

    def margins(self, tube: TubeRadii) -> list[tuple[str, float, float]]:
        """Returns of each value its label, what is taken of it (inf if unknown), and of how much.

        Nothing is left where the second is not below the third.

        Args:
            tube: With all blocks filled in.
        """
        taken = self.tube_takes(tube)
        radii = np.full(len(self.half), np.inf) if taken is None else taken + self.plan_takes(tube)
        return list(zip(self.labels, map(float, radii), map(float, self.half), strict=True))

    def tightened(self, tube: TubeRadii) -> Self:
        """Returns the limit tightened by the tube and for plans, if it says by how much."""
        taken, between_knots_margin = self.tube_takes(tube), self.plan_takes(tube)
        out = copy(self)
        out.margin = self.margin + between_knots_margin if taken is None else self.margin + taken + between_knots_margin
        out.between_knots_margin = between_knots_margin
        return out

    # Names and units ------------------------------------------------------------------------------

    @property
    def parts(self) -> list[str]:
        """Names of the m values."""
        return [self.name] if len(self.upper) == 1 else [
            f"{self.name}[{i}]" for i in range(len(self.upper))]

    @property
    def labels(self) -> list[str]:
        """Names of the m values in messages and in the certificate's conditions."""
        return self.parts

    def signals(self, at: Points) -> dict[str, tuple[np.ndarray, float]]:
        """Returns by name the signals (...) and the bounds that they have to stay below.

        Those whose names end with _min have to stay above.
        """
        out, values = {}, self.values(at)
        for i, label in enumerate(self.labels):
            out[f"{label}_min"] = (values[..., i], float(self.lower[i]))
            out[f"{label}_max"] = (values[..., i], float(self.upper[i]))
        return out

    def unit_of(self, signal: str) -> str:
        """Returns the unit of one of the `signals`, if it is known."""
        return ""

    @property
    def bars(self) -> list[str]:
        """Names of the bars that show it."""
        return self.labels

    def bar_lengths(self, at: Points) -> np.ndarray:
        """Returns the part of the limit that each of the bars shows (..., number of bars)."""
        return self.used(at)

    def complaint(self, at: Points) -> str:
        """Returns what would have to be so at one pose that breaks it, for a message."""
        return f"such that {self.name}, {self.values(at)}, is within {self.lower} to {self.upper}"


class AbsoluteLimit(Limit):
    """A bound on the absolute value, or the norm, of one value: |value| ≤ bound."""

    bound: float

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Returns ∓bound."""
        return np.array([-self.bound]), np.array([self.bound])

    def signals(self, at: Points) -> dict[str, tuple[np.ndarray, float]]:
        """Returns the absolute value."""
        return {self.name: (np.abs(self.values(at)[..., 0]), float(self.upper[0]))}
