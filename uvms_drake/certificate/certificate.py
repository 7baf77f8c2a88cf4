"""The certificate as data: its results, its verdict and the hashes of its inputs.

`certificate.json` carries the SHA-256 of its own content, of every file of the robot and of the
part of the scenario that it depends on. A certificate that was changed by hand, or whose inputs
have changed, is recognised; see `stale_reason`.
"""

import dataclasses
import hashlib
import json
from dataclasses import dataclass, field, replace
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydrake.common.yaml import yaml_load_data

from uvms_drake.certificate.assumptions import Assumption
from uvms_drake.certificate.declared_unknowns import UnknownEffect
from uvms_drake.common.errors import RunFailed
from uvms_drake.common.jsonable import jsonable, restored
from uvms_drake.common.program import FOLDER, VERSION
from uvms_drake.control.limits import HoldRadii, TubeRadii
from uvms_drake.model.description.robot_folder import model_dir
from uvms_drake.station.contact.mission_legs import Leg
from uvms_drake.station.scenario.modules import module_file
from uvms_drake.station.scenario.parts import uncovered
from uvms_drake.station.scenario.scenario import Scenario, dump_scenario
from uvms_drake.tube.conditions import Condition
from uvms_drake.tube.constants import Constant
from uvms_drake.tube.estimates import Estimate
from uvms_drake.tube.ultimate_bounds import HOLD

if TYPE_CHECKING:
    from uvms_drake.certificate.in_probability import AnyCertificate

KIND = "worst case"
"""`kind` of the certificate.json of a `Certificate`; the other is of `in_probability`."""
CERTIFICATE_FILE = "certificate.json"
IRRELEVANT = ("name", "description", "modules", "seed", "duration", "log_period", "simulator",
              "tube", "visual")
"""Keys of a scenario that a certificate does not depend on: `tube` is for runs without one, and the
files of `modules` count by their content. Other keys count in part, see `fingerprint`: bound and
weights of `disturbance`, all of `task` but the tolerance of the force, and those of `faults` that
the proofs do not cover."""


@dataclass(frozen=True)
class TerminalResult:
    """The terminal ingredients, and the result of their check."""

    radius: float
    """Radius ε of the terminal set."""
    limiting: str
    """Name of the condition with the smallest margin."""
    margins: dict[str, float]
    """Margins by condition, see `terminal_set.TerminalCheck`."""
    samples: int
    """Number of states at which the set was checked."""
    P: np.ndarray
    """Matrix P of the set ‖ξ‖_P ≤ ε (2(6+n), 2(6+n))."""
    gain: np.ndarray
    """Gain of the terminal controller (6+n, 2(6+n))."""


@dataclass(frozen=True)
class Certificate:
    """The claims about a scenario's closed loop, and the conditions that they need."""

    scenario: str
    law: str
    k: float
    """Gain k of the velocity error [1/s]."""
    sigma: float
    """Gain σ of the task error [1/s]."""
    d_bound: float
    """Bound d̃ [m/s², rad/s²] of the disturbance."""
    files: dict[str, str]
    """SHA-256 of the robot's files, by name."""
    inputs: str
    """SHA-256 of the scenario's relevant part."""
    versions: dict[str, str]
    weights: np.ndarray | None = None
    """Bounds of each component of the disturbance over d̃, the diagonal of Ŵ: ‖Ŵ⁻¹d‖₂ ≤ d̃. None,
    and not in the file, for a ball."""
    made_by: str = "certify"
    """The command that wrote it."""
    assumptions: tuple[Assumption, ...] = ()
    """Statements that it rests on and does not compute."""
    constants: tuple[Constant, ...] = ()
    conditions: tuple[Condition, ...] = ()
    tube: TubeRadii | None = None
    unknowns: tuple[UnknownEffect, ...] = ()
    """Declared unknowns and the acceleration that each causes."""
    budget: dict[str, dict[str, float]] = field(default_factory=dict)
    """Parts of some radii by their source; not in the file, if there are none."""
    margin: dict[str, float] = field(default_factory=dict)
    """Smallest limit of each of those radii that has one, the tube being zero."""
    legs: tuple[Leg, ...] = ()
    """The steps of a mission; not in the file, if there are none."""
    estimates: tuple[Estimate, ...] = ()
    """Estimated suprema of the tube, with the result of a second search."""
    tightening: int = 0
    """Number of limits that the tube tightens, each component of an input being one."""
    proven: int = 0
    """Number of these that are tightened by a proven number."""
    terminal: TerminalResult | None = None
    bounds: dict[str, float] = field(default_factory=dict)
    """Ultimate bounds by name, see `tube.ultimate_bounds`."""

    @property
    def failed(self) -> Condition | None:
        """First condition that does not hold, or None."""
        return next((item for item in self.conditions if not item.holds), None)

    @property
    def certified(self) -> bool:
        """Whether every condition that was checked holds."""
        return bool(self.conditions) and self.failed is None

    @property
    def force_sentence(self) -> str:
        """The certified force in words, with both bands of a sensed contact; empty if none is."""
        if "force" not in self.bounds:
            return ""
        text = (f"the force is off by less than {self.bounds['force']:.3g} N once the plan is at "
                "the task")
        if HOLD not in self.bounds or self.tube is None or self.tube.hold is None:
            return text
        return (f"{text}, and by less than {self.bounds[HOLD]:.3g} N in a hold, from "
                f"{self.tube.hold.time:.2g} s after the plan stands")

    def __str__(self) -> str:
        """Returns the whole certificate as a table, as `certify --full` prints it."""
        import uvms_drake as uv  # The table stands above: only its public name is known here.

        return uv.format_certificate(self)

    def adding(self, conditions: list[Condition]) -> "Certificate":
        """Returns the certificate with more conditions."""
        return replace(self, conditions=(*self.conditions, *conditions))

    def applied_to(self, scenario: Scenario) -> Scenario:
        """Returns the scenario with this tube and terminal set instead of the declared ones."""
        mpc = scenario.mpc
        if self.terminal is not None:
            mpc = replace(mpc, terminal_radius=self.terminal.radius)
        return replace(scenario, tube=self.tube or scenario.tube, mpc=mpc)

    def to_data(self) -> dict[str, Any]:
        """Returns the content as JSON data, with its own SHA-256 as `sha256`."""
        data = {"kind": KIND, **jsonable(dataclasses.asdict(self), names=True),
                "certified": self.certified}
        if self.weights is None:
            del data["weights"]
        if not self.budget:
            del data["budget"], data["margin"]
        if not data["legs"]:
            del data["legs"]
        return signed(data)

    @staticmethod
    def inputs_of(scenario: Scenario) -> dict[str, Any]:
        """Returns the inputs that a certificate of a scenario has now, see `fingerprint`."""
        return fingerprint(scenario)

    @staticmethod
    def from_data(data: dict[str, Any]) -> "Certificate":
        """Returns the certificate of which `to_data` made `data`."""
        data = {key: restored(value) for key, value in data.items()
                if key not in ("kind", "certified", "sha256")}
        tube, terminal, weights = data["tube"], data["terminal"], data.get("weights")
        return Certificate(**(data | {
            "assumptions": tuple(Assumption(**item) for item in data["assumptions"]),
            "constants": tuple(Constant.from_data(item) for item in data["constants"]),
            "conditions": tuple(Condition(**item) for item in data["conditions"]),
            "estimates": tuple(Estimate(**item) for item in data["estimates"]),
            "unknowns": tuple(UnknownEffect(**(item | {"each": tuple(item["each"])}))
                              for item in data["unknowns"]),
            "legs": tuple(Leg(**item) for item in data.get("legs", ())),
            "weights": None if weights is None else np.array(weights, dtype=float),
            "tube": None if tube is None else _tube_of(tube),
            "terminal": None if terminal is None else TerminalResult(**_with_arrays(terminal))}))


def _tube_of(data: dict[str, Any]) -> TubeRadii:
    holds = {key: None if data.get(key) is None else HoldRadii(**data[key])
             for key in ("hold", "likely_hold")}
    return TubeRadii(**(_with_arrays(data) | holds))


def _with_arrays(data: dict[str, Any]) -> dict[str, Any]:
    return {key: np.array(value, dtype=float) if isinstance(value, list) else value
            for key, value in data.items()}


def signed(data: dict[str, Any]) -> dict[str, Any]:
    """Returns JSON data with their own SHA-256 as `sha256`."""
    return data | {"sha256": _digest(data)}


def _digest(data: object) -> str:
    text = json.dumps(data, sort_keys=True, ensure_ascii=False, allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def fingerprint(scenario: Scenario) -> dict[str, Any]:
    """Returns the inputs of a certificate: hashes of files and scenario, and versions."""
    folder = model_dir(scenario.model)
    own_modules = [path for path in map(module_file, scenario.modules)
                   if FOLDER not in path.parents]  # Those of the package count by its version.
    files = {path.name: hashlib.sha256(path.read_bytes()).hexdigest()
             for path in (*sorted(folder.iterdir()), *own_modules)
             if path.is_file()}
    relevant = yaml_load_data(dump_scenario(scenario))
    for key in IRRELEVANT:
        relevant.pop(key, None)
    bound, weights = scenario.disturbance.bound, scenario.disturbance.weights
    relevant["disturbance"] = bound if np.size(weights) == 0 else [bound, *weights]
    relevant["faults"] = uncovered(scenario.faults)
    if scenario.contact.declared_wall() is not None:
        relevant["duration"] = scenario.duration
    relevant["mpc"].pop("terminal_radius")
    relevant["mpc"].pop("deadline", None)
    relevant["mpc"].pop("hover", None)  # At rest where it starts: the tube holds from then on.
    relevant["task"].pop("force_tolerance")
    return {"files": files, "inputs": _digest(jsonable(relevant, names=True)),
            "versions": {"uvms_drake": VERSION, "drake": version("drake")}}


def write_certificate(certificate: "AnyCertificate", folder: Path) -> None:
    """Writes `certificate.json` into a folder."""
    text = json.dumps(certificate.to_data(), indent=1, ensure_ascii=False, allow_nan=False)
    (folder / CERTIFICATE_FILE).write_text(text + "\n", encoding="utf-8")


def read_certificate(path: Path) -> Certificate:
    """Returns the certificate of a file.

    Raises:
        RunFailed: It was changed since it was made, or is one in probability.
    """
    data = read_data(path)
    if data.get("kind", KIND) != KIND:
        raise RunFailed(f"{path}: a certificate {data['kind']}, none for the worst case")
    return Certificate.from_data(data)


def read_data(path: Path) -> dict[str, Any]:
    """Returns the data of a certificate of any kind, without their SHA-256.

    Raises:
        RunFailed: They were changed since the certificate was made.
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
    return data


def stale_reason(certificate: "AnyCertificate", scenario: Scenario) -> str | None:
    """Returns the input that has changed since a certificate was made, or None.

    One in probability is of the program that made its runs.
    """
    now = certificate.inputs_of(scenario)
    for key, what in (("files", "a file of the robot"), ("inputs", "the scenario"),
                      ("versions", "a version"), ("source", "this package")):
        if key in now and getattr(certificate, key) != now[key]:
            return what
    return None
