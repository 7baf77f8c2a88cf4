"""Conditions of a certificate: inequalities between two numbers, and assumptions."""

import math
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

Relation = Literal["<", "<=", ">", ">="]
Kind = Literal["bound", "tightening", "assumption"]


@dataclass(frozen=True)
class Condition:
    """An inequality between two numbers, or an assumption that is kept or not, see `assumption`."""

    name: str
    left: float
    relation: Relation
    right: float
    advice: str = ""
    """Addition to the command line, `--set key=value`, if it is not met and a value is known."""
    theorem: str = field(kw_only=True)
    """Link, below `uvms_drake/`, to the theorem that needs it, page and heading."""
    kind: Kind = field(default="bound", kw_only=True)
    """`bound`, two numbers; `tightening`, the part of a limit that the tube takes; `assumption`,
    yes or no: `left` is 0 where it is kept, else the number or size of its violations."""
    topic: str = field(default="", kw_only=True)
    """Key of its advice in words, `certificate.text.HELP`; empty if there is none."""
    about: str = field(default="", kw_only=True)
    """Key of an assumption or step of a mission, or label of a limit's value."""
    proven: bool = field(default=False, kw_only=True)
    """Whether `left` of a tightening is proven, not estimated."""

    @property
    def holds(self) -> bool:
        """True if it is met; a NaN meets nothing."""
        return self.margin > 0.0 or ("=" in self.relation and self.left == self.right)

    @property
    def margin(self) -> float:
        """Distance of the sides, negative if it is not met; in the unit of the sides."""
        return self.left - self.right if self.relation.startswith(">") else self.right - self.left

    @property
    def is_count(self) -> bool:
        """True of an assumption without a size: the name says it."""
        return self.kind == "assumption" and float(self.left).is_integer()

    def __str__(self) -> str:
        if self.is_count:
            return f"{self.about}: as the proofs assume" if self.holds else self.name
        return (f"{self.name}: {self.left:.4g} {self.relation} {self.right:.4g} "
                f"{'holds' if self.holds else 'does not hold'}")


def assumption(about: str, reason: str, broken: float = 1.0, *, topic: str = "", theorem: str,
               advice: str = "") -> Condition:
    """Returns the condition that the proofs' assumption about something is kept.

    Args:
        about: Its subject, such as a key of the scenario.
        reason: Reason why it is broken, if it is.
        broken: 0 if it is kept; else how many violations, or how large one.
        topic: As of `Condition`; the subject if left out.
        theorem: As of `Condition`.
        advice: As of `Condition`.
    """
    return Condition(f"{about}, {reason}" if reason else about, float(broken), "<=", 0.0, advice,
                     theorem=theorem, kind="assumption", topic=topic or about, about=about)


def setting(**values: float | np.ndarray) -> str:
    """Returns an advice for the command line; two underscores stand for a dot."""
    return " ".join(
        f"--set {key.replace('__', '.')}="
        + (f"{value:.6g}" if np.ndim(value) == 0 else
           "[" + ",".join(f"{each:.6g}" for each in np.asarray(value)) + "]")
        for key, value in values.items())


def rounded_up(value: float, digits: int = 3) -> float:
    """Returns a positive number rounded up to significant digits."""
    step = 10.0 ** (math.floor(math.log10(value)) - digits + 1)
    return float(f"{math.ceil(value / step - 1e-9) * step:.{digits}g}")
