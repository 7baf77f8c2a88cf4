"""Three ambiguous or wrong choices of the paper, each simulated both ways, in a figure.

* `initial_state.png` (E9): plans from the nominal or from the measured state;
* `input_reference.png` (E6): the stage cost is about u_eq or about zero;
* `law.png` (E2, E5): the ancillary law `transpose` or `resolved`.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from uvms_drake.common.progress import Progress, silent
from uvms_drake.model.frames.euler import pose_difference
from uvms_drake.papers.nikou2018 import kinematics
from uvms_drake.papers.nikou2018.kinematics import Run
from uvms_drake.report.figure_style import BLUE, STYLE, VERMILION, legend_above, panels
from uvms_drake.station.record import Record
from uvms_drake.station.scenario.scenario import load_scenario
from uvms_drake.station.simulation import simulate


class Signal(NamedTuple):
    """Quantity of a panel."""

    label: str
    of: Callable[[Any], np.ndarray]
    """Function from a record to the plotted values (T,)."""
    logarithmic: bool = True


class Choice(NamedTuple):
    """Two runs that differ in one key, and the signals that show it."""

    scenario: str
    key: str
    """Key of the scenario that differs."""
    options: tuple[str, str]
    """Values of the key, the project's own first."""
    signals: tuple[Signal, ...]


def _task_error_norm(record: Record | Run) -> np.ndarray:
    return np.linalg.norm(pose_difference(record.chi, record.chi_des), axis=1)


def _nominal_task_error_norm(record: Record | Run) -> np.ndarray:
    return np.linalg.norm(pose_difference(record.chi_nominal, record.chi_des), axis=1)


def _deviation(record: Record | Run) -> np.ndarray:
    return np.linalg.norm(pose_difference(record.chi, record.chi_nominal), axis=1)


def _joint_deviation(record: Record | Run) -> np.ndarray:
    return np.linalg.norm((record.config - record.nominal_config)[:, 6:], axis=1)


_TASK_ERROR = Signal(r"$\|\chi-\chi_{\mathrm{des}}\|$ [m, rad]", _task_error_norm)
_NOMINAL = Signal(r"$\|\bar\chi-\chi_{\mathrm{des}}\|$ [m, rad]", _nominal_task_error_norm)
_DEVIATION = Signal(r"$\|\chi-\bar\chi\|$ [m, rad]", _deviation, logarithmic=False)
_JOINTS = Signal(r"$\|q-\bar q\|$ [rad]", _joint_deviation, logarithmic=False)

CHOICES = {
    "initial_state.png": Choice("paper_kinematic", "mpc.initial_state", ("nominal", "measured"),
                                (_TASK_ERROR, _NOMINAL, _DEVIATION)),
    "input_reference.png": Choice("paper_dynamic_resolved", "mpc.input_reference",
                                  ("equilibrium", "zero"), (_TASK_ERROR,)),
    "law.png": Choice("paper_kinematic", "ancillary",
                      ("!Resolved {sigma: 3.084}", "!Transpose {sigma: 3.084}"),
                      (_TASK_ERROR, _DEVIATION, _JOINTS)),
}


def draw_choices(folder: Path, progress: Progress = silent,
                 overrides: Sequence[str] = ()) -> list[Path]:
    """Simulates all choices, writes their figures into a folder and returns the paths.

    Args:
        folder: Folder of the files.
        progress: Called before every figure.
        overrides: Overrides of all scenarios.
    """
    paths = []
    for i, (name, choice) in enumerate(CHOICES.items()):
        progress(name, i / len(CHOICES))
        scenarios = [load_scenario(choice.scenario, [f"{choice.key}={option}", *overrides])
                     for option in choice.options]
        records = [kinematics.simulate(each) if each.simulation else simulate(each)
                   for each in scenarios]
        with matplotlib.rc_context(STYLE):
            draw_choice(choice, records).savefig(folder / name)
        paths.append(folder / name)
    return paths


def draw_choice(choice: Choice, records: Sequence[Record | Run]) -> Figure:
    """Draws the signals of both runs of a choice."""
    figure, axes = panels(len(choice.signals), 0.6 + 1.2 * len(choice.signals))
    for axis, signal in zip(axes, choice.signals, strict=True):
        for record, option, color, linestyle in zip(
                records, choice.options, (BLUE, VERMILION), ("-", (0, (4, 1.2))), strict=True):
            axis.plot(record.time, signal.of(record), label=option_name(option), color=color,
                      linestyle=linestyle)
        axis.set_ylabel(signal.label)
        if signal.logarithmic:
            axis.set_yscale("log")
        else:
            axis.set_ylim(bottom=0.0)
    legend_above(figure, axes[0])
    return figure


def option_name(option: str) -> str:
    """Returns the name of a value in a legend: a tag without its mapping, else the value."""
    return option.removeprefix("!").split()[0].lower()
