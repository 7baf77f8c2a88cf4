"""The interface of the parts between plant and controller, and of faults.

A part is one file in `sensing/` or `actuation/`, a fault one beside the system that it puts into
the loop.
"""

from abc import ABC, abstractmethod
from typing import ClassVar, Literal, NamedTuple

import numpy as np
from pydrake.systems.framework import DiagramBuilder, OutputPort

from uvms_drake.common.errors import require
from uvms_drake.model.uvms_model import UvmsModel

ONLY_ONCE = 1e9
"""Period [s] of an event that comes once in a run; Drake's systems have none without a period."""

MEASURED_FORCE = "force_measured"
"""Name of the signal 𝔉_s (6) [N, N m], force in Σ_I and torque conjugate to Euler rates. If a part
of sensing gives it, the law takes it in place of the force by the law of the surface."""

VEHICLE_WRENCH = "vehicle_wrench"
"""Name of the signal τ_v (6) [N, N m] in body axes: the wrench on the vehicle that the thrusters
give now, by their model driven by the commands. If a part of actuation gives it, a law that
`takes_wrench` takes it as it is. Its port is to come from states alone: with a direct feedthrough
from the command it closes an algebraic loop, which Drake refuses."""


class Signals(dict[str, OutputPort]):
    """The vectors of a closed loop by name; all of them are logged.

    A name is given once: nobody can replace another's signal.
    """

    def __setitem__(self, name: str, port: OutputPort) -> None:
        require(name not in self, "signal", name,
                "given by one part only, and another one gives it already")
        super().__setitem__(name, port)


class Component:
    """Something that a scenario can put into the closed loop."""

    motions: ClassVar[tuple[str, ...]] = ("dynamic", "kinematic")
    """Motions of a scenario with which it has a meaning."""

    def check(self) -> None:
        """Raises `InvalidParameter` for the first value that has no meaning."""

    def assumption(self) -> str | None:
        """Returns the assumption of the proofs that it breaks, or None if they still hold.

        By default nothing is proven, and there is no certificate.
        """
        return "nothing is proven about it"


class ForceReading(NamedTuple):
    """What is known of a measured force: F̂ = HF + e, H a lag that is sampled and held."""

    error: np.ndarray
    """Bound of each component of e (6,) in axes of the tip, about it [N, N m]."""
    lag: float
    """T [s]."""
    period: float
    """h [s]."""
    tare: float = 0.0
    """Time at the start in which nothing may be touched [s]."""
    noisy: bool = False
    """Whether noise moves all three components of the force in every reading, so that two that are
    equal come of a sensor that froze."""
    largest: float = np.inf
    """Norm of a force that is within the sensor's range whatever comes to it [N]."""

    def missing(self, delay: float) -> float:
        """Returns the largest weight that forces older than `delay` [s] have in a reading."""
        if self.lag == 0.0:
            return 0.0 if delay >= self.period else 1.0
        return float(np.exp(-max(delay - self.period, 0.0) / self.lag))


class ActuationDelay(NamedTuple):
    """How much later than it is commanded a force acts, as the controller believes [s].

    The delay of what changes slowly: a dead time, half a period of a hold, the constant of a lag.
    """

    vehicle: float = 0.0
    joints: float = 0.0


ON_TIME = ActuationDelay()
"""Forces that act at once."""


class CommandPath(NamedTuple):
    """How a command goes on, as is known: sampled, held, late by a dead time, behind a lag."""

    period: float
    """h [s]."""
    delay: float
    """From a sample to where it comes to the lag [s]."""
    lag: float = 0.0
    """T [s], in the mean."""
    whole: bool = True
    """Whether it is all of the command, and not the vehicle's wrench alone."""
    off: np.ndarray = np.zeros((6, 0))
    """The wrench that each thruster may be off by (6, m) [N, N m]."""
    undriven: tuple[int, ...] = ()
    """Axes of the vehicle that get nothing."""
    unknown: tuple[str, ...] = ()
    """What these numbers do not say of it."""
    foreseen: bool = True
    """Whether the plan's forces are asked for ahead, see `control.feedback.feedforward_preview`."""

    @property
    def actuation_delay(self) -> ActuationDelay:
        """How late a force is behind it, as far as a plan is asked for ahead."""
        if not self.foreseen:
            return ON_TIME
        late = self.delay + 0.5 * self.period + self.lag
        return ActuationDelay(late, late if self.whole else 0.0)


class Part(Component, ABC):
    """A part of a chain from plant to controller (sensing) or from controller to plant (actuation).

    It is a dataclass, whose fields are its settings.
    """

    @abstractmethod
    def add_to(self, builder: DiagramBuilder, model: UvmsModel, port: OutputPort,
               signals: Signals, seed: int) -> OutputPort:
        """Adds the part behind `port`, and returns the port of the same size that takes its place.

        Where it begins, the returned port has to be right already: the first plan is made at the
        initialization, before any event of the part has taken effect. What is late gives the
        state of the start until then.

        Args:
            builder: Where to add systems, by names that are the part's own.
            model: The controller's.
            port: The measured (𝔮, ζ) (2(6+n)) or the command τ (6+n) [N, N m]; if the motion is
                kinematic, 𝔮 (6+n) or the command ζ (6+n) [m/s, rad/s].
            signals: Signals to read, and to add to, so that they are logged. `state` is the true
                one.
            seed: Seed of random numbers, zero or positive.
        """

    def reading(self, time: float, turning: float) -> ForceReading | None:
        """Returns what is known of the force that it measures; None, as by default: nothing.

        Args:
            time: The end [s].
            turning: Bound of the angular velocity of the end-effector [rad/s].
        """
        return None

    def command_path(self, model: UvmsModel) -> CommandPath | None:
        """Returns what is known of what it makes of a command; None, as by default: nothing.

        Args:
            model: The controller's.
        """
        return None


class Fault(Component):
    """Something that fails in a run."""

    place: ClassVar[Literal["sensing", "force", "actuation", "solver", "disturbance"]]
    """Place in the loop: a chain, as a `Part` of it, where that of the force has `MEASURED_FORCE`
    on it; or the solver or the disturbance."""


def check_times(start: float, duration: float | None) -> None:
    """Raises `InvalidParameter` unless a fault's times [s] have a meaning."""
    require(0.0 <= start < np.inf, "start", start, "zero or positive")
    require(duration is None or 0.0 < duration < np.inf, "duration", duration, "positive")


def is_active(start: float, duration: float | None, time: float) -> bool:
    """Returns whether `time` [s] is in [start, start + duration)."""
    return start <= time and (duration is None or time < start + duration)
