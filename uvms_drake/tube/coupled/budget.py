"""Error budget of the coupled linear loop: rows × sources, worst case and by chance.

The worst case of a row is the sum of the largest effects of all sources within their bounds. By
chance it is, but for a probability δ in a run,

    q √(Σ σᵢ²) + Σ (largest effects of sources that are not random),   q = √(2 ln(2N/δ)),     (1)

with the sum of variances over random sources and N the number of rows and instants that are looked
at. It is about the linear loop alone: the remainder of second order is not bounded by it.
See tube/coupled/theory.md#gains-by-the-pattern-of-an-error.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from uvms_drake.model.signals.linear import ErrorChannel
from uvms_drake.tube.coupled.gains import Gain, Responses
from uvms_drake.tube.coupled.periodic import PeriodicSystem

GROUPS = {
    "depth": ("depth",), "position": ("depth", "tip y", "tip z"), "roll": ("roll",),
    "pitch": ("pitch",), "depth_speed": ("depth speed",),
    "tip_speed": ("depth speed", "tip speed y", "tip speed z"),
    "nu1": ("surge", "sway", "heave"), "nu2": ("roll rate", "pitch rate", "yaw rate")}
"""Rows of each radius of a tube, of which it is the norm; those of the joints depend on the arm."""

DEPTH = "depth"
"""Row and radius of the depth in the wall."""
AT_THE_WALL = DEPTH, "position"
"""Radii of the tip's position, which limits read in the press alone."""
APPROACH, PRESS = "approach", "press"
"""Names of the stages: in open water, and on walls of the class."""
PLANNED = "plan"
"""Name of the source of a plan's motion."""
POSES = ("depth", "tip y", "tip z", "roll", "pitch")
"""Rows of positions and angles but those of the joints, q1, q2, ..."""


@dataclass(frozen=True)
class Source:
    """Effect of one source on each row, largest over the walls of a stage."""

    name: str
    worst: np.ndarray
    """Largest effect within its bound (rows,)."""
    std: np.ndarray
    """Standard deviation (rows,); zero of a source that is not random."""
    random: bool
    counted: bool = True
    """Whether it is in the sums; friction as any force is not."""


@dataclass(frozen=True)
class Stability:
    """Margin of stability of a loop, the least over walls."""

    loop: str
    """Name of the gain or of the delay."""
    kind: str
    """`gain` or `delay`."""
    margin: float
    """Largest stable multiple of it."""


@dataclass(frozen=True)
class Stage:
    """The sources of a part of the task."""

    name: str
    """`APPROACH` or `PRESS`."""
    sources: tuple[Source, ...]
    elsewhere: np.ndarray
    """Largest sum by chance at drawn postures (rows,)."""

    @property
    def worst(self) -> np.ndarray:
        """Sums of the worst case (rows,)."""
        return np.sum([each.worst for each in self.sources if each.counted], axis=0)


@dataclass(frozen=True)
class CoupledBudget:
    """The budget of a scenario at its task."""

    rows: tuple[str, ...]
    stages: tuple[Stage, ...]
    """None of an unstable loop."""
    chance: float
    """δ."""
    quantile: float
    """q."""
    postures: int
    """Number of drawn postures."""
    left: dict[str, float]
    """Limits less the part that the task uses, by row."""
    declared: dict[str, float]
    """Radii of the scenario's tube, by the names of `GROUPS` and of the joints."""
    stability: tuple[Stability, ...]
    decay: float
    """Slowest decay rate over walls and drawn postures [1/s]; negative: unstable."""
    own: tuple[str, ...] = ()
    """Rows that are no errors but the robot's own deviations, see `CoupledLoop.own`."""

    @property
    def planned(self) -> bool:
        """Whether the sums count the plan."""
        return all(any(each.name == PLANNED and each.counted for each in stage.sources)
                   for stage in self.stages)

    def by_chance(self, stage: Stage) -> np.ndarray:
        """Returns the sums by chance of a stage (rows,), see (1)."""
        return by_chance(stage.sources, self.quantile)

    def radii(self) -> dict[str, float]:
        """Returns the radii of a tube by the sums by chance, as norms, the largest of the stages.

        Those of the tip's position are of the press, and the robot's own deviations are in none.
        """
        errors = ~np.isin(self.rows, self.own)
        found = {stage.name: radii_of(self.rows, self.by_chance(stage) * errors)
                 for stage in self.stages}
        return {name: found[PRESS][name] if name in AT_THE_WALL else max(
            radii[name] for radii in found.values()) for name in found[PRESS]}

    def row(self, name: str) -> float:
        """Returns the sum by chance of a row, larger of the stages; the depth of the press."""
        return max(float(self.by_chance(stage)[self.rows.index(name)]) for stage in self.stages
                   if stage.name == PRESS or name != DEPTH)

    def shares(self) -> dict[str, dict[str, float]]:
        """Returns the share of each counted source in the sums by chance, by row.

        That of a random source is in proportion to its variance. Rows are those of positions and
        angles that have a limit, of the stage in which their sum is larger.
        """
        out = {}
        for row in self.left if self.stages else ():
            if row in POSES or re.fullmatch(r"q\d+", row):
                i = self.rows.index(row)
                stage = next(stage for stage in reversed(self.stages)
                             if self.by_chance(stage)[i] == self.row(row))
                counted = [each for each in stage.sources if each.counted]
                std = np.sqrt(np.sum([each.std[i]**2 for each in counted if each.random]))
                out[row] = {each.name: float(
                    self.quantile * each.std[i]**2 / max(std, np.finfo(float).tiny)
                    if each.random else each.worst[i]) for each in counted}
        return out

    def to_data(self) -> dict[str, Any]:
        """Returns it with its sums, as data of a file."""
        sums = {stage.name: {"worst": stage.worst, "by_chance": self.by_chance(stage)}
                for stage in self.stages}
        return asdict(self) | {"sums": sums}

    @staticmethod
    def from_data(data: dict[str, Any]) -> "CoupledBudget":
        """Returns the budget of which `to_data` made `data`."""
        data = {key: value for key, value in data.items() if key != "sums"}
        return CoupledBudget(**(data | {
            "rows": tuple(data["rows"]), "own": tuple(data["own"]),
            "stages": tuple(Stage(stage["name"], tuple(
                Source(**(each | {key: np.array(each[key]) for key in ("worst", "std")}))
                for each in stage["sources"]), np.array(stage["elsewhere"]))
                for stage in data["stages"]),
            "stability": tuple(Stability(**each) for each in data["stability"])}))


def quantile(rows: int, instants: float, chance: float) -> float:
    """Returns q of (1), for a number of rows and of instants at which they are looked at."""
    return math.sqrt(2.0 * math.log(2.0 * rows * instants / chance))


def by_chance(sources: Sequence[Source], quantile: float) -> np.ndarray:
    """Returns the sums (1) of the counted sources (rows,)."""
    counted = [each for each in sources if each.counted]
    variance = np.sum([each.std**2 for each in counted if each.random], axis=0)
    rest = np.sum([each.worst for each in counted if not each.random], axis=0)
    out: np.ndarray = quantile * np.sqrt(variance) + rest
    return out


def radii_of(rows: Sequence[str], sums: np.ndarray) -> dict[str, float]:
    """Returns the radii of a tube by sums of the rows (rows,), as norms."""
    joints = tuple(row for row in rows if row.startswith("q") and not row.endswith(" rate"))
    groups = GROUPS | {"joints": joints, "qdot": tuple(f"{joint} rate" for joint in joints)}
    return {name: float(np.linalg.norm([sums[rows.index(row)] for row in members]))
            for name, members in groups.items()}


def sources_of(systems: Sequence[tuple[PeriodicSystem, Sequence[ErrorChannel]]],
               quantile: float, not_counted: Sequence[str] = (), phases: int | None = None
               ) -> tuple[Source, ...]:
    """Returns the sources at a point, each the largest over its walls.

    Args:
        systems: System of each wall, which is stable, with its channels.
        quantile: q.
        not_counted: Names of channels that are in no sum.
        phases: Number of phases at which the rows are looked at; all if left out.
    """
    found: dict[str, list[Gain]] = {}
    random: dict[str, bool] = {}
    for system, channels in systems:
        count = len(system.steps)
        responses = Responses(system, None if phases is None else tuple(
            int(each) for each in np.linspace(0, count, phases, endpoint=False)))
        for channel, gain in zip(channels, responses.gains(channels, quantile), strict=True):
            found.setdefault(channel.name, []).append(gain)
            random[channel.name] = channel.sigma is not None
    return tuple(Source(
        name, np.max([gain.worst for gain in gains], axis=0),
        np.sqrt(np.max([gain.variance for gain in gains], axis=0)), random[name],
        name not in not_counted) for name, gains in found.items())
