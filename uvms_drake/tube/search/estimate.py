"""Numbers of a certificate that are estimated, and the condition that nobody found them too small.

A claim is what the certificate uses for a supremum: the largest value that one search found, times
a declared factor. Another search, which does not start from what the first found, looks for the
same. If it finds more than is claimed, the claim was wrong and the certificate is void; if it does
not, the claim is still an estimate.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from uvms_drake.tube.conditions import Condition


@dataclass(frozen=True)
class Estimate:
    """A number that is estimated."""

    name: str
    claim: float
    """What the certificate uses."""
    second: float
    """The largest value that the second search found."""

    @property
    def ratio(self) -> float:
        """`second` over `claim`: more than 1 refutes it."""
        if self.claim > 0.0:
            return self.second / self.claim
        return np.inf if self.second > 0.0 else 0.0


Check = Callable[[], tuple[Estimate, ...]]
"""Makes the second search, which takes as long as the first: it is for a certificate, not for a
study of many tubes."""


def no_estimates() -> tuple[Estimate, ...]:
    """Returns none."""
    return ()


def together(*checks: Check) -> Check:
    """Returns the check that makes several."""
    return lambda: tuple(estimate for check in checks for estimate in check())


def largest_of(name: str, claim: np.ndarray, second: np.ndarray) -> Estimate:
    """Returns the one of several claims (c,) that the second search comes closest to.

    Its name says which, counted from 0 like the components of u.
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
                      1.0, theorem="tube/theory.md#estimates-and-second-searches"),)
