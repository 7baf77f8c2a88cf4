"""Short runs that tests share: one of each scenario in a session."""

from functools import cache

import uvms_drake as uv
from uvms_drake.station.record import Record


@cache
def simulated(scenario: str, seconds: float, *overrides: str) -> Record:
    """Returns the record of a scenario's first seconds; do not change it."""
    return uv.simulate(uv.load_scenario(scenario, [f"duration={seconds}", *overrides]))
