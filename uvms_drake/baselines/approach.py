"""Approach and contact logic: the reference of every baseline, by touch."""

from dataclasses import dataclass

import numpy as np
from pydrake.systems.framework import (
    Context,
    DiagramBuilder,
    DiscreteValues,
    LeafSystem,
    OutputPort,
)

from uvms_drake.baselines.law import PERIOD
from uvms_drake.baselines.measured import PressTask
from uvms_drake.common.wiring import added, output_of
from uvms_drake.model.uvms_model import UvmsModel

RELEASE = 0.3
"""Part of the force of a touch below which the contact is lost."""
SMOOTHING = 0.05
"""Time constant of the force for that decision [s]."""


@dataclass
class ApproachGains:
    """Parameters of the approach."""

    speed: float = 0.04
    """Speed along n until the touch [m/s]."""
    across: float = 0.05
    """Largest speed across n, to a place that may jump [m/s]."""
    follow: float = 5.0
    """Time constant by which the reference's depth follows the touched tip's [s]."""
    touch: float = 1.0
    """Force along n of a touch [N]."""
    wait: float = 2.0
    """Time before the approach, for the tare of the sensor [s]."""


def moved_reference(
    gains: ApproachGains, n: np.ndarray, x: np.ndarray, tip: np.ndarray, place: np.ndarray,
    touched: bool, time: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Returns the next x_d and ẋ_d (3,): along n at `speed`, or after the tip; across to `place`.

    Args:
        gains: Its parameters.
        n: Direction (3,).
        x: Last x_d (3,) [m].
        tip: Measured position of the tip (3,) [m].
        place: Place across n (3,) [m].
        touched: Whether the tip is in contact.
        time: Instant [s].
    """
    if time < gains.wait:
        return x, np.zeros(3)
    along = n @ (tip - x) / gains.follow if touched else gains.speed
    across = place - x - n * (n @ (place - x))
    distance = float(np.linalg.norm(across))
    if distance > 0.0:
        across = across * min(gains.across, distance / PERIOD) / distance
    v = along * n + across
    return x + PERIOD * v, v


class Approach(LeafSystem):
    """State machine of approach and contact.

    .. pydrake_system::

        name: Approach
        input_ports:
        - state
        - force_measured
        - desired_force (optional)
        - place (optional)
        output_ports:
        - reference

    - `state`: (𝔮, ζ) (2(6+n)); `force_measured`: 𝔉_s (6) [N, N m].
    - `desired_force` (6): 𝔉_des [N, N m], of which the part along n is used; the task's if
      unconnected.
    - `place` (3): place across n [m]; the task's if unconnected.
    - `reference` (9): see `Reference`.

    The discrete state is x_d, ẋ_d, the smoothed force along n, whether the tip touches, and since
    when (9). The first initialisation sets x_d to the measured tip; it is NaN before.

    Args:
        model: Supplies the position of the tip.
        task: The task.
        gains: Parameters.
    """

    def __init__(self, model: UvmsModel, task: PressTask, gains: ApproachGains):
        super().__init__()
        self._model, self._task, self._gains = model, task, gains
        self._state_port = self.DeclareVectorInputPort("state", 2 * model.size)
        self._force_port = self.DeclareVectorInputPort("force_measured", 6)
        desired = self._desired_port = self.DeclareVectorInputPort("desired_force", 6)
        self._place_port = self.DeclareVectorInputPort("place", 3)
        self.DeclareDiscreteState(np.concatenate([np.full(3, np.nan), np.zeros(6)]))
        self.DeclareInitializationDiscreteUpdateEvent(self._begin)
        self.DeclarePeriodicDiscreteUpdateEvent(PERIOD, PERIOD, self._step)
        output_of(self, "reference", 9, self._reference, {self.xd_ticket(), desired.ticket()})

    def _tip(self, context: Context) -> np.ndarray:
        return self._model.task_pose(self._state_port.Eval(context)[: self._model.size])[:3]

    def _begin(self, context: Context, state: DiscreteValues) -> None:
        if np.isnan(context.get_discrete_state_vector().value()[0]):
            state.set_value(np.concatenate([self._tip(context), np.zeros(6)]))

    def _step(self, context: Context, state: DiscreteValues) -> None:
        old, n, time = context.get_discrete_state_vector().value(), self._task.direction, (
            context.get_time())
        read = float(n @ self._force_port.Eval(context)[:3])
        force = old[6] + PERIOD / SMOOTHING * (read - old[6])
        touched = force > self._gains.touch * (RELEASE if old[7] else 1.0)
        place = (self._place_port.Eval(context) if self._place_port.HasValue(context)
                 else self._task.place)
        x, v = moved_reference(
            self._gains, n, old[:3], self._tip(context), place, touched, time)
        since = time if touched != bool(old[7]) else old[8]
        state.set_value(np.concatenate([x, v, [force, float(touched), since]]))

    def _reference(self, context: Context) -> np.ndarray:
        now = context.get_discrete_state_vector().value()
        force = self._task.force
        if self._desired_port.HasValue(context):
            force = float(self._task.direction @ self._desired_port.Eval(context)[:3])
        return np.concatenate([now[:6], [force], now[7:]])

    @staticmethod
    def AddToBuilder(builder: DiagramBuilder, model: UvmsModel, task: PressTask,
                     gains: ApproachGains, *, state: OutputPort, force_measured: OutputPort,
                     name: str = "approach") -> "Approach":
        """Adds the system and connects it; the arguments are its constructor's and its inputs."""
        return added(builder, name, Approach(model, task, gains), state=state,
                     force_measured=force_measured)
