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

POSES = ("depth", "tip y", "tip z", "roll", "pitch")
"""Rows of positions and angles but those of the joints, q1, q2, ..."""


@dataclass(frozen=True)
class Source:
    """Effect of one source on each row, largest over the walls of a point."""

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
class CoupledBudget:
    """The budget of a scenario at its task."""

    rows: tuple[str, ...]
    sources: tuple[Source, ...]
    chance: float
    """δ."""
    quantile: float
    """q."""
    elsewhere: np.ndarray
    """Largest sum by chance at drawn postures (rows,)."""
    postures: int
    """Number of drawn postures."""
    left: dict[str, float]
    """Limits less the part that the task uses, by row."""
    declared: dict[str, float]
    """Radii of the scenario's tube, by the names of `GROUPS` and of the joints."""
    stability: tuple[Stability, ...]
    decay: float
    """Slowest decay rate over walls and drawn postures [1/s]; negative: unstable."""

    @property
    def worst(self) -> np.ndarray:
        """Sums of the worst case (rows,)."""
        return np.sum([each.worst for each in self.sources if each.counted], axis=0)

    @property
    def by_chance(self) -> np.ndarray:
        """Sums by chance (rows,), see (1)."""
        return by_chance(self.sources, self.quantile)

    def shares(self) -> dict[str, dict[str, float]]:
        """Returns the share of each counted source in the sums by chance, by row.

        That of a random source is in proportion to its variance. Rows are those of positions and
        angles that have a limit.
        """
        counted = [each for each in self.sources if each.counted]
        std = np.sqrt(np.sum([each.std**2 for each in counted if each.random], axis=0))
        parts = {each.name: self.quantile * each.std**2 / np.maximum(std, np.finfo(float).tiny)
                 if each.random else each.worst for each in counted}
        rows = [row for row in self.left if row in POSES or re.fullmatch(r"q\d+", row)]
        return {row: {name: float(part[self.rows.index(row)]) for name, part in parts.items()}
                for row in rows if parts}

    def radii(self, sums: np.ndarray) -> dict[str, float]:
        """Returns the radii of a tube by sums of the rows, as norms."""
        return radii_of(self.rows, sums)

    def to_data(self) -> dict[str, Any]:
        """Returns it with its sums, as data of a file."""
        sums = {"worst": self.worst, "by_chance": self.by_chance}
        return asdict(self) | {"sums": sums}

    @staticmethod
    def from_data(data: dict[str, Any]) -> "CoupledBudget":
        """Returns the budget of which `to_data` made `data`."""
        data = {key: value for key, value in data.items() if key != "sums"}
        return CoupledBudget(**(data | {
            "rows": tuple(data["rows"]), "elsewhere": np.array(data["elsewhere"]),
            "sources": tuple(Source(**(each | {key: np.array(each[key]) for key in (
                "worst", "std")})) for each in data["sources"]),
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
               not_counted: Sequence[str] = (), phases: int | None = None) -> tuple[Source, ...]:
    """Returns the sources at a point, each the largest over its walls.

    Args:
        systems: System of each wall, which is stable, with its channels.
        not_counted: Names of channels that are in no sum.
        phases: Number of phases at which the rows are looked at; all if left out.
    """
    found: dict[str, list[Gain]] = {}
    random: dict[str, bool] = {}
    for system, channels in systems:
        count = len(system.steps)
        responses = Responses(system, None if phases is None else tuple(
            int(each) for each in np.linspace(0, count, phases, endpoint=False)))
        for channel in channels:
            found.setdefault(channel.name, []).append(responses.gain(channel))
            random[channel.name] = channel.sigma is not None
    return tuple(Source(
        name, np.max([gain.worst for gain in gains], axis=0),
        np.sqrt(np.max([gain.variance for gain in gains], axis=0)), random[name],
        name not in not_counted) for name, gains in found.items())
