"""Alarms during a run, on the logger `uvms_drake`.

Python prints the warnings of a logger without handlers on stderr.
"""

import logging

LOGGER = logging.getLogger("uvms_drake")


def warn(time: float, text: str) -> None:
    """Warns of an event at a simulated time [s], for events that change a state."""
    LOGGER.warning("t = %g s: %s", time, text)
