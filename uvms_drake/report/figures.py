"""Figures of a run, one idea each, at the width of a column in a paper."""

import textwrap
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

from uvms_drake.certificate.assumptions import assumptions_of, scope_of
from uvms_drake.control.limits import resolved_radii
from uvms_drake.control.limits.inputs import input_names
from uvms_drake.control.mpc.planner import HOVERED, KEPT, SOLVED
from uvms_drake.model.frames.euler import pose_difference
from uvms_drake.report import figure_style as style
from uvms_drake.report.contact_figures import contact_drawing, draw_coverage, mission_drawing
from uvms_drake.report.drawing import Drawing, Panel, band, draw, levels, line, pair
from uvms_drake.report.robot.robot_figure import draw_robot
from uvms_drake.report.signals import nominal_limits, real_limits, thruster_part, thrusters_of
from uvms_drake.report.summary import summarise
from uvms_drake.station.diagram import bounds_disturbance
from uvms_drake.station.record import Record
from uvms_drake.station.scenario.scenario import Scenario

FORCE, INPUTS, JOINTS, THRUSTERS, MISSION, COVERAGE = (
    "force.png", "inputs.png", "joints.png", "thrusters.png", "mission.png", "coverage.png")
DASHED = {"linewidth": 0.8, "linestyle": "--"}
DOTS = {"marker": ".", "markersize": 3.5, "linestyle": ""}
SAME = 1e-12
"""Rounding of the components of a disturbance [m/s², rad/s²]."""
FAINT = 0.05
"""Fraction of a bound below which deviations have a logarithmic axis, to stay visible."""
FOOTER_CHARACTERS = 30
"""Characters of the footer in an inch of a figure's width."""
FOOTER_POINTS = 4
"""Size of its letters [pt]."""
LINE_SPACING = 1.45
"""Distance of its lines, over their size."""


def make_figures(record: Record, output_dir: str | Path,
                 certified: Mapping[str, float] | None = None,
                 verdict: dict[str, Any] | None = None) -> list[Path]:
    """Writes all figures of a run as PNG files into a folder and returns their paths.

    The verdict of the run is below each of them.

    Args:
        record: Record of the run.
        output_dir: Folder of the files, created if missing.
        certified: Ultimate bounds of the run's certificate, if it has one.
        verdict: Of the run's summary, which is made here if it is left out.
    """
    verdict = verdict or summarise(record)["verdict"]
    figures = FIGURES | {
        FORCE: partial(contact_drawing, certified=(certified or {}).get("force"))}
    paths, folder = [], Path(output_dir)
    scope = scope_of(assumptions_of(record.scenario, record.model)) if record.certified else {}
    lines = [verdict["text"], *(f"certified for {about}: {said}" for about, said in scope.items())]
    color = "0.4" if record.certified and not verdict["status"] else style.VERMILION
    folder.mkdir(parents=True, exist_ok=True)
    for name in figures_of(record.scenario):
        with matplotlib.rc_context(style.STYLE):
            made = figures[name](record)
            figure = draw(made) if isinstance(made, Drawing) else made
            figure.savefig(folder / name, bbox_inches=_with_footer(figure, lines, color))
        paths.append(folder / name)
    return paths


def _with_footer(figure: Figure, paragraphs: Sequence[str], color: str) -> Bbox:
    """Adds small lines of text below a figure; returns the box of both, as wide as the figure."""
    width, height = figure.get_size_inches()
    lines = [line for each in paragraphs for line in textwrap.wrap(
        each, int(width * FOOTER_CHARACTERS))]
    figure.text(0.995, 0.0, "\n".join(lines), ha="right", va="top", fontsize=FOOTER_POINTS,
                color=color)
    return Bbox([[0.0, -len(lines) * LINE_SPACING * FOOTER_POINTS / 72.0 - 0.02], [width, height]])


def figures_of(scenario: Scenario) -> list[str]:
    """Returns the names of the figures of a scenario's run."""
    missing = {name for name, there in (
        (JOINTS, len(scenario.start.q) > 0), (THRUSTERS, thruster_part(scenario)),
        (MISSION, scenario.mission.steps), (COVERAGE, scenario.mission.steps)) if not there}
    return [name for name in FIGURES if name not in missing]


def task_error_drawing(record: Record) -> Drawing:
    """Returns χ − χ_des, real and nominal, with the tube; on the right close to zero."""
    real = 1e3 * pose_difference(record.chi, record.chi_des)
    nominal = 1e3 * pose_difference(record.chi_nominal, record.chi_des)
    tube = resolved_radii(record.scenario.tube)
    whole, close = [], []
    for part, names, name, unit in (
            (slice(0, 3), ("$x$", "$y$", "$z$"), "position", "mm"),
            (slice(3, 6), (r"$\phi$", r"$\theta$", r"$\psi$"), "orientation", "mrad")):
        bound = 1e3 * getattr(tube, name)
        series = [each for color, darker, label, e, e_bar in zip(
            style.XYZ, style.DARKER, names, real[:, part].T, nominal[:, part].T,
            strict=True) for each in (
                band(e_bar - bound, e_bar + bound, color=color, alpha=0.18),
                line(e, color=color, label=label),
                line(e_bar, DASHED, color=darker))]
        reach = 2.5 * bound or 2.5 * float(np.max(np.abs(real[-1, part]))) or 1.0
        whole.append(Panel(f"{name} error [{unit}]", record.time, series, legend=3))
        close.append(Panel("", record.time, series, limits=(-reach, reach),
                           title=f"close to zero; the tube is $\\pm${bound:.3g} {unit}"))
    return Drawing([whole, close], 3.2, legend=3, key=[
        line(0.0, color="0.45"), line(0.0, DASHED, color="0.2", label="nominal"),
        band(0.0, 0.0, color="0.8", label=style.tube_label(bool(record.certified)))])


def velocities_drawing(record: Record) -> Drawing:
    """Returns the block norms of ζ with their limits, full and tightened."""
    limits, nominal = real_limits(record), nominal_limits(record)
    blocks = ((slice(0, 3), r"$\|\nu_1\|$ [m/s]", "nu1"),
              (slice(3, 6), r"$\|\nu_2\|$ [rad/s]", "nu2"),
              (slice(6, None), rf"$\|\dot{{q}}\|$ [{limits['qdot'].unit_of('qdot')}]", "qdot"))
    return Drawing([[Panel(
        label, record.time, [
            *pair(np.linalg.norm(record.zeta[:, block], axis=1),
                  np.linalg.norm(record.nominal_zeta[:, block], axis=1)),
            *levels(limits[key].upper[0], nominal[key].upper[0])],
        title="" if i else _tightened(record), scale="zero")
        for i, (block, label, key) in enumerate(blocks)]], 3.8)


def joints_drawing(record: Record) -> Drawing:
    """Returns the joint angles with their limits, full and tightened."""
    nominal = nominal_limits(record)["q"]
    whole, between = (1e3 * float(np.max(each)) for each in (
        nominal.margin, nominal.between_knots_margin))
    unit = "mm, mrad" if np.any(record.model.slides) else "mrad"
    by = (f", by {whole - between:.3g} {unit}" + f", and {between:.3g} {unit} between the knots of "
          f"a plan: {whole:.3g} {unit}" * (between > 0.0))
    return Drawing([[Panel(
        f"$q_{{{i + 1}}}$ [{'m' if record.model.slides[i] else 'rad'}]", record.time, [
            *pair(record.config[:, 6 + i], record.nominal_config[:, 6 + i]),
            *levels(record.joint_lower[i], nominal.lower[i]),
            *levels(record.joint_upper[i], nominal.upper[i])],
        title="" if i else _tightened(record) + by)
        for i in range(record.num_joints)]], 0.8 + 0.95 * record.num_joints)


def inputs_drawing(record: Record) -> Drawing:
    """Returns the acceleration commands with their limits, full and tightened, by channel."""
    real, tightened = real_limits(record)["u"], nominal_limits(record)["u"].upper
    return _two_columns([Panel(
        f"{name}\n[{real.unit_of(f'u_{name}')}]", record.time, [
            *pair(record.u[:, i], record.nominal_input[:, i]),
            *levels(-real.upper[i], -tightened[i]), *levels(real.upper[i], tightened[i])],
        title="" if i else _tightened(record))
        for i, name in enumerate(input_names(record.num_joints))])


def thrusters_drawing(record: Record) -> Drawing:
    """Returns the force of each thruster, its command, limits and dead band."""
    thrusters = thrusters_of(record)
    asked = np.array([thrusters.forces_of(row) for row in record.signals["thruster_command"]])
    return _two_columns([Panel(
        f"{name.replace('_', ' ')}\n[N]", record.time, [
            line(asked[:, i], style.NOMINAL, label="commanded", linewidth=0.8),
            line(record.signals["thruster_force"][:, i]),
            line(thrusters.lower[i], style.LIMIT), line(thrusters.upper[i], style.LIMIT),
            band(-smallest, smallest, color=style.BLACK, alpha=0.15, label="dead band")])
        for i, (name, smallest) in enumerate(zip(
            thrusters.names, thrusters.smallest, strict=True))])


def _two_columns(cells: list[Panel]) -> Drawing:
    """Returns small panels one below the other, in two columns."""
    rows = -(-len(cells) // 2)
    return Drawing([cells[:rows], cells[rows:]], 0.5 + 1.0 * rows)


def disturbance_drawing(record: Record) -> Drawing:
    """Returns the components of d and its norm against the bound.

    The norm of the effective disturbance is shown too, if it differs.
    """
    declared, unit = record.scenario.disturbance, "m/s², rad/s²"
    bound, size = declared.d_bound, record.disturbance.shape[1]
    if float(np.max(np.ptp(record.disturbance, axis=1))) < SAME:
        parts = [line(record.disturbance[:, 0],
                      label=f"each of the {size} components, all equal")]
    else:
        parts = [line(each, color=color, linewidth=0.7, label=name)
                 for block, color, name in zip(
                     (slice(0, 3), slice(3, 6), slice(6, None)), style.XYZ,
                     ("surge, sway, heave", "roll, pitch, yaw", "joints"), strict=True)
                 for each in record.disturbance[:, block].T]
    norm, effective = (declared.norm(each) for each in (
        record.disturbance, record.effective_disturbance))
    norms = [line(norm, color="0.35", label="applied")]
    if bounds_disturbance(bound, bool(record.certified)):
        norms.append(line(bound, style.LIMIT, label=rf"bound $\tilde{{d}}$ = {bound:.3g}"))
    if not np.allclose(norm, effective, atol=1e-6):
        norms.insert(1, line(effective, color=style.ORANGE, linewidth=0.8,
                             label="with model errors and the water's motion"))
    scaled = r"\hat{W}^{-1}d" if np.size(declared.weights) else "d"
    return Drawing([[
        Panel(f"$d_i$ [{unit}]", record.time, parts),
        Panel(rf"$\|{scaled}\|_2$ [{unit}]", record.time, norms, scale="zero", legend=3)]], 2.8)


def mpc_drawing(record: Record) -> Drawing:
    """Returns the MPC's step time, failed samples, active rows of limits, and terminal slack."""
    step_ms, sound = 1e3 * record.step_seconds, np.isin(record.mpc_status, (SOLVED, KEPT))
    failed = ~sound & (record.mpc_status != HOVERED)
    time, window = record.mpc_time, (record.time[0], record.time[-1])
    steps = [line(step_ms[chosen], DOTS, x=time[chosen], marker=marker, color=color, label=label)
             for chosen, marker, color, label in (
                 (sound, ".", style.BLUE, "solved, or the last plan kept"),
                 (failed, "x", style.VERMILION, "failed, late or dropped"))]
    period = line(1e3 * record.scenario.mpc.time_step, style.LIMIT, label="sampling period")
    return Drawing([[
        Panel("step time [ms]", time, [*steps, period], scale="log", window=window),
        *(Panel(label, time, [line(values, DOTS, linestyle="-")], scale="zero", window=window,
                title="" if np.any(values) else "zero at every step")
          for label, values in (("rows of limits [-]", record.mpc_rows),
                                ("terminal slack [-]", record.mpc_terminal_slack)))]], 3.6)


def deviation_drawing(record: Record) -> Drawing:
    """Returns the deviation of the real from the nominal state, and both bounds of the tube."""
    tube, cells = record.scenario.tube, []
    error = "y" if record.scenario.ancillary.protects_joints else r"\chi"
    for part, radius, label in (
            ("task", tube.e, rf"$\|{error}-\bar{{{error}}}\|_2$ [mm, mrad]"),
            ("z", tube.z, r"$\|\zeta-\bar{\zeta}\|_2$ [mm/s, mrad/s]")):
        deviation, bound = 1e3 * record.deviation_of(part), 1e3 * radius
        series = [line(deviation, label="deviation"),
                  line(bound, style.LIMIT, label=style.tube_label(bool(record.certified))),
                  band(0.0, bound, color=style.BLUE, alpha=0.1)]
        if np.all(np.isfinite(record.bound_of(part))):
            series.append(line(1e3 * record.bound_of(part), color=style.VERMILION, linewidth=0.8,
                               label="bound along the run"))
        faint = bool(np.max(deviation) < FAINT * bound < np.inf)
        cells.append(Panel(label, record.time, series, scale="log" if faint else "zero",
                           limits=(1e-4 * bound, 2.0 * bound) if faint else None))
    return Drawing([cells], 2.8)


def _tightened(record: Record) -> str:
    """Returns the title that names the tube that tightened the limits."""
    return f"tightened by the {style.tube_label(bool(record.certified))}"


FIGURES: dict[str, Callable[[Record], Drawing | Figure]] = {
    "robot.png": draw_robot,
    "task_error.png": task_error_drawing,
    FORCE: contact_drawing,
    MISSION: mission_drawing,
    COVERAGE: draw_coverage,
    "velocities.png": velocities_drawing,
    JOINTS: joints_drawing,
    INPUTS: inputs_drawing,
    THRUSTERS: thrusters_drawing,
    "disturbance.png": disturbance_drawing,
    "mpc.png": mpc_drawing,
    "deviation.png": deviation_drawing,
}
