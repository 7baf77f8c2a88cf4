"""The figure of the force: the whole run, and the impact enlarged."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from uvms_drake.model.frames.euler import pose_difference
from uvms_drake.report.events import events
from uvms_drake.report.figure_style import (
    BLUE,
    DESIRED,
    GREEN,
    LIMIT,
    TIGHTENED,
    XYZ,
    instant,
    legend_above,
    panels,
)
from uvms_drake.report.metrics import summarise_force
from uvms_drake.report.signals import nominal_limits, real_limits, settling_index, wrench_unit
from uvms_drake.station.record import Record

AT_TASK = 1e-3
"""Error of the nominal pose from which on the plan counts as at the task [m, rad]."""


def draw_force(record: Record, certified: float | None = None) -> Figure:
    """Draws 𝔉 and the penetration, and after an approach the force from contact to settling.

    Args:
        record: Record of the run.
        certified: Certified bound of the force error once the plan is at the task [N].
    """
    torque, approach = bool(np.any(record.force[:, 3:])), not record.penetration[0] > 0.0
    rows = 2 + torque + approach
    figure, axes = panels(rows, 0.6 + 1.2 * rows, sharex=False)
    whole = axes[: 2 + torque]
    _draw_wrench(whole[0], record, slice(0, 3), "$F_{}$")
    draw_tolerance(whole[0], record, wanted(record, slice(0, 3)))
    if certified is not None:
        draw_certified(whole[0], record, wanted(record, slice(0, 3)), certified)
    draw_instants(whole[0], record)
    whole[0].set_ylabel("force [N]")
    if torque:
        _draw_wrench(whole[1], record, slice(3, 6), "$M_{}$")
        draw_tolerance(whole[1], record, wanted(record, slice(3, 6)))
        whole[1].set_ylabel("torque [N m]")
        whole[1].legend(ncols=4, loc="best")
    # Penetration, below everything of the whole run.
    whole[-1].plot(record.time, 1e3 * record.penetration)
    _draw_deepest(whole[-1], record)
    whole[-1].set_ylabel("penetration [mm]")
    whole[-1].set_xlabel("time [s]")
    for axis in whole[:-1]:
        axis.sharex(whole[-1])
        axis.tick_params(labelbottom=False)
    # The impact once more, enlarged.
    if approach:
        _draw_wrench(axes[-1], record, slice(0, 3), "$F_{}$")
        axes[-1].set_ylabel("force [N]")
        axes[-1].set_xlim(*_impact_window(record))
        draw_instants(axes[-1], record)
        over = summarise_force(record)["overshoot"]
        axes[-1].set_title("\n" if over["percent"] is None else
                           f"overshoot {over['newton']:.2g} N, {over['percent']:.3g} %\n")
    legend_above(figure, axes[0], 3)
    return figure


def _draw_wrench(axis: Axes, record: Record, part: slice, name: str) -> None:
    for color, letter, force in zip(XYZ, "xyz", record.force[:, part].T, strict=True):
        axis.plot(record.time, force, color=color, label=name.format(letter))
    goals = np.unique(record.desired_force[:, part], axis=1).T
    for i, goal in enumerate(goal for goal in goals if np.any(goal)):
        axis.plot(record.time, goal, **{**DESIRED, "label": "_" if i else "desired"})


def wanted(record: Record, part: slice) -> np.ndarray:
    """Returns the components of 𝔉_des that are not zero all the time (T, K)."""
    goals = record.desired_force[:, part]
    return goals[:, np.any(goals, axis=0)]


def draw_certified(axis: Axes, record: Record, goals: np.ndarray, bound: float) -> None:
    """Draws the certified band of the force from the instant at which the plan is at the task.

    Args:
        axis: Where to draw.
        record: Record of the run.
        goals: Desired forces (T, K) [N].
        bound: The certified bound of their errors [N].
    """
    error = np.linalg.norm(pose_difference(record.chi_nominal, record.chi_des), axis=1)
    start = settling_index(error, AT_TASK)
    if start is None:
        return
    for i, goal in enumerate(goals[start:].T):
        axis.fill_between(
            record.time[start:], goal - bound, goal + bound, color=GREEN, alpha=0.25, linewidth=0,
            label="_" if i else f"certified with the plan at the task, $\\pm${bound:.3g} N")


def draw_instants(axis: Axes, record: Record) -> None:
    """Marks the first contact and the instant of settling."""
    first = {event.kind: event.start for event in reversed(events(record))}
    if first.get("contact", 0.0) > 0.0:
        instant(axis, first["contact"], "contact", "right")
    if "settled" in first:
        instant(axis, first["settled"], "settled")


def _draw_deepest(axis: Axes, record: Record) -> None:
    """Draws how deep the limit on the static force lets it go into a surface that is known."""
    limit = real_limits(record).get("static_force")
    if record.scenario.surface_error.size > 0.0 or limit is None:
        return
    nominal = nominal_limits(record)["static_force"]
    for force, style in ((limit.upper[0], LIMIT), (nominal.upper[0], TIGHTENED)):
        deepest = record.model.surface.penetration_for(force)
        if deepest is not None:
            axis.axhline(1e3 * deepest, **style)
            axis.legend(loc="best")


def draw_tolerance(axis: Axes, record: Record, goals: np.ndarray) -> None:
    """Draws the bands about desired forces or torques (T, K) that count as settled."""
    tolerance, unit = record.scenario.task.force_tolerance, wrench_unit(record.desired_force[-1])
    for i, goal in enumerate(goals.T):
        axis.fill_between(record.time, goal - tolerance, goal + tolerance, color=BLUE, alpha=0.12,
                          linewidth=0, label="_" if i else
                          f"counts as settled, $\\pm${tolerance:g} {unit}")


def _impact_window(record: Record) -> tuple[float, float]:
    """Returns the times from just before the first contact to just after settling [s]."""
    force = np.linalg.norm(record.force, axis=1)
    touching = np.flatnonzero(force > 0.01 * max(float(np.max(force)), 1e-12))
    start = float(record.time[touching[0]]) if len(touching) else float(record.time[0])
    error = np.linalg.norm(record.force - record.desired_force, axis=1)
    settled = settling_index(error, record.scenario.task.force_tolerance)
    stop = start + 2.0 if settled is None else max(float(record.time[settled]), start) + 0.5
    return max(start - 0.2, float(record.time[0])), min(stop, float(record.time[-1]))
