"""Figures and page of an identification."""

import html
from pathlib import Path
from string import Template

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from uvms_drake.common.errors import shortened
from uvms_drake.common.program import VERSION
from uvms_drake.identification.identify import Identification
from uvms_drake.identification.log import GRID, STATE
from uvms_drake.identification.output_error import STEP
from uvms_drake.identification.written import format_result, sources, validation_rms
from uvms_drake.report.figure_style import BLUE, COLUMN_WIDTH, STYLE, VERMILION
from uvms_drake.report.html import PAGE as REPORT
from uvms_drake.report.html import embedded

PAGE = Template(REPORT.template.partition("<h1>")[0]
                + Path(__file__).with_name("page.html").read_text(encoding="utf-8"))
"""The page, with `$name` for each of its parts; its head is that of the report of a run."""
PAGE_FILE = "identification.html"
FIGURES = ("validation.png", "parameters.png", "residual.png")
CAPTIONS = {
    "validation.png": "Measured roll and pitch of some windows (black), and their prediction from "
                      "the measured state at the beginning, with parameters one step from those "
                      "of all logs to those of the other half (blue).",
    "parameters.png": "Identified parameters with their intervals, over the numbers of the file.",
    "residual.png": "Residual of the vehicle's acceleration: the fraction of the samples above a "
                    "size, by axis.",
}
SHOWN = 6
"""Largest number of windows in a figure."""
LONGEST = 21
"""Most letters of a log's name in a figure."""


def validation_figure(found: Identification) -> Figure:
    """Returns measured and predicted roll and pitch of windows."""
    measured = found.windows.measured()[..., :2]
    predicted = measured - found.validation[..., :2]
    chosen = np.unique(np.linspace(0, len(measured) - 1, SHOWN).astype(int))
    figure = Figure(figsize=(2.0 * COLUMN_WIDTH, 2.6), layout="constrained")
    axes = figure.subplots(2, len(chosen), sharex=True, squeeze=False)
    time = STEP * GRID * np.arange(measured.shape[1])
    for i, column in zip(chosen, axes.T, strict=True):
        for k, ax in enumerate(column):
            ax.plot(time, np.rad2deg(measured[i, :, k]), "k")
            ax.plot(time, np.rad2deg(predicted[i, :, k]), color=BLUE)
        column[0].set_title(shortened(found.windows.logs[found.windows.log_of[i]].name, LONGEST))
        column[1].set_xlabel("time [s]")
    for ax, name in zip(axes[:, 0], STATE[:2], strict=True):
        ax.set_ylabel(f"{name} [deg]")
    return figure


def parameter_figure(found: Identification) -> Figure:
    """Returns the identified parameters with their intervals; 1 is the number of the file."""
    shown = [each for each in found.identified if each.parameter.relative]
    figure = Figure(figsize=(COLUMN_WIDTH, 0.6 + 0.22 * max(len(shown), 1)), layout="constrained")
    ax = figure.subplots()
    for row, each in enumerate(shown):
        ax.plot(1.0 + each.theta + each.half * np.array([-1.0, 1.0]), [row, row], color=BLUE)
        ax.plot(1.0 + each.theta, row, "o", color=BLUE, markersize=3)
    ax.axvline(1.0, color=VERMILION, linewidth=0.8)
    ax.set_yticks(range(len(shown)), [each.parameter.name for each in shown])
    ax.margins(y=0.1)
    ax.set_xlabel("over the number of the file")
    return figure


def residual_figure(found: Identification) -> Figure:
    """Returns the fraction of the samples whose residual is above a size."""
    figure = Figure(figsize=(2.0 * COLUMN_WIDTH, 2.0), layout="constrained")
    flat = np.abs(found.residual.reshape(-1, 6))
    names = ("surge", "sway", "heave", "roll", "pitch", "yaw")
    for ax, part, unit in zip(figure.subplots(1, 2), (slice(0, 3), slice(3, 6)),
                              ("m/s²", "rad/s²"), strict=True):
        for each, name in zip(flat.T[part], names[part], strict=True):
            sizes = np.sort(each[np.isfinite(each)])
            if len(sizes):
                ax.semilogy(sizes, 1.0 - np.arange(len(sizes)) / len(sizes), label=name)
        ax.set_xlabel(f"size of the residual [{unit}]")
        ax.set_ylabel("fraction above")
        if ax.lines:
            ax.legend()
        else:
            ax.text(0.5, 0.5, "not measured", ha="center", transform=ax.transAxes)
    return figure


def write_page(found: Identification, digests: dict[str, str], folder: Path) -> None:
    """Writes the figures and the page with them into a folder."""
    with matplotlib.rc_context(STYLE):
        for name, figure in zip(FIGURES, (validation_figure(found), parameter_figure(found),
                                          residual_figure(found)), strict=True):
            figure.savefig(folder / name)
    drawn = "".join(embedded(folder / name, CAPTIONS[name]) for name in FIGURES)
    rms = ", ".join(f"{name} {np.rad2deg(size):.2f} deg" if name in ("roll", "pitch") else
                    f"{name} {size:.3g}" for name, size in validation_rms(found).items())
    excitation = ", ".join(f"{name} {size:.3g}" for name, size in found.excitation.items())
    texts = {
        "title": f"Identification of {found.robot.name}",
        "verdict": f"{len(found.identified)} of {len(found.results)} parameters identified, from "
                   f"{len(found.windows.start)} windows of {len(found.windows.logs)} logs. "
                   f"Held-out prediction, rms: {rms}.",
        "parameters": "\n".join(map(format_result, found.results)),
        "refused": "\n".join(found.refused) or "Nothing.",
        "sources": "\n".join(sources(digests, found.confidence)),
        "excitation": excitation, "version": VERSION}
    (folder / PAGE_FILE).write_text(PAGE.substitute(
        {name: html.escape(text) for name, text in texts.items()}, figures=drawn), encoding="utf-8")
