"""What is done without a measurement: the last one goes on."""

import numpy as np
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiagramBuilder,
    DiscreteValues,
    LeafSystem,
    OutputPort,
)

from uvms_drake.common.wiring import added


class HoldLastValue(LeafSystem):
    """Passes a vector on while it is finite, and else the last one that was.

    A gap of a sensor is so a longer hold, whose error is what the vector changes by meanwhile. Its
    age has no bound: nothing for an `ContactEstimator`, which has to know how old a force may be.

    .. pydrake_system::

        name: HoldLastValue
        input_ports:
        - measured
        - release (optional)
        output_ports:
        - finite

    - `measured`, `finite` (size).
    - `release` (1): in a gap, zeros take the place of the last vector while it is above zero.

    The discrete state is the vector at the beginning of the last step of the simulation at which it
    was finite (size); NaN before there is one. Of a vector that is sampled and held, as that of a
    `ForceSensor` in its own axes is, that is the last sample, however long the steps; of one that
    moves in between, it is older than the gap by up to a step.

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
        if np.isfinite(measured).all():
            state.set_value(measured)

    def _calc(self, context: Context, output: BasicVector) -> None:
        measured = self._port.Eval(context)
        if np.isfinite(measured).all():
            output.SetFromVector(measured)
        elif self._release_port.HasValue(context) and self._release_port.Eval(context)[0] > 0.0:
            output.SetFromVector(np.zeros_like(measured))
        else:
            output.SetFromVector(context.get_discrete_state_vector().value())

    @staticmethod
    def AddToBuilder(builder: DiagramBuilder, *, measured: OutputPort,
                     release: OutputPort | None = None, name: str = "hold_last_value") -> "HoldLastValue":
        """Adds the system behind the vector that `measured` gives; `release` may be None."""
        return added(builder, name, HoldLastValue(measured.size()), measured=measured, release=release)
