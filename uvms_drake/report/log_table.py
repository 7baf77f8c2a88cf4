"""The log of a run as CSV, one line a sample, for PlotJuggler, Foxglove or a spreadsheet.

The first column is the time; a slash in a column's name makes a tree of them in PlotJuggler. Much
more is in `log.npz`.
"""

import io
from collections.abc import Iterator

import numpy as np

from uvms_drake.mission.system import PROGRESS
from uvms_drake.station.record import Record

POSE = ("x", "y", "z", "roll", "pitch", "yaw")
VELOCITY = ("u", "v", "w", "p", "q", "r")
"""Components of ν, by the names of SNAME."""
COMPONENTS = {"force_last_valid": ("x", "y", "z"), "target": ("x", "y", "z"),
              "mission_place": ("x", "y", "z"), "mission_progress": PROGRESS}
"""Components of signals that have more than one; of a wrench, the force."""


def log_columns(record: Record) -> dict[str, np.ndarray]:
    """Returns the columns (T,) by name, in SI units.

    There are those of a mission and of a sensed contact, if there is one.
    """
    return {f"{name}/{part}" if part else name: values
            for name, parts, table in _tables(record)
            for part, values in zip(parts, table.T, strict=False)}


def _tables(record: Record) -> Iterator[tuple[str, tuple[str, ...], np.ndarray]]:
    """Yields names, names of components, and values (T, components and maybe more)."""
    joints = tuple(f"q{i + 1}" for i in range(record.num_joints))
    yield "time", ("",), record.time[:, None]
    yield "tip", POSE, record.chi
    yield "planned_tip", POSE, record.chi_nominal
    yield "force", POSE[:3], record.force
    yield "desired_force", POSE[:3], record.desired_force
    yield "vehicle", POSE, record.config
    yield "joints", joints, record.config[:, 6:]
    yield "vehicle_velocity", VELOCITY, record.zeta
    yield "joint_velocity", joints, record.zeta[:, 6:]
    for name, values in record.signals.items():
        if name in COMPONENTS or values.shape[1] == 1:
            yield name, COMPONENTS.get(name, ("",)), values


def format_log(record: Record) -> str:
    """Returns the log as CSV, to ten digits; unknown values are `nan`.

    By six, of 5 ms a sample every second time repeats after 1000 s, and at a depth of 3000 m only
    centimetres are left.
    """
    columns, out = log_columns(record), io.StringIO()
    np.savetxt(out, np.column_stack(list(columns.values())), delimiter=",", fmt="%.10g",
               header=",".join(columns), comments="")
    return out.getvalue()
