"""Interface of sensors and actuators between plant and controller, the `Part`s of the loop."""

from abc import ABC, abstractmethod
from typing import NamedTuple

import numpy as np
from pydrake.systems.framework import DiagramBuilder, OutputPort

from uvms_drake.common.errors import require
from uvms_drake.model.signals.command_path import IDEAL_PATH, CommandPath
from uvms_drake.model.uvms_model import UvmsModel

MEASURED_FORCE = "force_measured"
"""Name of the signal 𝔉_s (6) [N, N m], force in Σ_I and torque conjugate to Euler rates. If a part
of sensing provides it, the law takes it in place of the modelled force."""

VEHICLE_WRENCH = "vehicle_wrench"
"""Name of the signal τ_v (6) [N, N m] in body axes: the present wrench of the thrusters on the
vehicle, by their model driven by the commands. A law that `takes_wrench` takes it from a part of
actuation. Its port may depend on states alone: a direct feedthrough from the command closes an
algebraic loop, which Drake refuses."""

TICK = "tick"
"""Name of the signal (1) whose changes are the ticks of a clock outside of the Diagram, if it has
one: a `SampledCommand` goes by them in place of a clock of its own."""

SAFETY = ("mode", "cause", "time", "stiffness", "isolated")
"""Entries of the signal `safety` of a `Supervisor`: its mode; index of the cause from 1, 0 before
the trip; time of the trip [s]; stiffness of the wall by the touch [N/m], NaN if unknown; number of
the thruster whose power it cuts, from 1, 0 for none."""

CAUSES = {
    "force": "the force is above the declared one",
    "slope": "the wall is stiffer than declared",
    "tip": "the end-effector is off its plan",
    "tool": "the attitude of the end-effector is off its plan",
    "joints": "the joints are off their plan",
    "fix": "position and velocity are without a fix",
    "drift": "the water or a thruster drives the vehicle away",
    "raised": "the law failed",
    "cut": "the commands are beyond the limits of thrusters and joints",
    "plan": "there is no new plan",
    "force_lost": "the force is not measured",
}
"""Causes of a trip of a `Supervisor` by name, each with its sentence; the signal has the index,
from 1."""

PAYLOAD, PAYLOAD_AT_REST = "payload", "payload_at_rest"
"""Names of the signals (6) [N, N m] of a plant with a payload: the wrench on the payload, about
the origin of the end-effector in its axes, and the static part of it."""


class Signals(dict[str, OutputPort]):
    """The vectors of a closed loop by name; all of them are logged.

    A name is given once: a signal cannot be replaced.
    """

    def __setitem__(self, name: str, port: OutputPort) -> None:
        require(name not in self, "signal", name,
                "given by one part only, and another one gives it already")
        super().__setitem__(name, port)


class Component:
    """Component that a scenario can add to the closed loop."""

    def check(self) -> None:
        """Raises `InvalidParameter` for the first value that has no meaning."""

    def assumption(self) -> str | None:
        """Returns the assumption of the proofs that it breaks, or None if they still hold.

        By default it breaks one, and there is no certificate.
        """
        return "nothing is proven about it"


class ForceReading(NamedTuple):
    """Bounds of a force measurement F̂ = HF + e, H a first-order lag with sample and hold."""

    error: np.ndarray
    """Bound of each component of e (6,) in axes of the tip, about it [N, N m]."""
    lag: float
    """Time constant T [s]."""
    period: float
    """h [s]."""
    tare: float = 0.0
    """Duration of the tare at the start, without contact [s]."""
    repeated: float = 1.0
    """Largest probability that a reading repeats the last one in all six components, see
    `sensing.force_fault_detector`; 1: none is known."""
    largest: float = np.inf
    """Largest norm of a force that is surely within the sensor's range [N]."""
    constant: np.ndarray = np.zeros(6)
    """Part of `error` that never changes, as the error of a tare (6,) [N, N m]."""
    likely_constant: np.ndarray = np.zeros(6)
    """The same if the noise of samples is independent: within three standard deviations."""
    payload: tuple[float, float] = (0.0, 0.0)
    """Bounds of the norms of a further error's force [N] and of its torque about the tip [N m], as
    of an unknown payload."""

    def likely(self) -> "ForceReading":
        """Returns the reading with a constant error that is only likely."""
        return self._replace(error=self.error - self.constant + self.likely_constant,
                             constant=self.likely_constant)

    def missing(self, delay: float) -> float:
        """Returns the largest weight that forces older than `delay` [s] have in a reading."""
        if self.lag == 0.0:
            return 0.0 if delay >= self.period else 1.0
        return float(np.exp(-max(delay - self.period, 0.0) / self.lag))


class Part(Component, ABC):
    """A part in series from plant to controller (sensing) or from controller to plant (actuation).

    It is a dataclass, whose fields are its settings.
    """

    @abstractmethod
    def add_to(self, builder: DiagramBuilder, model: UvmsModel, port: OutputPort,
               signals: Signals, seed: int) -> OutputPort:
        """Adds the part after `port`, and returns the port of the same size that takes its place.

        The returned port has to be valid from the start: the first plan is made at the
        initialization, before any event of the part. A delayed signal has its initial value until
        then.

        Args:
            builder: Builder to add systems to, with names of the part's own.
            model: The controller's model.
            port: The measured (𝔮, ζ) (2(6+n)) or the command τ (6+n) [N, N m].
            signals: Signals to read, and to add to, so that they are logged. `state` is the true
                one.
            seed: Seed of random numbers, zero or positive.
        """

    def reading(self, time: float, turning: float) -> ForceReading | None:
        """Returns the bounds of its force measurement; None, the default: it measures none.

        Args:
            time: End of the run [s].
            turning: Bound of the angular velocity of the end-effector [rad/s].
        """
        return None

    def command_path(self, model: UvmsModel) -> CommandPath:
        """Returns the path of a command through it, by the controller's model; default: ideal."""
        return IDEAL_PATH


class Sensor(Part):
    """Part between the robot's state and the controller, of the list `sensing`."""


class Actuator(Part):
    """Part between the controller's command and the robot, of the list `actuation`."""
