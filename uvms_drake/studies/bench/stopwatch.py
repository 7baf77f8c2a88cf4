"""Stopwatch of functions, which are replaced by timed ones during a measurement.

The time of a part excludes that of the other parts that it calls, so the parts add up to the total.
Wall times depend on the machine and its load; compare them within a run only.
"""

import time
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

REST = "rest"
"""Name of the remaining time, outside of all parts."""


@dataclass(frozen=True)
class Timing:
    """Statistics of a repeated measurement [ms]."""

    min: float
    """Smallest [ms]."""
    mean: float
    """Mean [ms]."""
    p50: float
    """Median [ms]."""
    p95: float
    """95th percentile [ms]."""
    p99: float
    """99th percentile [ms]."""
    max: float
    """Largest [ms]."""

    @staticmethod
    def of(seconds: Sequence[float]) -> "Timing":
        """Returns the statistics of at least one measurement [s]."""
        ms = 1e3 * np.asarray(seconds, dtype=float)
        p50, p95, p99 = (float(x) for x in np.percentile(ms, [50, 95, 99]))
        return Timing(min=float(np.min(ms)), mean=float(np.mean(ms)), p50=p50, p95=p95, p99=p99,
                      max=float(np.max(ms)))


class Stopwatch:
    """Time of functions, each without that of the others that it calls."""

    def __init__(self) -> None:
        self._seconds: dict[Hashable, float] = {}
        self._within: list[float] = []

    def timed(self, part: Hashable, function: Callable) -> Callable:
        """Returns a function that does the same and counts as a `part`."""
        def call(*args: Any, **kwargs: Any) -> Any:
            """Times the function, without the timed functions inside of it."""
            self._within.append(0.0)
            started = time.perf_counter()
            try:
                return function(*args, **kwargs)
            finally:
                took = time.perf_counter() - started
                own = took - self._within.pop()
                self._seconds[part] = self._seconds.get(part, 0.0) + own
                if self._within:
                    self._within[-1] += took
        return call

    def lap(self) -> dict[Hashable, float]:
        """Returns the time of every part [s] since the last lap."""
        seconds, self._seconds = self._seconds, {}
        return seconds

    def measure(self, function: Callable[[], object]) -> dict[Hashable, float]:
        """Returns the time of every part [s] in a call, with the remaining time as `REST`."""
        self.lap()
        self.timed(REST, function)()
        return self.lap()


@contextmanager
def replaced(owner: Any, name: str, value: object) -> Iterator[None]:
    """Gives an object, class or module another attribute inside the block."""
    own = vars(owner)
    old = own.get(name)
    is_own = name in own
    setattr(owner, name, value)
    try:
        yield
    finally:
        if is_own:
            setattr(owner, name, old)
        else:
            delattr(owner, name)


@contextmanager
def stopwatch(parts: Mapping[str, tuple[Any, str]]) -> Iterator[Stopwatch]:
    """Times functions inside the block.

    Args:
        parts: By name of the part, the owner of a function and the function's name there.
    """
    watch = Stopwatch()
    with ExitStack() as stack:
        for part, (owner, name) in parts.items():
            stack.enter_context(replaced(owner, name, watch.timed(part, getattr(owner, name))))
        yield watch


def timings(samples: Sequence[Mapping[str, float]]) -> tuple[Timing, dict[str, Timing]]:
    """Returns the timings of the total and of every part; a part that is missing took no time."""
    names = list(dict.fromkeys(name for sample in samples for name in sample))
    parts = {name: Timing.of([sample.get(name, 0.0) for sample in samples]) for name in names}
    return Timing.of([sum(sample.values()) for sample in samples]), parts


@dataclass(frozen=True)
class Effort:
    """Numbers of repetitions of the measurements."""

    warm_up: int = 5
    """Repetitions before each measurement."""
    steps: int = 100
    """Measured steps of the controller."""
    first_plans: int = 5
    """Number of repetitions of the first plan."""
    instants: int = 10
    """Instants of a simulation at which derivatives are evaluated."""
    rounds: int = 50
    """Evaluations at each instant."""
    simulated: float = 5.0
    """Simulated time, or the scenario's duration if that is shorter [s]."""
    horizons: tuple[int, ...] = (5, 10, 20, 40)
    """Numbers of intervals N at which the growth is measured."""
    horizon_steps: int = 100
    """Largest number of steps at each of the horizons."""
    horizon_seconds: float = 20.0
    """Wall time after which no further step at the horizons is begun [s]."""
    solvers: tuple[str, ...] = ("structured", "clarabel", "snopt", "ipopt")
    """Solvers that are compared, each with the first of them."""
    solver_horizon: int = 5
    """Number of intervals N for that comparison; a nonlinear solver takes seconds at 15."""
    solver_steps: int = 5
    """Largest number of steps of that comparison."""
    solver_seconds: float = 10.0
    """Wall time after which no further step of that comparison is begun [s]."""
