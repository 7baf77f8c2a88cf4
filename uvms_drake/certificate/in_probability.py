"""A certificate in probability: a bound on how likely a run fails, from drawn runs.

It proves nothing about the worst case. N runs are drawn from the distribution that the scenario
declares, each simulated by the whole Diagram; of the number that failed follows a bound p of the
probability of failure, `failure_probability`. A run with the declared values, or others of their
ranges, is one that might have been drawn.
"""

import dataclasses
import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pydrake.common.yaml import yaml_load_data

from uvms_drake.certificate.cache import source_digest
from uvms_drake.certificate.certificate import (
    Certificate,
    fingerprint,
    read_data,
    signed,
)
from uvms_drake.certificate.failure_probability import percent_above
from uvms_drake.common.jsonable import jsonable
from uvms_drake.station.scenario.scenario import Scenario, dump_scenario

KIND = "in probability"
"""`kind` of its certificate.json."""
FAILURES = {
    "exception": "ended in an exception",
    "not finite": "had a signal that is not finite",
    "tube": "left the declared tube",
    "limit": "violated a limit",
    "saturation": "had a command that was cut",
    "force": "pressed the wall harder than allowed",
    "no plan": "had a sample without a plan",
    "contact": "lost the contact",
    "no touch": "never touched the wall",
    "mission": "did not complete a step of its mission",
}
"""Kinds of failure of a run, in words."""

UNDRAWN = ("name", "description", "modules", "seed", "duration", "simulator", "visual")
"""Keys of a scenario that two distributions may differ in; a run is kept with its chosen step."""


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
    seed: int
    """Seed of the draws."""
    campaign: str
    """Identity of the campaign of these runs, see `campaign.Campaign`."""
    files: dict[str, str]
    """SHA-256 of the robot's files, by name."""
    inputs: str
    """SHA-256 of the scenario without `UNDRAWN`."""
    versions: dict[str, str]
    source: str
    """SHA-256 of the package's Python files that made the runs."""
    mission: str = ""
    """Steps of the mission that every run has, by their kinds; empty without one."""
    made_by: str = "certify"
    """The command that wrote it."""

    @property
    def holds(self) -> bool:
        """Whether there is a bound below 1: not if every run failed."""
        return self.failures < self.runs

    @property
    def verdict(self) -> str:
        """The bound in words."""
        if not self.holds:
            return "not certified in probability: every run failed"
        mission = f" of the mission {self.mission}" if self.mission else ""
        return (f"certified in probability: at most {percent_above(self.probability)} per run at "
                f"{100.0 * self.confidence:g} % confidence, for the declared distribution{mission}")

    def applied_to(self, scenario: Scenario) -> Scenario:
        """Returns the scenario unchanged: the tube is the declared one."""
        return scenario


    def to_data(self) -> dict[str, Any]:
        """Returns the content as JSON data, with its own SHA-256 as `sha256`."""
        data = jsonable(dataclasses.asdict(self), names=True)
        return signed({"kind": KIND, **data})

    @staticmethod
    def from_data(data: Mapping[str, Any]) -> "ProbabilityCertificate":
        """Returns the certificate of which `to_data` made `data`."""
        known = {key: value for key, value in data.items() if key not in ("kind", "sha256")}
        lists = {key: tuple(known[key]) for key in ("failed", "distribution")}
        return ProbabilityCertificate(**(known | lists))

    @staticmethod
    def inputs_of(scenario: Scenario) -> dict[str, Any]:
        """Returns the inputs that a certificate of a scenario has now: hashes and versions.

        Of the scenario all counts but `UNDRAWN`, the tube too: it is the declared one.
        """
        fixed = yaml_load_data(dump_scenario(scenario))
        for key in UNDRAWN:
            fixed.pop(key, None)
        text = json.dumps(jsonable(fixed, names=True), sort_keys=True, ensure_ascii=False)
        return fingerprint(scenario) | {
            "inputs": hashlib.sha256(text.encode()).hexdigest(), "source": source_digest()}


AnyCertificate = Certificate | ProbabilityCertificate


def read_any_certificate(path: Path) -> AnyCertificate:
    """Returns the certificate of a file, of either kind; as `read_certificate`."""
    data = read_data(path)
    if data.get("kind") == KIND:
        return ProbabilityCertificate.from_data(data)
    return Certificate.from_data(data)


def cache_key(scenario: Scenario) -> dict[str, Any]:
    """Returns the key in the cache of the certificate in probability of a scenario."""
    declared = replace(scenario, name="", description="", seed=0)
    return {KIND: dump_scenario(declared), "files": fingerprint(scenario)["files"]}
