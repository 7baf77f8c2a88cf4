"""Estimated numbers of a certificate, and the condition that no second search refutes them.

A claim is the number in the certificate for a supremum: the largest value that one search found,
times a declared factor. Another search, independent of the first, looks for the same. If it finds
more, the claim was wrong and nothing is certified; if it finds far less, it could not have found
that, and nothing is certified either; else the claim is still an estimate.
See tube/theory.md#estimates-and-second-searches.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from uvms_drake.common.constraints import AtLeast, Between, NotNegative
from uvms_drake.tube.conditions import Condition

ROUNDING = 1e-12
"""Claims that are smaller, over the largest of their kind, are zeros."""
ATTEMPTS = 10
"""Most repetitions of a second search where it has no power yet."""
LEAST_SHARE = 0.85
"""Least part of a claim that a second search has to reach: one that reaches less has no power."""
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


def extremes_of(name: str, claim: np.ndarray, second: np.ndarray) -> tuple[Estimate, ...]:
    """Returns those of several claims (c,) with the least and the largest ratio.

    Zeros, but for rounding, do not count. The names have the index, counted from 0 like the
    components of u.
    """
    tiny = ROUNDING * np.max(claim)
    each = [Estimate(f"{name} [{i}]" if len(claim) > 1 else name, float(a), float(b))
            for i, (a, b) in enumerate(zip(claim, second, strict=True)) if max(a, b) > tiny]
    each.sort(key=lambda estimate: estimate.ratio)
    return (*each[:1], *each[1:][-1:])


def searched_again(claim: np.ndarray, search: Callable[[np.ndarray, int], np.ndarray]
                   ) -> np.ndarray:
    """Returns the largest values (c,) of a second search, repeated where it has no power yet.

    Args:
        claim: The claims (c,).
        search: Function that returns the largest values that it finds of those of some indices, by
            the number of the attempt, with which its starts have to change.
    """
    second = np.zeros(len(claim))
    which = np.arange(len(claim))
    for attempt in range(ATTEMPTS):
        if len(which) == 0:
            break
        second[which] = np.maximum(second[which], search(which, attempt))
        which = np.nonzero(second < LEAST_SHARE * claim)[0]
    return second


def checked(estimates: tuple[Estimate, ...]) -> tuple[Condition, ...]:
    """Returns the conditions that no claim is refuted and that each could have been, if any."""
    if not estimates:
        return ()
    theorem = "tube/theory.md#estimates-and-second-searches"
    least, *_, most = sorted((estimates[0], *estimates), key=lambda estimate: estimate.ratio)
    return (Condition(f"estimates, second search over claim ({most.name})", most.ratio, "<=", 1.0,
                      theorem=theorem, topic="estimates"),
            Condition(f"estimates, least second search over claim ({least.name}); one below has no "
                      "power", least.ratio, ">=", LEAST_SHARE, theorem=theorem, topic="no power"))


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

