"""How what takes long says how far it is."""

from collections.abc import Callable

Progress = Callable[[str, float], None]
"""Called with what comes next and the part, from 0 to 1, of all the time that is over, about."""


def silent(what: str, done: float) -> None:
    """Says nothing."""


def part_of(progress: Progress, first: float, last: float) -> Progress:
    """Returns the progress of what is done between the parts `first` and `last` of the whole."""
    return lambda what, done: progress(what, first + (last - first) * done)
