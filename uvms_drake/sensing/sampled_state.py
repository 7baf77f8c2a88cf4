"""A state that is measured at a clock's ticks only."""

from dataclasses import dataclass

import numpy as np
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiagramBuilder,
    DiscreteValues,
    LeafSystem,
    OutputPort,
)

from uvms_drake.common.errors import require
from uvms_drake.model.part import Part, Signals
from uvms_drake.model.uvms_model import UvmsModel


@dataclass
class SampledState(Part):
    """The state is measured every `period`; the controller has the last sample in between.

    The sample is logged as `measured_state`.
    """

    period: float = 0.01
    """Time between two samples [s]."""

    def check(self) -> None:
        """Raises `InvalidParameter` for the first value that has no meaning."""
        require(0.0 < self.period < np.inf, "period", self.period, "positive")

    def assumption(self) -> str:
        """Returns the assumption that it breaks."""
        return "the proofs take the state for measured at all times"

    def add_to(self, builder: DiagramBuilder, model: UvmsModel, port: OutputPort,
               signals: Signals, seed: int) -> OutputPort:
        """Adds a `Sampler`; see `Part`."""
        sampler = builder.AddNamedSystem("sampler", Sampler(self.period, port.size()))
        builder.Connect(port, sampler.get_input_port())
        signals["measured_state"] = sampler.get_output_port()
        return sampler.get_output_port()


class Sampler(LeafSystem):
    """Passes on the last sample of a vector; before the first one, the vector itself.

    Drake's ZeroOrderHold is zero until its first event, and the first plan is made before that.

    .. pydrake_system::

        name: Sampler
        input_ports:
        - true
        output_ports:
        - measured

    - `true`, `measured` (size).

    The discrete state is whether there is a sample yet (1), and the sample (size).

    Args:
        period: Time between two samples [s].
        size: Size of the vector.
    """

    def __init__(self, period: float, size: int):
        super().__init__()
        self._port = self.DeclareVectorInputPort("true", size)
        self.DeclareDiscreteState(1 + size)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._sample)
        self.DeclareVectorOutputPort("measured", size, self._calc)

    def _sample(self, context: Context, state: DiscreteValues) -> None:
        state.set_value(np.append(1.0, self._port.Eval(context)))

    def _calc(self, context: Context, output: BasicVector) -> None:
        sampled, *sample = context.get_discrete_state_vector().value()
        output.SetFromVector(sample if sampled else self._port.Eval(context))
