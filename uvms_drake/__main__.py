"""`python -m uvms_drake` is the command `uvms-drake`."""

import signal
import sys
from collections.abc import Callable

from uvms_drake.command.interrupt import run_interruptible


def main() -> int:
    """Runs the command line and returns the exit status."""
    def load() -> Callable[[], int]:
        """Imports the command line, while a signal can already end it."""
        from uvms_drake.command.main import main as command

        return command

    status = run_interruptible(load)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # There is nothing left to interrupt.
    return status


if __name__ == "__main__":
    sys.exit(main())
