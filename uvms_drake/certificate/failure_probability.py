"""Upper confidence bound on the probability of failure of a run, from independent runs.

With k failures in N independent runs of the failure probability P, the one-sided bound of Clopper
and Pearson at the confidence c is the p at which as few failures have the probability 1 − c,

    Σ_{i ≤ k} (N over i) pⁱ (1 − p)^{N−i} = 1 − c;       k = 0:  p = 1 − (1 − c)^{1/N}.         (1)

P ≤ p unless the N runs were an event of probability 1 − c or less. N must not depend on outcomes.

References: Clopper, Pearson (1934), The use of confidence or fiducial limits illustrated in the
case of the binomial, *Biometrika* 26; Tempo, Bai, Dabbene (1997), Probabilistic robustness
analysis: explicit bounds for the minimum number of samples, *Systems & Control Letters* 30.
"""

import math

from uvms_drake.common.errors import require

BISECTIONS = 100
"""Number of halvings of [0, 1]: more than a number in double precision can tell apart."""


def failure_bound(runs: int, failures: int, confidence: float) -> float:
    """Returns p of (1).

    Args:
        runs: Number N of runs, positive.
        failures: Number k of them that failed, from 0 to N.
        confidence: Confidence c, above 0 and below 1.

    Raises:
        InvalidParameter: An argument is out of its range.
    """
    require(runs >= 1, "runs", runs, "at least 1")
    require(0 <= failures <= runs, "failures", failures, f"from 0 to {runs}")
    require(0.0 < confidence < 1.0, "confidence", confidence, "above 0 and below 1")
    if failures == 0:
        return -math.expm1(math.log1p(-confidence) / runs)
    if failures == runs:
        return 1.0
    # The tail falls with p, so the upper end of the bracket is never below the bound.
    low, high = 0.0, 1.0
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        if binomial_tail(runs, failures, middle) > 1.0 - confidence:
            low = middle
        else:
            high = middle
    return high


def binomial_tail(runs: int, most: int, p: float) -> float:
    """Returns the probability of at most `most` failures in so many runs, 0 < p < 1."""
    log_p, log_q, factorial = math.log(p), math.log1p(-p), math.lgamma(runs + 1)
    return math.fsum(math.exp(
        factorial - math.lgamma(i + 1) - math.lgamma(runs - i + 1) + i * log_p + (runs - i) * log_q)
        for i in range(most + 1))


def percent_above(p: float) -> str:
    """Returns a probability in percent with three digits, rounded up: "at most" stays true."""
    if p <= 0.0 or p >= 1.0:
        return f"{100.0 * p:g} %"
    digits = 2 - math.floor(math.log10(100.0 * p))
    return f"{math.ceil(100.0 * p * 10.0**digits) / 10.0**digits:.3g} %"
