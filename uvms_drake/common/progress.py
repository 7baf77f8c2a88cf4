"""How what takes long says how far it is."""

from collections.abc import Callable

Progress = Callable[[str, float], None]
"""Called with what comes next and the part, from 0 to 1, of all the time that is over, about."""


def silent(what: str, done: float) -> None:
    """Says nothing."""
