"""Parameters of a sensed contact that enter the tube, each with the scenarios that differ in it.

A worse sensor comes with the allowance that the safe region needs for it (`contact.force_error`,
`contact.delay`).
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from uvms_drake.sensing.force_sensor import ForceSensor
from uvms_drake.station.contact.bounds import largest_reading_error, sensed_contact

if TYPE_CHECKING:
    from uvms_drake.station.scenario.scenario import Scenario

LAGS = 5.0
"""Number of lags of a sensor after which older values are neglected."""


@dataclass(frozen=True)
class Parameter:
    """Parameter of a scenario that enters the tube."""

    name: str
    unit: str
    today: float
    """Value in the scenario."""
    at: "Callable[[float], Scenario]"
    """Function from another value to the scenario with it."""
    start: float = 1e-3
    """First trial value, if that of the scenario is zero."""
    tried: Callable[[float], float] = float
    """Function from a requested value to the admissible one."""


def contact_parameters(scenario: "Scenario") -> Iterator[Parameter]:
    """Yields the parameters of force sensor and wall, and the desired force without a mission."""
    contact = sensed_contact(scenario)
    for i, sensor in enumerate(scenario.sensing):
        if isinstance(sensor, ForceSensor):
            yield from _of_sensor(scenario, i, sensor)

    def of_wall(key: str, value: float) -> "Scenario":
        changed: Any = {key: value}
        return allowing(replace(scenario, contact=replace(contact, **changed)), scenario)

    for name, unit, key, start in (("wall and tool, stiffness", "N/m", "stiffness", 1e-3),
                                   ("wall, angle of its normal", "rad", "angle", 1e-3),
                                   ("wall, friction", "-", "friction", 0.01)):
        yield Parameter(name, unit, getattr(contact, key), partial(of_wall, key), start)
    force = np.asarray(scenario.task.force, dtype=float)
    size = float(np.linalg.norm(force))
    if size > 0.0 and not scenario.mission.steps:  # Its steps have forces of their own.
        yield Parameter("desired force", "N", size, lambda value: replace(
            scenario, task=replace(scenario.task, force=force * value / size)))


def _of_sensor(scenario: "Scenario", i: int, sensor: ForceSensor) -> Iterator[Parameter]:
    """Yields the parameters of the force sensor `sensing[i]`."""
    noise = np.asarray(sensor.noise, dtype=float)
    shape = noise if np.max(noise[:3]) > 0.0 else ForceSensor().noise

    def with_sensor(**changed: Any) -> "Scenario":
        parts = [*scenario.sensing]
        parts[i] = replace(sensor, **changed)
        return allowing(replace(scenario, sensing=parts), scenario)

    yield Parameter("force sensor, noise (σ)", "N", float(np.max(noise[:3])),
                    lambda value: with_sensor(noise=shape * value / np.max(shape[:3])))
    yield Parameter("force sensor, lag", "s", sensor.lag, lambda value: with_sensor(lag=value))
    yield Parameter("force sensor, period", "s", 1.0 / sensor.rate,
                    lambda value: with_sensor(rate=1.0 / value))


def allowing(scenario: "Scenario", base: "Scenario") -> "Scenario":
    """Returns the scenario with at least the allowance that the safe region needs for its sensor.

    The contact then declares the delay and the error of the measurement, and for the unevenness of
    the tip's motion as much as `base` does.
    """
    contact = sensed_contact(scenario)
    bounds, known = (each.contact.force_bounds(each) for each in (scenario, base))
    assert bounds is not None and known is not None  # The contact is sensed.
    later = replace(scenario, contact=replace(
        contact, delay=max(contact.delay, LAGS * bounds.lag + bounds.period)))
    more = largest_reading_error(later, bounds, 0.0) - largest_reading_error(base, known, 0.0)
    return replace(later, contact=replace(
        sensed_contact(later), force_error=contact.force_error + max(more, 0.0)))
