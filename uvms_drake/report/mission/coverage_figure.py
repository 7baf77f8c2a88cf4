"""Figure of a mission's coverage: the points pressed on, coloured by force."""

import numpy as np
from matplotlib.figure import Figure

from uvms_drake.report.figure_style import BLACK, COLUMN_WIDTH
from uvms_drake.report.mission.attempts import attempts_of
from uvms_drake.report.mission.inspection import COLUMNS, inspection_table
from uvms_drake.station.contact.bounds import sensed_contact
from uvms_drake.station.problem import task_place
from uvms_drake.station.record import Record
from uvms_drake.station.scene_setting import PAINTED


def draw_coverage(record: Record) -> Figure:
    """Draws every measurement at its place normal to n, coloured by force, and the mission's steps.

    The axes are those of the mission's places in the scenario's file; n points into the paper.
    """
    contact, mission = sensed_contact(record.scenario), record.scenario.mission.checked()
    across, table = contact.walls.axes[1:], inspection_table(record)
    columns = {name: i for i, name in enumerate(COLUMNS)}
    origin = task_place(record.scenario)
    place = 1e3 * (table[:, 2:5] - origin) @ across.T
    figure = Figure(figsize=(COLUMN_WIDTH, 4.0), layout="constrained")
    axis = figure.subplots()
    for attempt in attempts_of(record):
        step = mission.steps[attempt.step]
        if step.touches:
            begin = 1e3 * (record.signals["mission_place"][attempt.when.start] - origin) @ across.T
            end = begin + 1e3 * step.end
            axis.plot(*np.array([begin, end])[:, ::-1].T, "o-", color=BLACK, linewidth=5.0,
                      markersize=9.0, markerfacecolor="none", markeredgewidth=0.7, alpha=0.15
                      if np.any(step.end) else 1.0)
    strongest = max(step.strongest for step in mission.steps)
    drawn = axis.scatter(place[:, 1], place[:, 0], s=4.0, c=table[:, columns["force_N"]],
                         cmap="viridis", vmin=0.0, vmax=PAINTED * strongest, linewidths=0.0)
    axis.margins(0.15)
    axis.set_aspect("equal", adjustable="datalim")
    axis.invert_xaxis()
    axis.invert_yaxis()
    axis.set_xlabel("place $b$ [mm]")
    axis.set_ylabel("place $a$ [mm]")
    figure.colorbar(drawn, ax=axis, shrink=0.8, label="measured force along the normal [N]")
    return figure
