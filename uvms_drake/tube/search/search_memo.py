"""Searches that are made once: for a study of many tubes that differ little.

A tube takes a dozen searches for suprema, nearly all of its time. While they are held, a search
goes back to where the first one of its name and place in line found its largest values, and looks
nowhere else. What it returns is a value that is reached, from below as every search is, and the
worst place hardly moves with a disturbance's bound or a gain. So a value found under held searches
is worth a first answer, and a certificate searches anew.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, TypeVar

Found = TypeVar("Found")
"""What a search is to find again."""


class SearchMemo:
    """What searches found, in the order in which those of a name were made."""

    def __init__(self) -> None:
        self._found: dict[str, list[Any]] = {}
        self._next: dict[str, int] = {}

    def again(self) -> None:
        """Begins with the first of them again."""
        self._next = {}

    def get(self, name: str, search: Callable[[], Found]) -> tuple[Found, bool]:
        """Returns what the next search of a name found, and whether it was made now."""
        found, index = self._found.setdefault(name, []), self._next.get(name, 0)
        new = index == len(found)
        if new:
            found.append(search())
        self._next[name] = index + 1
        return found[index], new


_HELD: ContextVar[SearchMemo | None] = ContextVar("held", default=None)


def held() -> SearchMemo | None:
    """Returns the searches that are held, if any are."""
    return _HELD.get()


@contextmanager
def holding(searches: SearchMemo | None = None) -> Iterator[SearchMemo]:
    """Holds the searches that are made meanwhile, after those of before; see `SearchMemo.again`."""
    searches = searches or SearchMemo()
    token = _HELD.set(searches)
    try:
        yield searches
    finally:
        _HELD.reset(token)


def once(name: str, search: Callable[[], Found]) -> Found:
    """Returns what a search finds; while searches are held, what the first in its place found."""
    searches = held()
    return search() if searches is None else searches.get(name, search)[0]
