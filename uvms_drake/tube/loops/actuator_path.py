"""Clocks, dead times and lags from the command of a law to the robot."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from uvms_drake.model.signals.sensor_actuator import ON_TIME, ActuationDelay, CommandPath

SAME = 1e-6
"""Tolerance of equal times, over a period."""
KNOTS_CHECKED = 10_000
"""Knots at which a clock has to tick at the very same number of seconds: half an hour of 0.2 s."""


@dataclass(frozen=True)
class Path:
    """G of `tube.loops.row_loop`: a hold, a dead time and a first-order lag."""

    period: float = 0.0
    """h [s]; zero for a continuous feedback."""
    dead_time: float = 0.0
    """Delay from a tick to the arrival of its command at the actuator [s]."""
    lag: float = 0.0
    """T [s]."""
    preview: float = 0.0
    """ℓ, time by which the plan's forces are commanded earlier [s], see
    `control.feedback.feedforward_preview`."""

    @property
    def age(self) -> float:
        """Largest mean age of the acting command [s]: |(G − 1)f| ≤ age · sup|ḟ|."""
        return self.period + self.dead_time + self.lag


@dataclass(frozen=True)
class Actuators:
    """Paths of the vehicle's wrench and of the joints' torques."""

    vehicle: Path = Path()
    joints: Path = Path()
    thrusters: bool = False
    """True if the law measures the present wrench of the thrusters."""
    off: np.ndarray = field(default_factory=lambda: np.zeros((6, 0)))
    """Wrench error of each thruster by its model (6, m) [N, N m]."""
    undriven: tuple[int, ...] = ()
    """Axes of the vehicle without thrusters."""
    unknown: tuple[str, ...] = ()
    """Effects without a path."""

    @property
    def delayed(self) -> bool:
        """True if either path has a delay."""
        return self.vehicle.age > 0.0 or self.joints.age > 0.0


def actuators_of(paths: Sequence[CommandPath | None], preview: ActuationDelay = ON_TIME
                 ) -> Actuators:
    """Returns the actuators of a chain: thrusters behind a clock, either of them or none.

    Thrusters are sampled by a clock of their own. A command that goes out at δ after a tick meets
    the first sample after δ, at a constant delay if the period is a multiple of theirs.
    """
    out = Actuators()
    for path in paths:
        if path is None:
            return Actuators(unknown=("a part without a known delay",))
        if path.period == path.delay == path.lag == 0.0:
            continue  # An ideal wrench.
        if path.whole and not out.delayed:
            both = Path(path.period, path.delay, path.lag)
            out = Actuators(both, both, unknown=path.unknown)
        elif not path.whole and not out.thrusters:
            before, unknown = out.vehicle, out.unknown + path.unknown
            wait, period = 0.0, path.period
            if before.period > 0.0:
                samples, period = before.period / path.period, before.period
                if abs(samples - round(samples)) > SAME * samples:
                    unknown += ("a clock whose period is no multiple of that of the thrusters",)
                wait = path.period * (1.0 + np.floor(before.dead_time / path.period + SAME))
            out = Actuators(Path(period, wait + path.delay, path.lag), out.joints, True,
                            path.off, path.undriven, unknown)
        else:
            return Actuators(unknown=("another order of parts than a clock and then thrusters",))
    return replace(out, vehicle=replace(out.vehicle, preview=preview.vehicle),
                   joints=replace(out.joints, preview=preview.joints))


def at_ticks(time_step: float, period: float) -> bool:
    """Returns whether the knots of plans are ticks to the last digit: then a tick has its plan."""
    ticks = round(time_step / period)
    return all(k * time_step == k * ticks * period for k in range(KNOTS_CHECKED))


def lagged_alone(actuators: Actuators, time_step: float) -> bool:
    """Returns whether there are delayed thrusters, on all axes and as known, and no more.

    Then `tube.actuation.lagged_wrench` has a proof, if no plan is commanded ahead and its knots
    are ticks.

    Args:
        actuators: The actuators.
        time_step: Time step of a plan [s].
    """
    vehicle = actuators.vehicle
    return (actuators.thrusters and vehicle.period > 0.0 and vehicle.preview == 0.0
            and actuators.joints == Path() and not np.any(actuators.off)
            and not actuators.undriven and not actuators.unknown
            and at_ticks(time_step, vehicle.period))
