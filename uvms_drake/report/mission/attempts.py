"""Attempts at the steps of a mission in the logs of a run."""

from typing import NamedTuple

import numpy as np

from uvms_drake.mission.law import REASONS, RUNNING
from uvms_drake.mission.system import PROGRESS
from uvms_drake.station.record import Record

UNFINISHED = "not over"
"""Outcome of a step at the end of the run."""


class Attempt(NamedTuple):
    """Attempt at a step, from begin to end; the step may be begun again later."""

    step: int
    """Index of the step in the mission."""
    when: slice
    """Logged samples."""
    ended: str
    """Outcome: `done`, the reason of failure, or `UNFINISHED`."""


def has_mission(record: Record) -> bool:
    """Returns whether a run has a mission."""
    return "mission_progress" in record.signals


def progress_of(record: Record) -> dict[str, np.ndarray]:
    """Returns the entries of `PROGRESS` (T,) each, integers."""
    logged = record.signals["mission_progress"].astype(int)
    return dict(zip(PROGRESS, logged.T, strict=True))


def losses_of(record: Record) -> int:
    """Returns how often the tip left the wall during a step that needs a contact."""
    steps, touching = record.scenario.mission.steps, (record.penetration > 0.0).astype(int)
    return sum(int(np.count_nonzero(np.diff(touching[attempt.when]) < 0))
               for attempt in attempts_of(record) if steps[attempt.step].touches)


def attempts_of(record: Record) -> list[Attempt]:
    """Returns all attempts of a mission in order; between two of a step there is a retreat."""
    progress = progress_of(record)
    step, running = progress["step"], progress["outcome"] == RUNNING
    begins = np.flatnonzero(running & (np.diff(step, prepend=-1) != 0))
    ends = [*begins[1:], np.count_nonzero(running)][: len(begins)]
    out = []
    for begin, end in zip(begins, ends, strict=True):
        failed = end < len(step) and progress["failures"][end] > progress["failures"][begin]
        ended = (UNFINISHED if end == len(step)
                 else REASONS[progress["reason"][end]] if failed else "done")
        out.append(Attempt(int(step[begin]), slice(int(begin), int(end)), ended))
    return out
