"""Certified bounds of each step of a mission: force, time, and the condition that fails.

In a hold the force error is bounded by `UnknownContact.band`, with the plan at its target, and by
`hold_band` once that has stood. In a slide the bound depends on the lag behind the target, which is
known only in the run, see `report.mission`. The static force is at most `contact.force`.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from uvms_drake.control.limits import TubeRadii
from uvms_drake.mission.steps import Mission
from uvms_drake.model.surface.unknown_contact import UnknownContact
from uvms_drake.tube.conditions import Condition
from uvms_drake.tube.ultimate_bounds import hold_band, tip_errors


@dataclass(frozen=True)
class Leg:
    """Bounds of a step of a mission."""

    kind: str
    force: float
    """Largest desired force [N]."""
    band: float | None
    """Bound b(0) of the force error of a hold [N]."""
    least: float
    """Shortest duration without a failure [s]; zero if unknown."""
    most: float
    """Time-out [s]."""
    unmet: str
    """Condition that fails; empty if none."""
    hold_band: float | None = None
    """Bound b(0) of a hold in which the plan has stood, see `HoldRadii` [N]."""


def legs_of(mission: Mission, contact: UnknownContact, tube: TubeRadii,
            conditions: Sequence[Condition]) -> list[Leg]:
    """Returns the legs of a mission.

    Args:
        mission: Checked mission.
        contact: Specification of the contact.
        tube: Radii of the tube.
        conditions: Conditions of the certificate, some about a step.
    """
    legs = []
    for i, step in enumerate(mission.steps):
        failed = next((each for each in conditions if not each.holds
                       and each.about == f"mission.steps[{i}]"), None)
        is_hold = step.touches and not np.any(step.fastest)
        legs.append(Leg(
            type(step).__name__, step.strongest,
            contact.band(step.strongest, tip_errors(tube)) if is_hold else None,
            step.least_time, step.timeout,
            "" if failed is None else str(failed),
            None if tube.hold is None or not is_hold
            else hold_band(contact, step.strongest, tube.hold)))
    return legs
