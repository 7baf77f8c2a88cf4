"""Faults of limited duration of the sensors of the state and of the contact force."""

from abc import abstractmethod
from dataclasses import dataclass, field
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydrake.systems.framework import DiagramBuilder, OutputPort

from uvms_drake.common.constraints import NotNegative, Positive, Vector
from uvms_drake.model.signals.fault import Fault, FaultySignal
from uvms_drake.model.signals.sensor_actuator import Part, Signals
from uvms_drake.model.uvms_model import UvmsModel


@dataclass
class SensorFault(Fault, Part):
    """Fault of the sensor of the state, or of another vector."""

    place: ClassVar[Literal["sensing", "force"]] = "sensing"

    start: Annotated[float, NotNegative] = 0.0
    """Beginning of the fault, just after this instant [s]."""
    duration: Annotated[float, Positive] = 0.5
    """Duration of the fault [s]."""

    @abstractmethod
    def faulty(self, true: np.ndarray, frozen: np.ndarray) -> np.ndarray:
        """Returns the measurement during the fault; `frozen` is the vector at its start."""

    def add_to(self, builder: DiagramBuilder, model: UvmsModel, port: OutputPort,
               signals: Signals, seed: int) -> OutputPort:
        """Adds a `FaultySignal`; see `Part`."""
        return FaultySignal.AddToBuilder(
            builder, self, lambda true, frozen, _: self.faulty(true, frozen), port.size(),
            port.size(), name="faulty_sensor", signal=port, watched=port).get_output_port()


@dataclass
class FrozenState(SensorFault):
    """Frozen state: that at `start`, or at the beginning of a simulation after it."""

    def faulty(self, true: np.ndarray, frozen: np.ndarray) -> np.ndarray:
        """Returns the measurement at the start."""
        return frozen


@dataclass
class LostState(SensorFault):
    """Missing state: not a number."""

    start: Annotated[float, Positive] = 1.0
    """Beginning, just after this instant [s]; above 0: the first plan needs a measured state."""

    def faulty(self, true: np.ndarray, frozen: np.ndarray) -> np.ndarray:
        """Returns NaN."""
        return np.full_like(frozen, np.nan)


@dataclass
class JumpedPosition(SensorFault):
    """Measured position of the vehicle with an offset, as after a wrong position fix."""

    jump: Annotated[np.ndarray, Vector(3)] = field(
        default_factory=lambda: np.array([0.1, 0.0, 0.0]))
    """Offset in Σ_I (3,) [m]."""

    def faulty(self, true: np.ndarray, frozen: np.ndarray) -> np.ndarray:
        """Returns the measurement with the offset."""
        return true + np.append(self.jump, np.zeros(len(true) - 3))


class ForceFault(SensorFault):
    """Fault of the measured force 𝔉_s, of any sensor.

    Under faults that are detected an unknown wall is pressed no harder than F_max, as long as its
    tube holds: the safe region stays, plans advance no further without readings, and retreat if
    they stay missing, control/contact/theory.md#retreat-without-readings. Until then, and during
    the retreat, no certificate covers the tube.
    """

    place = "force"


@dataclass
class LostForce(ForceFault):
    """The measured force is not a number; the law goes on with the last one that was.

    In a sensed contact the tip retreats after as many readings as the sensor's `patience`, without
    a force in the law, and continues by itself with the next reading.
    """

    def faulty(self, true: np.ndarray, frozen: np.ndarray) -> np.ndarray:
        """Returns NaN."""
        return np.full_like(true, np.nan)


@dataclass
class FrozenForce(ForceFault):
    """The measured force keeps its value at `start`.

    A force from before the touch, taken for new, would let the tip press without end. After as many
    equal readings as a `ForceFaultDetector` has `repeats`, it is lost. Those before it are older
    than they seem by less than the window W of the safe region allows for. Of a sensor that is as
    quiet as a frozen one (`sensing.force_fault_detector`) it is not detected.
    """

    def faulty(self, true: np.ndarray, frozen: np.ndarray) -> np.ndarray:
        """Returns the measurement at the start."""
        return frozen


@dataclass
class SaturatedForce(ForceFault):
    """No component of the measured force is larger than `largest`.

    A `ForceFaultDetector` rejects a force from the declared end of the sensor's range on, from the
    first reading on. A sensor that saturates below is not detected: its readings hide a part of the
    force, and the tip may press harder by that part.
    """

    largest: Annotated[float, NotNegative] = 10.0
    """Largest component, either way [N, N m]."""

    def faulty(self, true: np.ndarray, frozen: np.ndarray) -> np.ndarray:
        """Returns the measurement, cut."""
        return np.clip(true, -self.largest, self.largest)


@dataclass
class JumpedForce(ForceFault):
    """The measured force has a bias that was not there when it was tared.

    It is covered as part of the declared error of the force; beyond that it is not: friction and
    contact may change the force as fast, so no detector tells the jump from them, and a bias that
    hides a part of the force lets the tip press harder by that part.
    """

    jump: Annotated[np.ndarray, Vector(6)] = field(
        default_factory=lambda: np.array([5.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
    """Bias of 𝔉_s, in Σ_I (6,) [N (3), N m (3)]."""

    def faulty(self, true: np.ndarray, frozen: np.ndarray) -> np.ndarray:
        """Returns the measurement with the bias."""
        return true + self.jump


@dataclass
class MiscalibratedForce(ForceFault):
    """The measured force has other gains, cross-talk between its axes, and an error of the depth.

    With C = 1 + diag(gain), and `crosstalk` off the diagonal within force and within torque, the
    reading is C 𝔉_s + depth (z − z₀), z − z₀ the depth below that at `start`: a sensor is loaded by
    the water's pressure. No detector tells it from a force.
    """

    gain: Annotated[np.ndarray, Vector(6)] = field(default_factory=lambda: np.zeros(6))
    """Relative error of each component of 𝔉_s, in Σ_I (6,)."""
    crosstalk: float = 0.0
    """Share of each other component of force (torque) that is in a component of it."""
    depth: Annotated[np.ndarray, Vector(6)] = field(default_factory=lambda: np.zeros(6))
    """Error by the depth of the end-effector (6,) [N/m (3), N (3)]."""

    def faulty(self, true: np.ndarray, frozen: np.ndarray) -> np.ndarray:
        """Returns the measurement C 𝔉_s at an unchanged depth."""
        cross = self.crosstalk * np.kron(np.eye(2), 1.0 - np.eye(3))
        out: np.ndarray = true + self.gain * true + cross @ true
        return out

    def add_to(self, builder: DiagramBuilder, model: UvmsModel, port: OutputPort,
               signals: Signals, seed: int) -> OutputPort:
        """Adds a `FaultySignal` that watches the end-effector; see `Part`."""
        def law(true: np.ndarray, start: np.ndarray, now: np.ndarray) -> np.ndarray:
            return self.faulty(true, true) + self.depth * (now[2] - start[2])

        return FaultySignal.AddToBuilder(
            builder, self, law, port.size(), 6, name="faulty_sensor", signal=port,
            watched=signals["chi"]).get_output_port()
