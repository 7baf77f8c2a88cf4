"""Steps of a mission, as in a scenario's file.

*Places* (a, b) are lengths along two directions t₁, t₂ across the declared direction n of a
contact, from the place of the task: `SurfaceClass.axes`. For n = x of a world whose z points down
they are down and to port. Depths are along n. Neither depends on the wall's shape.

*Spots.* A mission is a sequence of spots, each of them

    !Approach, then any number of !Hold and !Slide, then !Retreat,

so every contact has a planned end: after any failure at a spot its retreat is next.

*A step of one's own* derives from `Step` or `Pressing`: it is one in contact, between an approach
and a retreat. The state machine in `law` asks a step for its references, for its end and whether it
is done; nothing depends on its type.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar, Literal

import numpy as np

from uvms_drake.common.errors import require, vector, within
from uvms_drake.common.kinds import offer

ROUNDING = 1e-9
"""Largest difference of two sums of periods [s]."""
FAILURES = ("skip", "retry", "home")
"""Continuations after the retreat from a spot with a failed step: the next spot; the same again, at
most the mission's `retries`, and then the next; or the end."""


@dataclass
class Step:
    """Step of a mission."""

    role: ClassVar[Literal["approach", "contact", "retreat"]] = "contact"
    """Its part of a spot: the beginning, in between, or the end."""
    touches: ClassVar[bool] = False
    """Whether it needs a contact made by an earlier step."""

    timeout: float = 60.0
    """Time-out [s]."""

    def checked(self) -> "Step":
        """Returns the step with arrays, or raises."""
        require(0.0 < self.timeout < np.inf, "timeout", self.timeout, "positive")
        return self

    @property
    def strongest(self) -> float:
        """Largest desired force [N]."""
        return 0.0

    @property
    def fastest(self) -> np.ndarray:
        """Speed along t₁ and along t₂ in contact (2,) [m/s]."""
        return np.zeros(2)

    @property
    def end(self) -> np.ndarray:
        """Displacement (a, b) from its place at the beginning to that at the end (2,) [m]."""
        return np.zeros(2)

    @property
    def line_speed(self) -> float:
        """Speed along the line to its end [m/s]; zero of a step without."""
        return 0.0

    @property
    def least_time(self) -> float:
        """Shortest duration without a failure [s]; zero if unknown."""
        return 0.0

    @property
    def largest_error(self) -> float:
        """Largest deviation of the force that it allows [N]; zero of a step without a force."""
        return 0.0

    @property
    def choice(self) -> str:
        """Continuation after it has failed, one of `FAILURES`."""
        return "skip"

    def desired_force(self, spent: float, searching: bool) -> float:
        """Returns the desired force along n [N], at a time after its beginning [s].

        Args:
            spent: Time since its beginning [s].
            searching: Whether an approach searches for the wall.
        """
        return 0.0

    def displacement(self, spent: float) -> np.ndarray:
        """Returns the displacement (a, b) of its place at a time after its beginning (2,) [m]."""
        return np.zeros(2)

    def is_pressed(self, force: float, asked: float) -> bool:
        """Returns whether a measured force is within its tolerance of the desired one [N]."""
        return False

    def is_there(self, tip: np.ndarray, place: np.ndarray, deepest: float, reached: float) -> bool:
        """Returns whether the tip is at the step's destination: by default its end.

        Args:
            tip: Depth and place of the tip (3,) [m].
            place: Place (a, b) of the step's beginning (2,) [m].
            deepest: Largest depth that is due [m].
            reached: `Mission.reached` [m].
        """
        return bool(np.linalg.norm(tip[1:] - (place + self.end)) <= reached)

    def is_done(self, spent: float, steady: float, there: bool, searching: bool) -> bool:
        """Returns whether it is done; by default as soon as the tip is at its destination.

        Args:
            spent: Time since its beginning [s].
            steady: Time for which the force has been within its tolerance [s]; NaN if it is not.
            there: Whether the tip is at its destination.
            searching: Whether an approach searches for the wall.
        """
        return there

    def first_place(self, place: np.ndarray, tip: np.ndarray) -> np.ndarray:
        """Returns its place (a, b) (2,) [m], given the end of the step before and the tip (3,)."""
        return place

    def first_depth(self, deepest: float, tip: np.ndarray) -> float:
        """Returns the largest depth that is due at its beginning [m], given that of before."""
        return deepest

    def search_depth(self, tip: np.ndarray) -> float | None:
        """Returns the depth [m] down to which it searches for the wall from its place, or None."""
        return None


@dataclass
class Pressing(Step):
    """Step with a desired force along n."""

    force: float = 10.0
    """Desired force along n [N]."""
    tolerance: float = 2.0
    """Largest deviation of the measured force [N]."""
    on_failure: str = "skip"
    """Continuation after the retreat from a spot at which this step failed: `skip` to the next
    spot, `retry` the spot, or `home`: end the mission."""

    def checked(self) -> "Pressing":
        """Returns the step with arrays, or raises."""
        super().checked()
        for key in ("force", "tolerance"):
            value = getattr(self, key)
            require(0.0 < value < np.inf, key, value, "positive")
        require(self.on_failure in FAILURES, "on_failure", self.on_failure,
                f"one of {', '.join(FAILURES)}")
        return self

    @property
    def strongest(self) -> float:
        """Largest desired force [N]."""
        return self.force

    @property
    def largest_error(self) -> float:
        """`tolerance`."""
        return self.tolerance

    @property
    def choice(self) -> str:
        """`on_failure`."""
        return self.on_failure

    def desired_force(self, spent: float, searching: bool) -> float:
        """Returns `force`."""
        return self.force

    def is_pressed(self, force: float, asked: float) -> bool:
        """Returns whether the force is within `tolerance`, where one is desired."""
        return asked > 0.0 and abs(force - asked) <= self.tolerance


@dataclass
class Approach(Pressing):
    """Motion to a place off the wall, then along n until it presses.

    Done after a touch and a force within its tolerance during `settle`.
    """

    role = "approach"

    at: np.ndarray = field(default_factory=lambda: np.zeros(2))
    """Place (a, b) [m]."""
    within: float = 0.5
    """Search distance along n [m]."""
    settle: float = 1.0
    """Time of the force within its tolerance [s]."""

    def checked(self) -> "Approach":
        """Returns the step with arrays, or raises."""
        super().checked()
        require(0.0 < self.within < np.inf, "within", self.within, "positive")
        require(0.0 <= self.settle < self.timeout, "settle", self.settle,
                "zero or positive, and less than the timeout")
        return replace(self, at=vector("at", self.at, 2))

    @property
    def least_time(self) -> float:
        """`settle`: the time of the motion to the wall is unknown."""
        return self.settle

    def desired_force(self, spent: float, searching: bool) -> float:
        """Returns `force` while it searches for the wall, or presses on it."""
        return self.force if searching else 0.0

    def is_done(self, spent: float, steady: float, there: bool, searching: bool) -> bool:
        """Returns whether it presses for long enough."""
        return searching and bool(steady + ROUNDING >= self.settle)

    def first_place(self, place: np.ndarray, tip: np.ndarray) -> np.ndarray:
        """Returns `at`."""
        return self.at

    def search_depth(self, tip: np.ndarray) -> float | None:
        """Returns the depth that is `within` deeper than the tip."""
        return float(tip[0]) + self.within


@dataclass
class Hold(Pressing):
    """Pressing at a place.

    Done after a force within its tolerance during `seconds` without interruption.
    """

    touches: ClassVar[bool] = True

    seconds: float = 5.0
    """Time of the force within its tolerance [s]."""

    def checked(self) -> "Hold":
        """Returns the step with arrays, or raises."""
        super().checked()
        require(0.0 <= self.seconds < self.timeout, "seconds", self.seconds,
                "zero or positive, and less than the timeout")
        return self

    @property
    def least_time(self) -> float:
        """`seconds`."""
        return self.seconds

    def is_done(self, spent: float, steady: float, there: bool, searching: bool) -> bool:
        """Returns whether it presses for long enough."""
        return bool(steady + ROUNDING >= self.seconds)


@dataclass
class Slide(Pressing):
    """Motion along a line with the force F(t) = force + amplitude sin(2π frequency t).

    Done when the reference and the tip are at the line's end. The tool keeps its attitude, but for
    `contact.turn`.
    """

    touches: ClassVar[bool] = True

    along: np.ndarray = field(default_factory=lambda: np.array([0.2, 0.0]))
    """Displacement (a, b) from the beginning to the end of the line [m]."""
    speed: float = 0.02
    """Speed along the line [m/s]."""
    amplitude: float = 0.0
    """Amplitude of a sine that is added to the force [N]."""
    frequency: float = 0.0
    """Frequency of that sine [Hz]."""

    def checked(self) -> "Slide":
        """Returns the step with arrays, or raises."""
        super().checked()
        out = replace(self, along=vector("along", self.along, 2))
        require(out.length > 0.0, "along", self.along, "not zero")
        require(0.0 < self.speed < np.inf, "speed", self.speed, "positive")
        require(out.time < self.timeout, "timeout", self.timeout,
                f"more than the {out.time:.3g} s that it takes at this speed")
        require(0.0 <= self.amplitude < self.force, "amplitude", self.amplitude,
                f"zero or positive, and less than the force, {self.force:g} N")
        require(0.0 <= self.frequency < np.inf, "frequency", self.frequency, "zero or positive")
        return out

    @property
    def length(self) -> float:
        """Length of the line [m]."""
        return float(np.linalg.norm(self.along))

    @property
    def time(self) -> float:
        """Time from beginning to end [s]."""
        return self.length / self.speed

    @property
    def strongest(self) -> float:
        """Largest desired force [N]."""
        return self.force + self.amplitude

    @property
    def fastest(self) -> np.ndarray:
        """Speed along t₁ and along t₂ (2,) [m/s]."""
        return np.abs(self.along) / self.time

    @property
    def end(self) -> np.ndarray:
        """`along`."""
        return self.along

    @property
    def line_speed(self) -> float:
        """`speed`."""
        return self.speed

    @property
    def least_time(self) -> float:
        """That of the line."""
        return self.time

    def desired_force(self, spent: float, searching: bool) -> float:
        """Returns force + amplitude sin(2π frequency t)."""
        return self.force + self.amplitude * math.sin(math.tau * self.frequency * spent)

    def displacement(self, spent: float) -> np.ndarray:
        """Returns the part of the line that is over."""
        done: np.ndarray = self.along * min(spent / self.time, 1.0)
        return done

    def is_done(self, spent: float, steady: float, there: bool, searching: bool) -> bool:
        """Returns whether reference and tip are at the end of the line."""
        return spent >= self.time - ROUNDING and there


@dataclass
class Retreat(Step):
    """Motion straight back along n.

    Done when the tip is `distance` less deep. If it fails, the mission is over.
    """

    role = "retreat"

    distance: float = 0.1
    """Distance back from the place at its beginning [m]."""

    def checked(self) -> "Retreat":
        """Returns the step with arrays, or raises."""
        super().checked()
        require(0.0 < self.distance < np.inf, "distance", self.distance, "positive")
        return self

    def is_there(self, tip: np.ndarray, place: np.ndarray, deepest: float, reached: float) -> bool:
        """Returns whether the tip is back."""
        return bool(tip[0] <= deepest + reached)

    def first_place(self, place: np.ndarray, tip: np.ndarray) -> np.ndarray:
        """Returns that of the tip."""
        return tip[1:]

    def first_depth(self, deepest: float, tip: np.ndarray) -> float:
        """Returns the depth `distance` less deep than the tip."""
        return min(deepest, float(tip[0]) - self.distance)


offer(Step, Approach, Hold, Slide, Retreat)


@dataclass
class Mission:
    """List of steps, with the tolerances of all of them."""

    steps: list[Step] = field(default_factory=list)
    """Steps, spot by spot; none: there is no mission."""
    retries: int = 1
    """Largest number of retries of a spot whose failed step has `on_failure: retry`."""
    reached: float = 0.01
    """Largest distance of the tip from a place that is reached [m]."""
    patience: float = 0.5
    """Largest time of a lost contact during a hold or slide [s]."""
    lead: float = 0.0
    """Lead of the references for places and forces of a slide, the lag of the tip [s]."""

    def checked(self) -> "Mission":
        """Returns the mission with arrays, or raises."""
        require(0 <= self.retries <= 100, "retries", self.retries, "from 0 to 100")
        require(0.0 < self.reached < np.inf, "reached", self.reached, "positive")
        for key in ("patience", "lead"):
            value = getattr(self, key)
            require(0.0 <= value < np.inf, key, value, "zero or positive")
        _require_spots(self.steps)
        return replace(self, steps=[_checked(i, step) for i, step in enumerate(self.steps)])

    def spot(self, i: int) -> tuple[int, int]:
        """Returns the indices of the approach and of the retreat of the spot of a step."""
        first = max(j for j in range(i + 1) if self.steps[j].role == "approach")
        last = min(j for j in range(i, len(self.steps)) if self.steps[j].role == "retreat")
        return first, last


def _checked(i: int, step: Step) -> Step:
    with within(f"steps[{i}]"):
        return step.checked()


def _require_spots(steps: Sequence[Step]) -> None:
    """Raises `InvalidParameter` unless the steps are spots, see the module."""
    away = True
    for i, step in enumerate(steps):
        fits = (step.role == "approach") == away
        require(fits, f"steps[{i}]", type(step).__name__, "an !Approach: nothing is touched"
                if away else "!Hold, !Slide or !Retreat: the last !Approach has no !Retreat yet")
        away = step.role == "retreat"
    require(away, f"steps[{len(steps) - 1}]", type(steps[-1]).__name__ if steps else None,
            "a !Retreat, as the last step")
