"""Functions for a worker of a campaign in tests; without imports that take time."""

import os
from typing import Any


def process_id(campaign: Any, index: int) -> dict[str, int]:
    """Returns the worker's own process, in the place of `run_one`."""
    return {"process": os.getpid()}
