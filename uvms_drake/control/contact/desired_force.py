"""Desired force, clipped to the range along n that is accepted."""

import numpy as np
from pydrake.systems.framework import Context, DiscreteValues

from uvms_drake.common.alarm import warn
from uvms_drake.common.errors import require, unit_vector
from uvms_drake.common.wiring import WiredSystem, cached, output_of

GIVEN, CUT, ACROSS, LOST = range(4)
"""Outcomes of a desired force: accepted, clipped, without its part across n, or not finite."""
SLACK = 1e-9
"""Relative and absolute rounding of a force that gives no warning [1, N]."""


def along_of(wanted: np.ndarray, direction: np.ndarray, largest: float) -> tuple[float, int]:
    """Returns the accepted force along n [N] and the outcome.

    Args:
        wanted: 𝔉_des (6,) [N, N m].
        direction: Unit vector n (3,) in Σ_I.
        largest: Largest accepted force along n [N].
    """
    if not np.all(np.isfinite(wanted)):
        return 0.0, LOST
    along = float(direction @ wanted[:3])
    given = min(max(along, 0.0), largest)
    slack = SLACK * (1.0 + abs(along))
    if abs(given - along) > slack:
        return given, CUT
    across = wanted - np.append(along * direction, np.zeros(3))
    return given, ACROSS if np.max(np.abs(across)) > slack else GIVEN


class DesiredForce(WiredSystem):
    """Desired force along a direction, clipped to its accepted range.

    The logger `uvms_drake` warns when a desired force begins to differ from the accepted one.

    .. pydrake_system::

        name: DesiredForce
        input_ports:
        - desired_force (optional)
        output_ports:
        - accepted_force
        - along

    - `desired_force` (6): 𝔉_des [N, N m]; the default if unconnected; zero if it is not finite.
    - `accepted_force` (6): its force along n, from 0 to the largest; no other force, no torque.
    - `along` (1): the size of that force [N].

    The discrete state is the outcome at the beginning of the last step, to warn once.

    Args:
        direction: Unit vector n (3,) in Σ_I.
        default: Force along n [N].
        largest: Largest force along n that is accepted [N].
    """

    def __init__(self, direction: np.ndarray, default: float, largest: float):
        super().__init__()
        self._direction = unit_vector("direction", direction)
        require(0.0 <= default <= largest, "default", default, f"from 0 to {largest:g} N")
        self._default, self._largest = default, largest
        self._port = self.DeclareVectorInputPort("desired_force", 6)
        self.DeclareDiscreteState([float(GIVEN)])
        self.DeclarePerStepDiscreteUpdateEvent(self._tell)
        self._given = cached(self, "the accepted force", self._along, {self._port.ticket()})
        output_of(self, "accepted_force", 6, lambda c: np.append(
            self._given.Eval(c)[0] * self._direction, np.zeros(3)), {self._given.ticket()})
        output_of(self, "along", 1, lambda c: [self._given.Eval(c)[0]], {self._given.ticket()})

    def _along(self, context: Context) -> tuple[float, int]:
        if not self._port.HasValue(context):
            return self._default, GIVEN
        return along_of(self._port.Eval(context), self._direction, self._largest)

    def _tell(self, context: Context, state: DiscreteValues) -> None:
        given, became = self._given.Eval(context)
        if became not in (GIVEN, int(context.get_discrete_state_vector()[0])):
            warn(context.get_time(), {
                LOST: "the desired force is not finite: none is given",
                ACROSS: "of the desired force only the part along the direction is given, "
                        f"{given:.4g} N",
                CUT: f"the desired force is cut to {given:.4g} N, along the direction from 0 to "
                     f"{self._largest:.4g} N can be given"}[became])
        state.set_value([float(became)])
