"""Margin of a source of error: its largest value, and the condition that limits it."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from uvms_drake.certificate.certify import TERMINAL, tightening_margins
from uvms_drake.control.limits import TubeRadii
from uvms_drake.control.ocp.ocp import Ocp
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.station.problem import limits_of, make_ocp
from uvms_drake.station.scenario.scenario import Scenario
from uvms_drake.tube.conditions import Condition
from uvms_drake.tube.law_tube import Basis
from uvms_drake.tube.laws import TUBES

FINE = 1.02
"""Largest ratio of a failing value to the reported largest one."""
FARTHEST = 64.0
"""Largest multiple of the nominal value in the search."""


@dataclass(frozen=True)
class Margin:
    """A source of error."""

    name: str
    unit: str
    today: float
    """Nominal value of the scenario."""
    largest: float
    """Largest value with a positive margin of every limit, by memoised searches; NaN if none."""
    ends: str
    """Condition that fails beyond; empty at the end of the search."""
    d: tuple[float, ...] = ()
    """Largest |dᵢ| at `asked` (6+n,) [m/s², rad/s²], of a source that acts as a disturbance."""
    asked: float = math.nan
    """Typical value of a vehicle."""
    settings: str = ""
    """Settings that the certificate of `largest` asks for, for the command line."""


def tube_of(scenario: Scenario, model: ContactModel, basis: Basis
            ) -> tuple[TubeRadii, list[Condition]]:
    """Returns the tube of a scenario, and the conditions on it and on the margin of every limit."""
    law = scenario.ancillary
    found = TUBES[type(law)].tube(law, basis)
    if not all(condition.holds for condition in found.conditions):
        return found.radii, list(found.conditions)
    found = scenario.contact.in_contact(found, scenario, basis)
    tightened = tightening_margins(found.radii, limits_of(scenario, model))
    if all(condition.holds for condition in tightened):
        tightened += inputs_at_the_task(make_ocp(replace(scenario, tube=found.radii), model))
    return found.radii, [*found.conditions, *tightened]


def inputs_at_the_task(ocp: Ocp) -> list[Condition]:
    """Returns the conditions that the inputs of the task are within the tightened limits.

    Without them there is no terminal set of any size: in a sensed contact every force has to be
    pressed at the task, too.
    """
    _, _, at_rest, _ = ocp.move(np.zeros(ocp.state_size), np.zeros(ocp.model.size))
    return [Condition(f"{part} at the task, over its tightened limit", float(used), "<", 1.0,
                      theorem=TERMINAL)
            for limit in ocp.lasting_limits.values() if limit.about == "input"
            for part, used in zip(limit.parts, limit.used(at_rest), strict=True)]


def worst_of(conditions: Sequence[Condition]) -> Condition | None:
    """Returns the most violated condition, or None."""
    return min((each for each in conditions if not each.holds), key=_slack, default=None)


def _slack(condition: Condition) -> float:
    """Returns the relative margin of a condition; negative if it fails."""
    size = max(abs(condition.left), abs(condition.right), 1e-300)
    return condition.margin / size if math.isfinite(size) else -1.0


def bracket(failing: Callable[[float], Condition | None], holds: float
            ) -> tuple[float, Condition | None]:
    """Returns the largest value without a failing condition, and the condition that fails beyond.

    Args:
        failing: Function from a value to the failing condition, or None.
        holds: A value without a failing condition.
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
