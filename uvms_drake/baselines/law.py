"""Interface of a baseline's law, and the system that runs it."""

from abc import ABC, abstractmethod

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import (
    Context,
    DiagramBuilder,
    DiscreteValues,
    LeafSystem,
    OutputPort,
)

from uvms_drake.baselines.measured import Measured
from uvms_drake.common.wiring import added, output_of
from uvms_drake.model.uvms_model import UvmsModel

PERIOD = 0.01
"""Time between two updates of a memory, of integrals and contact [s]."""


class Law(ABC):
    """A law τ(measured, memory), with a memory of m numbers that is updated every `PERIOD`."""

    memory: int = 0
    """Number m of its own states, which start at zero."""
    declared: tuple[str, ...] = ()
    """Names of the data of robot and task that it is given, besides state and force."""

    @abstractmethod
    def tau(self, now: Measured, memory: np.ndarray) -> np.ndarray:
        """Returns τ (6+n,) [N, N m], the vehicle's part in body axes."""

    def updated(self, now: Measured, memory: np.ndarray, limited: bool) -> np.ndarray:
        """Returns the next memory (m,); `limited` is whether a limit cuts the sum of all laws."""
        return memory


class LawSystem(LeafSystem):
    """System of a `Law`.

    .. pydrake_system::

        name: LawSystem
        input_ports:
        - measured
        - limited (optional)
        output_ports:
        - tau
        - memory

    - `measured`: `Measured` (abstract).
    - `limited` (1): above zero while a limit cuts the sum of all laws; none if unconnected.
    - `tau` (6+n): τ [N, N m]; `memory` (m): the law's states.

    The discrete state is the law's memory.

    Args:
        model: Supplies the size of τ.
        law: The law.
    """

    def __init__(self, model: UvmsModel, law: Law):
        super().__init__()
        self._law = law
        self._port = self.DeclareAbstractInputPort("measured", AbstractValue.Make(()))
        self._limited_port = self.DeclareVectorInputPort("limited", 1)
        self.DeclareDiscreteState(law.memory)
        if law.memory:
            self.DeclarePeriodicDiscreteUpdateEvent(PERIOD, PERIOD, self._update)
        output_of(self, "tau", model.size, self._tau, {self._port.ticket(), self.xd_ticket()})
        output_of(self, "memory", law.memory,
                  lambda context: context.get_discrete_state_vector().value(), {self.xd_ticket()})

    def _tau(self, context: Context) -> np.ndarray:
        return self._law.tau(self._port.Eval(context),
                             context.get_discrete_state_vector().value())

    def _update(self, context: Context, state: DiscreteValues) -> None:
        limited = self._limited_port.HasValue(context) and bool(
            self._limited_port.Eval(context)[0] > 0.0)
        state.set_value(self._law.updated(
            self._port.Eval(context), context.get_discrete_state_vector().value(), limited))

    @staticmethod
    def AddToBuilder(builder: DiagramBuilder, model: UvmsModel, law: Law, *, measured: OutputPort,
                     name: str = "law") -> "LawSystem":
        """Adds the system and connects it; the arguments are its constructor's and its input."""
        return added(builder, name, LawSystem(model, law), measured=measured)


def integrated(integral: np.ndarray, rate: np.ndarray, clamp: np.ndarray | float, limited: bool
               ) -> np.ndarray:
    """Returns the next value of an integral, within ±`clamp`; while limited it only shrinks."""
    step = np.clip(integral + PERIOD * rate, -np.asarray(clamp), clamp)
    return np.where(limited & (np.abs(step) > np.abs(integral)), integral, step)
