"""A certificate in probability in words: a sentence for each of its parts."""

from collections.abc import Sequence

from uvms_drake.certificate.coupled.table import coupled_rows
from uvms_drake.certificate.failure_probability import percent_above
from uvms_drake.certificate.in_probability import FAILURES, ProbabilityCertificate

NAMED = 12
"""Largest number of failed runs that a sentence names."""


def sentences(certificate: ProbabilityCertificate) -> list[str]:
    """Returns count, bound, meaning, condition, comparison, and the definition of a failure."""
    p, runs = percent_above(certificate.probability), certificate.runs
    chance = f"{100.0 * (1.0 - certificate.confidence):.3g} %"
    return [
        _count(certificate),
        f"A run drawn from the declared distribution fails with a probability of at most {p}, "
        f"unless these {runs} runs were an event of probability {chance} or less.",
        "It is a statement about drawn runs of this simulation, none about the worst of them, and "
        "none about a robot that differs from its declared distribution.",
        "It needs the number of runs and the seed to be chosen before the first run.",
        _compared(certificate), *_planned(certificate),
        f"A run counts as failed if it {_listed(_counted(certificate), 'or')}."]


def format_probability(certificate: ProbabilityCertificate) -> str:
    """Returns the verdict, the sentences, the declared distribution, and the linear budget."""
    return "\n".join([
        f"{certificate.scenario}: {certificate.verdict}", "", *sentences(certificate), "",
        "declared distribution", *(f"  {line}" for line in certificate.distribution),
        *coupled_rows(certificate.coupled)])


def format_coverage(outside: Sequence[str]) -> str:
    """Returns whether a run is one of the declared distribution.

    Args:
        outside: Phrases of `ProbabilityCertificate.outside`.
    """
    if not outside:
        return "every value of this run is within its declared range"
    return ("NOT OF THE DECLARED DISTRIBUTION, so the certificate in probability is not for this "
            f"run: {'; '.join(outside)}")


def _compared(certificate: ProbabilityCertificate) -> str:
    """Returns how near the runs were to their coupled linear loop."""
    if not certificate.apart:
        return "No run was compared with its coupled linear loop."
    parts = [f"{ratio:.2g} of the line of the {rows}" for rows, ratio in certificate.apart.items()]
    return ("The largest distance of a run from its coupled linear loop, given its noise, plan, "
            f"touch and friction, is {_listed(parts, 'and')}.")


def _planned(certificate: ProbabilityCertificate) -> list[str]:
    """Returns how much of the declared class of plans the runs used, if there is one."""
    if not certificate.plan:
        return []
    parts = [f"{ratio:.2g} in the {stage}" if stage != "start" else f"{ratio:.2g} at the start"
             for stage, ratio in certificate.plan.items()]
    return [f"Of the declared class of plans the runs used {_listed(parts, 'and')}."]


def _counted(certificate: ProbabilityCertificate) -> list[str]:
    """Returns the kinds of failure that were looked for, in words."""
    looked = {"linear": certificate.apart, "plan": certificate.plan,
              "mission": certificate.mission}
    return [text for kind, text in FAILURES.items() if looked.get(kind, True)]


def _count(certificate: ProbabilityCertificate) -> str:
    """Returns the number of failures by kind, and the failed runs."""
    if certificate.failures == 0:
        return f"0 of {certificate.runs} runs failed."
    failed = certificate.failed
    named = ", ".join(map(str, failed[:NAMED])) + (", ..." if len(failed) > NAMED else "")
    kinds = [f"{count} {FAILURES[kind]}" for kind, count in certificate.kinds.items() if count]
    return (f"{certificate.failures} of {certificate.runs} runs failed ({named}): "
            f"{_listed(kinds, 'and')}.")


def _listed(parts: list[str], last: str) -> str:
    *before, end = parts
    return f"{', '.join(before)} {last} {end}" if before else end
