"""Brake of a joint, whatever torque is commanded: a fault."""

from dataclasses import dataclass

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
from uvms_drake.model.signals.sensor_actuator import ONLY_ONCE, Fault, Part, Signals, check_times
from uvms_drake.model.uvms_model import UvmsModel

BRAKE = (400.0, 40.0)
"""Stiffness [1/s²] and damping [1/s] of a brake, per inertia: critical, settled in 0.3 s."""


@dataclass
class StuckJoint(Fault, Part):
    """Brake, a stiff spring with a damper, on a joint at its angle at `start`.

    In a simulation that begins after that, at its angle at the beginning.
    """

    place = "actuation"

    joint: int = 0
    """Index of the joint, from 0."""
    start: float = 0.0
    """First instant of the braking [s]."""

    def check(self) -> None:
        """Raises `InvalidParameter` for the first value that has no meaning."""
        require(self.joint >= 0, "joint", self.joint, "an index from 0")
        check_times(self.start, None)

    def add_to(self, builder: DiagramBuilder, model: UvmsModel, port: OutputPort,
               signals: Signals, seed: int) -> OutputPort:
        """Adds a `JointBrake`; see `Part`."""
        return JointBrake.AddToBuilder(
            builder, model, self, commanded=port, state=signals["state"]).get_output_port()


def brake_torque(inertia: float, stretch: float, rate: float) -> float:
    """Returns the torque [N m] of a brake.

    Args:
        inertia: Inertia of the joint alone [kg m²].
        stretch: Angle from that of the brake [rad].
        rate: Rate q̇ of the joint [rad/s].
    """
    stiffness, damping = BRAKE
    return -inertia * (stiffness * stretch + damping * rate)


class JointBrake(LeafSystem):
    """Brake in place of a joint's torque.

    .. pydrake_system::

        name: JointBrake
        input_ports:
        - commanded
        - state
        output_ports:
        - tau

    - `commanded`, `tau`: τ (6+n), wrench on the vehicle in body axes and joint torques [N, N m].
    - `state`: (𝔮, ζ) (2(6+n)), in the paper's order.

    The discrete state is the angle of the brake (1), taken at the fault's start or at a later
    initialization, and 1 if it has been taken, else 0 (1).

    Args:
        model: Supplies the joint's inertia.
        fault: Joint and beginning of the fault.
    """

    def __init__(self, model: UvmsModel, fault: StuckJoint):
        super().__init__()
        require(0 <= fault.joint < model.num_joints, "joint", fault.joint,
                f"an index from 0 to {model.num_joints - 1}")
        self._model, self._row, self._start = model, 6 + fault.joint, fault.start
        self._tau_port = self.DeclareVectorInputPort("commanded", model.size)
        self._state_port = self.DeclareVectorInputPort("state", 2 * model.size)
        for _ in ("angle", "taken"):
            self.DeclareDiscreteState(1)
        self.DeclareInitializationDiscreteUpdateEvent(self._begin)
        self.DeclarePeriodicDiscreteUpdateEvent(ONLY_ONCE, fault.start, self._hold)
        self.DeclareVectorOutputPort("tau", model.size, self._calc)

    def _hold(self, context: Context, state: DiscreteValues) -> None:
        state.set_value(0, self._state_port.Eval(context)[[self._row]])
        state.set_value(1, [1.0])

    def _begin(self, context: Context, state: DiscreteValues) -> None:
        if context.get_time() > self._start and not self._taken(context):
            self._hold(context, state)

    @staticmethod
    def _taken(context: Context) -> bool:
        return bool(context.get_discrete_state(1).value()[0])

    def _calc(self, context: Context, output: BasicVector) -> None:
        tau = self._tau_port.Eval(context).copy()
        if context.get_time() > self._start:
            config, zeta = np.split(self._state_port.Eval(context), 2)
            row = self._row
            angle = config[row]
            if self._taken(context):
                angle = context.get_discrete_state(0).value()[0]
            inertia = self._model.mass_matrix(self._model.kinematics(config))[row, row]
            tau[row] = brake_torque(inertia, config[row] - angle, zeta[row])
        output.SetFromVector(tau)

    @staticmethod
    def AddToBuilder(builder: DiagramBuilder, model: UvmsModel, fault: StuckJoint, *,
                     commanded: OutputPort, state: OutputPort,
                     name: str = "joint_brake") -> "JointBrake":
        """Adds the brake and connects it; the arguments are its constructor's and its inputs."""
        return added(builder, name, JointBrake(model, fault), commanded=commanded, state=state)
