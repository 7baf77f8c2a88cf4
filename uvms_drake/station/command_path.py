"""Command path of a scenario's actuation, and the limits to which its commands are cut."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from uvms_drake.common.errors import within
from uvms_drake.control.limits import Limits
from uvms_drake.model.signals.command_path import IDEAL_PATH, CommandPath
from uvms_drake.model.signals.sensor_actuator import Actuator
from uvms_drake.model.uvms_model import UvmsModel
from uvms_drake.station.parts import keyed

if TYPE_CHECKING:
    from uvms_drake.station.scenario.scenario import Scenario

IMPLICIT = ("implicit_euler", "radau1", "radau3", "velocity_implicit_euler")
"""Integration schemes whose steps may be much longer than 1/k, with which the command is not cut.
Their Newton iteration asks the law far from the solution, and where a limit cuts the command it is
flat: in `paper_dynamic` it would converge in far shorter steps only."""


def command_limits(scenario: "Scenario") -> Limits | None:
    """Returns the limits to which the command is cut, `u` and, if declared, `tau`; or None.

    See `IMPLICIT`.
    """
    implicit = scenario.simulator.integration_scheme in IMPLICIT
    return None if implicit else scenario.limits


def command_path_of(actuation: Sequence[Actuator], model: UvmsModel) -> CommandPath:
    """Returns the path of a law's commands through a scenario's actuation.

    It is that of the controller's model.
    """
    path = IDEAL_PATH
    for key, part in keyed("actuation", actuation).items():
        with within(key):
            path = path.then(part.command_path(model))
    return path
