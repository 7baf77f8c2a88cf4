"""Runs without a simulation, for workers; without imports that take time."""

import os
import time


def process_of(cell: int) -> dict[str, int]:
    """Returns the worker's own process."""
    return {"process": os.getpid()}


def square(cell: int) -> dict[str, int]:
    """Returns the square of a number, after a while."""
    time.sleep(0.1)
    return {"square": cell**2}
