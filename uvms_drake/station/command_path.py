"""Command paths of a scenario's actuation, and the limits to which its commands are cut."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from uvms_drake.common.errors import within
from uvms_drake.control.limits import Limits
from uvms_drake.model.signals.sensor_actuator import ON_TIME, ActuationDelay, Actuator, CommandPath
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


def actuation_delay_of(actuation: Sequence[Actuator], model: UvmsModel) -> ActuationDelay:
    """Returns the preview time of the plans of a scenario's actuation, as the controller has it.

    The delay of the actuation, if it has a lag. Behind a clock alone only the knots of a plan are
    delayed, and with a preview they would come early.
    """
    paths = [path for path in command_paths(actuation, model) if path is not None]
    delays = [] if all(path.whole for path in paths) else [path.actuation_delay for path in paths]
    return ActuationDelay(*(sum(times) for times in zip(ON_TIME, *delays, strict=True)))


def command_paths(actuation: Sequence[Actuator], model: UvmsModel) -> list[CommandPath | None]:
    """Returns the command path of each part of a scenario's actuation; None if it has none."""
    paths = []
    for key, part in keyed("actuation", actuation).items():
        with within(key):
            paths.append(part.command_path(model))
    return paths
