"""The certificate of a run: the one that its folder has, or a new one."""

import argparse
import shlex
import sys
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

from uvms_drake.certificate.certificate import (
    AnyCertificate,
    Certificate,
    cache_key,
    from_data,
    read_certificate,
    stale_reason,
)
from uvms_drake.certificate.in_probability import ProbabilityCertificate
from uvms_drake.certificate.text import largest_force, scope
from uvms_drake.command.interrupt import PROGRAM
from uvms_drake.command.progress import CERTIFYING, bar
from uvms_drake.common.cache import stored
from uvms_drake.common.errors import RunFailed
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.station.scenario.scenario import Scenario, remarks
from uvms_drake.station.scenario.scenario_file import reported_in
from uvms_drake.station.true_wall import in_words, outside

AnyCert = TypeVar("AnyCert", Certificate, AnyCertificate)


def kept_certificate(path: Path, scenario: Scenario, source: str, again: list[str], *,
                     named: bool = True) -> AnyCertificate | None:
    """Returns the certificate in a run's folder if it fits, or None if a new one is needed.

    One that `certify` has written is a commitment: if it no longer fits, the run is refused, with
    the words `again` of the command that computes it for this scenario. One of a former run is
    replaced, and so is one for the worst case in a folder that was not `named` on the command line.
    """
    if not path.is_file():
        return None
    certificate = read_certificate(path)
    changed = stale_reason(certificate, scenario)
    if not changed:
        return sound(certificate, source)
    if certificate.made_by != "certify":
        return None
    if not named and isinstance(certificate, Certificate):
        print(f"{path}: {changed} has changed since 'certify' made it, a new one replaces it",
              file=sys.stderr)
        return None
    command = shlex.join([PROGRAM, *again])
    if isinstance(certificate, ProbabilityCertificate):  # Its runs are of another campaign.
        command += f" --runs {certificate.runs}, in a new folder"
    raise RunFailed(f"{path}: stale, {changed} has changed since 'certify' made it; "
                    f"use another --output, or make it again: {command}")


def new_certificate(args: argparse.Namespace, scenario: Scenario, model: ContactModel,
                    source: str) -> AnyCertificate:
    """Returns the worst-case certificate; if it does not hold, one in probability from the cache.

    Raises:
        RunFailed: There is neither.
    """
    from uvms_drake.certificate.certify import certified_once

    with reported_in(source), bar(args, CERTIFYING, is_steady=False) as progress:
        worst_case = certified_once(scenario, progress, model)
    known = None if worst_case.certified else stored(cache_key(scenario))
    found = worst_case if known is None else from_data(known)
    return replace(sound(found, source), made_by="run")


def sound(certificate: AnyCert, source: str) -> AnyCert:
    """Returns a certificate that holds, or raises `RunFailed` with both ways out of it."""
    if not certificate.certified:
        raise RunFailed(f"{source}: --uncertified runs it with its declared tube, and 'certify "
                        "--runs N' bounds the probability that a run fails; "
                        f"{certificate.verdict}")
    return certificate


def announce(certificate: AnyCertificate, scenario: Scenario) -> None:
    """Says on stderr the kind and scope of a run's certificate."""
    lines = ([certificate.verdict] if isinstance(certificate, ProbabilityCertificate) else
             [*scope(certificate), f"certified: {largest_force(certificate, scenario)}"])
    print("\n".join(lines), file=sys.stderr)


def compare_class(scenario: Scenario, model: ContactModel) -> None:
    """Says on stderr whether the scenario's own surface is outside of its declared class."""
    if words := in_words(outside(scenario, model)):
        print(f"the scenario's own surface is outside of its declared class: {words}",
              file=sys.stderr)


def note(scenario: Scenario) -> None:
    """Notes on stderr the values of a scenario without effect."""
    for line in remarks(scenario):
        print(f"note: {line}", file=sys.stderr)
