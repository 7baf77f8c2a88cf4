"""Progress of long computations."""

from collections.abc import Callable

Progress = Callable[[str, float], None]
"""Callback with the next stage and the elapsed fraction of all time, from 0 to 1."""


def silent(what: str, done: float) -> None:
    """Discards progress."""


def part_of(progress: Progress, first: float, last: float) -> Progress:
    """Returns the progress of a part from the fraction `first` to `last` of the whole."""
    return lambda what, done: progress(what, first + (last - first) * done)
