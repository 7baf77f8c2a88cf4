"""Faults of a thruster from an instant on: dead, stuck at a force, reversed, two exchanged.

They change the commands to the real thrusters; the controller's model of these does not know.
"""

from abc import abstractmethod
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydrake.systems.framework import DiagramBuilder, OutputPort

from uvms_drake.actuation.thrusters import Thrusters
from uvms_drake.common.constraints import Between, NotNegative
from uvms_drake.common.errors import require
from uvms_drake.model.propulsion.thrusters import ThrusterModel
from uvms_drake.model.signals.fault import Fault, FaultySignal


@dataclass
class ThrusterFault(Fault):
    """Fault of a thruster, by its name in `thrusters.yaml`."""

    place: ClassVar[Literal["thrusters"]] = "thrusters"

    thruster: str = ""
    """Name of the thruster."""
    start: Annotated[float, NotNegative] = 0.0
    """First instant of the fault [s]."""

    def index(self, thrusters: ThrusterModel, key: str = "thruster") -> int:
        """Returns the index of the thruster that a field names, or raises."""
        name = getattr(self, key)
        require(name in thrusters.names, key, name, f"one of {', '.join(thrusters.names)}")
        return thrusters.names.index(name)

    @abstractmethod
    def sent(self, thrusters: ThrusterModel, command: np.ndarray, kept: np.ndarray) -> np.ndarray:
        """Returns the commands (m,) that the thrusters get; `kept` are those at the start."""

    def add_to(self, builder: DiagramBuilder, thrusters: ThrusterModel, command: OutputPort
               ) -> OutputPort:
        """Adds a `FaultySignal` after the commands, and returns its port."""
        return FaultySignal.AddToBuilder(
            builder, self, lambda now, kept, _: self.sent(thrusters, now, kept), command.size(),
            command.size(), name=type(self).__name__, signal=command, watched=command
        ).get_output_port()


@dataclass
class LostThruster(ThrusterFault):
    """Dead thruster: its force decays with its lag."""

    def sent(self, thrusters: ThrusterModel, command: np.ndarray, kept: np.ndarray) -> np.ndarray:
        """Returns the commands with that of no force."""
        out, i = command.copy(), self.index(thrusters)
        out[i] = thrusters.curves[i].command_of(0.0)
        return out


@dataclass
class StuckThruster(ThrusterFault):
    """Thruster that keeps a force, whatever is commanded."""

    share: Annotated[float, Between(-1.0, 1.0)] | None = None
    """Force over the largest one in its sense; None: that of the command at the start."""

    def sent(self, thrusters: ThrusterModel, command: np.ndarray, kept: np.ndarray) -> np.ndarray:
        """Returns the commands with the one that stays."""
        out, i = command.copy(), self.index(thrusters)
        curve = thrusters.curves[i]
        out[i] = kept[i] if self.share is None else curve.command_of(
            abs(self.share) * float(curve.force[0 if self.share < 0.0 else -1]))
        return out


@dataclass
class ReversedThruster(ThrusterFault):
    """Thruster with a force of the other sign, as far as its curve goes: two wires exchanged."""

    def sent(self, thrusters: ThrusterModel, command: np.ndarray, kept: np.ndarray) -> np.ndarray:
        """Returns the commands with that of the opposite force."""
        out, i = command.copy(), self.index(thrusters)
        out[i] = thrusters.curves[i].command_of(-thrusters.curves[i].force_of(command[i]))
        return out


@dataclass
class ExchangedThrusters(ThrusterFault):
    """Two thrusters, each of which gets the command of the other."""

    other: str = ""
    """Name of the second one."""

    def check(self) -> None:
        """Raises `InvalidParameter` if there is only one."""
        require(self.other != self.thruster, "other", self.other, "another one than `thruster`")

    def sent(self, thrusters: ThrusterModel, command: np.ndarray, kept: np.ndarray) -> np.ndarray:
        """Returns the commands with two of them exchanged."""
        out, i, j = command.copy(), self.index(thrusters), self.index(thrusters, "other")
        out[[i, j]] = out[[j, i]]
        return out


@dataclass
class FaultyThrusters(Thrusters):
    """Thrusters of a scenario with its faults of them."""

    faults: tuple[ThrusterFault, ...] = ()
    """Faults of them, one after another."""

    def received(self, builder: DiagramBuilder, thrusters: ThrusterModel, command: OutputPort
                 ) -> OutputPort:
        """Returns the commands behind the faults, one after another."""
        for fault in self.faults:
            command = fault.add_to(builder, thrusters, command)
        return command
