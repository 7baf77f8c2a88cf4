"""Systems behind sensors: hold of the last value over a gap, pose of a measured end-effector."""

import numpy as np
from pydrake.systems.framework import (
    Context,
    DiagramBuilder,
    DiscreteValues,
    OutputPort,
)

from uvms_drake.common.finite import is_finite
from uvms_drake.common.wiring import WiredSystem, output_of
from uvms_drake.model.signals.sensor_actuator import Signals
from uvms_drake.model.uvms_model import UvmsModel


class HoldLastValue(WiredSystem):
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
        output_of(self, "finite", size, self._finite,
                  {self.xd_ticket(), self.all_input_ports_ticket()})

    def _remember(self, context: Context, state: DiscreteValues) -> None:
        measured = self._port.Eval(context)
        if is_finite(measured):
            state.set_value(measured)

    def _finite(self, context: Context) -> np.ndarray:
        measured = self._port.Eval(context)
        if is_finite(measured):
            return measured
        if self._release_port.HasValue(context) and self._release_port.Eval(context)[0] > 0.0:
            return np.zeros_like(measured)
        return context.get_discrete_state_vector().value()


class TipPose(WiredSystem):
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
        output_of(self, "chi", 6, self._chi, {self._state_port.ticket()})

    def _chi(self, context: Context) -> np.ndarray:
        config = self._state_port.Eval(context)[: self._model.size]
        return self._model.task_pose(config)[:6] if is_finite(config) else np.full(6, np.nan)


def tip_pose(builder: DiagramBuilder, model: UvmsModel, state: OutputPort, signals: Signals
             ) -> OutputPort:
    """Returns the port of χ (6) in a measured state; that of the true one exists already."""
    if state is signals["state"]:
        return signals["chi"]
    return TipPose.AddToBuilder(builder, model, state=state).get_output_port()
