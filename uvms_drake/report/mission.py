"""A mission in the logs of a run: outcome of each attempt at a step, and the inspection table.

The normal is estimated from force and path. The tip presses with F_N along the wall's inward
normal, and sliding friction acts along its motion t. On a straight path t follows from two
positions, and the component of the force normal to t,

    n̂ ∝ (I − t tᵀ) 𝐅,

is free of friction for any μ. The force is averaged over the same path against noise. At rest
friction may have any direction: the error of n̂ ∝ 𝐅 is up to atan μ, 17° at μ = 0.3, that of the
declared direction at most the declared angle. An error b F_N of the force normal to n̂, such as a
bias of the sensor, turns n̂ by atan b.

Places are those of the navigation, with its error; true ones without a navigation.
"""

import io
from itertools import pairwise
from typing import Any

import numpy as np

from uvms_drake.mission.law import DONE, RETREATED, RUNNING, SKIPPED
from uvms_drake.mission.steps import Step
from uvms_drake.model.frames.euler import rotation_matrix
from uvms_drake.report.contact_check import ForceBands, force_bands, force_error
from uvms_drake.report.signals import attempts_of, has_mission, progress_of
from uvms_drake.station.contact.bounds import sensed_contact
from uvms_drake.station.record import Record

OUTCOMES = {RUNNING: "not over at the end of the run", DONE: "done", SKIPPED: "skipped in part",
            RETREATED: "retreated"}
"""Texts of the outcomes of a mission."""
WINDOW = 2.0
"""Window for path and force [s]."""
SHORTEST_PATH = 0.02
"""Shortest path in that time that counts as sliding [m]."""
COLUMNS = ("time_s", "step", "x_m", "y_m", "z_m", "normal_x", "normal_y", "normal_z", "slid",
           "force_N", "desired_N", "tool_angle_rad")
"""Columns of the table; `slid` is 1 for a normal from force and path, 0 for the declared direction.
`force_N` is the measured force along the normal, `tool_angle_rad` the angle between the normal and
the tool's axis."""


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
    if not np.any(step.along):
        return np.linalg.norm(tip - place, axis=1), np.zeros(len(tip))
    along = np.asarray(step.along) / np.linalg.norm(step.along)
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
                    "within": np.mean(np.abs(error[when]) <= step.tolerance),
                    "off_rms": np.sqrt(np.mean(off**2)), "off_worst": np.max(off),
                    "behind": np.max(behind)}
        rows.append(row)
    return {"outcome": OUTCOMES[int(progress["outcome"][-1])],
            "over_s": record.time[over[0]] if len(over) else None,
            "failures": int(progress["failures"][-1]),
            "not_begun": len(mission.steps) - len({row["step"] for row in rows}),
            "steps": rows}


def pressing_samples(record: Record) -> np.ndarray:
    """Returns whether a pressing step is active and the last measurement was a contact (T,)."""
    steps, progress = record.scenario.mission.steps, progress_of(record)
    presses = np.array([*(step.strongest > 0.0 for step in steps), False])
    return ((progress["outcome"] == RUNNING) & presses[progress["step"]]
            & (record.signals["touched"][:, 0] > 0.0))


def learned_normals(time: np.ndarray, tip: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Returns n̂ (T, 3) while the tip slides, else NaN; see the module.

    Args:
        time: Instants without a gap (T,) [s].
        tip: Positions of a tip in contact (T, 3) [m].
        force: Measured force on the wall (T, 3) [N].
    """
    first = np.searchsorted(time, time - WINDOW - 1e-9)
    count = np.arange(1, len(time) + 1) - first
    total = np.concatenate([np.zeros((1, 3)), np.cumsum(force, axis=0)])
    mean = (total[1:] - total[first]) / count[:, None]
    path = tip - tip[first]
    length = np.linalg.norm(path, axis=1, keepdims=True)
    along = path / np.maximum(length, 1e-12)
    across = mean - np.sum(mean * along, axis=1, keepdims=True) * along
    size = np.linalg.norm(across, axis=1, keepdims=True)
    slides = (length >= SHORTEST_PATH) & (size > 0.0)
    return np.where(slides, across / np.maximum(size, 1e-12), np.nan)


def inspection_table(record: Record) -> np.ndarray:
    """Returns the rows of `COLUMNS` (m, 12): the logged samples of the mission's pressing steps."""
    pressing, step = pressing_samples(record), progress_of(record)["step"]
    force, n = record.signals["force_last_valid"][:, :3], sensed_contact(record.scenario).direction
    chi = record.chi
    if "measured_state" in record.signals:
        chi = record.model.task_pose(record.signals["measured_state"][:, : record.model.size])
    tip, axis = chi[:, :3], rotation_matrix(chi[:, 3:6])[..., 0] @ record.model.R_WT.T
    normals = np.full((len(pressing), 3), np.nan)
    changes = np.diff(np.where(pressing, step, -1), prepend=-1, append=-1) != 0
    edges = np.flatnonzero(changes)
    for begin, end in pairwise(edges):
        if pressing[begin]:
            part = slice(begin, end)
            normals[part] = learned_normals(record.time[part], tip[part], force[part])
    slid = np.isfinite(normals[:, 0])
    normals[~slid] = n
    rows = np.column_stack([
        record.time, step, tip, normals, slid, np.sum(force * normals, axis=1),
        record.signals["mission_force"],
        np.arccos(np.clip(np.sum(axis * normals, axis=1), -1.0, 1.0))])
    return rows[pressing]


def format_inspection(record: Record) -> str:
    """Returns the table as CSV."""
    out = io.StringIO()
    np.savetxt(out, inspection_table(record), delimiter=",", header=",".join(COLUMNS), comments="",
               fmt=["%.3f", "%d", *["%.5f"] * 6, "%d", *["%.3f"] * 3])
    return out.getvalue()
