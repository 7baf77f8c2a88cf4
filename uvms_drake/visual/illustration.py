"""Draws a run while it happens."""

from typing import cast

import numpy as np
from pydrake.common.value import Value
from pydrake.geometry import Meshcat
from pydrake.systems.framework import (
    Context,
    DiagramBuilder,
    EventStatus,
    LeafSystem,
    OutputPort,
)

from uvms_drake.common.wiring import added
from uvms_drake.visual.objects.contact_knowledge import KNOWN, contact_knowledge_from
from uvms_drake.visual.scene import Moment, Scene, Setting


class Illustration(LeafSystem):
    """Sink that draws its input signals in Meshcat; see `Scene`.

    .. pydrake_system::

        name: Illustration
        input_ports:
        - state
        - nominal_state
        - u
        - nominal_input
        - plan
        - force (optional)
        - desired_force (optional)
        - force_last_valid, safe_depth, contact_depth, stiffness_estimate (optional)

    - `state`, `nominal_state` (2(6+n)), `u`, `nominal_input` (6+n): as from a station.
    - `plan`: the current `Plan` (abstract).
    - `force` (6) [N, N m]: 𝔉; unconnected means the force of the surface's law at the pose at rest.
    - `desired_force` (6) [N, N m]: 𝔉_des; unconnected means the task's.
    - `force_last_valid` (6), `safe_depth`, `contact_depth`, `stiffness_estimate` (1): the estimate
      of an unknown surface, see `ContactKnowledge`; empty unless all of them are connected.

    A picture is drawn after the first step of the simulation in each period of the rate: an event
    with a period would end an integration step, and so change the run. The Context has no state;
    the system and its `Scene` remember the last picture, as Meshcat does: all Contexts draw on the
    one picture, and nothing that is simulated depends on it.

    Args:
        meshcat: Meshcat to draw in.
        setting: Constants of the scene.
    """

    def __init__(self, meshcat: Meshcat, setting: Setting):
        super().__init__()
        self._scene, self._model = Scene(meshcat, setting), setting.model
        self._task_force, self._rate = setting.force, setting.visual.rate
        self._knots = setting.horizon + 1
        self._last_time = np.inf
        size = self._model.size
        for name, width in (("state", 2 * size), ("nominal_state", 2 * size), ("u", size),
                            ("nominal_input", size), ("force", 6), ("desired_force", 6),
                            *KNOWN.items()):
            self.DeclareVectorInputPort(name, width)
        self.DeclareAbstractInputPort("plan", Value(object()))
        self.DeclarePerStepPublishEvent(self._draw_if_due)
        self.DeclareForcedPublishEvent(self._draw)

    def _draw_if_due(self, context: Context) -> EventStatus:
        now, last = context.get_time(), self._last_time
        if now < last or _frame(now, self._rate) > _frame(last, self._rate):
            return self._draw(context)
        return EventStatus.DidNothing()

    def _draw(self, context: Context) -> EventStatus:
        def value(name: str) -> np.ndarray:
            return cast(np.ndarray, self.GetInputPort(name).Eval(context))

        def has(name: str) -> bool:
            return self.GetInputPort(name).HasValue(context)

        self._last_time = context.get_time()
        plan = self.GetInputPort("plan").Eval(context)
        self._scene.show(Moment(
            state=value("state"), nominal_state=value("nominal_state"), u=value("u"),
            nominal_input=value("nominal_input"),
            desired_force=value("desired_force") if has("desired_force") else self._task_force,
            path=self._model.task_pose(plan.config[: self._knots])[:, :3],
            force=value("force") if has("force") else None,
            known=contact_knowledge_from({name: value(name) for name in KNOWN if has(name)})),
            self._last_time)
        return EventStatus.Succeeded()

    @staticmethod
    def AddToBuilder(builder: DiagramBuilder, meshcat: Meshcat, setting: Setting, *,
                     name: str = "illustration", **ports: OutputPort) -> "Illustration":
        """Adds the system; `ports` are connected to the input ports of their names."""
        return added(builder, name, Illustration(meshcat, setting), **ports)


def _frame(time: float, rate: float) -> float:
    """Returns the number of the picture that `time` [s] belongs to."""
    return np.floor(time * rate + 1e-9)
