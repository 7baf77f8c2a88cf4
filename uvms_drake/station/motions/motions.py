"""The motions that a scenario can name."""

from uvms_drake.common.errors import require
from uvms_drake.control.limits import Limit, make_limits
from uvms_drake.control.ocp.ocp import Ocp
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.station.motions.dynamic import Dynamic
from uvms_drake.station.motions.kinematic import Kinematic
from uvms_drake.station.motions.motion import Motion
from uvms_drake.station.motions.sensed_contact import SensedContactMotion
from uvms_drake.station.problem import load_model
from uvms_drake.station.scenario.scenario import Scenario

MOTIONS: dict[str, Motion] = {"dynamic": Dynamic(), "kinematic": Kinematic()}
SENSED_CONTACT = SensedContactMotion()
"""Dynamic motion with a sensed contact."""


def motion_of(scenario: Scenario) -> Motion:
    """Returns the kind of motion that a scenario names."""
    require(scenario.motion in MOTIONS, "motion", scenario.motion, f"one of {', '.join(MOTIONS)}")
    return SENSED_CONTACT if scenario.contact.is_sensed else MOTIONS[scenario.motion]


def make_ocp(scenario: Scenario, model: ContactModel | None = None) -> Ocp:
    """Returns the nominal MPC's problem.

    Args:
        scenario: Task, limits, tube and settings of the MPC.
        model: The controller's; loaded if it is left out.

    Raises:
        InvalidParameter: A value cannot be used, or the task cannot be held within the limits.
    """
    return motion_of(scenario).make_ocp(scenario, model or load_model(scenario))


def limits_of(scenario: Scenario, model: ContactModel) -> dict[str, Limit]:
    """Returns the limits of the real robot by name; the model is the controller's."""
    return make_limits(scenario.limits, model.q_lower, model.q_upper, model.surface,
                       accelerations=motion_of(scenario).has_forces, thrusters=model.thrusters,
                       slides=model.slides)
