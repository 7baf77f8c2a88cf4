"""The range over which the postures of a robot are looked at."""

import numpy as np

from uvms_drake.model.uvms_model import UvmsModel

HALF_TURN = np.pi
"""Range of a joint without limits, either way of zero [rad, m]."""


def joint_range(model: UvmsModel) -> tuple[np.ndarray, np.ndarray]:
    """Returns the smallest and largest joint coordinates (n,) to look at [rad, m].

    They are the joints' own limits, beyond ±π too. A joint without any is looked at for half a turn
    either way of zero, one with a single limit for a turn from there.
    """
    lower, upper = model.q_lower, model.q_upper
    below, above = np.isfinite(lower), np.isfinite(upper)
    return (np.where(below, lower, np.where(above, upper - 2.0 * HALF_TURN, -HALF_TURN)),
            np.where(above, upper, np.where(below, lower + 2.0 * HALF_TURN, HALF_TURN)))
