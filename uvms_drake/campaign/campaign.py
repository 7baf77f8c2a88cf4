"""A campaign as data: the scenario that is drawn from, and a seed; it is kept in the runs' folder.

Everything that a run depends on is in here, as text and numbers: it is sent to workers, and two
campaigns are the same if their `identity` is. Two scenarios have the same distribution if they are
the same.
"""

import hashlib
import json
import os
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path

from pydrake.common.yaml import yaml_load_data

from uvms_drake.campaign.harness import stored
from uvms_drake.certificate.certificate import Certificate, fingerprint, run_source
from uvms_drake.common.errors import InvalidParameter, RunFailed, require
from uvms_drake.station.record import from_anywhere
from uvms_drake.station.scenario.scenario import Scenario, dump_scenario, typed_scenario

SETUP_FILE = "setup.json"
DRAWING = {"numpy": version("numpy")}
"""Version of the random generator, beside those of a certificate."""
NO_OTHER = "a folder without another campaign in it (of another scenario, seed, option or program)"


@dataclass(frozen=True)
class Campaign:
    """Everything that the runs share; run number `index` is a function of this and of `index`."""

    scenario: str
    """YAML of the scenario, with the tube and the terminal set of the certificate in it."""
    declared: str
    """SHA-256 of the scenario's YAML without its certificate."""
    certified: bool
    """Whether the tube is that of a certificate that holds; it is declared otherwise."""
    seed: int
    files: dict[str, str]
    """SHA-256 of the robot's files, by name."""
    versions: dict[str, str]
    source: str
    """SHA-256 of this package's Python files that a run depends on."""
    runs: int | None
    """Number of runs, if it is chosen before the first one: that of a certificate."""

    @property
    def base(self) -> Scenario:
        """Scenario that is varied; it must not be changed."""
        return _parsed(self.scenario)

    @property
    def identity(self) -> str:
        """SHA-256 of everything."""
        return _digest(json.dumps(asdict(self), sort_keys=True, ensure_ascii=False))


@lru_cache(maxsize=2)
def _parsed(text: str) -> Scenario:
    return typed_scenario(yaml_load_data(text))


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def make_campaign(scenario: Scenario, seed: int, certificate: Certificate | None,
                  runs: int | None = None) -> Campaign:
    """Returns the campaign of a scenario.

    Args:
        scenario: Scenario to vary.
        seed: Seed of the draws.
        certificate: Its certificate, which holds; None for the declared tube.
        runs: Number of runs, if it is chosen before the first one.
    """
    scenario = from_anywhere(scenario)  # Workers, and who goes on with it, may be elsewhere.
    applied = scenario if certificate is None else certificate.applied_to(scenario)
    prints = fingerprint(scenario)
    return Campaign(
        scenario=dump_scenario(applied), declared=_digest(dump_scenario(scenario)),
        certified=certificate is not None, seed=seed, files=prints["files"],
        versions=prints["versions"] | DRAWING, source=run_source(), runs=runs)


def require_same_code(campaign: Campaign) -> None:
    """Raises `RunFailed` unless program and robot are those that a campaign was made with."""
    now = fingerprint(campaign.base) | {"source": run_source()}
    now["versions"] |= DRAWING
    for key, what in (("source", "this package"), ("versions", "a version"),
                      ("files", "a file of the robot")):
        if now[key] != getattr(campaign, key):
            raise RunFailed(f"{what} is not as it was when the campaign was made")


def check_folder(folder: Path, campaign: Campaign) -> None:
    """Raises `InvalidParameter` if another campaign is in a folder; the certificate may differ."""
    if (folder / SETUP_FILE).exists():
        found = read_setup(folder)
        require(replace(found, scenario=campaign.scenario) == campaign, "--output", str(folder),
                NO_OTHER)
    require((folder / SETUP_FILE).exists() or not stored(folder), "--output", str(folder),
            "a folder without runs of unknown origin")


def keep_setup(folder: Path, campaign: Campaign) -> None:
    """Writes a campaign into a folder, if there is none.

    Raises:
        InvalidParameter: There is another one, or the folder cannot be written to.
    """
    check_folder(folder, campaign)
    draft = folder / f"{SETUP_FILE}.{os.getpid()}.part"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        draft.write_text(json.dumps(asdict(campaign), indent=1, ensure_ascii=False) + "\n",
                         encoding="utf-8")
        with suppress(FileExistsError):  # A link is whole, and never in place of another file.
            os.link(draft, folder / SETUP_FILE)
        draft.unlink()
    except OSError as error:
        raise InvalidParameter("--output", str(folder),
                               f"a folder that can be written to ({error.strerror})") from None
    require(read_setup(folder) == campaign, "--output", str(folder), NO_OTHER)


def read_setup(folder: Path) -> Campaign:
    """Returns the campaign of a folder.

    Raises:
        InvalidParameter: There is none, or it is of another version.
    """
    try:
        return Campaign(**json.loads((folder / SETUP_FILE).read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError):
        raise InvalidParameter("--output", str(folder), "a campaign's folder, with its "
                               f"{SETUP_FILE} of this version") from None
