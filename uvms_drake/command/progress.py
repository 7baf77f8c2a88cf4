"""The progress of a command, on a terminal or in a log file."""

import logging
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TextIO

from uvms_drake.common.alarm import LOGGER

REFRESH_PERIOD = 0.2  # s of wall time, on a terminal
LINES = 5  # in all, in a log file


def announce_certifying() -> None:
    """Says on stderr that a certificate is being computed."""
    print("certifying (half a minute, the first time) ...", file=sys.stderr, flush=True)


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
        text = f"simulating: {now:.1f} of {self._duration:g} s, {wall:.1f} s elapsed"
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
