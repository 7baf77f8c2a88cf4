"""Use of the thrusters in a run."""

import numpy as np

from uvms_drake.model.propulsion.thrusters import ThrusterModel
from uvms_drake.report.signals import thruster_part, thrusters_of
from uvms_drake.station.record import Record


def at_limit(thrusters: ThrusterModel, command: np.ndarray) -> np.ndarray:
    """Returns whether commands (T, m) are at the lower or upper limit (T, m)."""
    ends = np.array([curve.command[[0, -1]] for curve in thrusters.curves])
    return (command <= ends[:, 0]) | (command >= ends[:, 1])


def summarise_thrusters(record: Record) -> dict[str, object]:
    """Returns by name the forces [N], the limits, and the share of the time at a limit.

    The limits are those of the controller's model. Empty if the wrench is ideal.
    """
    if thruster_part(record.scenario) is None:
        return {}
    thrusters, force = thrusters_of(record), record.signals["thruster_force"]
    bound = at_limit(thrusters, record.signals["thruster_command"])
    return {name: {
        "lower": thrusters.lower[i], "upper": thrusters.upper[i], "least": np.min(force[:, i]),
        "largest": np.max(force[:, i]), "rms": np.sqrt(np.mean(force[:, i] ** 2)),
        "at_limit": np.mean(bound[:, i])} for i, name in enumerate(thrusters.names)}
