"""Path of the commands from a law to the robot: clock, delay, dead time and lag.

::

                     clock h, δ              thrusters h_t, D, T
                  ┌─────────────────┐          ┌────────────┐
    τ of the law ─▶ sample and hold ├─┬───────▶│ delay, lag ├──▶ wrench on the vehicle
                  └─────────────────┘ │        └────────────┘
                                      └───────────────────────▶ torques of the joints

Each part of the actuation has a path, and the path of the whole is that through one after another.
"""

import math
from dataclasses import dataclass

SAME = 1e-6
"""Tolerance of equal times, over a period."""
KNOTS_CHECKED = 10_000
"""Knots at which a clock has to tick at the very same number of seconds: half an hour of 0.2 s."""


@dataclass(frozen=True)
class CommandPath:
    """Path of a command: a clock, which samples and holds all of it, and thrusters behind it."""

    period: float = 0.0
    """Period h of the clock [s]; zero for a continuous command."""
    delay: float = 0.0
    """Delay δ from a tick of the clock to the output of its command [s]."""
    thruster_period: float = 0.0
    """Period h_t of the thrusters' own sample and hold of the wrench [s]; zero for none."""
    dead_time: float = 0.0
    """Dead time D of the thrusters from a sample to the first change of a force [s]."""
    lag: float = 0.0
    """Mean time constant T of the thrusters' forces [s]."""
    foreseen: bool = True
    """Whether a plan's forces are commanded in advance, see `preview`."""
    thruster_error: tuple[tuple[float, ...], ...] = ()
    """Largest error of the wrench of each thruster by the controller's model (m, 6) [N, N m]."""
    undriven: tuple[int, ...] = ()
    """Axes of the vehicle without thrusters."""
    unknown: tuple[str, ...] = ()
    """Unmodelled effects."""

    def then(self, after: "CommandPath") -> "CommandPath":
        """Returns the path through this one and then another.

        Of a clock and thrusters either has one at most, so that their times add up; another order
        is an unmodelled effect.
        """
        unknown = self.unknown + after.unknown
        if (after.joint_age > 0.0 and self.vehicle_age > 0.0) or (
                after.has_thrusters and self.has_thrusters):
            unknown += ("another order of parts than a clock and then thrusters",)
        elif self.period > 0.0 and after.thruster_period > 0.0:
            samples = self.period / after.thruster_period
            if abs(samples - round(samples)) > SAME * samples:
                unknown += ("a clock whose period is no multiple of that of the thrusters",)
        return CommandPath(
            self.period + after.period, self.delay + after.delay,
            self.thruster_period + after.thruster_period, self.dead_time + after.dead_time,
            self.lag + after.lag, self.foreseen and after.foreseen,
            self.thruster_error + after.thruster_error, self.undriven + after.undriven, unknown)

    @property
    def has_thrusters(self) -> bool:
        """True if there are thrusters, of which a law measures the present wrench."""
        return self.thruster_period > 0.0 or self.dead_time > 0.0 or self.lag > 0.0

    @property
    def vehicle_period(self) -> float:
        """Time between two commands to the vehicle [s]; zero for a continuous one."""
        return self.period or self.thruster_period

    @property
    def vehicle_dead_time(self) -> float:
        """Delay from a tick to the arrival of its command at the lag of the thrusters [s].

        Thrusters are sampled by a clock of their own. A command that goes out at δ after a tick
        meets the first sample after δ, at a constant delay if h is a multiple of h_t.
        """
        wait = self.delay
        if self.period > 0.0 and self.thruster_period > 0.0:
            wait = self.thruster_period * (
                1.0 + math.floor(self.delay / self.thruster_period + SAME))
        return wait + self.dead_time

    @property
    def vehicle_age(self) -> float:
        """Largest mean age of the wrench's acting command [s]: |(G − 1)f| ≤ age · sup|ḟ|."""
        return self.vehicle_period + self.vehicle_dead_time + self.lag

    @property
    def joint_age(self) -> float:
        """Largest age of the acting command of the joints [s]."""
        return self.period + self.delay

    @property
    def mean_delays(self) -> tuple[float, float]:
        """Delays of slow signals [s]: of the vehicle's wrench, and of the joints' torques.

        A hold counts half of its period, a lag its time constant.
        """
        joints = self.delay + 0.5 * self.period
        return joints + (self.dead_time + 0.5 * self.thruster_period + self.lag), joints

    @property
    def preview(self) -> tuple[float, float]:
        """Times ℓ by which the forces of a plan are commanded earlier, likewise [s].

        They are the mean delays if thrusters follow and the plan is foreseen. Behind a clock alone
        only the knots of a plan are delayed, and with a preview they would come early. See
        `control.feedback.feedforward_preview`.
        """
        return self.mean_delays if self.has_thrusters and self.foreseen else (0.0, 0.0)

    def ticks_at_knots(self, time_step: float) -> bool:
        """Returns whether the knots of plans are ticks to the last digit: a tick has its plan then.

        Args:
            time_step: Time step of a plan [s].
        """
        period = self.vehicle_period
        ticks = round(time_step / period)
        return all(k * time_step == k * ticks * period for k in range(KNOTS_CHECKED))


IDEAL_PATH = CommandPath()
"""Path of a command that acts at once."""
