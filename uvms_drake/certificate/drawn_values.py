"""Values of a scenario that a certificate in probability has drawn, and their declared ranges."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from uvms_drake.actuation.thrusters import Thrusters, largest_error
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.plant.model_error import FACTORS
from uvms_drake.plant.waves import largest_speed
from uvms_drake.station.scenario.scenario import Scenario, Start

ROUNDING = 1e-9
"""Part of a range by which a value at its end may be off."""


@dataclass(frozen=True)
class DrawnRange:
    """Interval of a drawn quantity."""

    name: str
    """Name of the quantity, as of `drawn_values`."""
    low: float
    high: float
    unit: str
    """Unit; empty without one."""

    def __str__(self) -> str:
        return f"{self.name} from {self.low:.4g} to {self.high:.4g} {self.unit}".rstrip()

    def holds(self, value: float) -> bool:
        """Returns whether a value is in the interval."""
        slack = ROUNDING * max(abs(self.low), abs(self.high), 1.0)
        return self.low - slack <= value <= self.high + slack


def drawn_values(scenario: Scenario, model: ContactModel) -> dict[str, float]:
    """Returns the values of a scenario that may differ between runs, by name, in SI units."""
    error, current = scenario.model_error, np.asarray(scenario.current, dtype=float)
    out = {f"start.eta.{i}": float(value) for i, value in enumerate(scenario.start.eta)}
    out |= {f"start.q.{i}": float(value) for i, value in enumerate(scenario.start.q)}
    out |= {"duration": scenario.duration, "current, horizontal": float(np.hypot(*current[:2])),
            "current, up or down": abs(float(current[2])), "waves": largest_speed(scenario.waves)}
    out |= {f"model_error.{name}": float(getattr(error, name)) for name in FACTORS}
    out |= {"model_error.buoyancy_shift": float(np.linalg.norm(error.buoyancy_shift)),
            "model_error.payload.mass": error.payload.mass,
            "model_error.payload.displaced": error.payload.displaced,
            "model_error.joint_friction": error.joint_friction.largest,
            "thrusters.error": largest_error(scenario.actuation)}
    return out | scenario.contact.drawn_values(scenario, model)


def outside_ranges(ranges: Sequence[DrawnRange], values: Mapping[str, float]) -> list[str]:
    """Returns a phrase for each value that is outside of its declared range, or is not there."""
    out = []
    for each in ranges:
        value = values.get(each.name)
        if value is None or not each.holds(value):
            found = "not defined" if value is None else f"{value:.4g}"
            out.append(f"{each.name} is {found}, declared from {each.low:.4g} to "
                       f"{each.high:.4g} {each.unit}".rstrip())
    return out


def without_drawn(scenario: Scenario) -> Scenario:
    """Returns the scenario with defaults for its drawn values: the part that all runs share."""
    error, zero = scenario.model_error, np.zeros(1)
    return scenario.contact.without_drawn(replace(
        scenario, start=Start(), duration=1.0, seed=0, current=np.zeros(3),
        waves=[replace(wave, amplitude=0.0, direction=0.0, phase=0.0) for wave in scenario.waves],
        model_error=replace(
            error, **dict.fromkeys(FACTORS, 1.0), buoyancy_shift=np.zeros(3),
            payload=replace(error.payload, mass=0.0, displaced=0.0),
            joint_friction=replace(error.joint_friction, coulomb=zero, static=zero)),
        actuation=[replace(part, error=zero) if isinstance(part, Thrusters) else part
                   for part in scenario.actuation]))
