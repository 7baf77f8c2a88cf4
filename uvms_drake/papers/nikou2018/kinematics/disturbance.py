"""Disturbance w of the end-effector's velocity: a function of time, or along the task error."""

from collections.abc import Mapping, Sequence

import numpy as np
from pydrake.systems.framework import DiagramBuilder, LeafSystem, OutputPort

from uvms_drake.common.errors import InvalidParameter, require
from uvms_drake.common.wiring import added, output_of
from uvms_drake.plant.adversary import AdversarialDisturbance, toward
from uvms_drake.plant.disturbance import Disturbance, OpenLoopDisturbance, unit_vector


def add_tip_disturbance(builder: DiagramBuilder, disturbance: Disturbance, seed: int,
                        signals: Mapping[str, OutputPort]) -> OutputPort:
    """Adds the source of w and returns its port (6) [m/s, rad/s].

    Args:
        builder: Builder to add to.
        disturbance: Its kind and bound.
        seed: Seed of random numbers, zero or positive.
        signals: Signals of the closed loop, with `e` (6) of its `TubeMonitor`.

    Raises:
        InvalidParameter: It is of a kind that only moves a robot by forces.
    """
    if isinstance(disturbance, OpenLoopDisturbance):
        return disturbance.add_source(builder, 6, seed).get_output_port()
    if isinstance(disturbance, AdversarialDisturbance):
        require(disturbance.kind == "along_task_error", "kind", disturbance.kind,
                "along_task_error, if the motion is kinematic")
        return TaskAdversary.AddToBuilder(
            builder, disturbance.bound, disturbance.direction, e=signals["e"]).get_output_port()
    raise InvalidParameter("kind", type(disturbance).__name__,
                           "another, if the motion is kinematic")


class TaskAdversary(LeafSystem):
    """A disturbance w of the kinematic model χ̇ = J(𝔮)ζ + w with ‖w‖₂ = w̃, along the task error.

    Under the law `resolved`, 𝔢̇ = −σ𝔢 + w: no other w of this size makes ‖𝔢‖ larger.

    .. pydrake_system::

        name: TaskAdversary
        input_ports:
        - e
        output_ports:
        - disturbance

    - `e` (6): 𝔢 = χ − χ̄, differences of Euler angles wrapped; of a `TubeMonitor`.
    - `disturbance` (6) [m/s, rad/s]: w, along 𝔢, or along the fixed direction where 𝔢 vanishes.

    It has no state.

    Args:
        bound: w̃ [m/s, rad/s].
        direction: The fixed direction (6,), of any length; empty means the same in all components.
    """

    def __init__(self, bound: float, direction: Sequence[float] | np.ndarray = ()):
        super().__init__()
        require(0.0 <= bound < np.inf, "bound", bound, "zero or positive")
        wanted, e = unit_vector(np.asarray(direction), 6), self.DeclareVectorInputPort("e", 6)
        output_of(self, "disturbance", 6, lambda c: bound * toward(e.Eval(c), wanted),
                  {e.ticket()})

    @staticmethod
    def AddToBuilder(builder: DiagramBuilder, bound: float,
                     direction: Sequence[float] | np.ndarray = (), *, e: OutputPort | None = None,
                     name: str = "adversary") -> "TaskAdversary":
        """Adds the adversary; `e` is the port of 𝔢, left to the caller if None."""
        return added(builder, name, TaskAdversary(bound, direction), e=e)
