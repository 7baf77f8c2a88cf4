"""Static feed-forward of the desired force to the thrusters, and to the joints if asked."""

import numpy as np

from uvms_drake.baselines.law import PERIOD, Law
from uvms_drake.baselines.measured import Measured

RISE = 0.5
"""Time constant by which it rises after the touch [s]: thrusters lag, and a vehicle that is pushed
before the arm presses drives on the wall."""


class ForceFeedforward(Law):
    """τ_v = J_vᵀ n f_d in contact, smoothed; zero before the touch.

    Without it the vehicle's station keeping yields to the force. Without an integral or a measured
    force in the arm's law the joints yield too, and take J_qᵀ n f_d.
    """

    memory = 1

    def __init__(self, *, joints: bool = False):
        self._joints = joints

    def tau(self, now: Measured, memory: np.ndarray) -> np.ndarray:
        """See the class."""
        out: np.ndarray = now.J.T @ now.n * memory[0]
        if not self._joints:
            out[6:] = 0.0
        return out

    def updated(self, now: Measured, memory: np.ndarray, limited: bool) -> np.ndarray:
        """Returns the next force that is fed forward (1,) [N]."""
        wanted = now.reference.force if now.reference.touched else 0.0
        return memory + PERIOD / RISE * (wanted - memory)
