"""Use of the thrusters in a run: numbers for the summary, and a figure."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from uvms_drake.actuation import Thrusters
from uvms_drake.model.propulsion.thrusters import ThrusterModel
from uvms_drake.model.signals.sensor_actuator import Actuator
from uvms_drake.report.figure_style import BLACK, LIMIT, NOMINAL, REAL, legend_above, panels
from uvms_drake.station.record import Record


def part_of(actuation: Sequence[Actuator]) -> Thrusters | None:
    """Returns the robot's thrusters among the parts of actuation, if any."""
    return next((part for part in actuation if type(part) is Thrusters), None)


def thrusters_of(record: Record) -> ThrusterModel:
    """Returns the controller's model of the thrusters of a run that has some."""
    part = part_of(record.scenario.actuation)
    assert part is not None
    return part.known(record.model)


def at_limit(thrusters: ThrusterModel, command: np.ndarray) -> np.ndarray:
    """Returns whether commands (T, m) are at the lower or upper limit (T, m)."""
    ends = np.array([curve.command[[0, -1]] for curve in thrusters.curves])
    return (command <= ends[:, 0]) | (command >= ends[:, 1])


def summarise_thrusters(record: Record) -> dict[str, object]:
    """Returns by name the forces [N], the limits, and the share of the time at a limit.

    The limits are those of the controller's model. Empty if the wrench is ideal.
    """
    if part_of(record.scenario.actuation) is None:
        return {}
    thrusters, force = thrusters_of(record), record.signals["thruster_force"]
    bound = at_limit(thrusters, record.signals["thruster_command"])
    return {name: {
        "lower": thrusters.lower[i], "upper": thrusters.upper[i], "least": np.min(force[:, i]),
        "largest": np.max(force[:, i]), "rms": np.sqrt(np.mean(force[:, i] ** 2)),
        "at_limit": np.mean(bound[:, i])} for i, name in enumerate(thrusters.names)}


def format_thrusters(rows: dict[str, dict[str, float]]) -> list[str]:
    """Returns a line for each thruster."""
    lines = [
        f"{name}: {row['least']:.3g} to {row['largest']:.3g} N of {row['lower']:.4g} to "
        f"{row['upper']:.4g} N, {row['rms']:.3g} N rms, at a limit {100.0 * row['at_limit']:.2g} % "
        "of the time" for name, row in rows.items()]
    return [f"{'' if i else 'thrusters':<14}{line}" for i, line in enumerate(lines)]


def draw_thrusters(record: Record) -> Figure:
    """Draws the force of each thruster, its command, limits and dead band."""
    thrusters, command = thrusters_of(record), record.signals["thruster_command"]
    asked = np.array([thrusters.forces_of(row) for row in command])
    columns = 1 + (thrusters.size % 2 == 0)
    rows = thrusters.size // columns
    figure, grid = panels(rows, 0.5 + 1.0 * rows, columns=columns)
    axes = grid.T.ravel()
    for i, (axis, name) in enumerate(zip(axes, thrusters.names, strict=True)):
        axis.plot(record.time, asked[:, i], **{**NOMINAL, "label": "commanded", "linewidth": 0.8})
        axis.plot(record.time, record.signals["thruster_force"][:, i], **REAL)
        for limit in (thrusters.lower[i], thrusters.upper[i]):
            axis.axhline(limit, **LIMIT)
        smallest = thrusters.smallest[i]
        axis.axhspan(-smallest, smallest, color=BLACK, alpha=0.15, linewidth=0,
                     label="dead band")
        axis.set_ylabel(f"{name.replace('_', ' ')}\n[N]")
    legend_above(figure, axes[0], columns=2)
    return figure
