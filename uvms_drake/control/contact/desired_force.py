"""The force that is asked for, as far as it can be given."""

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder, LeafSystem, OutputPort

from uvms_drake.common.errors import require, vector
from uvms_drake.common.wiring import added


class DesiredForce(LeafSystem):
    """Puts out the desired force along a direction, cut to what may be asked for.

    .. pydrake_system::

        name: DesiredForce
        input_ports:
        - desired_force (optional)
        output_ports:
        - accepted_force
        - along

    - `desired_force` (6): 𝔉_des [N, N m]; where it is not connected, or not finite, the default.
    - `accepted_force` (6): its force along n, from 0 to the largest; no other force, no torque.
    - `along` (1): the size of that force [N].

    It has no state.

    Args:
        direction: Unit vector n (3,) in Σ_I.
        default: Force along n [N].
        largest: Largest force along n that is accepted [N].
    """

    def __init__(self, direction: np.ndarray, default: float, largest: float):
        super().__init__()
        self._direction = vector("direction", direction, 3)
        require(0.0 <= default <= largest, "default", default, f"from 0 to {largest:g} N")
        self._default, self._largest = default, largest
        self._port = self.DeclareVectorInputPort("desired_force", 6)
        asked = {self._port.ticket()}
        self.DeclareVectorOutputPort("accepted_force", 6, self._calc_force, asked)
        self.DeclareVectorOutputPort("along", 1, self._calc_along, asked)

    def _along(self, context: Context) -> float:
        if not self._port.HasValue(context):
            return self._default
        wanted = self._port.Eval(context)
        if not np.all(np.isfinite(wanted)):
            return self._default
        return float(np.clip(self._direction @ wanted[:3], 0.0, self._largest))

    def _calc_force(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(np.append(self._along(context) * self._direction, np.zeros(3)))

    def _calc_along(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector([self._along(context)])

    @staticmethod
    def AddToBuilder(builder: DiagramBuilder, direction: np.ndarray, default: float,
                     largest: float, *, desired_force: OutputPort | None = None,
                     name: str = "desired_force") -> "DesiredForce":
        """Adds the system; `desired_force` is left to the caller if None."""
        return added(builder, name, DesiredForce(direction, default, largest),
                     desired_force=desired_force)
