"""Interface of a limit: bounds on values of a motion, their tightening and their rows.

A limit of one's own is a subclass with a `name`, `values` and `bounds`, and its tightening by the
tube (`radius`, or `tube_takes`), in `Limits.more`: the nominal MPC keeps it by linearised rows,
softened like those of roll and pitch, the terminal set is searched for a state that breaks it, and
tables, bars and the certificate have it. A limit that is linear in (y, ζ), or a norm of that, has a
`closed_form`.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from copy import copy
from typing import ClassVar, NamedTuple, Self

import numpy as np

from uvms_drake.common.errors import require
from uvms_drake.control.limits.radii import TubeRadii
from uvms_drake.control.plan.points import About, Points, Slopes, slopes


class Cone(NamedTuple):
    """Second-order cone ‖value + slopes · change‖₂ ≤ bound."""

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
    """Key below `limits`; unique."""
    about: ClassVar[About] = "pose"
    """Arguments that `values` reads: `pose` for 𝔮 and y, `speed` for ζ too, `input` for u and τ
    too. A limit about pose or speed holds at the knots of a plan, one about the input at both ends
    of every interval."""
    soft: ClassVar[bool] = True
    """Whether the convex program may relax it, as is best for a limit that is not linear."""
    overshoots: ClassVar[bool] = True
    """Whether the values may go beyond their bounds between two knots that keep them."""
    owner: ClassVar[str] = "pose"
    """Part of a task or start whose change would restore it: `pose`, `joints` or `force`."""
    absolute: ClassVar[bool] = False
    """Whether it bounds absolute values or norms, which tables have then."""
    unit: str | Sequence[str] = ""
    """Unit of the values, or of each of them."""
    titles: Sequence[str] = ()
    """Names of the values at the bars that display them; their `labels` if left out."""
    radius: str | Sequence[str] = ""
    """Key of the radius of the tube by which the values change within it, or of each of them."""
    between: str = ""
    """Key of the radius by which a plan exceeds the bounds between knots that keep them."""
    margin: np.ndarray | float = 0.0
    """Margin that has been taken off both bounds (m,) or ()."""
    between_knots_margin: np.ndarray | float = 0.0
    """Part of the margin for the motion of a plan between its knots (m,) or ()."""

    @abstractmethod
    def values(self, at: Points) -> np.ndarray:
        """Returns the values (..., m) of points (...).

        Also of complex ones, without abs or norm, where `slopes` is not overridden.
        """

    @abstractmethod
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Returns the lower and the upper bounds (m,) of the real motion."""

    def tube_takes(self, tube: TubeRadii) -> np.ndarray | None:
        """Returns the tightening: the largest change (m,) of the values within the tube.

        By default that of `radius`. None if it is unknown: then there is no certificate, and a plan
        keeps the whole limit, which the real motion may exceed.

        Args:
            tube: With all blocks filled in.
        """
        m = len(self.upper)
        keys = [self.radius] * m if isinstance(self.radius, str) else self.radius
        taken = [getattr(tube, key) if key else None for key in keys]
        return None if None in taken else np.array(taken, dtype=float)

    def plan_takes(self, tube: TubeRadii) -> np.ndarray | float:
        """Returns the largest excess (m,) or () of a plan between knots that keep the bounds.

        Zero if there is none or it is unknown.

        Args:
            tube: With all blocks filled in.
        """
        return (getattr(tube, self.between) or 0.0) if self.between else 0.0

    def closed_form(self, size: int) -> list[Slopes] | None:
        """Returns G (r, 6+n) of each value, which changes by at most ‖G d(y, ζ)‖₂ anywhere.

        None, as by default, if there is none; the terminal set then checks it at samples.

        Args:
            size: 6 + n.
        """
        return None

    def cone(self, at: Points) -> Cone | None:
        """Returns the limit as a cone for the convex program, in place of `rows`, or None.

        It is one at all points or at none.
        """
        return None

    def slopes(self, at: Points) -> Slopes:
        """Returns the derivatives of the values; by default by complex steps."""
        return slopes(self.values, at, self.about)

    def row_values(self, at: Points) -> np.ndarray:
        """Returns the values of the limit's rows in a convex program (..., m)."""
        return self.values(at)

    def row_slopes(self, at: Points) -> Slopes:
        """Returns the derivatives of the rows; (m, 6+n) where they are the same everywhere."""
        return self.slopes(at)

    def row_bounds(self, at: Points) -> tuple[np.ndarray, np.ndarray]:
        """Returns the lower and the upper bounds (m,) of the rows, the same at all points."""
        return self.lower, self.upper

    def check(self) -> None:
        """Raises `InvalidParameter` for the first parameter that has no meaning."""
        name = getattr(self, "name", None)
        require(isinstance(name, str) and not name.endswith(("_min", "_max")), "name", name,
                "the limit's key, such as `tip_height`, without _min or _max, which mark its ends")
        lower, upper = self.bounds()
        require(np.ndim(lower) == 1 and np.shape(lower) == np.shape(upper), "bounds",
                [lower, upper], "two arrays (m,) for m values")
        require(bool(np.all(lower < upper)), "bounds", [lower, upper], "in order")

    # Consequences ---------------------------------------------------------------------------------

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
        """Half of the distance between the bounds (m,)."""
        return 0.5 * (self.upper - self.lower)

    def excess(self, at: Points) -> np.ndarray:
        """Returns the excess of the values over their bounds (..., m); negative within."""
        values = self.values(at)
        return np.maximum(values - self.upper, self.lower - values)

    def used(self, at: Points) -> np.ndarray:
        """Returns the distance from the middle over that of the nearer bound (..., m)."""
        off = self.values(at) - 0.5 * (self.lower + self.upper)
        return np.where(off.real < 0.0, -off, off) / self.half

    def margins(self, tube: TubeRadii) -> list[tuple[str, float, float]]:
        """Returns (label, tightening, available margin) of each value; inf if unknown.

        The tightened set is empty where the second is not below the third.

        Args:
            tube: With all blocks filled in.
        """
        taken = self.tube_takes(tube)
        radii = np.full(len(self.half), np.inf) if taken is None else taken + self.plan_takes(tube)
        return list(zip(self.labels, map(float, radii), map(float, self.half), strict=True))

    def tightened(self, tube: TubeRadii) -> Self:
        """Returns the limit tightened by the tube, if that is known, and for plans."""
        taken, between_knots = self.tube_takes(tube), self.plan_takes(tube)
        out = copy(self)
        out.margin = (self.margin + between_knots if taken is None
                      else self.margin + taken + between_knots)
        out.between_knots_margin = between_knots
        return out

    # Names and units ------------------------------------------------------------------------------

    @property
    def labels(self) -> list[str]:
        """Names of the m values as signals, in messages and in the certificate's conditions."""
        return [self.name] if len(self.upper) == 1 else [
            f"{self.name}[{i}]" for i in range(len(self.upper))]

    @property
    def units(self) -> list[str]:
        """Unit of each value."""
        return [self.unit] * len(self.upper) if isinstance(self.unit, str) else list(self.unit)

    def signals(self, at: Points) -> dict[str, tuple[np.ndarray, float]]:
        """Returns by name the signals (...) and their upper, or for _min their lower, bounds."""
        out, values = {}, self.values(at)
        for i, name in enumerate(self.labels):
            if self.absolute:
                out[name] = (np.abs(values[..., i]), float(self.upper[i]))
            else:
                out[f"{name}_min"] = (values[..., i], float(self.lower[i]))
                out[f"{name}_max"] = (values[..., i], float(self.upper[i]))
        return out

    def unit_of(self, signal: str) -> str:
        """Returns the unit of one of the `signals`."""
        return next(unit for label, unit in zip(self.labels, self.units, strict=True)
                    if signal in (label, f"{label}_min", f"{label}_max"))

    @property
    def bars(self) -> list[str]:
        """Names of the bars that display it: value, range and unit."""
        each = zip(self.titles or self.labels, self.lower, self.upper, self.units, strict=True)
        return [f"{title}  {_range(*ends)} {unit}".rstrip() for title, *ends, unit in each]

    def bar_lengths(self, at: Points) -> np.ndarray:
        """Returns the used part of the limit (..., number of bars)."""
        return self.used(at)

    def complaint(self, at: Points) -> str:
        """Returns the requirement that a pose breaks most, for a message."""
        values = self.values(at)
        i = int(np.argmax(np.maximum(values - self.upper, self.lower - values)))
        return (f"such that {(self.titles or self.labels)[i]}, {values[i]:.3g}, is within "
                f"{self.lower[i]:.3g} to {self.upper[i]:.3g} {self.units[i]}".rstrip())


class AbsoluteLimit(Limit):
    """Bound on the absolute value, or the norm, of each value: |value| ≤ bound."""

    absolute = True
    bound: float | np.ndarray

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Returns ∓bound."""
        most = np.array(self.bound, dtype=float, ndmin=1)
        return -most, most


def _range(lower: float, upper: float) -> str:
    return f"≤ {upper:.3g}" if lower == -upper else f"{lower:.2g} … {upper:.2g}"
