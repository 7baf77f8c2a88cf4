"""Path of the commands from a law to the robot: clock, delay, dead time and lag.

::

                     clock h, δ              thrusters h_t, D, T
                  ┌─────────────────┐          ┌────────────┐
    τ of the law ─▶ sample and hold ├─┬───────▶│ delay, lag ├──▶ wrench on the vehicle
                  └─────────────────┘ │        └────────────┘
                                      └───────────────────────▶ torques of the joints

Each part of the actuation has a path, and the path of the whole is that through one after another.
"""

from typing import NamedTuple


class CommandPath(NamedTuple):
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

    def then(self, after: "CommandPath") -> "CommandPath":
        """Returns the path through this one and then another, whose times add up."""
        return CommandPath(*map(sum, zip(self, after, strict=True)))

    @property
    def has_thrusters(self) -> bool:
        """True if there are thrusters, of which a law measures the present wrench."""
        return any(self[2:])

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

        They are the mean delays if thrusters follow. Behind a clock alone only the knots of a plan
        are delayed, and with a preview they would come early. See
        `control.feedback.feedforward_preview`.
        """
        return self.mean_delays if self.has_thrusters else (0.0, 0.0)


IDEAL_PATH = CommandPath()
"""Path of a command that acts at once."""
