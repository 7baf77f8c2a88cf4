"""Three ambiguous or wrong choices of the paper, each simulated both ways, in a figure.

* `initial_state.png` (E9): plans from the nominal or from the measured state;
* `input_reference.png` (E6): the stage cost is about u_eq or about zero;
* `law.png` (E2, E5): the ancillary law `resolved` or `transpose`.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from uvms_drake.common.progress import Progress, silent
from uvms_drake.model.frames.euler import pose_difference
from uvms_drake.papers.nikou2018.errata.simulation import SPRING, settled
from uvms_drake.papers.nikou2018.kinematics import Run, simulate
from uvms_drake.report.drawing import Drawing, Panel, line, save
from uvms_drake.report.figure_style import BLUE, VERMILION
from uvms_drake.station.scenario.scenario import load_scenario

TASK_ERROR = r"$\|\chi-\chi_{\mathrm{des}}\|$ [m, rad]"
CHOICES = {
    "initial_state.png": ("mpc.initial_state=nominal", "mpc.initial_state=measured"),
    "law.png": ("ancillary=!Resolved {sigma: 3.084}", "ancillary=!Transpose {sigma: 3.084}")}
"""Overrides of `paper_kinematic`, the project's own first, by the figures."""
FIGURES = ("input_reference.png", *CHOICES)

Panels = dict[str, list[np.ndarray]]
"""Values (T,) of both ways by the labels of their panels."""


def draw_choices(folder: Path, progress: Progress = silent, overrides: Sequence[str] = ()
                 ) -> None:
    """Simulates all choices and writes their figures into a folder.

    Args:
        folder: Folder of the files.
        progress: Called before every figure.
        overrides: Overrides of all scenarios.
    """
    for i, name in enumerate(FIGURES):
        progress(name, i / len(FIGURES))
        if name in CHOICES:
            runs = [simulate(load_scenario("paper_kinematic", [each, *overrides]))
                    for each in CHOICES[name]]
            made = drawing(panels_of(runs), runs[0].time, [named(each) for each in CHOICES[name]])
        else:
            errors = [np.linalg.norm(settled(u_ref)[0], axis=1) for u_ref in (1.0, 0.0)]
            h = load_scenario(SPRING).mpc.time_step
            time = h * np.arange(1, len(errors[0]) + 1)
            made = drawing({TASK_ERROR: errors}, time, ["u_eq", "zero"])
        save(made, folder / name)


def panels_of(runs: Sequence[Run]) -> Panels:
    """Returns the task error of runs, and their deviation from the plan."""
    def norms(values: list[np.ndarray]) -> list[np.ndarray]:
        return [np.linalg.norm(each, axis=1) for each in values]

    return {
        TASK_ERROR: norms([pose_difference(run.chi, run.chi_des) for run in runs]),
        r"$\|\bar\chi-\chi_{\mathrm{des}}\|$ [m, rad]": norms(
            [pose_difference(run.chi_nominal, run.chi_des) for run in runs]),
        r"$\|\chi-\bar\chi\|$ [m, rad]": norms(
            [pose_difference(run.chi, run.chi_nominal) for run in runs]),
        r"$\|q-\bar q\|$ [rad]": norms(
            [(run.config - run.nominal_config)[:, 6:] for run in runs])}


def drawing(values: Panels, time: np.ndarray, names: Sequence[str]) -> Drawing:
    """Returns both ways of a choice."""
    ways = list(zip(names, (BLUE, VERMILION), ("-", (0, (4, 1.2))), strict=True))
    return Drawing([[Panel(label, time, [
        line(each, color=color, linestyle=style, label=name)
        for each, (name, color, style) in zip(both, ways, strict=True)], scale="zero")
        for label, both in values.items()]], 0.6 + 1.2 * len(values))


def named(override: str) -> str:
    """Returns the name of a value in a legend: a tag without its mapping, else the value."""
    return override.split("=")[1].removeprefix("!").split()[0].lower()
