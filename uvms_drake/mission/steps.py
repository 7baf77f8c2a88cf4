"""The steps of a mission, as they stand in a scenario's file.

*Places* (a, b) are lengths along two directions t₁, t₂ across the declared direction n of a
contact, from the place of the task: `SurfaceClass.axes`. For n = x of a world whose z points down
they are down and to port. Depths are along n. A wall's own shape is in neither.

*Spots.* A mission is a sequence of spots, each of them

    !Approach, then any number of !Hold and !Slide, then !Retreat,

so every contact has an end that is planned: whatever goes wrong at a spot, its retreat is next.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from uvms_drake.common.errors import require, vector, within

FAILURES = ("skip", "retry", "home")
"""What comes after the retreat from a spot at which a step failed: the next spot; the same again,
as often as the mission's `retries`, and then the next; or nothing more."""


@dataclass
class Step:
    """What all steps have."""

    touches: ClassVar[bool] = False
    """Whether it asks for a contact that was made before."""

    timeout: float = 60.0
    """Time after which it has failed [s]."""

    def checked(self) -> "Step":
        """Returns the step with arrays, or raises."""
        require(0.0 < self.timeout < np.inf, "timeout", self.timeout, "positive")
        return self

    @property
    def strongest(self) -> float:
        """Largest force that it asks for [N]."""
        return 0.0

    @property
    def fastest(self) -> np.ndarray:
        """Speed along t₁ and along t₂ that it asks for while touching (2,) [m/s]."""
        return np.zeros(2)


@dataclass
class Pressing(Step):
    """A step that presses: the force is asked for along n."""

    force: float = 10.0
    """Desired force along n [N]."""
    tolerance: float = 2.0
    """Distance from it within which the felt force is as asked for [N]."""
    on_failure: str = "skip"
    """What comes after the retreat from a spot at which this step failed: `skip` the rest of the
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
        """Largest force that it asks for [N]."""
        return self.force


@dataclass
class Approach(Pressing):
    """Swims to a place off the wall, then on along n until it presses.

    Done when it has touched, and the force was as asked for during `settle`.
    """

    at: np.ndarray = field(default_factory=lambda: np.zeros(2))
    """Place (a, b) [m]."""
    within: float = 0.5
    """How far along n it looks for the wall [m]."""
    settle: float = 1.0
    """How long the force is as asked for before it is done [s]."""

    def checked(self) -> "Approach":
        """Returns the step with arrays, or raises."""
        super().checked()
        require(0.0 < self.within < np.inf, "within", self.within, "positive")
        require(0.0 <= self.settle < self.timeout, "settle", self.settle,
                "zero or positive, and less than the timeout")
        return replace(self, at=vector("at", self.at, 2))


@dataclass
class Hold(Pressing):
    """Presses where it is.

    Done when the force was as asked for during `seconds` on end.
    """

    touches: ClassVar[bool] = True

    seconds: float = 5.0
    """How long on end the force is as asked for [s]."""

    def checked(self) -> "Hold":
        """Returns the step with arrays, or raises."""
        super().checked()
        require(0.0 <= self.seconds < self.timeout, "seconds", self.seconds,
                "zero or positive, and less than the timeout")
        return self


@dataclass
class Slide(Pressing):
    """Goes along a line while it presses: F(t) = force + amplitude sin(2π frequency t).

    Done when the line's end was asked for, and the tip is there. The tool keeps its attitude,
    but for `contact.turn`.
    """

    touches: ClassVar[bool] = True

    along: np.ndarray = field(default_factory=lambda: np.array([0.2, 0.0]))
    """From begin to end of the line (a, b) [m]."""
    speed: float = 0.02
    """Along the line [m/s]."""
    amplitude: float = 0.0
    """Of a sine that is added to the force [N]."""
    frequency: float = 0.0
    """Of that sine [Hz]."""

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
        """Time from begin to end [s]."""
        return self.length / self.speed

    @property
    def strongest(self) -> float:
        """Largest force that it asks for [N]."""
        return self.force + self.amplitude

    @property
    def fastest(self) -> np.ndarray:
        """Speed along t₁ and along t₂ (2,) [m/s]."""
        return np.abs(self.along) / self.time


@dataclass
class Retreat(Step):
    """Goes straight back along n.

    Done when the tip is `distance` back from where it began. If it fails, the mission is over.
    """

    distance: float = 0.1
    """How far back from where it begins [m]."""

    def checked(self) -> "Retreat":
        """Returns the step with arrays, or raises."""
        super().checked()
        require(0.0 < self.distance < np.inf, "distance", self.distance, "positive")
        return self


AnyStep = Approach | Hold | Slide | Retreat
"""The steps that a scenario's file may name; the first is the one meant without a tag."""


@dataclass
class Mission:
    """A list of steps, and what counts as being somewhere, for all of them."""

    steps: list[AnyStep] = field(default_factory=list)
    """The steps, spot by spot; none: there is no mission."""
    retries: int = 1
    """How often a spot is tried again, if a step of it says so."""
    reached: float = 0.01
    """Distance of the tip from a place at which it is there [m]."""
    patience: float = 0.5
    """How long the contact may be lost during a hold or slide before it has failed [s]."""
    lead: float = 0.0
    """How much before they are due places and forces of a slide are asked for: what the tip is
    behind by otherwise [s]."""

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


def _checked(i: int, step: AnyStep) -> AnyStep:
    with within(f"steps[{i}]"):
        checked = step.checked()
    assert isinstance(checked, AnyStep)
    return checked


def _require_spots(steps: Sequence[AnyStep]) -> None:
    """Raises `InvalidParameter` unless the steps are spots, see the module."""
    away = True
    for i, step in enumerate(steps):
        fits = isinstance(step, Approach) if away else not isinstance(step, Approach)
        require(fits, f"steps[{i}]", type(step).__name__, "an !Approach: nothing is touched"
                if away else "!Hold, !Slide or !Retreat: the last !Approach has no !Retreat yet")
        away = isinstance(step, Retreat)
    require(away, f"steps[{len(steps) - 1}]", type(steps[-1]).__name__ if steps else None,
            "a !Retreat, as the last step")
