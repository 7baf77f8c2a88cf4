"""The three result figures of the paper, in its layout: real solid, nominal dashed, time below.

They compare one by one with those of Nikou, Verginis and Dimarogonas (2018): position errors,
orientation errors (angles modulo 2π), and the norms of the inputs with their limit.
"""

from collections.abc import Callable

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from uvms_drake.model.frames.euler import pose_difference
from uvms_drake.report.figure_style import BLACK, LIMIT, XYZ, legend_above, panels
from uvms_drake.station.record import Record

HEIGHT = 2.4  # inches


def draw_position_errors(record: Record) -> Figure:
    """Draws 𝔭 − 𝔭_des, real and nominal."""
    names = (r"$\mathfrak{p}_1$", r"$\mathfrak{p}_2$", r"$\mathfrak{p}_3$")
    return _draw_errors(record, slice(0, 3), names, "position errors [m]")


def draw_orientation_errors(record: Record) -> Figure:
    """Draws 𝔬 − 𝔬_des, real and nominal."""
    names = (r"$\mathfrak{o}_1$", r"$\mathfrak{o}_2$", r"$\mathfrak{o}_3$")
    return _draw_errors(record, slice(3, 6), names, "orientation errors [rad]")


def draw_input_norms(record: Record) -> Figure:
    """Draws ‖ν₁‖, ‖ν₂‖ and ‖q̇‖, real and nominal, and the paper's common limit."""
    figure, (axis,) = panels(1, HEIGHT)
    limits = record.scenario.limits
    blocks = ((slice(0, 3), r"$\|\nu_1\|$", limits.nu1), (slice(3, 6), r"$\|\nu_2\|$", limits.nu2),
              (slice(6, None), r"$\|\dot{q}\|$", limits.qdot))
    for color, (block, name, limit) in zip(XYZ, blocks, strict=True):
        axis.plot(record.time, np.linalg.norm(record.zeta[:, block], axis=1), color=color,
                  label=name)
        axis.plot(record.time, np.linalg.norm(record.nominal_zeta[:, block], axis=1), color=color,
                  linestyle="--", linewidth=0.8)
        axis.axhline(limit, **LIMIT)
    axis.set_ylim(0.0, 1.08 * max(limit for *_, limit in blocks))
    axis.set_ylabel("input norms [m/s, rad/s]")
    legend_above(figure, axis)
    return figure


def _draw_errors(record: Record, part: slice, names: tuple[str, ...], label: str) -> Figure:
    figure, (axis,) = panels(1, HEIGHT)
    real = pose_difference(record.chi, record.chi_des)[:, part]
    nominal = pose_difference(record.chi_nominal, record.chi_des)[:, part]
    for color, name, e, e_bar in zip(XYZ, names, real.T, nominal.T, strict=True):
        axis.plot(record.time, e, color=color, label=name)
        axis.plot(record.time, e_bar, color=color, linestyle="--", linewidth=0.8)
    axis.axhline(0.0, color=BLACK, linewidth=0.5)
    axis.set_ylabel(label)
    handles, labels = axis.get_legend_handles_labels()
    handles += [Line2D([], [], color="0.45"), Line2D([], [], color="0.45", linestyle="--")]
    figure.legend(handles, [*labels, "real", "nominal"], ncols=5, loc="outside upper center")
    return figure


FIGURES: dict[str, Callable[[Record], Figure]] = {
    "position_errors.png": draw_position_errors,
    "orientation_errors.png": draw_orientation_errors,
    "input_norms.png": draw_input_norms,
}
"""The figures by the names of their files."""
