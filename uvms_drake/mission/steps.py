"""Steps of a mission, as in a scenario's file.

*Places* (a, b) are lengths along two directions t₁, t₂ across the declared direction n of a
contact, from the place of the task: down and to port, on a floor or a ceiling north and east or
west (`wall_axes`). Depths are along n. Neither depends on the wall's shape.

*Spots.* A mission is a sequence of spots, each of them

    !Approach, then any number of !Hold and !Slide, then !Retreat,

so every contact has a planned end: after any failure at a spot its retreat is next.

*A step of one's own* derives from `Pressing`: it is one in contact, between an approach and a
retreat. A step is a record of data, with its references by time and whether it is done; the state
machine is in `law`.
"""

import math
from dataclasses import dataclass, field, replace
from typing import Annotated, ClassVar

import numpy as np

from uvms_drake.common.constraints import Between, NotNegative, OneOf, Positive, Vector
from uvms_drake.common.errors import require
from uvms_drake.common.kinds import offer
from uvms_drake.common.schema import check_values, checked

ROUNDING = 1e-9
"""Largest difference of two sums of periods [s]."""
REACHED = 0.01
"""Largest distance of the tip from a place that is reached [m]."""
FAILURES = ("skip", "retry", "home")
"""Continuations after the retreat from a spot with a failed step: the next spot; the same again, at
most the mission's `retries`, and then the next; or the end."""


@dataclass
class Step:
    """Step of a mission."""

    touches: ClassVar[bool] = False
    """Whether it needs a contact made by an earlier step."""
    force = 0.0
    """Desired force along n [N]."""
    tolerance = 0.0
    """Largest deviation of the measured force [N]."""
    on_failure = "skip"
    """Continuation after it has failed, one of `FAILURES`."""
    along = np.zeros(2)
    """Displacement (a, b) from its place at the beginning to that at the end [m]."""
    speed = 0.0
    """Speed along that line [m/s]."""
    least_time = 0.0
    """Shortest duration without a failure [s]; zero if unknown."""

    timeout: Annotated[float, Positive] = 60.0
    """Time-out [s]."""

    def check(self) -> None:
        """Raises `InvalidParameter` unless there is time enough."""
        require(self.least_time < self.timeout, "timeout", self.timeout,
                f"more than the {self.least_time:.3g} s that it takes")

    @property
    def strongest(self) -> float:
        """Largest desired force [N]."""
        return self.force

    @property
    def fastest(self) -> np.ndarray:
        """Speed along t₁ and along t₂ in contact (2,) [m/s]."""
        length = float(np.linalg.norm(self.along))
        return np.abs(self.along) * (self.speed / length if length > 0.0 else 0.0)

    def desired_force(self, spent: float, searching: bool) -> float:
        """Returns the desired force along n [N], at a time after its beginning [s].

        Args:
            spent: Time since its beginning [s].
            searching: Whether an approach searches for the wall.
        """
        return self.force

    def displacement(self, spent: float) -> np.ndarray:
        """Returns the displacement (a, b) of its place at a time after its beginning (2,) [m]."""
        return np.zeros(2)

    def is_done(self, spent: float, steady: float, there: bool, searching: bool) -> bool:
        """Returns whether it is done; by default as soon as the tip is at its destination.

        Args:
            spent: Time since its beginning [s].
            steady: Time for which the force has been within its tolerance [s]; NaN if it is not.
            there: Whether the tip is at its destination.
            searching: Whether an approach searches for the wall.
        """
        return there


@dataclass
class Pressing(Step):
    """Step with a desired force along n."""

    force: Annotated[float, Positive] = 10.0
    """Desired force along n [N]."""
    tolerance: Annotated[float, Positive] = 2.0
    """Largest deviation of the measured force [N]."""
    on_failure: Annotated[str, OneOf(*FAILURES)] = "skip"
    """Continuation after the retreat from a spot at which this step failed: `skip` to the next
    spot, `retry` the spot, or `home`: end the mission."""


@dataclass
class Approach(Pressing):
    """Motion to a place off the wall, then along n until it presses.

    Done after a touch and a force within its tolerance during `settle`.
    """

    at: Annotated[np.ndarray, Vector(2)] = field(default_factory=lambda: np.zeros(2))
    """Place (a, b) [m]."""
    within: Annotated[float, Positive] = 0.5
    """Search distance along n [m]."""
    settle: Annotated[float, NotNegative] = 1.0
    """Time of the force within its tolerance [s]."""

    @property
    def least_time(self) -> float:  # type: ignore[override]
        """`settle`: the time of the motion to the wall is unknown."""
        return self.settle

    def desired_force(self, spent: float, searching: bool) -> float:
        """Returns `force` while it searches for the wall, or presses on it."""
        return self.force if searching else 0.0

    def is_done(self, spent: float, steady: float, there: bool, searching: bool) -> bool:
        """Returns whether it presses for long enough."""
        return searching and bool(steady + ROUNDING >= self.settle)


@dataclass
class Hold(Pressing):
    """Pressing at a place.

    Done after a force within its tolerance during `seconds` without interruption.
    """

    touches: ClassVar[bool] = True

    seconds: Annotated[float, NotNegative] = 5.0
    """Time of the force within its tolerance [s]."""

    @property
    def least_time(self) -> float:  # type: ignore[override]
        """`seconds`."""
        return self.seconds

    def is_done(self, spent: float, steady: float, there: bool, searching: bool) -> bool:
        """Returns whether it presses for long enough."""
        return bool(steady + ROUNDING >= self.seconds)


@dataclass
class Slide(Pressing):
    """Motion along a line with the force F(t) = force + amplitude sin(2π frequency t).

    Done when the reference and the tip are at the line's end. The tool keeps its attitude.
    """

    touches: ClassVar[bool] = True

    along: Annotated[np.ndarray, Vector(2)] = field(default_factory=lambda: np.array([0.2, 0.0]))
    """Displacement (a, b) from the beginning to the end of the line [m]."""
    speed: Annotated[float, Positive] = 0.02
    """Speed along the line [m/s]."""
    amplitude: Annotated[float, NotNegative] = 0.0
    """Amplitude of a sine that is added to the force [N]."""
    frequency: Annotated[float, NotNegative] = 0.0
    """Frequency of that sine [Hz]."""

    def check(self) -> None:
        """Raises `InvalidParameter` unless it moves, within its time, and always presses."""
        super().check()
        require(bool(np.any(self.along)), "along", self.along, "not zero")
        require(self.amplitude < self.force, "amplitude", self.amplitude,
                f"less than the force, {self.force:g} N")

    @property
    def least_time(self) -> float:  # type: ignore[override]
        """Time from the beginning to the end of the line [s]."""
        return float(np.linalg.norm(self.along)) / self.speed

    @property
    def strongest(self) -> float:
        """Largest desired force [N]."""
        return self.force + self.amplitude

    def desired_force(self, spent: float, searching: bool) -> float:
        """Returns force + amplitude sin(2π frequency t)."""
        return self.force + self.amplitude * math.sin(math.tau * self.frequency * spent)

    def displacement(self, spent: float) -> np.ndarray:
        """Returns the part of the line that is over."""
        done: np.ndarray = self.along * min(spent / self.least_time, 1.0)
        return done

    def is_done(self, spent: float, steady: float, there: bool, searching: bool) -> bool:
        """Returns whether reference and tip are at the end of the line."""
        return spent >= self.least_time - ROUNDING and there


@dataclass
class Retreat(Step):
    """Motion straight back along n.

    Done when the tip is `distance` less deep. If it fails, the mission is over.
    """

    distance: Annotated[float, Positive] = 0.1
    """Distance back from the place at its beginning [m]."""


offer(Step, Approach, Hold, Slide, Retreat)


@dataclass
class Mission:
    """List of steps, with the tolerances of all of them."""

    steps: list[Step] = field(default_factory=list)
    """Steps, spot by spot; none: there is no mission."""
    retries: Annotated[int, Between(0, 100)] = 1
    """Largest number of retries of a spot whose failed step has `on_failure: retry`."""
    patience: Annotated[float, NotNegative] = 0.5
    """Largest time of a lost contact during a hold or slide [s]."""
    on_retreat: Annotated[str, OneOf("end", "skip", "retry")] = "end"
    """Continuation after a retreat of the supervisor: the end, or the next spot, or the same one
    again, unless its force or stiffness was above the declared one; once the robot stands and all
    that is watched is as declared again."""
    lead: Annotated[float, NotNegative] = 0.0
    """Lead of the references for places and forces of a slide, the lag of the tip [s]."""

    def checked(self) -> "Mission":
        """Returns the mission with arrays, or raises."""
        check_values(self)
        return replace(self, steps=[checked(step) for step in self.steps])

    def check(self) -> None:
        """Raises `InvalidParameter` unless the steps are spots, see the module."""
        away = True
        for i, step in enumerate(self.steps):
            fits = isinstance(step, Approach) == away
            require(fits, f"steps[{i}]", type(step).__name__, "an !Approach: nothing is touched"
                    if away else
                    "!Hold, !Slide or !Retreat: the last !Approach has no !Retreat yet")
            away = isinstance(step, Retreat)
        require(away, f"steps[{len(self.steps) - 1}]",
                type(self.steps[-1]).__name__ if self.steps else None,
                "a !Retreat, as the last step")

    def spot(self, i: int) -> tuple[int, int]:
        """Returns the indices of the approach and of the retreat of the spot of a step."""
        first = max(j for j in range(i + 1) if isinstance(self.steps[j], Approach))
        last = min(j for j in range(i, len(self.steps)) if isinstance(self.steps[j], Retreat))
        return first, last
