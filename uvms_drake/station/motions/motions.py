"""The motions that a scenario can name."""

from typing import TYPE_CHECKING

from uvms_drake.common.errors import require
from uvms_drake.common.kinds import kinds_of, offer
from uvms_drake.control.limits import Limit, make_limits
from uvms_drake.control.ocp.ocp import Ocp
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.station.motions.dynamic import Dynamic
from uvms_drake.station.motions.motion import Motion
from uvms_drake.station.problem import load_model

if TYPE_CHECKING:
    from uvms_drake.station.scenario.scenario import Scenario

offer(Motion, Dynamic)


def motions() -> tuple[type[Motion], ...]:
    """Returns the kinds of motion, those of one's own among them."""
    return kinds_of(Motion)


def motion_named(name: str) -> Motion:
    """Returns the kind of motion of a name, `scenario.motion`; one's own is registered."""
    kinds = {kind.name: kind for kind in motions()}
    require(name in kinds, "motion", name, f"one of {', '.join(kinds)}")
    return kinds[name]()


def motion_of(scenario: "Scenario") -> Motion:
    """Returns the kind of motion that a scenario names."""
    return motion_named(scenario.motion)


def make_ocp(scenario: "Scenario", model: ContactModel | None = None) -> Ocp:
    """Returns the nominal MPC's problem.

    Args:
        scenario: Task, limits, tube and settings of the MPC.
        model: The controller's; loaded if it is left out.

    Raises:
        InvalidParameter: A value cannot be used, or the task cannot be held within the limits.
    """
    return motion_of(scenario).make_ocp(scenario, model or load_model(scenario))


def limits_of(scenario: "Scenario", model: ContactModel) -> dict[str, Limit]:
    """Returns the limits of the real robot by name; the model is the controller's."""
    return make_limits(scenario.limits, model.q_lower, model.q_upper, model.surface,
                       accelerations=motion_of(scenario).has_forces, thrusters=model.thrusters,
                       slides=model.slides, of_contact=scenario.contact.limits())
