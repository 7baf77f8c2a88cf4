"""Mission as a system: references for a controller with a sensed contact."""

from collections.abc import Callable

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import Context
from pydrake.systems.framework import State as ContextState

from uvms_drake.common.errors import require, vector
from uvms_drake.common.wiring import WiredSystem, output_of
from uvms_drake.mission.law import Due, Measured, State, advance, begin, due_at
from uvms_drake.mission.steps import Mission
from uvms_drake.model.signals.sensor_actuator import CAUSES, SAFETY
from uvms_drake.model.surface.surface_class import SurfaceClass
from uvms_drake.model.uvms_model import UvmsModel

PROGRESS = ("step", "outcome", "reason", "failures", "tries")
"""Entries of the port `progress`: fields of `law.State`."""
STIFFER = [list(CAUSES).index(name) + 1 for name in ("force", "slope")]
"""Causes of a retreat after which a spot is not tried again, as in the port `safety`."""


class MissionControl(WiredSystem):
    """State machine of a mission, updated every `period`: references of force and place.

    .. pydrake_system::

        name: MissionControl
        input_ports:
        - state
        - force_last_valid
        - touched
        - force_lost
        - stop (optional)
        - safety (optional)
        output_ports:
        - desired_force
        - place
        - deepest
        - resume
        - due_place
        - due_force
        - progress

    - `state`: (𝔮, ζ) (2(6+n)) measured, for the tip; missing if it is not finite.
    - `force_last_valid`: 𝔉_s (6) [N, N m], of a `HoldLastValue`.
    - `touched`, `force_lost` (1): those of a `ContactEstimator`.
    - `stop` (1): above zero, the mission goes home.
    - `safety` (5): of a `Supervisor`; its retreat ends the step, or the mission, by `on_retreat`.
    - `desired_force` (6): 𝔉_des along n [N].
    - `place` (3): place across n at which to press, in Σ_I [m]; it moves along a line in a slide.
    - `deepest` (1): largest target depth along n [m]; inf: any.
    - `resume` (1): 1 if the mission goes on after a retreat of the supervisor, else 0.
    - `due_place` (3), `due_force` (1): references of now; the ports above lead them by
      `Mission.lead`.
    - `progress` (5): `PROGRESS`.

    The abstract state is `law.State`. Before the first update it is that of the measured state, so
    that a plan can be made at initialization.

    Args:
        mission: The steps, one at least.
        model: The controller's model, for the tip.
        surface: The class of walls, for its axes.
        origin: Place of (0, 0), in Σ_I (3,) [m].
        period: Time between two updates [s].
    """

    def __init__(self, mission: Mission, model: UvmsModel, surface: SurfaceClass,
                 origin: np.ndarray, *, period: float = 0.05):
        super().__init__()
        require(0.0 < period < np.inf, "period", period, "positive")
        require(len(mission.steps) > 0, "steps", mission.steps, "not empty")
        self._mission, self._model, self._axes = mission.checked(), model, surface.axes
        self._origin = vector("origin", origin, 3)
        self._state_port = self.DeclareVectorInputPort("state", 2 * model.size)
        self._force_port = self.DeclareVectorInputPort("force_last_valid", 6)
        self._touched_port = self.DeclareVectorInputPort("touched", 1)
        self._lost_port = self.DeclareVectorInputPort("force_lost", 1)
        self._stop_port = self.DeclareVectorInputPort("stop", 1)
        self._safety_port = self.DeclareVectorInputPort("safety", len(SAFETY))
        self._memory = self.DeclareAbstractState(Value(object()))
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._update)
        # Forces act at the next update, so there is no algebraic loop through the controller.
        known = {self.all_state_ticket(), self.time_ticket(), self._state_port.ticket()}
        n, across = self._axes[0], self._axes[1:]
        lead = self._mission.lead
        for name, size, preview, calc in (
            ("desired_force", 6, lead, lambda due: np.append(due.force * n, np.zeros(3))),
            ("place", 3, lead, lambda due: self._origin + due.place @ across),
            ("deepest", 1, lead, lambda due: [due.deepest]),
            ("due_place", 3, 0.0, lambda due: self._origin + due.place @ across),
            ("due_force", 1, 0.0, lambda due: [due.force]),
        ):
            output_of(self, name, size, self._of_due(calc, preview), known)
        output_of(self, "resume", 1, lambda c: [float(self._now(c).waits)], known)
        output_of(self, "progress", len(PROGRESS), lambda c: [
            float(getattr(self._now(c), name)) for name in PROGRESS], known)

    def _tip(self, context: Context) -> np.ndarray:
        """Returns depth and place of the tip (3,) [m]; NaN if the state is not finite."""
        state = self._state_port.Eval(context)
        if not np.all(np.isfinite(state)):
            return np.full(3, np.nan)
        tip = self._model.task_pose(state[: self._model.size])[:3]
        return np.append(self._axes[0] @ tip, self._axes[1:] @ (tip - self._origin))

    def _now(self, context: Context) -> State:
        remembered = context.get_abstract_state(int(self._memory)).get_value()
        if isinstance(remembered, State):
            return remembered
        return begin(self._mission, self._tip(context), context.get_time())

    def _update(self, context: Context, state: ContextState) -> None:
        force, stop = self._force_port.Eval(context), self._stop_port
        safety = self._safety_port.Eval(context) if self._safety_port.HasValue(context) else (0, 0)
        measured = Measured(
            self._tip(context), float(self._axes[0] @ force[:3]),
            touched=bool(self._touched_port.Eval(context)[0] > 0.0),
            lost=bool(self._lost_port.Eval(context)[0] > 0.0),
            stop=bool(stop.HasValue(context) and stop.Eval(context)[0] > 0.0),
            retreated=bool(safety[0] > 0.0), stiffer=safety[1] in STIFFER)
        after, _ = advance(self._mission, self._now(context), measured, context.get_time())
        state.get_mutable_abstract_state(int(self._memory)).set_value(after)

    def _of_due(self, of: Callable[[Due], np.ndarray | list[float]], preview: float
                    ) -> Callable[[Context], np.ndarray | list[float]]:
        return lambda context: of(
            due_at(self._mission, self._now(context), context.get_time() + preview))
