"""Estimated numbers of a certificate, and the condition that no second search refutes them.

A claim is the number in the certificate for a supremum: the largest value that one search found,
times a declared factor. Another search, independent of the first, looks for the same. If it finds
more, the claim was wrong and nothing is certified; if it does not, the claim is still an estimate.
See tube/theory.md#estimates-and-second-searches.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from uvms_drake.common.constraints import AtLeast, Between, NotNegative
from uvms_drake.tube.conditions import Condition

Samples = Between(10, 1_000_000, ", which take hours and gigabytes")
"""Numbers of samples; a supremum that so many miss, more will miss too."""


@dataclass(frozen=True)
class Estimate:
    """A number that is estimated."""

    name: str
    claim: float
    """Number in the certificate."""
    second: float
    """Largest value that the second search found."""

    @property
    def ratio(self) -> float:
        """`second` over `claim`: more than 1 refutes it."""
        if self.claim > 0.0:
            return self.second / self.claim
        return np.inf if self.second > 0.0 else 0.0


Check = Callable[[], tuple[Estimate, ...]]
"""Function that makes the second search, as long as the first: for a certificate, not for a study
of many tubes."""


def no_estimates() -> tuple[Estimate, ...]:
    """Returns none."""
    return ()


def together(*checks: Check) -> Check:
    """Returns the check of several."""
    return lambda: tuple(estimate for check in checks for estimate in check())


def largest_of(name: str, claim: np.ndarray, second: np.ndarray) -> Estimate:
    """Returns the one of several claims (c,) with the largest ratio.

    Its name has the index, counted from 0 like the components of u.
    """
    each = [Estimate(f"{name} [{i}]" if len(claim) > 1 else name, float(a), float(b))
            for i, (a, b) in enumerate(zip(claim, second, strict=True))]
    return max(each, key=lambda estimate: estimate.ratio)


def unrefuted(estimates: tuple[Estimate, ...]) -> tuple[Condition, ...]:
    """Returns the condition that no claim is refuted, if there are any; by the closest one."""
    if not estimates:
        return ()
    worst = max(estimates, key=lambda estimate: estimate.ratio)
    return (Condition(f"estimates, second search over claim ({worst.name})", worst.ratio, "<=",
                      1.0, theorem="tube/theory.md#estimates-and-second-searches",
                      topic="estimates"),)


@dataclass
class CertificateSettings:
    """Samples, seed and safety factor of the estimates."""

    constant_samples: Annotated[int, Samples] = 2000
    """States at which each constant is evaluated before the local searches."""
    tube_samples: Annotated[int, Samples] = 300
    """Nominal states from the worst of which the tube in velocities and inputs is searched for."""
    terminal_samples: Annotated[int, Samples] = 2000
    """States in which the terminal set is checked, for every radius tried."""
    safety_factor: Annotated[float, AtLeast(1)] = 1.1
    """Factor of every estimated supremum."""
    seed: Annotated[int, NotNegative] = 0

