"""Ctrl-C, SIGTERM and closed pipes end a command in one line, at whatever second they come.

An interrupt is a `KeyboardInterrupt` where Python runs. Where C++ has called Python, as SNOPT does,
it comes back as another error, so that the signal itself is what counts.
"""

import os
import signal
import sys
from collections.abc import Callable
from types import FrameType

PROGRAM = "uvms-drake"
INTERRUPTED = f"{PROGRAM}: error: interrupted"
CLOSED_PIPE = 128 + signal.SIGPIPE
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
    signals = (signal.SIGINT, signal.SIGTERM)
    old = [signal.signal(number, interrupt) for number in signals]
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
        for number, handler in zip(signals, old, strict=True):
            signal.signal(number, handler)
