"""Functions for a worker of a campaign in tests; without imports that take time."""

import os


def process_id(run: int) -> dict[str, int]:
    """Returns the worker's own process."""
    return {"process": os.getpid()}
