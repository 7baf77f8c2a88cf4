"""What a study of margins is made of: a source of error, how far it may go, and what ends it."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from uvms_drake.certificate.certify import tightening_margins
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.station.motions.motions import motion_of
from uvms_drake.station.scenario.scenario import Scenario
from uvms_drake.tube.conditions import Condition
from uvms_drake.tube.law_tube import Basis

FINE = 1.02
"""Ratio of a value that fails to the one that is called the largest, at most."""
FARTHEST = 64.0
"""Multiple of today's value beyond which nobody looks."""


@dataclass(frozen=True)
class Margin:
    """A source of error."""

    name: str
    unit: str
    today: float
    """In the scenario."""
    largest: float
    """With which limits still have room by searches that are held; NaN if with none."""
    ends: str
    """The condition that fails beyond; empty where nobody looked farther."""
    d: tuple[float, ...] = ()
    """Of what counts as a disturbance: the largest |dᵢ| at `asked` (6+n,) [m/s², rad/s²]."""
    asked: float = math.nan
    """What a vehicle may well need."""
    axes: tuple[float, ...] = ()
    """Semi-axes of the ellipsoid that all d at `largest` is in (6+n,): bound times weights."""


def tube_conditions(scenario: Scenario, model: ContactModel, basis: Basis) -> list[Condition]:
    """Returns the conditions on the tube of a scenario, and that every limit leaves room for it."""
    motion, law = motion_of(scenario), scenario.ancillary
    found = motion.tubes[type(law)](law, basis)
    if all(condition.holds for condition in found.conditions):
        found = motion.in_contact(found, scenario, basis)
        return [*found.conditions, *tightening_margins(scenario, found.radii, model)]
    return list(found.conditions)


def worst_of(conditions: Sequence[Condition]) -> Condition | None:
    """Returns the condition that fails by the most, if any does."""
    return min((each for each in conditions if not each.holds), key=_slack, default=None)


def _slack(condition: Condition) -> float:
    """Returns by how much of its size a condition holds; negative if it does not."""
    size = max(abs(condition.left), abs(condition.right), 1e-300)
    return condition.margin / size if math.isfinite(size) else -1.0


def bracket(failing: Callable[[float], Condition | None], holds: float
            ) -> tuple[float, Condition | None]:
    """Returns the largest value with which nothing fails, and what does beyond.

    Args:
        failing: Returns what fails with a value.
        holds: A value with which nothing does.
    """
    fails, last, failed = math.inf, FARTHEST * holds, None
    while holds < last and fails > FINE * holds:
        tried = min(2.0 * holds, last) if math.isinf(fails) else math.sqrt(holds * fails)
        found = failing(tried)
        if found is None:
            holds = tried
        else:
            fails, failed = tried, found
    return holds, failed
