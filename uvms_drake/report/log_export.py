"""The log of a run for other programs: as CSV, and as MCAP for Foxglove.

A line, or a message, a sample. The first column is the time; every other is a signal's component
with its unit, such as `force/x_N`; a slash makes a tree of them in PlotJuggler, and a topic in
MCAP. The signals are those of `signals.md`.
"""

import io
import json
from pathlib import Path

import numpy as np

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.common.program import VERSION
from uvms_drake.station.record import Record

MCAP_FILE = "log.mcap"
TIME_DIGITS, DIGITS = 12, 10


def format_log(record: Record) -> str:
    """Returns the log as CSV, time to twelve digits and others to ten; unknown ones are `nan`.

    By six, of 5 ms a sample every second time repeats after 1000 s, and at a depth of 3000 m only
    centimetres are left.
    """
    columns, out = record.columns(), io.StringIO()
    formats = [f"%.{TIME_DIGITS}g", *[f"%.{DIGITS}g"] * (len(columns) - 1)]
    np.savetxt(out, np.column_stack(list(columns.values())), delimiter=",", fmt=formats,
               header=",".join(columns), comments="")
    return out.getvalue()


def write_mcap(record: Record, path: Path) -> None:
    """Writes all logged signals, named as in `log.csv`; an unknown value is null.

    Raises:
        InvalidParameter: The package `mcap` is not installed.
    """
    try:
        from mcap.writer import Writer  # type: ignore[import-not-found]
    except ImportError:
        raise InvalidParameter("--mcap", MCAP_FILE, "left out without the package 'mcap' (pip "
                               "install 'uvms_drake[mcap]')") from None
    columns = record.columns()
    times = np.round(1e9 * columns.pop("time_s")).astype(int)
    topics: dict[str, dict[str, np.ndarray]] = {}
    for name, values in columns.items():
        topic, _, part = name.rpartition("/")
        topics.setdefault(topic or name, {})[part] = values
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(library=f"uvms_drake {VERSION}")
        for topic, parts in topics.items():
            schema = writer.register_schema(topic, "jsonschema", json.dumps({
                "type": "object",
                "properties": {part: {"type": ["number", "null"]} for part in parts}}).encode())
            channel = writer.register_channel(f"/{topic}", "json", schema)
            table = np.column_stack(list(parts.values())).astype(float)
            for time, row in zip(times.tolist(), table.tolist(), strict=True):
                message = {part: value if np.isfinite(value) else None
                           for part, value in zip(parts, row, strict=True)}
                writer.add_message(channel, time, json.dumps(message).encode(), time)
        writer.finish()
