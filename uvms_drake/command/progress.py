"""The progress of a command, on a terminal or in a log file."""

import argparse
import io
import logging
import shutil
import sys
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from math import floor
from typing import TextIO

from uvms_drake.common.alarm import LOGGER

LINES = 5  # in a log file, and one for the beginning
BAR = 20  # letters
CERTIFYING = "certifying (half a minute of a core or more)"


class Bar:
    """The `Progress` of a command: a bar on a terminal, else a few lines; with the time left.

    Args:
        title: Name of the activity, such as "certifying".
        stream: Stream to write to.
        is_steady: Whether fractions grow with time, so that the time left is known.
    """

    def __init__(self, title: str, stream: TextIO, *, is_steady: bool = True):
        self._title, self._stream, self._is_steady = title, stream, is_steady
        self._started = time.perf_counter()
        self._due = 0.0
        self._is_open = False

    def __call__(self, what: str, done: float) -> None:
        """Reports the next stage `what`, after a fraction `done` of all the time."""
        elapsed = time.perf_counter() - self._started
        left = (f", about {elapsed * (1.0 - done) / done:.0f} s left"
                if done > 0.0 and self._is_steady else "")
        text = f"{self._title}: {what}{left}"
        if self._stream.isatty():
            line = f"[{'#' * round(BAR * done):<{BAR}}] {text}"
            self._stream.write(f"\r{line[: shutil.get_terminal_size().columns - 1]}\033[K")
            self._is_open = True
        elif done >= self._due or not self._is_steady:
            self._due = (floor(LINES * done) + 1) / LINES
            self._stream.write(f"{text}\n")
        self._stream.flush()

    def say(self, text: str) -> None:
        """Writes a permanent line; the next report goes below it."""
        self.close()
        self._stream.write(f"{text}\n")
        self._stream.flush()

    def close(self) -> None:
        """Clears the line for the next output."""
        if self._is_open:
            self._stream.write("\r\033[K")
            self._stream.flush()
            self._is_open = False


def bar(args: argparse.Namespace, title: str, *, is_steady: bool = True) -> closing[Bar]:
    """Returns the context of a command's bar on stderr, or nowhere with --quiet; see `Bar`."""
    stream = io.StringIO() if args.quiet else sys.stderr
    return closing(Bar(title, stream, is_steady=is_steady))


@contextmanager
def alarms_above(bar: Bar) -> Iterator[None]:
    """Shows the warnings of the package's logger above the bar, inside the block."""
    class Above(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            bar.say(self.format(record))

    handler = Above()
    LOGGER.addHandler(handler)
    try:
        yield
    finally:
        LOGGER.removeHandler(handler)
