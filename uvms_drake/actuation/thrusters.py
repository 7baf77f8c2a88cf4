"""Thrusters: the vehicle's wrench with their allocation, limits, dead time and lag.

::

          ┌────────────┐ command ┌───────────┐ f   ┌─────────┐
    τ ─┬─▶│ allocation ├────┬───▶│ thrusters ├────▶│ (B f, 0)├──▶(+)──▶ τ
       │  └────────────┘    │    └───────────┘     └─────────┘    ▲
       │                    │    ┌───────────┐     ┌─────────┐    │
       │                    └───▶│   model   ├────▶│   B f   ├────┼──▶ vehicle_wrench
       │                         └───────────┘     └─────────┘    │
       └─────────────────────────────────────────── (0, τ_q) ─────┘

A force follows its command by Tḟ + f = φ(command a dead time ago), φ its curve, and the torques of
the joints pass. The controller's model is the same without error. At the start the
thrusters hover: they hold the robot at rest, as far as they can.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import Adder, MatrixGain

from uvms_drake.actuation.thruster_systems import PowerCut, ThrusterAllocation, ThrusterDynamics
from uvms_drake.common.constraints import Period, Positive
from uvms_drake.common.errors import InvalidParameter, require
from uvms_drake.model.propulsion.allocation import Allocation
from uvms_drake.model.propulsion.thrusters import ThrusterModel
from uvms_drake.model.signals.command_path import CommandPath
from uvms_drake.model.signals.sensor_actuator import VEHICLE_WRENCH, Actuator, Signals
from uvms_drake.model.uvms_model import UvmsModel


@dataclass
class Thrusters(Actuator):
    """Thrusters of the vehicle: curves, dead bands, limits, lag, dead time and undriven axes.

    They are those of `thrusters.yaml` in the robot's folder. Logged are `thruster_command` and
    `thruster_force` (m), `vehicle_wrench`, their present wrench in the controller's model, and
    `wrench_shortfall`, the undelivered part of the commanded wrench.
    """


    period: Annotated[float, Period] = 0.01
    """Time between two commands to the thrusters [s]."""
    lag: Annotated[float, Positive] | None = None
    """Time constant of all forces [s]; by default the file's."""
    dead_time: float | None = None
    """Dead time from a command to the first change of a force [s], a multiple of `period`; by
    default the file's. Up to one period more passes until a command is sent."""
    error: np.ndarray = field(default_factory=lambda: np.zeros(1))
    """Relative error of each thruster's force to the controller's model (m,), or (1,) for all. A
    campaign draws that of each thruster, of either sign and up to this size. −1 is a dead one."""
    largest_current: Annotated[float, Positive] | None = None
    """Largest current of all thrusters together [A], beyond which their forces are reduced in
    proportion; the `current` of each kind is in `thrusters.yaml`. None: no limit."""

    def check(self) -> None:
        """Raises `InvalidParameter` for the first value that has no meaning."""
        if self.dead_time is not None:
            self._steps(self.dead_time)
        error = np.asarray(self.error, dtype=float)
        require(error.ndim == 1 and bool(np.all((error >= -1.0) & (error < 1.0))),
                "error", self.error, "numbers from -1 to 1 (exclusive), one for all or one each; a "
                "thruster with the other sign is !ReversedThruster of faults")

    def assumption(self) -> str:
        """Returns the assumption that it breaks."""
        return "the proofs take the vehicle's wrench for given at once and on all six axes"

    def command_path(self, model: UvmsModel) -> CommandPath:
        """Returns their clock, dead time and mean lag."""
        known = self.known(model)
        return CommandPath(thruster_period=self.period, dead_time=known.dead_time,
                           lag=float(np.mean(known.lag)))

    def _steps(self, dead_time: float) -> int:
        steps = dead_time / self.period
        require(0.0 <= dead_time < np.inf and abs(steps - round(steps)) <= 1e-9 * max(steps, 1.0),
                "dead_time", dead_time, f"a multiple of the period, {self.period:g} s")
        return round(steps)

    def known(self, model: UvmsModel) -> ThrusterModel:
        """Returns the thrusters of the controller's model."""
        parameters = model.thrusters
        if parameters is None:
            raise InvalidParameter("thrusters", None, "left out: the robot has no thrusters.yaml")
        found = ThrusterModel.of(parameters)
        lag = found.lag if self.lag is None else np.full(found.size, self.lag)
        dead_time = found.dead_time if self.dead_time is None else self.dead_time
        largest = np.inf if self.largest_current is None else self.largest_current
        require(largest == np.inf or bool(np.all(found.current > 0.0)), "largest_current", largest,
                "left out: a kind in thrusters.yaml has no current")
        return replace(found, lag=lag, dead_time=dead_time, largest_current=largest)

    def received(self, builder: DiagramBuilder, thrusters: ThrusterModel, command: OutputPort
                 ) -> OutputPort:
        """Returns the port of the commands (m,) that the real thrusters get."""
        return command

    def add_to(self, builder: DiagramBuilder, model: UvmsModel, port: OutputPort,
               signals: Signals, seed: int) -> OutputPort:
        """Adds the systems of the module's diagram; see `Part`."""
        # The allocation, by the controller's model of the thrusters.
        known = self.known(model)
        safety = signals.get("safety") if known.power_cut else None
        allocation = ThrusterAllocation.AddToBuilder(
            builder, model, Allocation.to(known), name="allocation", tau=port,
            state=signals["state"], force=signals["force"], safety=safety)
        steps, size = self._steps(known.dead_time), model.size

        command = allocation.GetOutputPort("command")

        def add(name: str, thrusters: ThrusterModel, command: OutputPort) -> OutputPort:
            system = ThrusterDynamics.AddToBuilder(
                builder, thrusters, self.period, steps, name=name, command=command,
                hover=allocation.GetOutputPort("hover"))
            return system.get_output_port()

        def add_gain(name: str, matrix: np.ndarray, of: OutputPort) -> OutputPort:
            gain = builder.AddNamedSystem(name, MatrixGain(matrix))
            builder.Connect(of, gain.get_input_port())
            return gain.get_output_port()

        # The real thrusters, which exert the wrench, and those of the controller's model.
        received = self.received(builder, known, command)
        if safety is not None:
            received = PowerCut.AddToBuilder(builder, known, name="power_cut", command=received,
                                             safety=safety).get_output_port()
        force = add("thrusters", known.off_by(self.error), received)
        modelled = add("thruster_model", known, command)
        exerted = builder.AddNamedSystem("exerted", Adder(num_inputs=2, size=size))
        for i, part in enumerate((
                add_gain("wrench", np.eye(size, 6) @ known.B, force),
                add_gain("torques", np.diag(np.repeat([0.0, 1.0], [6, model.num_joints])), port))):
            builder.Connect(part, exerted.get_input_port(i))
        signals["thruster_command"] = command
        signals["thruster_force"] = force
        signals["wrench_shortfall"] = allocation.GetOutputPort("shortfall")
        signals[VEHICLE_WRENCH] = add_gain("wrench_model", known.B, modelled)
        return exerted.get_output_port()


def largest_error(actuation: Sequence[Actuator]) -> float:
    """Returns the largest relative error of a thruster's force; zero without thrusters."""
    return max((float(np.max(np.abs(part.error), initial=0.0)) for part in actuation
                if isinstance(part, Thrusters)), default=0.0)


def with_errors(actuation: Sequence[Actuator], model: UvmsModel,
                shares: Callable[[int], np.ndarray]) -> list[Actuator]:
    """Returns the actuation with other errors of its thrusters, if they are declared.

    Args:
        actuation: The parts, with the largest errors.
        model: The controller's model.
        shares: Returns the errors of m thrusters over the largest (m,).
    """
    def changed(part: Thrusters) -> Thrusters:
        errors = part.known(model).each(part.error)
        return replace(part, error=shares(len(errors)) * errors)

    return [changed(part) if isinstance(part, Thrusters) and np.any(part.error) else part
            for part in actuation]
