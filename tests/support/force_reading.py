"""Force readings of which a test needs the sizes only."""

import numpy as np

from uvms_drake.model.signals.sensor_actuator import ForceReading


def reading_off(force: float, torque: float, lag: float, period: float) -> ForceReading:
    """Returns a reading with an error of a size in force [N] and one in torque [N m]."""
    return ForceReading(np.array([force, 0.0, 0.0, torque, 0.0, 0.0]), lag, period)
