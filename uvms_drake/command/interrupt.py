"""Ctrl-C, SIGTERM and closed pipes end a command with one line, at any time.

An interrupt is a `KeyboardInterrupt` in Python. From Python that C++ has called, as SNOPT does, it
returns as another error, so the signal itself is decisive. A block that should reach an orderly end
postpones it: `postponed`.
"""

import contextlib
import os
import signal
import sys
from collections.abc import Callable, Iterator
from types import FrameType

PROGRAM = "uvms-drake"
INTERRUPTED = f"{PROGRAM}: error: interrupted"
CLOSED_PIPE = 128 + signal.SIGPIPE
SIGNALS = (signal.SIGINT, signal.SIGTERM)
PATIENCE = 3
"""Number of signals after which the program ends without cleaning up."""


def run_interruptible(load: Callable[[], Callable[[], int]]) -> int:
    """Runs a command and returns its exit status, or 128 + the signal that has ended it.

    The standard streams escape characters outside of their encoding.

    Args:
        load: Function that does the slow imports and returns the command. A signal ends it at
            once: Drake cannot be loaded in part, and there is nothing to clean up yet.
    """
    received: list[int] = []
    loaded = False

    def interrupt(number: int, frame: FrameType | None) -> None:
        """Ends the process at once, or asks the command to end."""
        received.append(number)
        if not loaded:
            os.write(2, f"{INTERRUPTED}, nothing written\n".encode())
        if not loaded or len(received) == PATIENCE:
            os._exit(128 + number)
        if len(received) == 1:
            raise KeyboardInterrupt

    # From here on a signal interrupts; the former handlers are restored at the end.
    old = [signal.signal(number, interrupt) for number in SIGNALS]
    try:
        for stream in (sys.stdout, sys.stderr):
            if hasattr(stream, "reconfigure"):
                stream.reconfigure(errors="backslashreplace")
        command = load()
        loaded = True
        status = command()
        sys.stdout.flush()
        # The status of a run that has ended tells of the run, whatever closed its page.
        return 128 + received[0] if received and status in (1, 2) else status
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # The buffered output goes there.
        return CLOSED_PIPE
    except BaseException as error:
        if not received:
            raise
        saved = "; ".join(getattr(error, "__notes__", ())) or "nothing written"
        print(f"{INTERRUPTED}, {saved}", file=sys.stderr)
        # If it has passed through code that C ran, as pydrake does when it is imported, `python -m`
        # would kill itself in the end; with other such code Python forgets about it.
        eval("None")
        return 128 + received[0]
    finally:
        for number, handler in zip(SIGNALS, old, strict=True):
            signal.signal(number, handler)


@contextlib.contextmanager
def postponed() -> Iterator[Callable[[], bool]]:
    """Postpones a signal to the end of a block, with a function that reads whether it has come.

    A second one interrupts at once.
    """
    received: list[int] = []

    def note(number: int, frame: FrameType | None) -> None:
        """Notes a first signal, and lets others through."""
        received.append(number)
        if len(received) > 1:
            old[number](number, frame)

    handlers = {number: signal.getsignal(number) for number in SIGNALS}
    old = {int(number): handler for number, handler in handlers.items() if callable(handler)}
    for number in old:
        signal.signal(number, note)
    try:
        yield lambda: bool(received)
    finally:
        for number, handler in old.items():
            signal.signal(number, handler)
    if received:
        signal.raise_signal(received[0])
