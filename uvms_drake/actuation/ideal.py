"""Actuators without dynamics: the wrench as commanded, and a controller that runs at ticks."""

from dataclasses import dataclass, field
from typing import Annotated

from pydrake.systems.framework import DiagramBuilder, OutputPort

from uvms_drake.common.constraints import OneOf, Period
from uvms_drake.common.errors import require
from uvms_drake.model.description.thruster_file import AXES
from uvms_drake.model.signals.command_path import CommandPath
from uvms_drake.model.signals.sample_and_hold import Clock, SampledVector, TickedVector
from uvms_drake.model.signals.sensor_actuator import TICK, Actuator, Signals
from uvms_drake.model.uvms_model import UvmsModel


@dataclass
class IdealWrench(Actuator):
    """Force on every axis of vehicle and joints as commanded, at once and without limit.

    It adds no system, and comes last in the list. A certificate is for such a wrench; if the
    robot's own thrusters leave axes undriven, the scenario has to name them here.
    """

    undriven: list[Annotated[str, OneOf(*AXES)]] = field(default_factory=list)
    """Axes of the vehicle that its own thrusters do not drive, of surge, sway, heave, roll, pitch
    and yaw."""

    def assumption(self) -> None:
        """Returns None: the proofs are about this wrench."""

    def add_to(self, builder: DiagramBuilder, model: UvmsModel, port: OutputPort,
               signals: Signals, seed: int) -> OutputPort:
        """Returns `port`."""
        return port


@dataclass
class SampledCommand(Actuator):
    """Zero-order hold of the command with a computation delay.

    At a tick t_k the law reads the measured state, the measured force and the plan of that instant;
    its command acts from t_k + δ to t_k + h + δ. Before the first one acts it is that of the start:
    a controller runs before a task begins. The applied command is logged as `zoh_command`; `u` and
    `tau` of the log are those of the law in continuous time.

    Vehicles run at 10 Hz (COLA2, of the Girona 500) to 50 or 100 Hz (BlueROV2 with an arm); the
    default delay is half a period. The MPC has a period of its own and takes no time: its plans
    start at the nominal state, so that they can be computed in advance.
    """

    period: Annotated[float, Period] = 0.02
    """Period h of the clock [s]."""
    delay: float = 0.01
    """Delay δ from a tick to the action of its command [s]; at most 100 periods."""

    def check(self) -> None:
        """Raises `InvalidParameter` for the first value that has no meaning."""
        require(0.0 <= self.delay <= 100.0 * self.period, "delay", self.delay,
                f"from 0 to 100 periods, {100.0 * self.period:g} s")

    def assumption(self) -> str:
        """Returns the assumption that it breaks."""
        return "the proofs take the feedback for continuous"

    def command_path(self, model: UvmsModel) -> CommandPath:
        """Returns its clock and its delay."""
        return CommandPath(self.period, self.delay)

    def add_to(self, builder: DiagramBuilder, model: UvmsModel, port: OutputPort,
               signals: Signals, seed: int) -> OutputPort:
        """Adds a `SampledVector`, or a `TickedVector` if there are ticks; see `Part`.

        Of the latter `newest_command` is the last sample, even if it does not act yet.
        """
        clock = Clock(range(port.size()), self.period, self.delay)
        kind = TickedVector if TICK in signals else SampledVector
        sampled = kind.AddToBuilder(builder, port.size(), [clock], name="sampled_command",
                                    vector=port, tick=signals.get(TICK))
        signals["zoh_command"] = sampled.GetOutputPort("hold")
        if TICK in signals:
            signals["newest_command"] = sampled.GetOutputPort("newest")
        return signals["zoh_command"]
