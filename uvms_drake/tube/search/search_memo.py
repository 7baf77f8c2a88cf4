"""Memo of searches: for a study of many tubes that differ little.

A tube takes a dozen searches for suprema, nearly all of its time. With an active memo, a search
returns to the places where the first one of its name and place in line found its largest values,
and searches nowhere else. Its result is a value that is reached, from below as of every search, and
the worst place hardly moves with a disturbance's bound or a gain. So a value found with a memo is
good for a first answer, and a certificate searches anew.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, TypeVar

Found = TypeVar("Found")
"""Result of a search."""


class SearchMemo:
    """Results of searches, in the order in which those of a name were made."""

    def __init__(self) -> None:
        self._found: dict[str, list[Any]] = {}
        self._next: dict[str, int] = {}

    def again(self) -> None:
        """Returns to the first of them."""
        self._next = {}

    def get(self, name: str, search: Callable[[], Found]) -> tuple[Found, bool]:
        """Returns the result of the next search of a name, and whether it was made now."""
        found, index = self._found.setdefault(name, []), self._next.get(name, 0)
        new = index == len(found)
        if new:
            found.append(search())
        self._next[name] = index + 1
        return found[index], new


_ACTIVE: ContextVar[SearchMemo | None] = ContextVar("active memo", default=None)


def active_memo() -> SearchMemo | None:
    """Returns the active memo, or None."""
    return _ACTIVE.get()


@contextmanager
def memoising(searches: SearchMemo | None = None) -> Iterator[SearchMemo]:
    """Activates a memo, a new one or one with former searches; see `SearchMemo.again`."""
    searches = searches or SearchMemo()
    token = _ACTIVE.set(searches)
    try:
        yield searches
    finally:
        _ACTIVE.reset(token)


def once(name: str, search: Callable[[], Found]) -> Found:
    """Returns the result of a search; with an active memo, that of the first in its place."""
    searches = active_memo()
    return search() if searches is None else searches.get(name, search)[0]
