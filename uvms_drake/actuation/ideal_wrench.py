"""Ideal wrench on all six axes of the vehicle, also of one that its own thrusters do not drive."""

from dataclasses import dataclass, field

from pydrake.systems.framework import DiagramBuilder, OutputPort

from uvms_drake.common.errors import require
from uvms_drake.model.description.thruster_file import AXES
from uvms_drake.model.signals.command_path import IDEAL_PATH, CommandPath
from uvms_drake.model.signals.sensor_actuator import Actuator, Signals
from uvms_drake.model.uvms_model import UvmsModel


@dataclass
class IdealWrench(Actuator):
    """Force on every axis of vehicle and joints as commanded, at once and without limit.

    It adds no system, and comes last in the list. A certificate is for such a wrench; if the
    robot's own thrusters leave axes undriven, the scenario has to name them here.
    """

    undriven: list[str] = field(default_factory=list)
    """Axes of the vehicle that its own thrusters do not drive, of surge, sway, heave, roll, pitch
    and yaw."""

    def check(self) -> None:
        """Raises `InvalidParameter` for the first value that has no meaning."""
        require(set(self.undriven) <= set(AXES), "undriven", self.undriven, f"of {', '.join(AXES)}")

    def assumption(self) -> None:
        """Returns None: the proofs are about this wrench."""

    def command_path(self, model: UvmsModel) -> CommandPath:
        """Returns a path without a delay."""
        return IDEAL_PATH

    def add_to(self, builder: DiagramBuilder, model: UvmsModel, port: OutputPort,
               signals: Signals, seed: int) -> OutputPort:
        """Returns `port`."""
        return port

