"""Inspection table: place, normal and force of every measurement on the wall.

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

import numpy as np

from uvms_drake.model.frames.euler import rotation_matrix
from uvms_drake.report.mission.attempts import progress_of
from uvms_drake.report.mission.mission import pressing_samples
from uvms_drake.station.contact.bounds import sensed_contact
from uvms_drake.station.record import Record

WINDOW = 2.0
"""Window for path and force [s]."""
SHORTEST_PATH = 0.02
"""Shortest path in that time that counts as sliding [m]."""
COLUMNS = ("time_s", "step", "x_m", "y_m", "z_m", "normal_x", "normal_y", "normal_z", "slid",
           "force_N", "desired_N", "aslant_rad")
"""Columns of the table; `slid` is 1 for a normal from force and path, 0 for the declared direction.
`force_N` is the measured force along the normal, `aslant_rad` the angle between it and the tool's
axis."""


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
