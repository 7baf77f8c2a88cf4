"""The progress of a command, on a terminal or in a log file."""

import argparse
import io
import logging
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TextIO

from uvms_drake.common.alarm import LOGGER

REFRESH_PERIOD = 0.2  # s of wall time, on a terminal
LINES = 5  # in all, in a log file
BAR = 20  # letters
CERTIFYING = "certifying (half a minute, the first time)"


def stream_of(args: argparse.Namespace) -> TextIO:
    """Returns where the progress of a command goes: stderr, or nowhere with --quiet."""
    return io.StringIO() if args.quiet else sys.stderr


class StageBar:
    """Callable that reports stages: a bar with the time left on a terminal, else one line in all.

    Args:
        title: What is going on, such as "certifying".
        stream: Where to write.
    """

    def __init__(self, title: str, stream: TextIO):
        self._title, self._stream = title, stream
        self._started = time.perf_counter()
        self._said = False

    def __call__(self, what: str, done: float) -> None:
        """Reports that `what` comes next, after a part `done` of all the time."""
        if done == 0.0:
            self._started = time.perf_counter()
        if self._stream.isatty():
            elapsed = time.perf_counter() - self._started
            left = f", about {elapsed * (1.0 - done) / done:.0f} s left" if done > 0.0 else ""
            bar = "#" * round(BAR * done)
            self._stream.write(f"\r[{bar:<{BAR}}] {self._title}: {what}{left}\033[K")
        elif not self._said:
            self._stream.write(f"{self._title} ...\n")
        self._said = True
        self._stream.flush()

    def close(self) -> None:
        """Clears the line for the next output."""
        if self._said and self._stream.isatty():
            self._stream.write("\r\033[K")
            self._stream.flush()


class ProgressLine:
    """Callable that reports the simulated time: one updating line on a terminal, few lines else.

    Args:
        duration: Simulated time at the end [s].
        stream: Where to write.
    """

    def __init__(self, duration: float, stream: TextIO):
        self._duration = duration
        self._stream = stream
        self._is_terminal = stream.isatty()
        self._started = time.perf_counter()
        self._due = 0.0
        self._is_open = False

    def __call__(self, now: float) -> None:
        """Reports that the simulation is at `now` [s]."""
        wall = time.perf_counter() - self._started
        if (wall if self._is_terminal else now) < self._due:
            return
        left = f", about {wall * (self._duration / now - 1.0):.0f} s left" if now > 0.0 else ""
        text = f"simulating: {now:.1f} of {self._duration:g} s, {wall:.1f} s elapsed{left}"
        if self._is_terminal:
            self._due = wall + REFRESH_PERIOD
            self._stream.write(f"\r{text}\033[K")
            self._is_open = True
        else:
            self._due = now + self._duration / LINES
            self._stream.write(f"{text}\n")
        self._stream.flush()

    def say(self, text: str) -> None:
        """Writes a line that stays; the next report goes below it."""
        self.close()
        self._stream.write(f"{text}\n")
        self._stream.flush()

    def close(self) -> None:
        """Clears the line for the next output."""
        if self._is_open:
            self._stream.write("\r\033[K")
            self._stream.flush()
            self._is_open = False


class _Above(logging.Handler):
    """Passes log messages to a `ProgressLine`."""

    def __init__(self, line: ProgressLine):
        super().__init__()
        self._line = line

    def emit(self, record: logging.LogRecord) -> None:
        """Says the message."""
        self._line.say(self.format(record))


@contextmanager
def alarms_above(line: ProgressLine) -> Iterator[None]:
    """Shows the warnings of the package's logger above the progress line, inside the block."""
    handler = _Above(line)
    LOGGER.addHandler(handler)
    try:
        yield
    finally:
        LOGGER.removeHandler(handler)
