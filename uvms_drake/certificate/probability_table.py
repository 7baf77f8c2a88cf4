"""A certificate in probability in words: a sentence for each of its parts."""


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
        f"A run counts as failed if it {_listed(_counted(certificate), 'or')}."]


def format_probability(certificate: ProbabilityCertificate) -> str:
    """Returns the verdict, the sentences, the declared distribution, and the linear budget."""
    return "\n".join([
        f"{certificate.scenario}: {certificate.verdict}", "", *sentences(certificate), "",
        "declared distribution", *(f"  {line}" for line in certificate.distribution)])


def _counted(certificate: ProbabilityCertificate) -> list[str]:
    """Returns the kinds of failure that were looked for, in words."""
    return [text for kind, text in FAILURES.items() if kind != "mission" or certificate.mission]


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
