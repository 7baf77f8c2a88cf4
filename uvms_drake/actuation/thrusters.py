"""Thrusters: the vehicle's wrench by what its thrusters can give, when they give it.

::

          ┌────────────┐ command ┌───────────┐ f   ┌─────────┐
    τ ─┬─▶│ allocation ├────┬───▶│ thrusters ├────▶│ (B f, 0)├──▶(+)──▶ τ
       │  └────────────┘    │    └───────────┘     └─────────┘    ▲
       │                    │    ┌───────────┐     ┌─────────┐    │
       │                    └───▶│   model   ├────▶│   B f   ├────┼──▶ vehicle_wrench
       │                         └───────────┘     └─────────┘    │
       └─────────────────────────────────────────── (0, τ_q) ─────┘

A force follows its command by Tḟ + f = φ(command a dead time ago), φ its curve, and the torques of
the joints pass. The model is what the controller knows: the same without sag and error.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from pydrake.systems.framework import (
    BasicVector,
    Context,
    Diagram,
    DiagramBuilder,
    LeafSystem,
    OutputPort,
)
from pydrake.systems.primitives import (
    Adder,
    DiscreteTimeDelay,
    FirstOrderLowPassFilter,
    MatrixGain,
)

from uvms_drake.common.errors import InvalidParameter, require
from uvms_drake.model.allocation import Allocation
from uvms_drake.model.part import VEHICLE_WRENCH, Part, Signals
from uvms_drake.model.thrusters import ThrusterModel
from uvms_drake.model.uvms_model import UvmsModel


@dataclass
class Thrusters(Part):
    """The vehicle's thrusters: curves, dead bands, limits, lag, dead time, and what drives no axis.

    They are those of `thrusters.yaml` in the robot's folder. Logged are `thruster_command` and
    `thruster_force` (m), `vehicle_wrench`, what the thrusters give now by the controller's model of
    them, and `wrench_shortfall`, what they cannot give of the wrench that is asked for.
    """

    motions = ("dynamic",)

    period: float = 0.005
    """Time between two commands to the thrusters [s]."""
    lag: float | None = None
    """Time constant of all forces [s], if it is another one than the file's."""
    dead_time: float | None = None
    """From a command to the first change of a force [s], if it is another one than the file's; a
    multiple of `period`, of which up to one more passes until a command is sent."""
    sag: float = 0.0
    """By how much the voltage is below the one that the controller counts on [V]."""
    error: np.ndarray = field(default_factory=lambda: np.zeros(1))
    """Share by which each thruster gives more than the controller knows (m,), or (1,) for all."""

    def check(self) -> None:
        """Raises `InvalidParameter` for the first value that has no meaning."""
        require(0.0 < self.period < np.inf, "period", self.period, "positive")
        require(self.lag is None or 0.0 < self.lag < np.inf, "lag", self.lag,
                "positive, or left out")
        require(np.isfinite(self.sag), "sag", self.sag, "a number")
        if self.dead_time is not None:
            self._steps(self.dead_time)
        require(bool(np.all(np.isfinite(self.error))) and np.ndim(self.error) == 1, "error",
                self.error, "finite numbers, one for all or one each")

    def assumption(self) -> str:
        """Returns the assumption that it breaks."""
        return "the proofs take the vehicle's wrench for given at once and on all six axes"

    def _steps(self, dead_time: float) -> int:
        steps = dead_time / self.period
        require(0.0 <= dead_time < np.inf and abs(steps - round(steps)) <= 1e-9 * max(steps, 1.0),
                "dead_time", dead_time, f"a multiple of the period, {self.period:g} s")
        return round(steps)

    def known(self, model: UvmsModel) -> ThrusterModel:
        """Returns the thrusters as the controller knows them."""
        return self._at(model, 0.0)

    def true(self, model: UvmsModel) -> ThrusterModel:
        """Returns the thrusters as they are."""
        return self._at(model, self.sag).off_by(self.error)

    def _at(self, model: UvmsModel, sag: float) -> ThrusterModel:
        parameters = model.thrusters
        if parameters is None:
            raise InvalidParameter("thrusters", None, "left out: the robot has no thrusters.yaml")
        found = ThrusterModel.of(parameters, sag)
        lag = found.lag if self.lag is None else np.full(found.size, self.lag)
        dead_time = found.dead_time if self.dead_time is None else self.dead_time
        return replace(found, lag=lag, dead_time=dead_time)

    def add_to(self, builder: DiagramBuilder, model: UvmsModel, port: OutputPort,
               signals: Signals, seed: int) -> OutputPort:
        """Adds the systems of this module's picture; see `Part`."""
        known = self.known(model)
        allocation = ThrusterAllocation.AddToBuilder(
            builder, model, Allocation.to(known), tau=port)
        steps, size = self._steps(known.dead_time), model.size

        def add(name: str, thrusters: ThrusterModel) -> OutputPort:
            system = builder.AddNamedSystem(name, make_thrusters(thrusters, self.period, steps))
            builder.Connect(allocation.GetOutputPort("command"), system.get_input_port())
            return system.get_output_port()

        def add_gain(name: str, matrix: np.ndarray, of: OutputPort) -> OutputPort:
            gain = builder.AddNamedSystem(name, MatrixGain(matrix))
            builder.Connect(of, gain.get_input_port())
            return gain.get_output_port()

        force, believed = add("thrusters", self.true(model)), add("thruster_model", known)
        exerted = builder.AddNamedSystem("exerted", Adder(num_inputs=2, size=size))
        for i, part in enumerate((
                add_gain("wrench", np.eye(size, 6) @ known.B, force),
                add_gain("torques", np.diag(np.repeat([0.0, 1.0], [6, model.num_joints])), port))):
            builder.Connect(part, exerted.get_input_port(i))
        signals["thruster_command"] = allocation.GetOutputPort("command")
        signals["thruster_force"] = force
        signals["wrench_shortfall"] = allocation.GetOutputPort("shortfall")
        signals[VEHICLE_WRENCH] = add_gain("wrench_model", known.B, believed)
        return exerted.get_output_port()


class ThrusterAllocation(LeafSystem):
    """Commands the thrusters to give a wrench; see `Allocation`.

    .. pydrake_system::

        name: ThrusterAllocation
        input_ports:
        - tau
        output_ports:
        - command
        - shortfall

    - `tau` (6+n): (τ_v, τ_q), of which τ_v is read, in axes of B about its origin [N, N m].
    - `command` (m): to the thrusters' drivers, in their own unit.
    - `shortfall` (6): the part of τ_v that is not to be had, at rest [N, N m].

    It has no state.

    Args:
        model: Supplies the size of τ.
        allocation: To the thrusters as the controller knows them.
    """

    def __init__(self, model: UvmsModel, allocation: Allocation):
        super().__init__()
        self._allocation = allocation
        self._port = self.DeclareVectorInputPort("tau", model.size)
        self.DeclareVectorOutputPort("command", allocation.thrusters.size, self._calc_command)
        self.DeclareVectorOutputPort("shortfall", 6, self._calc_shortfall)

    def _calc_command(self, context: Context, output: BasicVector) -> None:
        forces = self._allocation.forces(self._port.Eval(context)[:6])
        output.SetFromVector(self._allocation.thrusters.commands_of(forces))

    def _calc_shortfall(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._allocation.shortfall(self._port.Eval(context)[:6]))

    @staticmethod
    def AddToBuilder(builder: DiagramBuilder, model: UvmsModel, allocation: Allocation, *,
                     tau: OutputPort, name: str = "allocation") -> "ThrusterAllocation":
        """Adds the allocation and connects it; the arguments are its constructor's and input."""
        system = ThrusterAllocation(model, allocation)
        builder.AddNamedSystem(name, system)
        builder.Connect(tau, system.GetInputPort("tau"))
        return system


class ThrustCurves(LeafSystem):
    """What thrusters give in the long run.

    .. pydrake_system::

        name: ThrustCurves
        input_ports:
        - command
        output_ports:
        - force

    - `command` (m): to the thrusters' drivers, in their own unit.
    - `force` (m): along their axes [N].

    It has no state.

    Args:
        thrusters: With their curves.
    """

    def __init__(self, thrusters: ThrusterModel):
        super().__init__()
        self._thrusters = thrusters
        self._port = self.DeclareVectorInputPort("command", thrusters.size)
        self.DeclareVectorOutputPort("force", thrusters.size, self._calc)

    def _calc(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._thrusters.forces_of(self._port.Eval(context)))


def make_thrusters(thrusters: ThrusterModel, period: float, steps: int) -> Diagram:
    """Returns thrusters as a Diagram named "thrusters", which stand still at first.

    ::

        command ──▶ curves ──▶ dead_time ──▶ lag ──▶ force

    The dead time comes after the curves, which have no memory, so that the order makes no
    difference and its zero is no force. Its discrete state and the lag's continuous one are
    Drake's; nothing feeds through.

    .. pydrake_system::

        name: thrusters
        input_ports:
        - command
        output_ports:
        - force

    - `command` (m): see `ThrustCurves`; sampled.
    - `force` (m): what they give now [N].

    Args:
        thrusters: Their curves and lags.
        period: Time between two samples of the command [s].
        steps: Dead time in periods.
    """
    builder = DiagramBuilder()
    curves = builder.AddNamedSystem("curves", ThrustCurves(thrusters))
    delay = builder.AddNamedSystem("dead_time", DiscreteTimeDelay(period, steps, thrusters.size))
    lag = builder.AddNamedSystem("lag", FirstOrderLowPassFilter(thrusters.lag))
    builder.ExportInput(curves.get_input_port(), "command")
    builder.Connect(curves.get_output_port(), delay.get_input_port())
    builder.Connect(delay.get_output_port(), lag.get_input_port())
    builder.ExportOutput(lag.get_output_port(), "force")
    diagram = builder.Build()
    diagram.set_name("thrusters")
    return diagram
