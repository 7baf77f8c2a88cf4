"""Figures of a contact: the force, the estimate of an unknown wall, a mission and its coverage."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from uvms_drake.model.frames.euler import pose_difference
from uvms_drake.model.surface.law import check_surface
from uvms_drake.model.surface.surface_class import axis_names, is_floor
from uvms_drake.report import figure_style as style
from uvms_drake.report import signals
from uvms_drake.report.contact_check import force_bands
from uvms_drake.report.drawing import Drawing, Instant, Panel, Series, band, line
from uvms_drake.report.events import events
from uvms_drake.report.metrics import summarise_force
from uvms_drake.report.mission import COLUMNS, inspection_table, lateral_errors
from uvms_drake.station.contact.bounds import safe_depth_margin, sensed_contact
from uvms_drake.station.diagram import PAINTED
from uvms_drake.station.problem import true_surface
from uvms_drake.station.record import Record
from uvms_drake.station.true_wall import surface_depth

AT_TASK = 1e-3
"""Error of the nominal pose from which on the plan counts as at the task [m, rad]."""
ESTIMATE = "stiffness_estimate"
"""Signal without which a run has no contact estimate to draw."""
MARKS = ("first touch", "contact lost", "retargeted", "last plan kept", "sensor lost")
"""Names of the marks on the time axis."""
BEFORE, AROUND = 1.5, 8.0
"""Time before the first touch [s], and depth beside all else [mm], in the enlarged panel."""
NORMAL_FORCE, DEPTH = "force along $n$ [N]", "depth [mm]"
WALL = {"color": style.BLACK, "linewidth": 0.9, "label": "wall"}
ESTIMATED = {"color": style.VERMILION, "linestyle": (0, (4, 1.5)), "linewidth": 0.9,
             "label": "estimated wall"}
MEASURED = {"color": style.VERMILION, "linewidth": 0.6, "alpha": 0.7, "label": "measured"}


def contact_drawing(record: Record, certified: float | None = None) -> Drawing:
    """Returns the force on a surface; for a sensed contact, with the contact estimate.

    Args:
        record: Record of the run.
        certified: Certified bound of the force error once the plan is at the task [N].
    """
    return (estimate_drawing if ESTIMATE in record.signals else force_drawing)(record, certified)


def force_drawing(record: Record, certified: float | None = None) -> Drawing:
    """Returns 𝔉 and the penetration, and after an approach the force from contact to settling."""
    torque, approach = bool(np.any(record.force[:, 3:])), not record.penetration[0] > 0.0
    forces, moments = slice(0, 3), slice(3, 6)
    marks = instants(record)
    cells = [Panel("force [N]", record.time, [
        *_wrench(record, forces, "$F_{}$"), *_tolerance(record, wanted(record, forces)),
        *_certified(record, wanted(record, forces), certified)], instants=marks)]
    if torque:
        cells.append(Panel("torque [N m]", record.time, [
            *_wrench(record, moments, "$M_{}$"), *_tolerance(record, wanted(record, moments))],
            legend=4))
    deepest = _deepest(record)
    cells.append(Panel("penetration [mm]", record.time, [
        line(1e3 * record.penetration, label=""), *deepest], legend=len(deepest)))
    if approach:  # The impact once more, enlarged.
        over = summarise_force(record)["overshoot"]
        cells.append(Panel(
            "force [N]", record.time, _wrench(record, forces, "$F_{}$"), instants=marks,
            window=_impact_window(record), title="\n" if over["percent"] is None else
            f"overshoot {over['newton']:.2g} N, {over['percent']:.3g} %\n"))
    return Drawing([cells], 0.6 + 1.2 * len(cells), legend=3)


def wanted(record: Record, part: slice) -> np.ndarray:
    """Returns the components of 𝔉_des that are not zero all the time (T, K)."""
    goals = record.desired_force[:, part]
    return goals[:, np.any(goals, axis=0)]


def _wrench(record: Record, part: slice, name: str) -> list[Series]:
    forces = zip(style.XYZ, "xyz", record.force[:, part].T, strict=True)
    return [*(line(force, color=color, label=name.format(letter))
              for color, letter, force in forces),
            *(line(goal, style.DESIRED) for goal in wanted(record, part).T)]


def _tolerance(record: Record, goals: np.ndarray) -> list[Series]:
    """Returns the bands about desired forces or torques (T, K) that count as settled."""
    tolerance = record.scenario.task.force_tolerance
    unit = signals.wrench_unit(record.desired_force[-1])
    return [band(goal - tolerance, goal + tolerance, color=style.BLUE, alpha=0.12,
                 label=f"counts as settled, $\\pm${tolerance:g} {unit}") for goal in goals.T]


def _certified(record: Record, goals: np.ndarray, bound: float | None) -> list[Series]:
    """Returns the certified bands about forces (T, K), from when the plan is at the task."""
    error = np.linalg.norm(pose_difference(record.chi_nominal, record.chi_des), axis=1)
    start = signals.settling_index(error, AT_TASK)
    if bound is None or start is None:
        return []
    return [band(goal[start:] - bound, goal[start:] + bound, x=record.time[start:],
                 color=style.GREEN, alpha=0.25,
                 label=f"certified with the plan at the task, $\\pm${bound:.3g} N")
            for goal in goals.T]


def _deepest(record: Record) -> list[Series]:
    """Returns how deep the limit on the static force lets it go into a surface that is known."""
    limit = signals.real_limits(record).get("static_force")
    if record.scenario.surface_error.size > 0.0 or limit is None:
        return []
    depths = [(record.model.surface.penetration_for(each.upper[0]), look) for each, look in (
        (limit, style.LIMIT), (signals.nominal_limits(record)["static_force"], style.TIGHTENED))]
    return [line(1e3 * depth, look) for depth, look in depths if depth is not None]


def instants(record: Record) -> list[Instant]:
    """Returns the first contact and the instant of settling, as far as there are some."""
    first = {event.kind: event.start for event in reversed(events(record))}
    marks = [Instant(first["contact"], "contact", "right")] if first.get("contact", 0.0) else []
    return marks + ([Instant(first["settled"], "settled")] if "settled" in first else [])


def _impact_window(record: Record) -> tuple[float, float]:
    """Returns the times from just before the first contact to just after settling [s]."""
    force = np.linalg.norm(record.force, axis=1)
    touching = np.flatnonzero(force > 0.01 * max(float(np.max(force)), 1e-12))
    start = float(record.time[touching[0]]) if len(touching) else float(record.time[0])
    error = np.linalg.norm(record.force - record.desired_force, axis=1)
    settled = signals.settling_index(error, record.scenario.task.force_tolerance)
    stop = start + 2.0 if settled is None else max(float(record.time[settled]), start) + 0.5
    return max(start - 0.2, float(record.time[0])), min(stop, float(record.time[-1]))


# An unknown wall.


def estimate_drawing(record: Record, certified: float | None = None) -> Drawing:
    """Returns force, depths, stiffness and events of a sensed contact, and the contact enlarged.

    Depths are along n, from where the tip first touches the wall or else from where it starts.
    """
    contact, time = sensed_contact(record.scenario), record.time
    marks = {name: times for name, times in marks_of(record).items() if times}
    strip, run = 0.25 * max(len(marks), 1), (float(time[0]), float(time[-1]))
    goal = record.desired_force[:, :3] @ contact.direction
    # A wall that is stiffer than declared is seen, too.
    slopes = _stiffness(record)
    steepest = max(float(np.nanmax(each.y, initial=contact.stiffness)) for each in slopes)
    force = Panel(NORMAL_FORCE, time, [
        *_normal_forces(record, goal),
        line(contact.force, style.LIMIT, label="limit of the static force"),
        *_tolerance(record, goal[:, None]),
        *(_bands(record, goal) if certified is not None else [])],
        instants=instants(record), window=run, height=1.6)
    depths = depths_of(record)
    cells = [
        force,
        Panel(DEPTH, time, _depths(depths), window=run, legend=3, height=1.4),
        Panel("stiffness [N/m]", time, slopes, window=run, legend=3, height=0.8,
              limits=(0.0, 1.15 * steepest)),
        Panel("", time, [
            line(np.full(len(times), -row), {"color": style.BLACK, "marker": "|", "markersize": 5,
                                             "linestyle": ""}, x=np.array(times))
            for row, times in enumerate(marks.values())], rows=list(marks), window=run,
            limits=(0.6 - max(len(marks), 1), 0.6), height=strip)]
    touched = "first touch" in marks
    if touched:
        cells.append(Panel(
            DEPTH, time, _depths(depths), title="the depths, enlarged\n", height=1.6,
            instants=instants(record),
            window=(max(marks["first touch"][0] - BEFORE, run[0]), run[1]),
            limits=(-AROUND, float(np.nanmax([depths["explored"], depths["tip"]])) + AROUND)))
    return Drawing([cells], 4.9 + 1.6 * touched + 0.3 * strip, legend=2)


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


def _normal_forces(record: Record, goal: np.ndarray) -> list[Series]:
    """Returns the force along n, measured and real, and the desired one (T,)."""
    n = sensed_contact(record.scenario).direction
    return [line(record.signals["force_last_valid"][:, :3] @ n, MEASURED),
            line(record.force[:, :3] @ n), line(goal, style.DESIRED)]


def _bands(record: Record, goal: np.ndarray) -> list[Series]:
    """Returns both certified bands about the desired force (T,): in contact, and in a hold."""
    found, hold = force_bands(record), record.scenario.tube.hold
    since = "" if hold is None else f":\nplan at its target for {hold.time:.2g} s"
    bands = []
    for holds, alpha, label in ((False, 0.12, "certified in motion"),
                                (True, 0.35, "certified in a hold")):
        bound = np.where(found.holds == holds, found.bound, np.nan)
        if np.any(np.isfinite(bound)):
            bands.append(band(
                goal - bound, goal + bound, extends=False, color=style.GREEN, alpha=alpha,
                label=f"{label}, $\\pm${np.nanmin(bound):.3g} N or more{since if holds else ''}"))
    return bands


def _depths(depths: dict[str, np.ndarray]) -> list[Series]:
    """Returns depths; the unexplored region is grey."""
    return [line(depths["explored"], color=style.GREEN, label="end of the safe region"),
            line(depths["wall"], WALL), line(depths["estimated"], ESTIMATED),
            line(depths["tip"], label="tip"),
            line(depths["planned"], style.NOMINAL, label="planned tip"),
            band(depths["explored"], 1e4, extends=False, color="0.93", zorder=0.5,
                 label="outside the safe region")]


def _stiffness(record: Record) -> list[Series]:
    """Returns the stiffness of the wall, its estimate with a band of ± 2σ, and the one used."""
    contact = sensed_contact(record.scenario)
    estimated, std, used = (record.signals[f"stiffness_{name}"][:, 0]
                            for name in ("estimate", "std", "used"))
    own = signals.surface_slope(
        check_surface(true_surface(record.scenario)), record.chi, contact.direction)
    return [line(contact.stiffness, style.LIMIT, label=r"declared, $\kappa_+$"),
            line(own, label="of the wall"),
            line(estimated, ESTIMATED, label=r"estimated, $\pm\,2\sigma$"),
            band(estimated - 2.0 * std, estimated + 2.0 * std, color=style.VERMILION, alpha=0.15),
            line(used, color=style.GREEN, linewidth=0.7, label="used by the controller")]


# A mission.


def mission_drawing(record: Record) -> Drawing:
    """Returns the force along n over time and along the lines, with the bands of the steps."""
    steps, attempts = record.scenario.mission.checked().steps, signals.attempts_of(record)
    goal, time = record.signals["mission_force"][:, 0], record.time
    forces = _normal_forces(record, goal)
    whole = [*forces, *(_step_band(time, goal, each.when, steps[each.step])
                        for each in attempts if steps[each.step].touches)]
    low, high = (float(end([end(each.y) for each in forces])) for end in (np.min, np.max))
    cells = [Panel(NORMAL_FORCE, time, whole,
                   limits=(min(1.05 * low, 0.0), 1.3 * max(high, 1.0)),  # Space for the names.
                   instants=[Instant(float(time[each.when.start]),
                                     type(steps[each.step]).__name__.lower(), "inside")
                             for each in attempts])]
    pressed: list[Series] = []
    off_line: list[Series] = []
    across = sensed_contact(record.scenario).walls.axes[1:]
    for each in attempts:
        step, when = steps[each.step], each.when
        if not np.any(step.along):
            continue
        begin = record.signals["mission_place"][when.start]
        path = 1e3 * ((record.chi[when, :3] - begin) @ across.T) @ step.along / np.linalg.norm(
            step.along)
        pressed += [*(line(np.asarray(one.y)[when], one.style, x=path) for one in forces),
                    _step_band(path, goal[when], slice(None), step)]
        off_line.append(line(1e3 * lateral_errors(record, step, when)[0], x=path))
    if pressed:
        cells += [Panel(label, time, series, x_label="path along the line [mm]") for label, series
                  in ((NORMAL_FORCE, pressed), ("off the line [mm]", off_line))]
    return Drawing([cells], 1.0 + 1.45 * len(cells))


def _step_band(x: np.ndarray, goal: np.ndarray, when: slice, step: Any) -> Series:
    """Returns the band of a mission's step about the desired force (T,)."""
    return band(goal[when] - step.tolerance, goal[when] + step.tolerance, x=x[when],
                color=style.GREEN, alpha=0.2, label="band of the step")


def draw_coverage(record: Record) -> Figure:
    """Draws every measurement at its place normal to n, coloured by force, and the mission's steps.

    The axes are those of the mission's places in the scenario's file; n points into the paper, and
    down is below, on floors and ceilings north above.
    """
    contact, mission = sensed_contact(record.scenario), record.scenario.mission.checked()
    across, table = contact.walls.axes[1:], inspection_table(record)
    columns = {name: i for i, name in enumerate(COLUMNS)}
    origin = record.scenario.task.place
    place = 1e3 * (table[:, 2:5] - origin) @ across.T
    figure = Figure(figsize=(style.COLUMN_WIDTH, 4.0), layout="constrained")
    axis = figure.subplots()
    for attempt in signals.attempts_of(record):
        step = mission.steps[attempt.step]
        if step.touches:
            begin = 1e3 * (record.signals["mission_place"][attempt.when.start] - origin) @ across.T
            end = begin + 1e3 * step.along
            axis.plot(*np.array([begin, end])[:, ::-1].T, "o-", color=style.BLACK, linewidth=5.0,
                      markersize=9.0, markerfacecolor="none", markeredgewidth=0.7, alpha=0.15
                      if np.any(step.along) else 1.0)
    strongest = max(step.strongest for step in mission.steps)
    drawn = axis.scatter(place[:, 1], place[:, 0], s=4.0, c=table[:, columns["force_N"]],
                         cmap="viridis", vmin=0.0, vmax=PAINTED * strongest, linewidths=0.0)
    axis.margins(0.15)
    axis.set_aspect("equal", adjustable="datalim")
    if not is_floor(contact.walls.direction):
        axis.invert_xaxis()
        axis.invert_yaxis()
    first, second = axis_names(contact.walls.direction)
    axis.set_xlabel(f"place $b$, {second} [mm]")
    axis.set_ylabel(f"place $a$, {first} [mm]")
    figure.colorbar(drawn, ax=axis, shrink=0.8, label="measured force along the normal [N]")
    return figure
