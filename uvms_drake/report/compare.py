"""Comparison of several runs: their figures of merit, the keys that differ, signals overlaid."""

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pydrake.common.yaml import yaml_load_data

from uvms_drake.certificate.run_verdict import is_violated
from uvms_drake.common.errors import shortened
from uvms_drake.model.frames.euler import pose_difference
from uvms_drake.report import figure_style as style
from uvms_drake.report.drawing import Drawing, Panel, Series, line
from uvms_drake.station.record import Record
from uvms_drake.station.scenario.scenario import Scenario, dump_scenario
from uvms_drake.station.scenario.scenario_file import leaves

COLORS = (style.BLUE, style.VERMILION, style.GREEN, style.ORANGE, style.PURPLE, style.BLACK)
MOST = len(COLORS)
"""Largest number of runs in a comparison, one for each colour."""
WIDEST = 40
"""Largest number of characters of a value in the table of keys."""
PART = re.compile(r"(.+)\.\d+\._tag$")
"""Key of the kind of a part of a list."""
METRICS: dict[str, tuple[str, ...]] = {
    "settled [s]": ("force", "settling_time_s"),
    "normal force error, end [N]": ("force", "final_error_normal"),
    "normal force error, worst once settled [N]": ("force", "worst_normal_error_after_settling"),
    "tangential force error, end [N]": ("force", "final_error_tangential"),
    "largest force in contact [N]": ("contact", "largest_force"),
    "first touch [s]": ("contact", "first_touch_s"),
    "losses of contact [-]": ("contact", "losses"),
    "disturbance, worst of all [m/s², rad/s²]": ("disturbance", "worst"),
    "part of the tube used [-]": ("tube", "largest_use"),
    "exits of the tube [-]": ("tube", "exits"),
    "MPC samples without a new plan [-]": ("mpc", "fallbacks"),
    "MPC step, median [ms]": ("mpc", "step_ms", "p50"),
    "times real time [-]": ("real_time_factor",),
}
"""Path in summary.json of each figure of merit, by its name with unit."""


def metrics_of(summary: Mapping[str, Any]) -> dict[str, float | None]:
    """Returns the figures of merit of a run by name; None where there is none."""
    out = {}
    for name, path in METRICS.items():
        value: Any = summary
        for key in path:
            value = value[key]
        out[name] = value
    out["failed at [s]"] = summary["duration_s"] if summary["failure"] else None
    out["limits violated [-]"] = sum(is_violated(row) for row in summary["constraints"].values())
    return out


def differing_keys(scenarios: Sequence[Scenario]) -> dict[str, list[str]]:
    """Returns the keys of which not all scenarios have the same value, and the value of each.

    A key that a scenario does not have, as another kind of part has others, is `-`. Of a list whose
    parts differ in kind or number there are the kinds alone.
    """
    flat = [dict(leaves(yaml_load_data(dump_scenario(each)))) for each in scenarios]
    keys = dict.fromkeys(key for each in flat for key in each)
    table = {key: [each.get(key, "-") for each in flat] for key in keys if key != "description"}
    table = {key: values for key, values in table.items() if len(set(values)) > 1}
    for name in dict.fromkeys(part[1] for key in table if (part := PART.match(key))):
        kinds = [", ".join(type(part).__name__ for part in _at(each, name)) for each in scenarios]
        table = {key: values for key, values in table.items() if not key.startswith(f"{name}.")}
        table[name] = [each or "-" for each in kinds]
    return table


def _at(data: Any, key: str) -> Any:
    """Returns the value at a dotted key, of attributes and of indices of lists."""
    for name in key.split("."):
        data = data[int(name)] if name.isdigit() else getattr(data, name)
    return data


def format_comparison(names: Sequence[str], summaries: Sequence[Mapping[str, Any]],
                      differences: Mapping[str, Sequence[str]]) -> str:
    """Returns both tables as Markdown, a column for each run.

    Args:
        names: Names of the runs.
        summaries: Their summaries.
        differences: As of `differing_keys`.
    """
    columns = [metrics_of(each) for each in summaries]
    rows = [[name, *(_text(column[name]) for column in columns)] for name in columns[0]]
    keys = [[key, *(shortened(value, WIDEST) for value in values)]
            for key, values in differences.items()]
    text = _table(["", *names], rows)
    if not keys:
        return f"{text}\n\nno key of the scenarios differs"
    return f"{text}\n\n{_table(['key', *names], keys)}"


def _text(value: float | None) -> str:
    return "-" if value is None else str(value) if isinstance(value, int) else f"{value:.4g}"


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Returns a table in Markdown, its columns aligned for a terminal."""
    cells = [[cell.replace("|", "/") for cell in row] for row in (header, *rows)]
    widths = [max(3, *map(len, column)) for column in zip(*cells, strict=True)]
    lines = ["| " + " | ".join(f"{cell:<{width}}" for cell, width in zip(
        row, widths, strict=True)) + " |" for row in cells]
    rule = "|" + "|".join("-" * (width + 2) for width in widths) + "|"
    return "\n".join([lines[0], rule, *lines[1:]])


def normal_force(record: Record) -> tuple[np.ndarray, np.ndarray]:
    """Returns force and desired force (T,) [N] along the direction of the last 𝔉_des.

    Along that of a sensed contact if there is one; the norms where no force is desired.
    """
    last = record.desired_force[-1, :3]
    wall = record.scenario.contact.declared_wall()
    direction = last if wall is None else wall.direction
    size = float(np.linalg.norm(direction))
    if size == 0.0:
        return (np.linalg.norm(record.force[:, :3], axis=1),
                np.linalg.norm(record.desired_force[:, :3], axis=1))
    return (record.force[:, :3] @ direction / size, record.desired_force[:, :3] @ direction / size)


def comparison_drawing(names: Sequence[str], records: Sequence[Record]) -> Drawing:
    """Returns force, pose error, tube and disturbance of all runs over each other.

    Args:
        names: Names of the runs, for the legend.
        records: Their records.
    """
    rows: dict[str, list[Series]] = {label: [] for label in (
        "normal force\n(desired thin) [N]", "position error\n[mm]", "orientation error\n[mrad]",
        "deviation over\nthe tube [%]", "disturbance\n[m/s², rad/s²]")}
    for name, record, color in zip(names, records, COLORS, strict=False):
        force, desired = normal_force(record)
        error, bound = 1e3 * pose_difference(record.chi, record.chi_des), record.scenario.tube.e
        used = 100.0 * record.deviation_of("task") / bound if bound > 0.0 else (
            np.full(len(record.time), np.nan))
        norm = record.scenario.disturbance.norm(record.effective_disturbance)
        for series, values in zip(rows.values(), (
                force, np.linalg.norm(error[:, :3], axis=1), np.linalg.norm(error[:, 3:], axis=1),
                used, norm), strict=True):
            series.append(line(values, x=record.time, color=color, linewidth=0.9, label=name))
        rows["normal force\n(desired thin) [N]"].append(
            line(desired, style.DESIRED, x=record.time, color=color, linewidth=0.6, label=""))
    _, *logarithmic, _ = rows
    rows["deviation over\nthe tube [%]"].append(line(100.0, style.LIMIT))
    return Drawing([[Panel(label, records[0].time, series,
                           **(_decades(series) if label in logarithmic else {}))
                     for label, series in rows.items()]], 6.6, legend=2)


def _decades(series: Sequence[Series]) -> dict[str, Any]:
    """Returns the scale of a panel over four decades, if it shows anything above zero."""
    values = np.concatenate([np.ravel(each.y) for each in series])
    largest = float(np.max(values[np.isfinite(values)], initial=0.0))
    return {"scale": "log", "limits": (1e-4 * largest, 2.0 * largest)} if largest > 0.0 else {}
