"""Sensor with a fault of limited duration, and the faults of the state's measurement."""

from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Literal

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
from uvms_drake.common.wiring import added
from uvms_drake.model.signals.sensor_actuator import (
    ONLY_ONCE,
    Fault,
    Part,
    Signals,
    check_times,
    is_active,
)
from uvms_drake.model.uvms_model import UvmsModel


@dataclass
class SensorFault(Fault, Part):
    """Fault of the sensor of the state, or of another vector."""

    place: ClassVar[Literal["sensing", "force"]] = "sensing"

    start: float = 0.0
    """Beginning of the fault, just after this instant [s]."""
    duration: float = 0.5
    """Duration of the fault [s]."""

    @abstractmethod
    def faulty(self, true: np.ndarray, frozen: np.ndarray) -> np.ndarray:
        """Returns the measurement during the fault; `frozen` is the vector at its start."""

    def check(self) -> None:
        """Raises `InvalidParameter` for the first value that has no meaning."""
        check_times(self.start, self.duration)

    def add_to(self, builder: DiagramBuilder, model: UvmsModel, port: OutputPort,
               signals: Signals, seed: int) -> OutputPort:
        """Adds a `FaultySensor`; see `Part`."""
        return FaultySensor.AddToBuilder(builder, self, true=port).get_output_port()


@dataclass
class FrozenState(SensorFault):
    """Frozen state: that at `start`, or at the beginning of a simulation after it."""

    def faulty(self, true: np.ndarray, frozen: np.ndarray) -> np.ndarray:
        """Returns the measurement at the start."""
        return frozen


@dataclass
class LostState(SensorFault):
    """Missing state: not a number."""

    start: float = 1.0
    """Beginning, just after this instant [s]; above 0: the first plan needs a measured state."""

    def check(self) -> None:
        """Raises `InvalidParameter` for the first value that has no meaning."""
        require(self.start > 0.0, "start", self.start,
                "above 0: the first plan needs a measured state")
        super().check()

    def faulty(self, true: np.ndarray, frozen: np.ndarray) -> np.ndarray:
        """Returns NaN."""
        return np.full_like(frozen, np.nan)


def sensed(fault: SensorFault, time: float, true: np.ndarray, frozen: np.ndarray) -> np.ndarray:
    """Returns the measurement of a vector: itself, or that of the fault while it lasts.

    A sample at the instant of the fault's start is taken before it, and so is a step's end.

    Args:
        fault: The fault and its time.
        time: Present time [s].
        true: The vector.
        frozen: Vector at the fault's start; not read before.
    """
    if time <= fault.start or not is_active(fault.start, fault.duration, time):
        return true
    return fault.faulty(true, frozen)


class FaultySensor(LeafSystem):
    """Sensor of a vector with a fault.

    .. pydrake_system::

        name: FaultySensor
        input_ports:
        - true
        output_ports:
        - measured

    - `true`, `measured` (size): see `sensed`.

    The discrete state is the vector at the fault's start or at a later initialization (size), and
    1 if it has been taken, else 0 (1).

    Args:
        size: Size of the vector.
        fault: The fault and its time.
    """

    def __init__(self, size: int, fault: SensorFault):
        super().__init__()
        self._fault = fault
        self._port = self.DeclareVectorInputPort("true", size)
        self.DeclareDiscreteState(size)
        self.DeclareDiscreteState(1)
        self.DeclareInitializationDiscreteUpdateEvent(self._begin)
        self.DeclarePeriodicDiscreteUpdateEvent(ONLY_ONCE, fault.start, self._hold)
        self.DeclareVectorOutputPort("measured", size, self._calc)

    def _hold(self, context: Context, state: DiscreteValues) -> None:
        state.set_value(0, self._port.Eval(context))
        state.set_value(1, [1.0])

    def _begin(self, context: Context, state: DiscreteValues) -> None:
        if context.get_time() > self._fault.start and not self._taken(context):
            self._hold(context, state)

    @staticmethod
    def _taken(context: Context) -> bool:
        return bool(context.get_discrete_state(1).value()[0])

    def _calc(self, context: Context, output: BasicVector) -> None:
        true = self._port.Eval(context)
        frozen = context.get_discrete_state(0).value() if self._taken(context) else true
        output.SetFromVector(sensed(self._fault, context.get_time(), true, frozen))

    @staticmethod
    def AddToBuilder(builder: DiagramBuilder, fault: SensorFault, *, true: OutputPort,
                     name: str = "faulty_sensor") -> "FaultySensor":
        """Adds the sensor and connects it."""
        return added(builder, name, FaultySensor(true.size(), fault), true=true)
