"""Ctrl-C, SIGTERM and closed pipes end a command in one line, at whatever second they come.

An interrupt is a `KeyboardInterrupt` where Python runs. Where C++ has called Python, as SNOPT does,
it comes back as another error, so that the signal itself is what counts. What should rather come
to an end that can be kept holds it back: `postponed`.
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
"""Number of signals after which the program ends without tidying up."""


def run_interruptible(load: Callable[[], Callable[[], int]]) -> int:
    """Runs a command and returns its exit status, or 128 + the signal that has ended it.

    The standard streams write what their encoding does not have as an escape.

    Args:
        load: Imports what takes long and returns the command. It is not interrupted but ended:
            Drake could not be loaded by halves, and there is nothing to tidy up yet.
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

    # From here on a signal interrupts; the handlers before are put back at the end.
    old = [signal.signal(number, interrupt) for number in SIGNALS]
    try:
        for stream in (sys.stdout, sys.stderr):
            if hasattr(stream, "reconfigure"):
                stream.reconfigure(errors="backslashreplace")
        command = load()
        loaded = True
        status = command()
        sys.stdout.flush()
        return 128 + received[0] if received and status else status
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # What is still in the buffer goes there.
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
    """Holds a signal back to the end of a block, and gives a function that tells of it inside.

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
