"""A controller that sends its command at a clock's ticks only."""

from dataclasses import dataclass

import numpy as np
from pydrake.systems import primitives
from pydrake.systems.framework import DiagramBuilder, OutputPort

from uvms_drake.common.errors import require
from uvms_drake.model.part import Part, Signals
from uvms_drake.model.uvms_model import UvmsModel


@dataclass
class ZeroOrderHold(Part):
    """The command is sampled every `period` and held in between, as a digital controller does.

    The command that arrives at the robot is logged as `held_command`.
    """

    period: float = 0.01
    """Time between two samples [s]."""

    def check(self) -> None:
        """Raises `InvalidParameter` for the first value that has no meaning."""
        require(0.0 < self.period < np.inf, "period", self.period, "positive")

    def assumption(self) -> str:
        """Returns the assumption that it breaks."""
        return "the proofs take the feedback for continuous"

    def add_to(self, builder: DiagramBuilder, model: UvmsModel, port: OutputPort,
               signals: Signals, seed: int) -> OutputPort:
        """Adds Drake's ZeroOrderHold; see `Part`."""
        hold = builder.AddNamedSystem(
            "zero_order_hold", primitives.ZeroOrderHold(self.period, port.size()))
        builder.Connect(port, hold.get_input_port())
        signals["held_command"] = hold.get_output_port()
        return hold.get_output_port()
