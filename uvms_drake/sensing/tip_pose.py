"""Pose of the end-effector in a measured state."""

import numpy as np
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiagramBuilder,
    LeafSystem,
    OutputPort,
)

from uvms_drake.common.finite import is_finite
from uvms_drake.model.signals.sensor_actuator import Signals
from uvms_drake.model.uvms_model import UvmsModel


class TipPose(LeafSystem):
    """Pose χ of the end-effector in a state.

    .. pydrake_system::

        name: TipPose
        input_ports:
        - state
        output_ports:
        - chi

    - `state`: (𝔮, ζ) (2(6+n)).
    - `chi`: χ (6) [m, rad]; NaN if 𝔮 is not finite.

    It has no state.

    Args:
        model: Supplies χ(𝔮).
    """

    def __init__(self, model: UvmsModel):
        super().__init__()
        self._model = model
        self._state_port = self.DeclareVectorInputPort("state", 2 * model.size)
        self.DeclareVectorOutputPort("chi", 6, self._calc, {self._state_port.ticket()})

    def _calc(self, context: Context, output: BasicVector) -> None:
        config = self._state_port.Eval(context)[: self._model.size]
        output.SetFromVector(
            self._model.task_pose(config)[:6] if is_finite(config) else np.full(6, np.nan))


def tip_pose(builder: DiagramBuilder, model: UvmsModel, state: OutputPort, signals: Signals
             ) -> OutputPort:
    """Returns the port of χ (6) in a measured state; that of the true one exists already."""
    if state is signals["state"]:
        return signals["chi"]
    system = builder.AddNamedSystem("tip_pose", TipPose(model))
    builder.Connect(state, system.get_input_port())
    return system.get_output_port()
