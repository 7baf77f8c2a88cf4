"""Faults as systems, which a station puts between plant and controller; see `faults`.

Each is a law, a plain function, and a system that evaluates it.
"""

import math
from collections.abc import Sequence

import numpy as np
from pydrake.systems.framework import BasicVector, DiagramBuilder, LeafSystem, OutputPort

from uvms_drake.common.errors import require
from uvms_drake.control.nominal_mpc import DROPPED, FAILED, LATE, SOLVED
from uvms_drake.model.uvms_model import UvmsModel
from uvms_drake.station.faults import (
    DroppedPeriod,
    LostState,
    SensorFault,
    SolverFailure,
    SolverFault,
    SolverTimeout,
    StuckJoint,
    is_active,
)

STATUS = {DroppedPeriod: DROPPED, SolverFailure: FAILED, SolverTimeout: LATE}
"""What a fault makes of a sample; of two at the same instant, the first one here."""
BRAKE = (400.0, 40.0)
"""Stiffness [1/s²] and damping [1/s] of a brake, per inertia: critical, settled in 0.3 s."""
SAMPLE_TOLERANCE = 1e-6
"""Fraction of a period by which rounding may take a sampling instant off."""
ONLY_ONCE = 1e9
"""Period [s] of an event that comes once in a run."""


def solver_fault(faults: Sequence[SolverFault], seed: int, index: int, period: float) -> int:
    """Returns what becomes of a sample of the MPC: `SOLVED`, `FAILED`, `LATE` or `DROPPED`.

    It is a pure function of its arguments: one uniform number for each kind of fault, from a
    generator seeded with (seed, index, kind).

    Args:
        faults: At most one of a kind.
        seed: Zero or positive.
        index: Of the sampling instant, t = index · period.
        period: Between two samples [s].
    """
    time = (index + SAMPLE_TOLERANCE) * period
    for kind, status in STATUS.items():
        for fault in faults:
            if isinstance(fault, kind) and is_active(fault.start, fault.duration, time):
                sequence = np.random.SeedSequence([seed, index, status])
                if np.random.Generator(np.random.Philox(sequence)).random() < fault.probability:
                    return status
    return SOLVED


class SolverFaults(LeafSystem):
    """Says at which samples the solver of a `NominalMpc` fails, is late or does not run.

    .. pydrake_system::

        name: SolverFaults
        output_ports:
        - fault

    - `fault` (1): `solver_fault` of the last sampling instant.

    It has no state: the output is a function of time.

    Args:
        faults: At most one of a kind.
        seed: Zero or positive.
        period: Of the samples [s].
    """

    def __init__(self, faults: Sequence[SolverFault], seed: int, period: float):
        super().__init__()
        require(seed >= 0, "seed", seed, "zero or positive")
        require(0.0 < period < np.inf, "period", period, "positive")
        self._faults, self._seed, self._period = tuple(faults), seed, period
        self.DeclareVectorOutputPort("fault", BasicVector(1), self._calc, {self.time_ticket()})

    def _calc(self, context, output):
        index = math.floor(context.get_time() / self._period + SAMPLE_TOLERANCE)
        output.SetFromVector([solver_fault(self._faults, self._seed, index, self._period)])

    @staticmethod
    def AddToBuilder(builder: DiagramBuilder, faults: Sequence[SolverFault], seed: int,
                     period: float, *, name: str = "solver_faults") -> "SolverFaults":
        """Adds the system; see the constructor."""
        system = SolverFaults(faults, seed, period)
        builder.AddNamedSystem(name, system)
        return system


def sensed(fault: SensorFault, time: float, true: np.ndarray, held: np.ndarray) -> np.ndarray:
    """Returns what is measured of a vector: the vector itself, NaN, or what it was.

    Args:
        fault: What is wrong with the sensor, and when.
        time: [s].
        true: What a sensor without a fault measures.
        held: What it was at the fault's start; not read before.
    """
    if not is_active(fault.start, fault.duration, time):
        return true
    if isinstance(fault, LostState):
        return np.full_like(true, np.nan)
    return held if time > fault.start else true


class FaultySensor(LeafSystem):
    """Passes a vector on as a sensor with a fault measures it.

    .. pydrake_system::

        name: FaultySensor
        input_ports:
        - true
        output_ports:
        - measured

    - `true`, `measured` (size): see `sensed`.

    The discrete state is what is held (size), taken at the fault's start.

    Args:
        size: Of the vector.
        fault: What is wrong, and when.
    """

    def __init__(self, size: int, fault: SensorFault):
        super().__init__()
        self._fault = fault
        self._port = self.DeclareVectorInputPort("true", size)
        self.DeclareDiscreteState(size)
        self.DeclarePeriodicDiscreteUpdateEvent(ONLY_ONCE, fault.start, self._hold)
        self.DeclareVectorOutputPort("measured", size, self._calc)

    def _hold(self, context, state):
        state.set_value(self._port.Eval(context))

    def _calc(self, context, output):
        output.SetFromVector(sensed(self._fault, context.get_time(), self._port.Eval(context),
                                    context.get_discrete_state_vector().value()))

    @staticmethod
    def AddToBuilder(builder: DiagramBuilder, fault: SensorFault, *, true: OutputPort,
                     name: str = "faulty_sensor") -> "FaultySensor":
        """Adds the sensor of the vector that `true` gives."""
        system = FaultySensor(true.size(), fault)
        builder.AddNamedSystem(name, system)
        builder.Connect(true, system.GetInputPort("true"))
        return system


def brake_torque(inertia: float, stretch: float, rate: float) -> float:
    """Returns the torque [N m] that takes a joint back to where it is held.

    Args:
        inertia: Of the joint alone [kg m²].
        stretch: How far it is from there [rad].
        rate: q̇ [rad/s].
    """
    stiffness, damping = BRAKE
    return -inertia * (stiffness * stretch + damping * rate)


class JointBrake(LeafSystem):
    """Puts a brake in place of a joint's torque.

    .. pydrake_system::

        name: JointBrake
        input_ports:
        - commanded
        - state
        output_ports:
        - tau

    - `commanded`, `tau`: τ (6+n), wrench on the vehicle in body axes and joint torques [N, N m].
    - `state`: (𝔮, ζ) (2(6+n)), in the paper's order.

    The discrete state is the angle that is held (1), taken at the fault's start.

    Args:
        model: Supplies the joint's inertia.
        fault: Which joint, and from when on.
    """

    def __init__(self, model: UvmsModel, fault: StuckJoint):
        super().__init__()
        require(0 <= fault.joint < model.num_joints, "joint", fault.joint,
                f"an index from 0 to {model.num_joints - 1}")
        self._model, self._row, self._start = model, 6 + fault.joint, fault.start
        self._tau_port = self.DeclareVectorInputPort("commanded", model.size)
        self._state_port = self.DeclareVectorInputPort("state", 2 * model.size)
        self.DeclareDiscreteState(1)
        self.DeclarePeriodicDiscreteUpdateEvent(ONLY_ONCE, fault.start, self._hold)
        self.DeclareVectorOutputPort("tau", model.size, self._calc)

    def _hold(self, context, state):
        state.set_value(self._state_port.Eval(context)[[self._row]])

    def _calc(self, context, output):
        tau = self._tau_port.Eval(context).copy()
        if context.get_time() > self._start:
            config, zeta = np.split(self._state_port.Eval(context), 2)
            row = self._row
            held = context.get_discrete_state_vector().value()[0]
            inertia = self._model.mass_matrix(self._model.kinematics(config))[row, row]
            tau[row] = brake_torque(inertia, config[row] - held, zeta[row])
        output.SetFromVector(tau)

    @staticmethod
    def AddToBuilder(builder: DiagramBuilder, model: UvmsModel, fault: StuckJoint, *,
                     commanded: OutputPort, state: OutputPort,
                     name: str = "joint_brake") -> "JointBrake":
        """Adds the brake and connects it; the arguments are its constructor's and its inputs."""
        system = JointBrake(model, fault)
        builder.AddNamedSystem(name, system)
        builder.Connect(commanded, system.GetInputPort("commanded"))
        builder.Connect(state, system.GetInputPort("state"))
        return system
