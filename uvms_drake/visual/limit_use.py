"""Used fraction of each limit, and the active limits."""

import numpy as np

from uvms_drake.control.limits import Limit
from uvms_drake.control.plan.points import Points
from uvms_drake.model.uvms_model import UvmsModel

ACTIVE = 0.98
"""Fraction of a limit from which on it counts as active."""


class LimitUse:
    """Fraction of each limit that a motion uses, from 0 to 1.

    It is the larger of two fractions: the real motion's of the limits, and the nominal motion's of
    the limits tightened by the tube. So a limit that is active in the plan counts as active, even
    though the real robot keeps a distance from it.

    Args:
        model: The controller's model.
        limits: Limits of the real robot, by name.
        nominal: The same, tightened by the tube.
    """

    def __init__(self, model: UvmsModel, limits: dict[str, Limit], nominal: dict[str, Limit]):
        self._model, self._limits, self._nominal = model, limits, nominal
        self.names = [bar for limit in limits.values() for bar in limit.bars]

    def __call__(self, state: np.ndarray, u: np.ndarray, nominal_state: np.ndarray,
                 nominal_input: np.ndarray) -> np.ndarray:
        """Returns the parts (L,) in the order of `names`.

        Args:
            state: (𝔮, ζ) (2(6+n),).
            u: 𝔲 (6+n,); not read if the motion is kinematic.
            nominal_state: (𝔮̄, ζ̄) (2(6+n),).
            nominal_input: ū (6+n,); not read if the motion is kinematic.
        """
        return np.maximum(self._lengths(self._limits, state, u),
                          self._lengths(self._nominal, nominal_state, nominal_input))

    def _lengths(self, limits: dict[str, Limit], state: np.ndarray, u: np.ndarray) -> np.ndarray:
        config, zeta = np.split(state, 2)
        at = Points(self._model, config, self._model.task_pose(config), zeta, u)
        return np.concatenate([limit.bar_lengths(at) for limit in limits.values()])
