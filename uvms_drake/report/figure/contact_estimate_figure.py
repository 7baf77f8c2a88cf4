"""The figure of a sensed contact: the estimate of the wall against the real wall."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from uvms_drake.model.surface.law import check_surface
from uvms_drake.report.events import events
from uvms_drake.report.figure.force_figure import draw_instants, draw_tolerance
from uvms_drake.report.figure_style import (
    BLACK,
    BLUE,
    DESIRED,
    GREEN,
    LIMIT,
    NOMINAL,
    REAL,
    VERMILION,
    legend_over,
    panels,
)
from uvms_drake.report.mission.force_bands import force_bands
from uvms_drake.report.signals import surface_depth, surface_slope
from uvms_drake.station.contact.bounds import safe_depth_margin, sensed_contact
from uvms_drake.station.problem import true_surface
from uvms_drake.station.record import Record

WALL: dict[str, Any] = {"color": BLACK, "linewidth": 0.9, "label": "wall"}
ESTIMATED: dict[str, Any] = {"color": VERMILION, "linestyle": (0, (4, 1.5)), "linewidth": 0.9,
                             "label": "estimated wall"}
ESTIMATE = "stiffness_estimate"
"""Signal without which a run has no contact estimate to draw."""
MARKS = ("first touch", "contact lost", "retargeted", "last plan kept", "sensor lost")
"""Names of the marks on the time axis."""
BEFORE, AROUND = 1.5, 8.0
"""Time before the first touch [s], and depth beside all else [mm], in the enlarged panel."""


def draw_contact_estimate(record: Record, certified: float | None = None) -> Figure:
    """Draws force, depths, stiffness and events of a sensed contact, and the contact enlarged.

    Depths are along n, from where the tip first touches the wall or else from where it starts.

    Args:
        record: Record of the run.
        certified: Certified bound of the force error once the plan is at the task [N].
    """
    marks = {name: times for name, times in marks_of(record).items() if times}
    touched, strip = "first touch" in marks, 0.25 * max(len(marks), 1)
    figure, axes = panels(4 + touched, 4.9 + 1.6 * touched + 0.3 * strip, sharex=False,
                          ratios=[1.6, 1.4, 0.8, strip, *[1.6] * touched])
    _draw_force(axes[0], record, certified)
    depths = depths_of(record)
    _draw_depths(axes[1], record, depths)
    legend_over(axes[1], 3)
    _draw_stiffness(axes[2], record)
    _draw_marks(axes[3], marks)
    for axis in axes[:3]:
        axis.sharex(axes[3])
        axis.tick_params(labelbottom=False)
    axes[3].set_xlim(record.time[0], record.time[-1])
    axes[3].set_xlabel("time [s]")
    if touched:
        start = marks["first touch"][0] - BEFORE
        _draw_depths(axes[4], record, depths)
        axes[4].set_xlim(max(start, record.time[0]), record.time[-1])
        axes[4].set_ylim(-AROUND, np.nanmax([depths["explored"], depths["tip"]]) + AROUND)
        axes[4].set_title("the depths, enlarged\n")
        draw_instants(axes[4], record)
    return figure


def depths_of(record: Record) -> dict[str, np.ndarray]:
    """Returns the real, planned, explored and estimated depths (T,) [mm].

    NaN is unknown: `explored` before anything is safe, `estimated` before a touch, and `wall` where
    it is not near.
    """
    n = sensed_contact(record.scenario).direction
    wall = surface_depth(check_surface(true_surface(record.scenario)), record.chi, n)
    safe, estimated = (record.signals[name][:, 0] for name in ("safe_depth", "contact_depth"))
    tip = record.chi[:, :3] @ n
    inside = record.penetration > 0.0
    origin = wall[np.argmax(inside)] if np.any(inside) else tip[0]
    depths = {"tip": tip, "planned": record.chi_nominal[:, :3] @ n, "wall": wall,
              "explored": np.where(
                  np.isfinite(safe), safe + safe_depth_margin(record.scenario), np.nan),
              "estimated": estimated}
    return {name: 1e3 * (depth - origin) for name, depth in depths.items()}


def marks_of(record: Record) -> dict[str, list[float]]:
    """Returns the times of each of `MARKS` [s]."""
    found = events(record)
    contacts = [event for event in found if event.kind == "contact"]
    starts = ([event.start for event in found if event.kind == kind]
              for kind in ("retarget", "plan_kept", "force_lost"))
    lost = [event.end for event in contacts if event.end is not None]
    return dict(zip(MARKS, ([event.start for event in contacts[:1]], lost, *starts), strict=True))


def _draw_force(axis: Axes, record: Record, certified: float | None) -> None:
    contact = sensed_contact(record.scenario)
    measured, real, goal = (force[:, :3] @ contact.direction for force in (
        record.signals["force_last_valid"], record.force, record.desired_force))
    axis.plot(record.time, measured, color=VERMILION, linewidth=0.6, alpha=0.7, label="measured")
    axis.plot(record.time, real, **REAL)
    axis.plot(record.time, goal, **DESIRED)
    axis.axhline(contact.force, **{**LIMIT, "label": "limit of the static force"})
    draw_tolerance(axis, record, goal[:, None])
    if certified is not None:
        limits = axis.get_ylim()
        _draw_bands(axis, record, goal)
        axis.set_ylim(*limits)
    draw_instants(axis, record)
    axis.set_ylabel("force along $n$ [N]")
    axis.figure.legend(*axis.get_legend_handles_labels(), ncols=2, loc="outside upper center")


def _draw_bands(axis: Axes, record: Record, goal: np.ndarray) -> None:
    """Draws both certified bands about the desired force (T,): in contact, and in a hold."""
    found, hold = force_bands(record), record.scenario.tube.hold
    since = "" if hold is None else f", from {hold.time:.2g} s on"
    for holds, alpha, label in ((False, 0.12, "certified in motion"),
                                (True, 0.35, f"certified in a hold{since}")):
        there = np.isfinite(found.bound) & (found.holds == holds)
        if np.any(there):
            least = np.min(found.bound[there])
            axis.fill_between(
                record.time, goal - found.bound, goal + found.bound, where=there, color=GREEN,
                alpha=alpha, linewidth=0, label=f"{label}, $\\pm${least:.3g} N or more")


def _draw_depths(axis: Axes, record: Record, depths: dict[str, np.ndarray]) -> None:
    """Draws depths; the unexplored region is grey."""
    for name, style in (("explored", {"color": GREEN, "label": "explored up to"}), ("wall", WALL),
                        ("estimated", ESTIMATED), ("tip", {**REAL, "label": "tip"}),
                        ("planned", {**NOMINAL, "label": "planned tip"})):
        axis.plot(record.time, depths[name], **style)
    limits = axis.get_ylim()
    axis.fill_between(record.time, depths["explored"], 1e4, color="0.93", linewidth=0, zorder=0.5,
                      label="unexplored")
    axis.set_ylim(*limits)
    axis.set_ylabel("depth [mm]")


def _draw_stiffness(axis: Axes, record: Record) -> None:
    """Draws the stiffness of the wall, its estimate with a band of ± 2σ, and the one used."""
    contact = sensed_contact(record.scenario)
    estimated, std, used = (record.signals[f"stiffness_{name}"][:, 0]
                            for name in ("estimate", "std", "used"))
    own = surface_slope(check_surface(true_surface(record.scenario)), record.chi, contact.direction)
    axis.axhline(contact.stiffness, **{**LIMIT, "label": r"declared, $\kappa_+$"})
    axis.plot(record.time, own, color=BLUE, label="of the wall")
    axis.plot(record.time, estimated, **{**ESTIMATED, "label": r"estimated, $\pm\,2\sigma$"})
    axis.fill_between(record.time, estimated - 2.0 * std, estimated + 2.0 * std, color=VERMILION,
                      alpha=0.15, linewidth=0)
    axis.plot(record.time, used, color=GREEN, linewidth=0.7, label="used by the controller")
    axis.set_ylim(0.0, 1.15 * contact.stiffness)
    axis.set_ylabel("stiffness [N/m]")
    legend_over(axis, 3)


def _draw_marks(axis: Axes, marks: dict[str, list[float]]) -> None:
    for row, times in enumerate(marks.values()):
        axis.plot(times, np.full(len(times), -row), "|", color=BLACK, markersize=5)
    axis.set_yticks(-np.arange(len(marks)), list(marks))
    axis.set_ylim(0.6 - max(len(marks), 1), 0.6)
    axis.grid(visible=False, axis="y")
