"""Outcome of a mission: a table with a line for each begun step."""

from typing import Any, NamedTuple

import numpy as np

from uvms_drake.mission.law import DONE, REASONS, RETREATED, RUNNING, SKIPPED
from uvms_drake.mission.steps import Hold, Pressing, Slide, Step
from uvms_drake.mission.system import PROGRESS
from uvms_drake.station.contact_bounds import sensed_contact
from uvms_drake.station.record import Record
from uvms_drake.tube.ultimate_bounds import tip_errors

OUTCOMES = {RUNNING: "not over at the end of the run", DONE: "done", SKIPPED: "skipped in part",
            RETREATED: "retreated"}
"""Texts of the outcomes of a mission."""
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


def lateral_errors(record: Record, step: Step, when: slice) -> tuple[np.ndarray, np.ndarray]:
    """Returns the distance of the tip from the place or line, and its lag on the line (m,) [m].

    Both are normal to n.

    Args:
        record: Record of the run.
        step: A `Hold` or `Slide`.
        when: The samples (m).
    """
    axes = sensed_contact(record.scenario).walls.axes[1:]
    place = record.signals["mission_place"][when] @ axes.T
    tip = record.chi[when, :3] @ axes.T
    if not isinstance(step, Slide):
        return np.linalg.norm(tip - place, axis=1), np.zeros(len(tip))
    along = np.asarray(step.along) / step.length
    off = (tip - place) @ np.array([-along[1], along[0]])
    return np.abs(off), (place - tip) @ along


def force_errors(record: Record, when: slice) -> np.ndarray:
    """Returns the error of the real force along n (m,) [N]."""
    n = sensed_contact(record.scenario).direction
    errors: np.ndarray = record.force[when, :3] @ n - record.signals["mission_force"][when, 0]
    return errors


def certified_error(record: Record, step: Hold | Slide, when: slice) -> float | None:
    """Returns the certified bound of the error of the force along n, for the plans of a step [N].

    None without a certificate. It is `SensedContact.band`, b(ℓ), with the largest logged ℓ.
    """
    if not record.certified:
        return None
    contact = sensed_contact(record.scenario)
    short = (record.signals["target"] - record.chi_nominal[:, :3])[when]
    lags = np.maximum(contact.walls.advance(short), contact.walls.advance(-short))
    return contact.band(step.strongest, tip_errors(record.scenario.tube),
                        step.speed if isinstance(step, Slide) else 0.0, float(np.max(lags)))


def summarise_mission(record: Record) -> dict[str, Any]:
    """Returns the outcome of a mission and of each attempt of its steps; empty without a mission.

    A hold or slide has the mean force, rms and largest error of the force along n, the certified
    bound of that (None without a certificate), and the share of the time in which it is within the
    step's `tolerance`; rms and largest distance from its place or line, and the largest lag on the
    line.
    """
    if not has_mission(record):
        return {}
    mission, progress = record.scenario.mission.checked(), progress_of(record)
    over = np.flatnonzero(progress["outcome"] != RUNNING)
    # A row for each attempt; force and position errors for those in contact.
    rows = []
    for attempt in attempts_of(record):
        step, when = mission.steps[attempt.step], attempt.when
        last = min(when.stop, len(record.time) - 1)
        row: dict[str, Any] = {
            "step": attempt.step, "kind": type(step).__name__, "ended": attempt.ended,
            "begin_s": record.time[when.start],
            "seconds": record.time[last] - record.time[when.start]}
        if isinstance(step, Hold | Slide):
            error, (off, behind) = force_errors(record, when), lateral_errors(record, step, when)
            n = sensed_contact(record.scenario).direction
            row |= {"mean_force": np.mean(record.force[when, :3] @ n),
                    "force_rms": np.sqrt(np.mean(error**2)),
                    "force_worst": np.max(np.abs(error)),
                    "certified": certified_error(record, step, when),
                    "within": np.mean(np.abs(error) <= step.tolerance),
                    "off_rms": np.sqrt(np.mean(off**2)), "off_worst": np.max(off),
                    "behind": np.max(behind)}
        rows.append(row)
    return {"outcome": OUTCOMES[int(progress["outcome"][-1])],
            "over_s": record.time[over[0]] if len(over) else None,
            "failures": int(progress["failures"][-1]),
            "not_begun": len(mission.steps) - len({row["step"] for row in rows}),
            "steps": rows}


def format_mission(mission: dict[str, Any]) -> list[str]:
    """Returns the table; empty without a mission."""
    if not mission:
        return []
    when = "" if mission["over_s"] is None else f" after {mission['over_s']:.1f} s"
    left = f", {mission['not_begun']} steps not begun" if mission["not_begun"] else ""
    lines = ["", f"{'mission':<14}{mission['outcome']}{when}, "
             f"{mission['failures']} steps failed{left}",
             f"{'':<14}{'':<10}{'from':>7}{'for':>7}{'mean':>8}{'rms':>7}{'worst':>7}"
             f"{'cert.':>7}{'within':>8}"
             f"{'off rms':>9}{'worst':>7}{'behind':>8}",
             f"{'':<14}{'':<10}{'s':>7}{'s':>7}{'N':>8}{'N':>7}{'N':>7}{'N':>7}{'%':>8}"
             f"{'mm':>9}{'mm':>7}{'mm':>8}"]
    for row in mission["steps"]:
        line = f"{row['step']:>12}  {row['kind']:<10}{row['begin_s']:>7.1f}{row['seconds']:>7.1f}"
        line += "" if "within" not in row else (
            f"{row['mean_force']:>8.2f}{row['force_rms']:>7.2f}{row['force_worst']:>7.2f}"
            + ("      -" if row["certified"] is None else f"{row['certified']:>7.2f}") +
            f"{100.0 * row['within']:>8.1f}{1e3 * row['off_rms']:>9.2f}"
            f"{1e3 * row['off_worst']:>7.2f}{1e3 * row['behind']:>8.1f}")
        lines.append(f"{line:<92}  {row['ended']}".rstrip())
    return lines


def pressing_samples(record: Record) -> np.ndarray:
    """Returns whether a pressing step is active and the last measurement was a contact (T,)."""
    steps, progress = record.scenario.mission.steps, progress_of(record)
    presses = np.array([*(isinstance(step, Pressing) for step in steps), False])
    return ((progress["outcome"] == RUNNING) & presses[progress["step"]]
            & (record.signals["touched"][:, 0] > 0.0))
