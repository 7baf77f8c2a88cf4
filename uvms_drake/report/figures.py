"""Figures of a run, one idea each, at the width of a column in a paper."""

import textwrap
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from uvms_drake.certificate.assumptions import assumptions_of, scope_of
from uvms_drake.control.limits import resolved_radii
from uvms_drake.control.limits.inputs import input_names
from uvms_drake.control.mpc.planner import HOVERED, KEPT, SOLVED
from uvms_drake.model.frames.euler import pose_difference
from uvms_drake.report.figure.contact_estimate_figure import ESTIMATE, draw_contact_estimate
from uvms_drake.report.figure.force_figure import draw_force
from uvms_drake.report.figure_style import (
    BLUE,
    DARKER,
    LIMIT,
    ORANGE,
    STYLE,
    TIGHTENED,
    VERMILION,
    XYZ,
    legend_above,
    legend_over,
    log_ticks,
    margin_above_zero,
    panels,
    real_and_nominal,
    real_nominal_tube_above,
    tube_label,
)
from uvms_drake.report.mission.coverage_figure import draw_coverage
from uvms_drake.report.mission.mission_figure import draw_mission
from uvms_drake.report.robot.robot_figure import draw_robot
from uvms_drake.report.signals import nominal_limits, real_limits
from uvms_drake.report.thrusters import draw_thrusters, part_of
from uvms_drake.station.record import Record
from uvms_drake.station.scenario.scenario import Scenario

FORCE, INPUTS, JOINTS, THRUSTERS, MISSION, COVERAGE = (
    "force.png", "inputs.png", "joints.png", "thrusters.png", "mission.png", "coverage.png")
UNCERTIFIED = "run without a certificate"
SAME = 1e-12
"""Rounding of the components of a disturbance [m/s², rad/s²]."""
FAINT = 0.05
"""Fraction of a bound below which deviations have a logarithmic axis, to stay visible."""
FOOTER_CHARACTERS = 30
"""Characters of the footer in an inch of a figure's width."""


def make_figures(record: Record, output_dir: str | Path, bounds: Mapping[str, float] | None = None
                 ) -> list[Path]:
    """Writes all figures of a run as PNG files into a folder and returns their paths.

    Args:
        record: Record of the run.
        output_dir: Folder of the files, created if missing.
        bounds: Ultimate bounds of the run's certificate, if it has one.
    """
    figures = FIGURES | {FORCE: partial(
        draw_contact, certified=(bounds or {}).get("force"))}
    paths, folder = [], Path(output_dir)
    certified_for = [f"certified for {about}: {statement}" for about, statement in scope_of(
        assumptions_of(record.scenario, record.model)).items()]
    folder.mkdir(parents=True, exist_ok=True)
    for name in figures_of(record.scenario):
        draw = figures[name]
        with matplotlib.rc_context(STYLE):
            figure = draw(record)
            if not record.certified:
                figure.text(0.995, 0.005, UNCERTIFIED, ha="right", va="bottom", fontsize=6,
                            color=VERMILION)
            else:
                _add_footer(figure, certified_for)
            figure.savefig(folder / name, bbox_inches="tight" if record.certified else None)
        paths.append(folder / name)
    return paths


def _add_footer(figure: Figure, paragraphs: Sequence[str]) -> None:
    """Adds small lines of text below a figure, to be saved with a tight bounding box."""
    width = int(figure.get_figwidth() * FOOTER_CHARACTERS)
    lines = [line for each in paragraphs for line in textwrap.wrap(each, width)]
    figure.text(0.995, 0.0, "\n".join(lines), ha="right", va="top", fontsize=4, color="0.4")


def figures_of(scenario: Scenario) -> list[str]:
    """Returns the names of the figures of a scenario's run."""
    missing = {name for name, there in (
        (JOINTS, len(scenario.start.q) > 0), (THRUSTERS, part_of(scenario.actuation)),
        (MISSION, scenario.mission.steps), (COVERAGE, scenario.mission.steps)) if not there}
    return [name for name in FIGURES if name not in missing]


def draw_contact(record: Record, certified: float | None = None) -> Figure:
    """Draws the force on a surface; for a sensed contact, with the contact estimate."""
    draw = draw_contact_estimate if ESTIMATE in record.signals else draw_force
    return draw(record, certified)


def draw_task_error(record: Record) -> Figure:
    """Draws χ − χ_des, real and nominal, with the tube; on the right close to zero."""
    figure, axes = panels(2, 3.2, columns=2)
    real = 1e3 * pose_difference(record.chi, record.chi_des)
    nominal = 1e3 * pose_difference(record.chi_nominal, record.chi_des)
    tube = resolved_radii(record.scenario.tube)
    rows = ((slice(0, 3), ("$x$", "$y$", "$z$"), "position", "mm"),
            (slice(3, 6), (r"$\phi$", r"$\theta$", r"$\psi$"), "orientation", "mrad"))
    for row, (part, labels, name, unit) in zip(axes, rows, strict=True):
        bound = 1e3 * getattr(tube, name)
        for axis in row:
            for color, darker, label, e, e_bar in zip(
                    XYZ, DARKER, labels, real[:, part].T, nominal[:, part].T, strict=True):
                axis.fill_between(record.time, e_bar - bound, e_bar + bound, color=color,
                                  alpha=0.18, linewidth=0)
                axis.plot(record.time, e, color=color, label=label)
                axis.plot(record.time, e_bar, color=darker, linewidth=0.8, linestyle="--")
        row[0].legend(ncols=3, loc="best")
        reach = 2.5 * bound or 2.5 * float(np.max(np.abs(real[-1, part]))) or 1.0
        row[1].set_ylim(-reach, reach)
        row[1].set_title(f"close to zero; the tube is $\\pm${bound:.3g} {unit}")
        row[0].set_ylabel(f"{name} error [{unit}]")
    real_nominal_tube_above(figure, bool(record.certified))
    return figure


def draw_velocities(record: Record) -> Figure:
    """Draws the block norms of ζ with their limits, full and tightened."""
    figure, axes = panels(3, 3.8)
    limits, nominal = real_limits(record), nominal_limits(record)
    blocks = ((slice(0, 3), r"$\|\nu_1\|$ [m/s]", "nu1"),
              (slice(3, 6), r"$\|\nu_2\|$ [rad/s]", "nu2"),
              (slice(6, None), rf"$\|\dot{{q}}\|$ [{limits['qdot'].unit_of('qdot')}]", "qdot"))
    for axis, (block, label, key) in zip(axes, blocks, strict=True):
        real_and_nominal(axis, record.time, np.linalg.norm(record.zeta[:, block], axis=1),
                         np.linalg.norm(record.nominal_zeta[:, block], axis=1))
        axis.axhline(limits[key].upper[0], **LIMIT)
        axis.axhline(nominal[key].upper[0], **TIGHTENED)
        axis.set_ylabel(label)
        margin_above_zero(axis)
    _name_tube(axes[0], record)
    legend_above(figure, axes[0])
    return figure


def draw_joints(record: Record) -> Figure:
    """Draws the joint angles with their limits, full and tightened."""
    n, nominal = record.num_joints, nominal_limits(record)["q"]
    figure, axes = panels(n, 0.8 + 0.95 * n)
    for i, axis in enumerate(axes):
        real_and_nominal(axis, record.time, record.config[:, 6 + i],
                         record.nominal_config[:, 6 + i])
        for limit, tightened in ((record.joint_lower[i], nominal.lower[i]),
                                 (record.joint_upper[i], nominal.upper[i])):
            if np.isfinite(limit):
                axis.axhline(limit, **LIMIT)
                axis.axhline(tightened, **TIGHTENED)
        axis.set_ylabel(f"$q_{{{i + 1}}}$ [{'m' if record.model.slides[i] else 'rad'}]")
    _name_tube(axes[0], record, resolved_radii(record.scenario.tube).joints)
    legend_above(figure, axes[0])
    return figure


def draw_inputs(record: Record) -> Figure:
    """Draws the acceleration commands with their limits, full and tightened, channel by channel."""
    names = input_names(record.num_joints)
    rows = -(-len(names) // 2)
    figure, grid = panels(rows, 0.5 + 1.0 * rows, columns=2)
    axes = grid.T.ravel()
    real, tightened = real_limits(record)["u"], nominal_limits(record)["u"].upper
    for i, (axis, name) in enumerate(zip(axes, names, strict=False)):
        real_and_nominal(axis, record.time, record.u[:, i], record.nominal_input[:, i])
        for sign in (-1.0, 1.0):
            axis.axhline(sign * real.upper[i], **LIMIT)
            axis.axhline(sign * tightened[i], **TIGHTENED)
        axis.set_ylabel(f"{name}\n[{real.unit_of(f'u_{name}')}]")
    if len(axes) > len(names):
        axes[-1].set_visible(False)
        axes[-2].set_xlabel("time [s]")
        axes[-2].tick_params(labelbottom=True)
    _name_tube(axes[0], record)
    legend_above(figure, axes[0])
    return figure


def draw_disturbance(record: Record) -> Figure:
    """Draws the components of d and its norm against the bound.

    The norm of the effective disturbance is drawn too, if it differs.
    """
    figure, axes = panels(2, 2.8)
    unit = "m/s², rad/s²"
    blocks = ((slice(0, 3), "surge, sway, heave"), (slice(3, 6), "roll, pitch, yaw"),
              (slice(6, None), "joints"))
    alike = float(np.max(np.ptp(record.disturbance, axis=1))) < SAME
    if alike:
        axes[0].plot(record.time, record.disturbance[:, 0], color=BLUE,
                     label=f"each of the {record.disturbance.shape[1]} components, all equal")
    for (block, name), color in zip(blocks, XYZ, strict=True):
        if not alike:
            axes[0].plot(record.time, record.disturbance[:, block], color=color, linewidth=0.7,
                         label=name)
    declared = record.scenario.disturbance
    norm, effective = (declared.norm(each) for each in (
        record.disturbance, record.effective_disturbance))
    axes[1].plot(record.time, norm, color="0.35", label="applied")
    if not np.allclose(norm, effective, atol=1e-6):
        axes[1].plot(record.time, effective, color=ORANGE, linewidth=0.8,
                     label="with model errors and the water's motion")
    bound = declared.d_bound
    axes[1].axhline(bound, **{**LIMIT, "label": rf"bound $\tilde{{d}}$ = {bound:.3g}"})
    axes[0].set_ylabel(f"$d_i$ [{unit}]")
    scaled = r"\hat{W}^{-1}d" if np.size(declared.weights) else "d"
    axes[1].set_ylabel(rf"$\|{scaled}\|_2$ [{unit}]")
    margin_above_zero(axes[1])
    legend_over(axes[1], 3)
    legend_above(figure, axes[0])
    return figure


def draw_mpc(record: Record) -> Figure:
    """Draws the MPC's step time, failed samples, active rows of limits, and terminal slack."""
    figure, axes = panels(3, 3.6)
    step_ms, sound = 1e3 * record.step_seconds, np.isin(record.mpc_status, (SOLVED, KEPT))
    failed = ~sound & (record.mpc_status != HOVERED)
    for chosen, marker, color, label in (
            (sound, ".", BLUE, "solved, or the last plan kept"),
            (failed, "x", VERMILION, "failed, late or dropped")):
        axes[0].plot(record.mpc_time[chosen], step_ms[chosen], marker, color=color, markersize=3.5,
                     label=label)
    axes[0].axhline(1e3 * record.scenario.mpc.time_step, **{**LIMIT, "label": "sampling period"})
    log_ticks(axes[0])
    axes[0].set_ylabel("step time [ms]")
    for axis, values, label in ((axes[1], record.mpc_rows, "rows of limits [-]"),
                                (axes[2], record.mpc_terminal_slack, "terminal slack [-]")):
        axis.plot(record.mpc_time, values, ".-", markersize=3.5)
        axis.set_ylabel(label)
        margin_above_zero(axis)
        if not np.any(values):
            axis.set_title("zero at every step")
            axis.set_yticks([0.0])
    axes[2].set_xlim(record.time[0], record.time[-1])
    legend_above(figure, axes[0])
    return figure


def draw_deviation(record: Record) -> Figure:
    """Draws the deviation of the real from the nominal state, and both bounds of the tube."""
    figure, axes = panels(2, 2.8)
    tube = record.scenario.tube
    error = "y" if record.scenario.ancillary.protects_joints else r"\chi"
    labels = (rf"$\|{error}-\bar{{{error}}}\|_2$ [mm, mrad]",
              r"$\|\zeta-\bar{\zeta}\|_2$ [mm/s, mrad/s]")
    name = tube_label(bool(record.certified))
    for axis, part, bound, label in zip(
            axes, ("task", "z"), (1e3 * tube.e, 1e3 * tube.z), labels, strict=True):
        deviation = 1e3 * record.deviation_of(part)
        axis.plot(record.time, deviation, label="deviation")
        axis.axhline(bound, **{**LIMIT, "label": name})
        if np.all(np.isfinite(record.bound_of(part))):
            axis.plot(record.time, 1e3 * record.bound_of(part), color=VERMILION, linewidth=0.8,
                      label="bound along the run")
        axis.fill_between(record.time, 0.0, bound, color=BLUE, alpha=0.1, linewidth=0)
        axis.set_ylabel(label)
        if np.max(deviation) < FAINT * bound < np.inf:
            axis.set_yscale("log")
            axis.set_ylim(1e-4 * bound, 2.0 * bound)
        else:
            margin_above_zero(axis)
    legend_above(figure, axes[0])
    return figure


def _name_tube(axis: Axes, record: Record, taken: float | None = None) -> None:
    """Names above an axis the tube that tightened the limits."""
    by = "" if taken is None else f", by {1e3 * taken:.2g} mrad"
    axis.set_title(f"tightened by the {tube_label(bool(record.certified))}{by}")


FIGURES: dict[str, Callable[[Record], Figure]] = {
    "robot.png": draw_robot,
    "task_error.png": draw_task_error,
    FORCE: draw_contact,
    MISSION: draw_mission,
    COVERAGE: draw_coverage,
    "velocities.png": draw_velocities,
    JOINTS: draw_joints,
    INPUTS: draw_inputs,
    THRUSTERS: draw_thrusters,
    "disturbance.png": draw_disturbance,
    "mpc.png": draw_mpc,
    "deviation.png": draw_deviation,
}
