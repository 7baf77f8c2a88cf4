"""Bound R of a remainder that depends on errors, which depend on R.

R is the least fixed point to first order in the errors, enlarged, and then checked by `ascent`: if
the errors that follow from R make no more than R, R was right. All suprema are estimates.
"""

from collections.abc import Callable

import numpy as np

from uvms_drake.tube.search.ascent import by_part, supremum
from uvms_drake.tube.search.estimate import Check, largest_of
from uvms_drake.tube.search.search_problem import SearchProblem
from uvms_drake.tube.search.second_search import second_search
from uvms_drake.tube.settings import CertificateSettings

TRIES, ROUNDS = 4, 300
"""Number of enlargements of R by the values found; rounds in which it converges to first order, or
never."""
Of = Callable[[np.ndarray], np.ndarray]


def remainder_bound(problem_of: Callable[[np.ndarray], SearchProblem], radii_of: Of, parts: int,
                    enlarged: float, settings: CertificateSettings, stream: int
                    ) -> tuple[np.ndarray, float]:
    """Returns R (c,), and the ratio of the values over errors within its bounds to it.

    R holds if the ratio is at most 1; where there is none, both are infinite.

    Args:
        problem_of: Problem of c values over errors of given radii (parts,).
        radii_of: Radii of the errors (parts,) that follow from R.
        parts: Number of parts of the errors.
        enlarged: Factor of R to first order.
        settings: Settings of the search.
        stream: Number of the random samples.
    """
    problem = problem_of(np.ones(parts))
    x = problem.draw(settings.tube_samples, np.random.default_rng([settings.seed, stream]))
    slopes = by_part(problem, x)
    more, ratio = np.full(slopes.shape[1], settings.safety_factor * enlarged), np.inf
    for _ in range(TRIES):
        remainder = _first_order(slopes, more, radii_of)
        if not np.isfinite(remainder).all():
            return remainder, np.inf
        radii = radii_of(remainder)
        claim = settings.safety_factor * supremum(problem_of(radii), x, slopes @ radii)
        ratio = float(np.max(claim / remainder))
        if ratio <= 1.0:
            break
        more = more * enlarged * np.maximum(claim / remainder, 1.0)
    return remainder, ratio


def _first_order(slopes: np.ndarray, more: np.ndarray, radii_of: Of) -> np.ndarray:
    """Returns the least R (c,) by slopes (m, c, parts) at samples; inf if there is none."""
    remainder = np.zeros(len(more))
    for _ in range(ROUNDS):
        last, remainder = remainder, more * np.max(slopes @ radii_of(remainder), axis=0)
        if np.all(remainder <= 1.001 * last):
            return remainder
        if not np.max(remainder) < 1e6:
            break
    return np.full(len(more), np.inf)


def second_search_of(problem: SearchProblem, name: str, claim: np.ndarray, seed: int, stream: int
                     ) -> Check:
    """Returns the second search for claims (c,)."""
    wanted = np.flatnonzero(claim > 0.0)
    return lambda: (largest_of(name, claim[wanted], second_search(
        problem, wanted, np.random.default_rng([seed, stream]))),)
