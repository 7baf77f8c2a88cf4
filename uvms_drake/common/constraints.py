"""Constraints of values in a schema, as in `Annotated[float, Positive]`.

`schema.check_values` reads them: at the load of a file, and wherever a dataclass of one is used.
They hold of every component of an array. Constraints of several fields together are in the method
`check` of their dataclass, which is called after its fields are checked.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from uvms_drake.common.errors import SHORTEST, InvalidParameter


@dataclass(frozen=True)
class Constraint:
    """Values that a field is allowed to have."""

    allowed: str
    """The allowed values, as the end of "must be ..."."""
    holds: Callable[[Any], Any]
    """Whether a finite number, each one of an array, or a text is such a value."""

    def check(self, key: str, value: object) -> None:
        """Raises `InvalidParameter` unless a value is allowed."""
        if not self._allows(value):
            raise InvalidParameter(key, value, self.allowed)

    def _allows(self, value: object) -> bool:
        if isinstance(value, str):
            return bool(self.holds(value))
        if isinstance(value, int | float):
            return math.isfinite(value) and bool(self.holds(value))
        try:
            array = np.array(value, dtype=float)
        except (TypeError, ValueError):
            return False
        return bool(np.all(np.isfinite(array)) and np.all(self.holds(array)))


Positive = Constraint("positive", lambda x: x > 0.0)
NotNegative = Constraint("zero or positive", lambda x: x >= 0.0)
Finite = Constraint("finite", lambda x: True)
Fraction = Constraint("from 0 to 1", lambda x: (x >= 0.0) & (x <= 1.0))
Period = Constraint(f"at least {SHORTEST:g} s", lambda x: x >= SHORTEST)
"""Period of a clock [s]: a faster one never ends."""
Rate = Constraint(f"positive, and at most {1.0 / SHORTEST:g} Hz",
                  lambda x: (x > 0.0) & (x <= 1.0 / SHORTEST))
"""Rate of a clock [Hz]."""
UnitVector = Constraint("a unit vector", lambda x: np.shape(x) == (3,) and (
    abs(np.linalg.norm(x) - 1.0) < 1e-3))
"""Unit vector (3,), of which three digits are enough: `schema.check_values` gives it length 1."""


def Above(least: float) -> Constraint:
    """Returns the constraint of a number that is smaller than any value."""
    return Constraint(f"above {least}", lambda x: x > least)


def AtLeast(least: float) -> Constraint:
    """Returns the constraint of a smallest value."""
    return Constraint(f"at least {least}", lambda x: x >= least)


def AtMost(most: float) -> Constraint:
    """Returns the constraint of a largest value."""
    return Constraint(f"at most {most}", lambda x: x <= most)


def Between(least: float, most: float, more: str = "") -> Constraint:
    """Returns the constraint of a smallest and a largest value; `more` says why."""
    return Constraint(f"from {least} to {most}{more}", lambda x: (x >= least) & (x <= most))


def Below(most: float, least: float = 0.0) -> Constraint:
    """Returns the constraint of a smallest value, and of one that is larger than any."""
    return Constraint(f"at least {least}, and less than {most}",
                      lambda x: (x >= least) & (x < most))


def Within(largest: float, unit: str) -> Constraint:
    """Returns the constraint of a largest absolute value."""
    return Constraint(f"within {largest:g} {unit}", lambda x: abs(x) <= largest)


def OneOf(*names: str) -> Constraint:
    """Returns the constraint of texts."""
    return Constraint(f"one of {', '.join(names)}", lambda x: x in names)


def Vector(size: int) -> Constraint:
    """Returns the constraint of a size of an array."""
    return Constraint(f"{size} finite numbers", lambda x: np.shape(x) == (size,))
