"""Steps of a mission, as in a scenario's file.

*Places* (a, b) are lengths along two directions t₁, t₂ across the declared direction n of a
contact, from the place of the task: `SurfaceClass.axes`. For n = x of a world whose z points down
they are down and to port. Depths are along n. Neither depends on the wall's shape.

*Spots.* A mission is a sequence of spots, each of them

    !Approach, then any number of !Hold and !Slide, then !Retreat,

so every contact has a planned end: after any failure at a spot its retreat is next.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from uvms_drake.common.errors import require, vector, within
from uvms_drake.common.kinds import offer

FAILURES = ("skip", "retry", "home")
"""Continuations after the retreat from a spot with a failed step: the next spot; the same again, at
most the mission's `retries`, and then the next; or the end."""


@dataclass
class Step:
    """Step of a mission."""

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


@dataclass
class Approach(Pressing):
    """Motion to a place off the wall, then along n until it presses.

    Done after a touch and a force within its tolerance during `settle`.
    """

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


@dataclass
class Retreat(Step):
    """Motion straight back along n.

    Done when the tip is `distance` less deep. If it fails, the mission is over.
    """

    distance: float = 0.1
    """Distance back from the place at its beginning [m]."""

    def checked(self) -> "Retreat":
        """Returns the step with arrays, or raises."""
        super().checked()
        require(0.0 < self.distance < np.inf, "distance", self.distance, "positive")
        return self


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
        first = max(j for j in range(i + 1) if isinstance(self.steps[j], Approach))
        last = min(j for j in range(i, len(self.steps)) if isinstance(self.steps[j], Retreat))
        return first, last


def _checked(i: int, step: Step) -> Step:
    with within(f"steps[{i}]"):
        return step.checked()


def _require_spots(steps: Sequence[Step]) -> None:
    """Raises `InvalidParameter` unless the steps are spots, see the module."""
    away = True
    for i, step in enumerate(steps):
        fits = isinstance(step, Approach) if away else not isinstance(step, Approach)
        require(fits, f"steps[{i}]", type(step).__name__, "an !Approach: nothing is touched"
                if away else "!Hold, !Slide or !Retreat: the last !Approach has no !Retreat yet")
        away = isinstance(step, Retreat)
    require(away, f"steps[{len(steps) - 1}]", type(steps[-1]).__name__ if steps else None,
            "a !Retreat, as the last step")
