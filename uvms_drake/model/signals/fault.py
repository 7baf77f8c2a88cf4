"""Faults in a run: their interface, and the system of those that change a signal."""

from collections.abc import Callable
from typing import ClassVar, Literal

import numpy as np
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiscreteValues,
)

from uvms_drake.common.wiring import WiredSystem
from uvms_drake.model.signals.sensor_actuator import Component

ONLY_ONCE = 1e9
"""Period [s] of an event that occurs once in a run; events of Drake's systems have a period."""

Faulty = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""Function of a signal, a watched vector at the fault's start, and the latter now: the signal
during the fault."""


class Fault(Component):
    """Fault in a run."""

    place: ClassVar[Literal[
        "sensing", "force", "fixes", "actuation", "thrusters", "solver", "disturbance", "water"]]
    """Place in the loop: a series of parts, of which that of the force carries `MEASURED_FORCE`; or
    the fixes of a navigation, the commands to the thrusters, the solver, the disturbance or the
    water."""

    start: float = 0.0
    """First instant of the fault [s]."""
    duration: float | None = None
    """Duration of the fault [s]; None: to the end of the run."""

    def is_active(self, time: float) -> bool:
        """Returns whether `time` [s] is in [start, start + duration)."""
        return self.start <= time and (
            self.duration is None or time < self.start + self.duration)


class FaultySignal(WiredSystem):
    """Signal with a fault, which may depend on a vector at the fault's start.

    A sample at the instant of the fault's start is taken before it, and so is a step's end.

    .. pydrake_system::

        name: FaultySignal
        input_ports:
        - signal
        - watched
        output_ports:
        - faulty

    - `signal`, `faulty` (size).
    - `watched`: the vector whose value at the start is kept.

    The discrete state is the watched vector at the fault's start, or at the initialization of a
    simulation that begins later, and 1 if it has been taken, else 0.

    Args:
        fault: The fault and its time.
        law: The signal during the fault; see `Faulty`.
        size: Size of the signal.
        watched: Size of the watched vector.
    """

    def __init__(self, fault: Fault, law: Faulty, size: int, watched: int):
        super().__init__()
        self._fault, self._law = fault, law
        self._port = self.DeclareVectorInputPort("signal", size)
        self._watched_port = self.DeclareVectorInputPort("watched", watched)
        self.DeclareDiscreteState(watched + 1)
        self.DeclareInitializationDiscreteUpdateEvent(self._begin)
        self.DeclarePeriodicDiscreteUpdateEvent(ONLY_ONCE, fault.start, self._hold)
        self.DeclareVectorOutputPort("faulty", size, self._calc)

    def _hold(self, context: Context, state: DiscreteValues) -> None:
        state.set_value(np.append(self._watched_port.Eval(context), 1.0))

    def _begin(self, context: Context, state: DiscreteValues) -> None:
        if context.get_time() > self._fault.start and not self._kept(context)[-1]:
            self._hold(context, state)

    @staticmethod
    def _kept(context: Context) -> np.ndarray:
        return context.get_discrete_state_vector().value()

    def _calc(self, context: Context, output: BasicVector) -> None:
        signal, time = self._port.Eval(context), context.get_time()
        if time > self._fault.start and self._fault.is_active(time):
            now, kept = self._watched_port.Eval(context), self._kept(context)
            signal = self._law(signal, kept[:-1] if kept[-1] else now, now)
        output.SetFromVector(signal)
