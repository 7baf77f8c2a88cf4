"""Certificates with the hashes of their inputs: file, verdict, and changed inputs.

`certificate.json` carries the SHA-256 of its own content, of every file of the robot and of the
part of the scenario that it depends on. A certificate that was changed by hand, or whose inputs
have changed, is recognised; see `stale_reason`.
"""

import hashlib
import json
from dataclasses import asdict, dataclass, field, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.common.yaml import yaml_load_data

from uvms_drake.certificate.claims import Claims
from uvms_drake.certificate.in_probability import ProbabilityCertificate
from uvms_drake.certificate.text import format_certificate, verdict
from uvms_drake.common.cache import source_digest
from uvms_drake.common.errors import RunFailed
from uvms_drake.common.jsonable import from_jsonable, jsonable, write_json
from uvms_drake.common.program import VERSION
from uvms_drake.model.description.robot_files import model_dir, read_robot_files
from uvms_drake.station.scenario.modules import module_files
from uvms_drake.station.scenario.parts import uncovered
from uvms_drake.station.scenario.scenario import Scenario, dump_scenario

CERTIFICATE_FILE = "certificate.json"
FORMAT = 3
"""Format of the file; those before had no number."""
IRRELEVANT = ("name", "description", "modules", "seed", "duration", "log_period", "simulator",
              "tube", "visual", "draws")
"""Keys of a scenario that a certificate does not depend on: `tube` is for runs without one, and
files of `modules` and `model` count by their content. Other keys count in part, see `fingerprint`:
bound and weights of `disturbance`, all of `task` but the tolerance of the force, those of `faults`
that the proofs do not cover, of a declared wall the duration and `mpc.hover`, and of a supervisor
the log's period and faults of the solver."""
UNDRAWN = ("name", "description", "modules", "seed", "visual")
"""Keys of a scenario that two distributions may differ in."""
SCHEME = ("integration_scheme", "accuracy", "use_error_control")
"""Keys of `simulator` that a distribution depends on; a run is kept with its chosen step."""
UNREAD = ("benchmark", "command", "setup", "visual")
"""Rooms of the package that no drawn run depends on."""


@dataclass(frozen=True)
class Certificate(Claims):
    """Claims for the worst case, with the inputs that they were computed from."""

    files: dict[str, str] = field(default_factory=dict)
    """SHA-256 of the robot's files, by name."""
    inputs: str = ""
    """SHA-256 of the scenario's relevant part."""
    versions: dict[str, str] = field(default_factory=dict)
    made_by: str = "certify"
    """The command that wrote it."""

    @property
    def verdict(self) -> str:
        """The verdict in words, with the first failed condition and advice."""
        return verdict(self)

    def __str__(self) -> str:
        """Returns the whole certificate as a table, as `certify --full` prints it."""
        return format_certificate(self)

    def applied_to(self, scenario: Scenario) -> Scenario:
        """Returns the scenario with this tube and terminal set instead of the declared ones."""
        mpc = scenario.mpc
        if self.terminal is not None:
            mpc = replace(mpc, terminal_radius=self.terminal.radius)
        return replace(scenario, tube=self.tube or scenario.tube, mpc=mpc)


AnyCertificate = Certificate | ProbabilityCertificate
KINDS: dict[str, type[AnyCertificate]] = {
    "worst case": Certificate, "in probability": ProbabilityCertificate}
"""Certificates by the `kind` of their file."""


# Inputs -------------------------------------------------------------------------------------------


def fingerprint(scenario: Scenario) -> dict[str, Any]:
    """Returns the inputs of a certificate: hashes of files and scenario, and versions."""
    folder = model_dir(scenario.model)
    read = {path.name: path for path in sorted(folder.iterdir()) if path.is_file()}
    for i, path in enumerate(read_robot_files(folder).read[1:]):
        read[f"included[{i}]/{path.name}"] = path
    for i, name in enumerate(scenario.modules):  # Those of the package count by its version.
        read |= {f"modules[{i}]/{key}": path for key, path in module_files(name).items()}
    files = {key: hashlib.sha256(path.read_bytes()).hexdigest() for key, path in read.items()}
    relevant = yaml_load_data(dump_scenario(scenario))
    for key in IRRELEVANT:
        relevant.pop(key, None)
    relevant["model"] = folder.name
    bound, weights = scenario.disturbance.bound, scenario.disturbance.weights
    relevant["disturbance"] = bound if np.size(weights) == 0 else [bound, *weights]
    relevant["faults"] = uncovered(scenario.faults)
    if scenario.contact.declared_wall() is not None:  # Within which the task is to be reached.
        relevant["duration"] = scenario.duration
        if scenario.supervisor is not None:  # On which its silence depends.
            relevant["supervised"] = [scenario.log_period, *(
                each.duration for each in scenario.faults if each.place == "solver")]
    else:  # At rest where it starts: the tube holds from then on.
        relevant["mpc"].pop("hover", None)
    relevant["mpc"].pop("terminal_radius")
    relevant["mpc"].pop("deadline", None)
    relevant["task"].pop("force_tolerance")
    relevant["contact"].pop("force_line", None)
    return {"files": files, "inputs": _digest(jsonable(relevant, names=True)),
            "versions": {"uvms_drake": VERSION, "drake": version("drake")}}


def probability_fingerprint(scenario: Scenario) -> dict[str, Any]:
    """Returns the inputs of a certificate in probability: that of the program's source, too.

    Of the scenario all counts but `UNDRAWN`, the tube too: it is the declared one.
    """
    fixed = yaml_load_data(dump_scenario(scenario))
    for key in UNDRAWN:
        fixed.pop(key, None)
    fixed["model"] = model_dir(scenario.model).name
    fixed["simulator"] = {key: fixed["simulator"][key] for key in SCHEME}
    return fingerprint(scenario) | {
        "inputs": _digest(jsonable(fixed, names=True)), "source": run_source()}


def run_source() -> str:
    """Returns the SHA-256 of the package's files that a drawn run depends on."""
    return source_digest(without=UNREAD)


def cache_key(scenario: Scenario) -> dict[str, Any]:
    """Returns the key in the cache of the certificate in probability of a scenario."""
    return {"in probability": probability_fingerprint(scenario)}


def stale_reason(certificate: AnyCertificate, scenario: Scenario) -> str | None:
    """Returns the input that has changed since a certificate was made, or None.

    One in probability is of the program that made its runs.
    """
    inputs_of = fingerprint if isinstance(certificate, Certificate) else probability_fingerprint
    now = inputs_of(scenario)
    for key, what in (("files", "a file of the robot"), ("inputs", "the scenario"),
                      ("versions", "a version"), ("source", "this package")):
        if key in now and getattr(certificate, key) != now[key]:
            return what
    return None


# File ---------------------------------------------------------------------------------------------


def to_data(certificate: AnyCertificate) -> dict[str, Any]:
    """Returns a certificate as JSON data, with their own SHA-256 as `sha256`."""
    kind = next(name for name, of_kind in KINDS.items() if isinstance(certificate, of_kind))
    data = {"format": FORMAT, "kind": kind, "certified": certificate.certified,
            **jsonable(asdict(certificate), names=True)}
    return data | {"sha256": _digest(data)}


def from_data(data: dict[str, Any]) -> AnyCertificate:
    """Returns the certificate of which `to_data` made `data`."""
    of_kind = KINDS[data["kind"]]
    known = of_kind.__dataclass_fields__
    certificate: AnyCertificate = from_jsonable(
        of_kind, {key: value for key, value in data.items() if key in known})
    return certificate


def _digest(data: object) -> str:
    text = json.dumps(data, sort_keys=True, ensure_ascii=False, allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def write_certificate(certificate: AnyCertificate, folder: Path) -> None:
    """Writes `certificate.json` into a folder."""
    write_json(to_data(certificate), folder / CERTIFICATE_FILE)


def read_certificate(path: Path) -> AnyCertificate:
    """Returns the certificate of a file.

    Raises:
        RunFailed: It was changed since it was made, or is in the format of another version.
    """
    try:
        data: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        claimed = data.pop("sha256")
        intact = _digest(data) == claimed
    except (OSError, ValueError, KeyError, AttributeError, TypeError):
        intact = False
    if not intact:
        raise RunFailed(f"{path}: its content does not match its SHA-256, it was changed; make it "
                        "again with 'certify'")
    if data.get("format") != FORMAT:
        raise RunFailed(f"{path}: in the format of another version of uvms_drake; make it again "
                        "with 'certify'")
    return from_data(data)
