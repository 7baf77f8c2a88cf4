"""A campaign as data: a certified scenario, a seed, and the surfaces and forces that it may draw.

Everything that a run depends on is in here, as text and numbers: it is sent to workers, and two
campaigns are the same if their `identity` is.
"""

import hashlib
import json
from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import Any

from pydrake.common.yaml import yaml_load_data

from uvms_drake.certificate.certificate import Certificate, fingerprint
from uvms_drake.common.cache import source_digest
from uvms_drake.common.errors import RunFailed
from uvms_drake.station.scenario.scenario import Scenario, dump_scenario, typed_scenario


@dataclass(frozen=True)
class Campaign:
    """Everything that the runs share; run number `index` is a function of this and of `index`."""

    scenario: str
    """YAML of the scenario, with the tube and the terminal set of the certificate in it."""
    certified: bool
    """Whether the tube is that of a certificate that holds; it is declared otherwise."""
    seed: int
    files: dict[str, str]
    """SHA-256 of the robot's files, by name."""
    versions: dict[str, str]
    source: str
    """SHA-256 of this package's Python files."""

    @property
    def base(self) -> Scenario:
        """Scenario that is varied; it must not be changed."""
        return _parsed(self.scenario)

    @property
    def identity(self) -> str:
        """SHA-256 of everything."""
        text = json.dumps(asdict(self), sort_keys=True, ensure_ascii=False)
        return hashlib.sha256(text.encode()).hexdigest()

    @staticmethod
    def from_data(data: dict[str, Any]) -> "Campaign":
        """Returns the campaign of which `dataclasses.asdict` made `data`."""
        return Campaign(**data)


@lru_cache(maxsize=2)
def _parsed(text: str) -> Scenario:
    return typed_scenario(yaml_load_data(text))


def require_same_code(campaign: Campaign) -> None:
    """Raises `RunFailed` unless program and robot are those that a campaign was made with."""
    now = fingerprint(campaign.base) | {"source": source_digest()}
    for key, what in (("source", "this package"), ("versions", "a version"),
                      ("files", "a file of the robot")):
        if now[key] != getattr(campaign, key):
            raise RunFailed(f"{what} is not as it was when the campaign was made")


def make_campaign(scenario: Scenario, seed: int, certificate: Certificate | None) -> Campaign:
    """Returns the campaign of a scenario.

    Args:
        scenario: Scenario to vary.
        seed: Seed of the draws.
        certificate: Its certificate, which holds; None for the declared tube.
    """
    applied = scenario if certificate is None else certificate.applied_to(scenario)
    prints = fingerprint(scenario)
    return Campaign(
        scenario=dump_scenario(applied), certified=certificate is not None, seed=seed,
        files=prints["files"], versions=prints["versions"], source=source_digest())
