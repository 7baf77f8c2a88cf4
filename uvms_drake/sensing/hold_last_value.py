"""Zero-order hold of the last finite measurement over a gap."""

import numpy as np
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiagramBuilder,
    DiscreteValues,
    LeafSystem,
    OutputPort,
)

from uvms_drake.common.finite import is_finite
from uvms_drake.common.wiring import added


class HoldLastValue(LeafSystem):
    """Zero-order hold: a vector while it is finite, and else its last finite value.

    A gap of a sensor is a longer hold, whose error is the change of the vector meanwhile. The age
    of the value has no bound, so it is not for a `ContactEstimator`, which needs one.

    .. pydrake_system::

        name: HoldLastValue
        input_ports:
        - measured
        - release (optional)
        output_ports:
        - finite

    - `measured`, `finite` (size).
    - `release` (1): while it is above zero, zeros replace the last vector in a gap.

    The discrete state is the vector at the beginning of the last step of the simulation at which it
    was finite (size); NaN before the first one. For a sampled and held vector, as of a
    `ForceSensor`, that is the last sample, however long the steps; for a continuous one it is older
    than the gap by up to a step.

    Args:
        size: Size of the vector.
    """

    def __init__(self, size: int):
        super().__init__()
        self._port = self.DeclareVectorInputPort("measured", size)
        self._release_port = self.DeclareVectorInputPort("release", 1)
        self.DeclareDiscreteState(np.full(size, np.nan))
        self.DeclarePerStepDiscreteUpdateEvent(self._remember)
        self.DeclareVectorOutputPort(
            "finite", size, self._calc, {self.xd_ticket(), self.all_input_ports_ticket()})

    def _remember(self, context: Context, state: DiscreteValues) -> None:
        measured = self._port.Eval(context)
        if is_finite(measured):
            state.set_value(measured)

    def _calc(self, context: Context, output: BasicVector) -> None:
        measured = self._port.Eval(context)
        if is_finite(measured):
            output.SetFromVector(measured)
        elif self._release_port.HasValue(context) and self._release_port.Eval(context)[0] > 0.0:
            output.SetFromVector(np.zeros_like(measured))
        else:
            output.SetFromVector(context.get_discrete_state_vector().value())

    @staticmethod
    def AddToBuilder(builder: DiagramBuilder, *, measured: OutputPort,
                     release: OutputPort | None = None, name: str = "hold_last_value"
                     ) -> "HoldLastValue":
        """Adds the system and connects it; `release` may be None."""
        return added(builder, name, HoldLastValue(measured.size()), measured=measured,
                     release=release)
