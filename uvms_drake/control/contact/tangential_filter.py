"""Low-pass filter of the tangential force: the law cancels it slowly, the normal force at once.

A law that cancels friction τ late makes the tip heavier by cτ, c the slope of friction below its
creep speed, which on a light vehicle is an oscillation that does not decay. So the law follows the
force across n with a time constant T,

    T 𝔣˙ = P_t 𝔉 − 𝔣,    𝔉_law = n n·𝔉 + 𝔣,                                                  (S)

which cancels steady friction and leaves its fast part to damp. 𝔣 is limited to `LARGEST_RATIO`
times the force along n: a wall that is left takes its friction with it at once. No proof covers
(S): the omitted part is not in the declared error of a reading. Derivation:
control/contact/theory.md#tangential-filter.
"""

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues

from uvms_drake.common.errors import require, unit_vector
from uvms_drake.common.finite import is_finite
from uvms_drake.common.wiring import WiredSystem

LARGEST_RATIO = 1.5
"""Largest ratio of 𝔣 to the force along n, for friction and the tilt of the wall; more is a
remainder of a wall that was left, or of a lost force."""


def followed(slow: np.ndarray, force: np.ndarray, direction: np.ndarray, ratio: float
             ) -> np.ndarray:
    """Returns 𝔣 (3,) a period later [N], exact for a constant force.

    Args:
        slow: 𝔣 now (3,) [N].
        force: 𝔉 now (3,) [N].
        direction: n (3,).
        ratio: The period over T.
    """
    across = force - (direction @ force) * direction
    return across + np.exp(-ratio) * (slow - across)


class TangentialFilter(WiredSystem):
    """First-order lag of the part of a force across n; the part along n passes.

    .. pydrake_system::

        name: TangentialFilter
        input_ports:
        - measured
        output_ports:
        - force

    - `measured`: 𝔉 in Σ_I (6) [N, N m]; 𝔣 stays as it is while that is not finite.
    - `force`: 𝔉_law of (S), with 𝔣 limited to `LARGEST_RATIO`, and the measured torque (6) [N, N
      m].

    The discrete state is 𝔣 (3), updated once in a period; zero at the start.

    Args:
        direction: Unit vector n (3,).
        lag: T [s].
        period: Time between two readings [s].
    """

    def __init__(self, direction: np.ndarray, lag: float, period: float):
        super().__init__()
        for key, value in (("lag", lag), ("period", period)):
            require(0.0 < value < np.inf, key, value, "positive")
        self._direction, self._ratio = unit_vector("direction", direction), period / lag
        self._port = self.DeclareVectorInputPort("measured", 6)
        self.DeclareDiscreteState(np.zeros(3))
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)
        self.DeclareVectorOutputPort(
            "force", 6, self._calc, {self.xd_ticket(), self.all_input_ports_ticket()})

    def _update(self, context: Context, state: DiscreteValues) -> None:
        force = self._port.Eval(context)[:3]
        if is_finite(force):
            state.set_value(followed(context.get_discrete_state_vector().value(), force,
                                     self._direction, self._ratio))

    def _calc(self, context: Context, output: BasicVector) -> None:
        force = self._port.Eval(context).copy()
        along, slow = self._direction @ force[:3], context.get_discrete_state_vector().value()
        size, most = np.linalg.norm(slow), LARGEST_RATIO * np.maximum(along, 0.0)
        force[:3] = along * self._direction + (slow if size <= most else slow * (most / size))
        output.SetFromVector(force)
