"""A campaign as data: a certified scenario, a seed, and the surfaces and forces that it may draw.

Everything that a run depends on is in here, as text and numbers: it is sent to workers, and two
campaigns are the same if their `identity` is.
"""

import hashlib
import json
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from pydrake.common.yaml import yaml_load_data

from uvms_drake.campaign.certified_surfaces import CertifiedWall, walls_of, with_wall
from uvms_drake.certificate.cache import cached, source_digest
from uvms_drake.certificate.certificate import Certificate, fingerprint
from uvms_drake.common.errors import InvalidParameter, RunFailed
from uvms_drake.common.progress import Progress, part_of, silent
from uvms_drake.station.motions.motions import motion_of
from uvms_drake.station.problem import load_model, retargeted_ocp
from uvms_drake.station.scenario.scenario import Scenario, dump_scenario, typed_scenario

FORCES = (0.5, 0.75, 1.0, 1.2)
"""Desired forces that are drawn, over the scenario's own. Each has an equilibrium, a P and an ε of
its own; the tube is the same, since it holds for forces of up to `limits.static_force`."""


@dataclass(frozen=True)
class Target:
    """A desired force that can be held, on a surface, within the limits that the tube leaves."""

    wall: int | None
    """Index of the surface; None for the scenario's own, without a certificate."""
    factor: float
    """Desired force as a multiple of the scenario's own."""
    radius: float
    """Radius ε of its terminal set, checked as that of a certificate."""


@dataclass(frozen=True)
class Campaign:
    """Everything that the runs share; run number `index` is a function of this and of `index`."""

    scenario: str
    """YAML of the scenario, with the tube and the terminal set of the certificate in it."""
    certified: bool
    """Whether the tube is that of a certificate that holds; it is declared otherwise."""
    seed: int
    model_error: float
    """Largest relative error of the model that is drawn; zero if nothing is unknown."""
    outside: bool
    """Whether something outside of the bounds happens in every run, see `outside`."""
    walls: tuple[CertifiedWall, ...]
    targets: tuple[Target, ...]
    files: dict[str, str]
    """SHA-256 of the robot's files, by name."""
    versions: dict[str, str]
    source: str
    """SHA-256 of this package's Python files."""

    @property
    def base(self) -> Scenario:
        """Scenario that is varied; it must not be changed."""
        return _parsed(self.scenario)

    def declared(self, target: Target) -> Scenario:
        """Returns the scenario with the surface of a target, and the tube that holds there."""
        return self.base if target.wall is None else with_wall(self.base, self.walls[target.wall])

    @property
    def identity(self) -> str:
        """SHA-256 of everything."""
        text = json.dumps(asdict(self), sort_keys=True, ensure_ascii=False)
        return hashlib.sha256(text.encode()).hexdigest()

    @staticmethod
    def from_data(data: dict[str, Any]) -> "Campaign":
        """Returns the campaign of which `dataclasses.asdict` made `data`."""
        return Campaign(**{**data, "walls": tuple(CertifiedWall(**item) for item in data["walls"]),
                           "targets": tuple(Target(**item) for item in data["targets"])})


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


def make_campaign(scenario: Scenario, seed: int, certificate: Certificate | None,
                  model_error: float = 0.0, outside: bool = False,
                  progress: Progress = silent) -> Campaign:
    """Returns the campaign of a scenario.

    Args:
        scenario: As it is loaded.
        seed: Seed of the draws, zero or positive.
        certificate: One that holds for the scenario; None if its declared tube is taken.
        model_error: As of `Campaign`.
        outside: As of `Campaign`.
        progress: As of `certified_once`.
    """
    applied, prints = scenario, fingerprint(scenario)
    walls: tuple[CertifiedWall, ...] = ()
    targets: tuple[Target, ...] = (Target(None, 1.0, scenario.mpc.terminal_radius),)
    if certificate is not None:
        applied = certificate.applied_to(scenario)
        walls = walls_of(scenario, certificate, part_of(progress, 0.0, 0.6))
        part = 0.4 / len(walls)
        targets = tuple(target for index, wall in enumerate(walls) for target in _targets_on(
            with_wall(applied, wall), index,
            part_of(progress, 0.6 + index * part, 0.6 + (index + 1) * part)))
    return Campaign(
        scenario=dump_scenario(applied), certified=certificate is not None, seed=seed,
        model_error=model_error, outside=outside, walls=walls, targets=targets,
        files=prints["files"], versions=prints["versions"], source=source_digest())


def _targets_on(scenario: Scenario, wall: int, progress: Progress) -> list[Target]:
    """Returns the desired forces that can be held on a surface, each with its terminal set.

    If no force acts, or the contact draws them itself, it is the scenario's own alone.

    Args:
        scenario: With the tube of the surface's certificate in it.
        wall: Index of the surface.
        progress: As of `certified_once`.
    """
    own = Target(wall, 1.0, scenario.mpc.terminal_radius)
    force = np.asarray(scenario.task.force, dtype=float)
    alone = scenario.contact.draws_surface or not motion_of(scenario).has_forces
    if alone or not (scenario.mpc.terminal_set and np.any(force)):
        return [own]

    def compute() -> list[list[float]]:
        """Returns factor and ε of each other force that can be held."""
        found, model = [], load_model(scenario)
        for i, factor in enumerate(FORCES):
            progress("terminal sets of other forces", i / len(FORCES))
            if factor == 1.0:
                continue
            try:
                radius = retargeted_ocp(scenario, model, factor * force).terminal.radius
            except InvalidParameter:  # It cannot be held within the limits.
                continue
            found.append([factor, float(radius)])
        return found

    key = {"targets": dump_scenario(scenario), "forces": FORCES,
           "files": fingerprint(scenario)["files"]}
    return [own, *(Target(wall, factor, radius) for factor, radius in cached(key, compute))]


def with_target(scenario: Scenario, target: Target) -> Scenario:
    """Returns the scenario with another desired force, and the terminal set of that."""
    force = target.factor * np.asarray(scenario.task.force, dtype=float)
    return replace(scenario, task=replace(scenario.task, force=force),
                   mpc=replace(scenario.mpc, terminal_radius=target.radius))
