"""The log of a run as CSV, one line a sample, for PlotJuggler, Foxglove or a spreadsheet.

The first column is the time; every other is a signal's component with its unit, such as
`force/x_N`; a slash makes a tree of them in PlotJuggler. The signals are those of `signals.md`.
"""

import io

import numpy as np

from uvms_drake.station.record import Record

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
