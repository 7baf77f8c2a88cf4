"""What is certified of each step of a mission before it begins: force, time, and what voids it.

*The force.* In a hold `SensedContact.band`, with the plan at its target. In a slide it follows the
target, and how far behind is known then and not before: no number here, see
`report.mission.mission`.

*At all times* the static force is at most `contact.force`, whatever the plan is short of.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from uvms_drake.control.limits import TubeRadii
from uvms_drake.mission.steps import AnyStep, Approach, Hold, Mission, Slide
from uvms_drake.model.surface import SensedContact
from uvms_drake.tube.conditions import Condition
from uvms_drake.tube.ultimate_bounds import tip_errors


@dataclass(frozen=True)
class Leg:
    """A step of a mission."""

    kind: str
    force: float
    """Largest force that it asks for [N]."""
    band: float | None
    """b(0) of a hold [N]."""
    least: float
    """Time that it takes at least, if nothing fails [s]."""
    most: float
    """Time-out [s]."""
    void: str
    """The condition that fails, or nothing."""


def least_time(step: AnyStep) -> float:
    """Returns the time that a step takes at least if nothing fails [s]; zero where none is known.

    How long it is on its way to a place off the wall and to a wall is known to nobody.
    """
    if isinstance(step, Slide):
        return step.time
    return step.settle if isinstance(step, Approach) else step.seconds if isinstance(step, Hold) \
        else 0.0


def legs_of(mission: Mission, contact: SensedContact, tube: TubeRadii,
            conditions: Sequence[Condition]) -> list[Leg]:
    """Returns the legs of a mission.

    Args:
        mission: Checked.
        contact: What is known of the wall.
        tube: The radii.
        conditions: Those of the certificate, of which some have a step's name.
    """
    legs = []
    for i, step in enumerate(mission.steps):
        failed = next((each for each in conditions if not each.holds
                       and each.name.startswith(f"mission.steps[{i}],")), None)
        legs.append(Leg(
            type(step).__name__, step.strongest,
            contact.band(step.strongest, tip_errors(tube)) if isinstance(step, Hold) else None,
            least_time(step), step.timeout,
            "" if failed is None else str(failed)))
    return legs
