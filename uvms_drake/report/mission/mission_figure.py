"""Figure of a mission: force over time and along each line, and distance from the line."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from uvms_drake.report.figure_style import (
    BLUE,
    DESIRED,
    GREEN,
    REAL,
    VERMILION,
    legend_above,
    panels,
)
from uvms_drake.report.mission.attempts import Attempt, attempts_of
from uvms_drake.report.mission.mission import lateral_errors
from uvms_drake.station.contact.bounds import sensed_contact
from uvms_drake.station.record import Record


def draw_mission(record: Record) -> Figure:
    """Draws the force along n over time and along the lines, with the bands of the steps."""
    steps = record.scenario.mission.checked().steps
    attempts = attempts_of(record)
    slides = [each for each in attempts if np.any(steps[each.step].end)]
    rows = 1 + 2 * bool(slides)
    figure, axes = panels(rows, 1.0 + 1.45 * rows, sharex=False)
    n = sensed_contact(record.scenario).direction
    measured, real = (force[:, :3] @ n for force in (
        record.signals["force_last_valid"], record.force))
    goal = record.signals["mission_force"][:, 0]
    axes[0].plot(record.time, measured, color=VERMILION, linewidth=0.5, alpha=0.7, label="measured")
    axes[0].plot(record.time, real, **REAL)
    axes[0].plot(record.time, goal, **DESIRED)
    for each in attempts:
        step = steps[each.step]
        if step.touches:
            _band(axes[0], record.time[each.when], goal[each.when], step.largest_error)
        _name(axes[0], record, each, type(step).__name__.lower())
    axes[0].set_xlim(record.time[0], record.time[-1])
    axes[0].set_ylim(top=1.3 * max(axes[0].get_ylim()[1], 0.0))  # Space for the names.
    axes[0].set_xlabel("time [s]")
    axes[0].set_ylabel("force along $n$ [N]")
    if slides:
        _draw_lines(axes[1], axes[2], record, slides, measured, real, goal)
    legend_above(figure, axes[0])
    return figure


def _draw_lines(forces: Axes, places: Axes, record: Record, slides: list[Attempt],
                measured: np.ndarray, real: np.ndarray, goal: np.ndarray) -> None:
    """Draws the forces, and the distance from the line, over the path along it."""
    contact, steps = sensed_contact(record.scenario), record.scenario.mission.checked().steps
    for each in slides:
        step, when = steps[each.step], each.when
        tip = record.chi[when, :3] @ contact.walls.axes[1:].T
        begin = record.signals["mission_place"][when.start] @ contact.walls.axes[1:].T
        path = 1e3 * (tip - begin) @ step.end / np.linalg.norm(step.end)
        forces.plot(path, measured[when], color=VERMILION, linewidth=0.5, alpha=0.7)
        forces.plot(path, real[when], **REAL)
        forces.plot(path, goal[when], **DESIRED)
        _band(forces, path, goal[when], step.largest_error)
        off, _ = lateral_errors(record, step, when)
        places.plot(path, 1e3 * off, color=BLUE)
    forces.set_ylabel("force along $n$ [N]")
    places.set_ylabel("off the line [mm]")
    forces.sharex(places)
    forces.tick_params(labelbottom=False)
    places.set_xlabel("path along the line [mm]")


def _band(axis: Axes, over: np.ndarray, goal: np.ndarray, tolerance: float) -> None:
    axis.fill_between(over, goal - tolerance, goal + tolerance, color=GREEN, alpha=0.2,
                      linewidth=0, label="band of the step")


def _name(axis: Axes, record: Record, attempt: Attempt, text: str) -> None:
    """Marks the begin of a step by a thin line with its name."""
    begin = record.time[attempt.when.start]
    axis.axvline(begin, color="0.35", linewidth=0.5)
    axis.annotate(text, (begin, 1.0), (1.0, -1.0), xycoords=axis.get_xaxis_transform(),
                  textcoords="offset points", fontsize=5, color="0.35", va="top", rotation=90)
