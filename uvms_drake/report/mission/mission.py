"""Outcome of a mission: a table with a line for each begun step."""

from typing import Any

import numpy as np

from uvms_drake.mission.law import DONE, RETREATED, RUNNING, SKIPPED
from uvms_drake.mission.steps import Step
from uvms_drake.report.mission.attempts import attempts_of, has_mission, progress_of
from uvms_drake.report.mission.force_bands import ForceBands, force_bands, force_error
from uvms_drake.station.contact.bounds import sensed_contact
from uvms_drake.station.record import Record

OUTCOMES = {RUNNING: "not over at the end of the run", DONE: "done", SKIPPED: "skipped in part",
            RETREATED: "retreated"}
"""Texts of the outcomes of a mission."""

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
    if not np.any(step.end):
        return np.linalg.norm(tip - place, axis=1), np.zeros(len(tip))
    along = np.asarray(step.end) / np.linalg.norm(step.end)
    off = (tip - place) @ np.array([-along[1], along[0]])
    return np.abs(off), (place - tip) @ along


def certified_errors(bands: ForceBands | None, when: slice) -> dict[str, float | None]:
    """Returns the certified bound of the error of the force along n in a step, and of its hold.

    `certified` is the largest in contact; `held` is the largest error once the plan has stood, and
    `certified_hold` the largest bound then, see `force_bands`. None where there is none [N].

    Args:
        bands: Those of the run; None without a certificate.
        when: The samples of the step.
    """
    if bands is None:
        return dict.fromkeys(("certified", "held", "certified_hold"))
    error, bound, holds = (each[when] for each in bands)
    there = np.isfinite(bound)

    def largest(values: np.ndarray) -> float | None:
        return float(np.max(values)) if len(values) else None

    return {"certified": largest(bound[there]), "held": largest(np.abs(error[there & holds])),
            "certified_hold": largest(bound[there & holds])}


def summarise_mission(record: Record) -> dict[str, Any]:
    """Returns the outcome of a mission and of each attempt of its steps; empty without a mission.

    A hold or slide has the mean force, rms and largest error of the force along n, the certified
    bound of that, error and bound once the plan has stood, see `certified_errors`, and the share of
    the time in which it is within the step's `tolerance`; rms and largest distance from its place
    or line, and the largest lag on the line.
    """
    if not has_mission(record):
        return {}
    mission, progress = record.scenario.mission.checked(), progress_of(record)
    over = np.flatnonzero(progress["outcome"] != RUNNING)
    error = force_error(record)
    bands = force_bands(record) if record.certified else None
    # A row for each attempt; force and position errors for those in contact.
    rows = []
    for attempt in attempts_of(record):
        step, when = mission.steps[attempt.step], attempt.when
        last = min(when.stop, len(record.time) - 1)
        row: dict[str, Any] = {
            "step": attempt.step, "kind": type(step).__name__, "ended": attempt.ended,
            "begin_s": record.time[when.start],
            "seconds": record.time[last] - record.time[when.start]}
        if step.touches:
            off, behind = lateral_errors(record, step, when)
            n = sensed_contact(record.scenario).direction
            row |= {"mean_force": np.mean(record.force[when, :3] @ n),
                    "force_rms": np.sqrt(np.mean(error[when]**2)),
                    "force_worst": np.max(np.abs(error[when])),
                    **certified_errors(bands, when),
                    "within": np.mean(np.abs(error[when]) <= step.largest_error),
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
             f"{'cert.':>7}{'held':>7}{'cert.':>7}{'within':>8}"
             f"{'off rms':>9}{'worst':>7}{'behind':>8}",
             f"{'':<14}{'':<10}{'s':>7}{'s':>7}{'N':>8}{'N':>7}{'N':>7}{'N':>7}{'N':>7}{'N':>7}{'%':>8}"
             f"{'mm':>9}{'mm':>7}{'mm':>8}"]
    for row in mission["steps"]:
        line = f"{row['step']:>12}  {row['kind']:<10}{row['begin_s']:>7.1f}{row['seconds']:>7.1f}"
        line += "" if "within" not in row else (
            f"{row['mean_force']:>8.2f}{row['force_rms']:>7.2f}{row['force_worst']:>7.2f}"
            + "".join("      -" if row[key] is None else f"{row[key]:>7.2f}"
                      for key in ("certified", "held", "certified_hold")) +
            f"{100.0 * row['within']:>8.1f}{1e3 * row['off_rms']:>9.2f}"
            f"{1e3 * row['off_worst']:>7.2f}{1e3 * row['behind']:>8.1f}")
        lines.append(f"{line:<106}  {row['ended']}".rstrip())
    return lines


def pressing_samples(record: Record) -> np.ndarray:
    """Returns whether a pressing step is active and the last measurement was a contact (T,)."""
    steps, progress = record.scenario.mission.steps, progress_of(record)
    presses = np.array([*(step.strongest > 0.0 for step in steps), False])
    return ((progress["outcome"] == RUNNING) & presses[progress["step"]]
            & (record.signals["touched"][:, 0] > 0.0))
