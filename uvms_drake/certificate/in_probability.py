"""A certificate in probability: a bound on how likely a run fails, from drawn runs.

It proves nothing about the worst case. N runs are drawn from the distribution that the scenario
declares, each simulated by the whole Diagram. If f of them failed, the one-sided bound of Clopper
and Pearson at the confidence c is the p at which as few failures have the probability 1 − c,

    Σ_{i ≤ f} (N over i) pⁱ (1 − p)^{N−i} = 1 − c;       f = 0:  p = 1 − (1 − c)^{1/N}.         (1)

P ≤ p unless the N runs were an event of probability 1 − c or less. The k-th attempt at a task takes
1 − (1 − c)/(k(k + 1)) in place of c, so that none of all attempts is wrong, unless an event of
probability 1 − c happened; see `attempts`.

References: Clopper, Pearson (1934), The use of confidence or fiducial limits illustrated in the
case of the binomial, *Biometrika* 26; Tempo, Bai, Dabbene (1997), Probabilistic robustness
analysis: explicit bounds for the minimum number of samples, *Systems & Control Letters* 30.
"""

import math
from dataclasses import dataclass

from uvms_drake.certificate.attempts import Attempt
from uvms_drake.common.errors import require
from uvms_drake.station.scenario.scenario import Scenario

FAILURES = {
    "exception": "ended in an exception",
    "not finite": "had a signal that is not finite",
    "tube": "left the declared tube in any of its radii",
    "limit": "violated a limit",
    "saturation": "had a command that was cut",
    "force": "pressed the wall harder than allowed",
    "no plan": "had a sample without a plan",
    "contact": "lost the contact",
    "no touch": "never touched the wall",
    "force line": "pressed off the desired force by more than the force line at the end of a hold",
    "mission": "did not complete a step of its mission",
    "retreat": "ended in a retreat of the supervisor",
}
"""Kinds of failure of a run, in words."""
BISECTIONS = 100
"""Number of halvings of [0, 1]: more than a number in double precision can tell apart."""


@dataclass(frozen=True)
class ProbabilityCertificate:
    """Bound of the probability that a run fails, and the distribution that it is for."""

    scenario: str
    """Name of the scenario."""
    runs: int
    """Number N of runs."""
    failures: int
    """Number of runs that failed."""
    confidence: float
    """Confidence of the bound."""
    probability: float
    """Upper confidence bound p of the probability that a run fails."""
    kinds: dict[str, int]
    """Number of runs that failed in each way; a run may fail in several."""
    failed: tuple[int, ...]
    """Numbers of the runs that failed."""
    distribution: tuple[str, ...]
    """The declared distribution, a sentence for each part."""
    never_drawn: tuple[str, ...]
    """Values of the scenario's own run that no draw has."""
    draws: dict[str, int]
    """Number of starts and walls that were drawn for the runs, those without a plan, of another
    class or too far included."""
    use: dict[str, float]
    """Largest deviation of all runs over each radius of the tube."""
    supervisor: dict[str, float]
    """Largest value of all runs over each threshold of the supervisor; empty without one."""
    force: dict[str, float | None]
    """Least and largest desired force [N], and the largest error at the end of a hold over the
    force line; None without a sensed contact."""
    attempts: tuple[Attempt, ...]
    """The attempts at the task in their order, this one last."""
    campaign: str
    """Identity of the campaign of these runs, see `campaign.Campaign`."""
    files: dict[str, str]
    """SHA-256 of the robot's files, by name."""
    inputs: str
    """SHA-256 of the scenario without its drawn values."""
    versions: dict[str, str]
    source: str
    """SHA-256 of the package's Python files that made the runs."""
    mission: str = ""
    """Steps of the mission that every run has, by their kinds; empty without one."""
    made_by: str = "certify"
    """The command that wrote it."""

    @property
    def attempt(self) -> int:
        """Number k of the attempt, from 1."""
        return len(self.attempts)

    @property
    def certified(self) -> bool:
        """Whether there is a bound below 1: not if every run failed."""
        return self.failures < self.runs

    @property
    def verdict(self) -> str:
        """The bound in words."""
        if not self.certified:
            return "not certified in probability: every run failed"
        mission = f" of the mission {self.mission}" if self.mission else ""
        return (f"certified in probability: at most {percent_above(self.probability)} per run at "
                f"{100.0 * self.confidence:g} % confidence over all attempts (attempt "
                f"{self.attempt}), for the declared distribution{mission}")

    def applied_to(self, scenario: Scenario) -> Scenario:
        """Returns the scenario unchanged: the tube is the declared one."""
        return scenario


def spent(confidence: float, attempt: int) -> float:
    """Returns the confidence 1 − (1 − c)/(k(k + 1)) of the k-th attempt, k from 1."""
    return 1.0 - (1.0 - confidence) / (attempt * (attempt + 1))


def failure_bound(runs: int, failures: int, confidence: float) -> float:
    """Returns p of (1).

    Args:
        runs: Number N of runs, positive.
        failures: Number f of them that failed, from 0 to N.
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
