"""Use of a tube: the largest deviation of a run from its plan over each declared radius."""

import numpy as np

from uvms_drake.common.errors import require
from uvms_drake.control.laws.law import FIELDS
from uvms_drake.control.limits.inputs import input_names
from uvms_drake.control.limits.radii import TubeRadii, resolved_radii
from uvms_drake.model.frames.euler import pose_difference
from uvms_drake.model.frames.spatial import times
from uvms_drake.report.signals import watched
from uvms_drake.station.diagram import monitor_floor, set_wise_radii
from uvms_drake.station.record import Record
from uvms_drake.station.scenario.scenario import Scenario
from uvms_drake.station.supervision import MONITOR_SLACK

Largest = dict[str, tuple[float, float]]
"""Largest deviation of each row of `tube_use` and its radius, by name."""
INPUTS = ("u_", "tau_")
"""Beginnings of the names of rows of inputs."""
ROUNDING = 1e-9
"""Least radius that a deviation is divided by."""


def tube_use(record: Record) -> dict[str, float]:
    """Returns the largest deviation over its radius of each row that a tube bounds, by name.

    From the logged samples after the hover; empty if there are none. Rows are those of
    `control.limits.TubeRadii`: `e` and `z`, and each that tightens a limit. Without a sensed
    contact those along its direction are left out.
    """
    return {name: largest / max(radius, ROUNDING)
            for name, (largest, radius) in largest_deviations(record).items()}


def rows_left(record: Record, found: Largest) -> list[str]:
    """Returns the rows of velocities, angles and depth whose radius a run has left, by name.

    Rows of inputs are none of them: the force of the contact is in the law's command, too, and the
    certificate has it beside their radii.
    """
    tube = resolved_radii(record.scenario.tube)
    rows, floor = radii_of(tube), monitor_floor(set_wise_radii(tube, record.scenario.ancillary))
    return [name for name, (largest, radius) in found.items()
            if name in rows and not name.startswith(INPUTS)
            and largest > (1.0 + MONITOR_SLACK) * radius + floor]


def largest_use(record: Record, found: Largest) -> tuple[str | None, float | None]:
    """Returns the row with the largest deviation over its radius, and that ratio; None: no radius.

    With a certificate for the worst case rows of inputs are none of them, see `rows_left`.
    """
    use = {name: largest / radius for name, (largest, radius) in found.items()
           if radius > 0.0 and not (record.certified and name.startswith(INPUTS))}
    worst = max(use, key=lambda name: np.nan_to_num(use[name], nan=np.inf), default=None)
    return worst, None if worst is None else use[worst]


def largest_deviations(record: Record) -> Largest:
    """Returns the largest deviation of each row of `tube_use` and its radius, by name."""
    if not np.any(is_watched := watched(record)):
        return {}
    tube, law = resolved_radii(record.scenario.tube), record.scenario.ancillary
    norms, radii = deviations(record), radii_of(tube)
    for field, radius in set_wise_radii(tube, law).items():
        name = {"task": "e"}.get(field, field)
        norms[name], radii[name] = record.tube_deviation[:, FIELDS.index(field)], radius
    return {name: (float(np.max(norms[name][is_watched])), radius)
            for name, radius in radii.items() if name in norms}


def radii_of(tube: TubeRadii) -> dict[str, float]:
    """Returns the radii of `deviations` by name; those that were not declared are left out."""
    parts = ("nu1", "nu2", "qdot", "roll", "pitch", "tip_speed", "depth", "depth_speed",
             "between_knots")
    radii = {name: getattr(tube, name) for name in parts if getattr(tube, name) is not None}
    tau = () if tube.tau is None else tube.tau
    return radii | {f"{name}_{channel}": float(radius)
                    for name, of in (("u", tube.u), ("tau", tau))
                    for channel, radius in zip(
                        input_names(len(of) - 6), of, strict=False)}


def deviations(record: Record) -> dict[str, np.ndarray]:
    """Returns |real − nominal| (T,) of velocities, angles, depth and inputs, by `TubeRadii`."""
    model, contact = record.model, record.scenario.contact.declared_wall()
    nominal = model.kinematics(record.nominal_config)
    angles = np.abs(pose_difference(record.config, record.nominal_config)[:, 3:6])
    off = record.zeta - record.nominal_zeta
    tip = (times(model.tip_kinematics(record.config).J_chi[:, :3], record.zeta)
           - times(nominal.J_chi[:, :3], record.nominal_zeta))
    planned = times(model.mass_matrix(nominal), record.nominal_input)
    found = {"nu1": np.linalg.norm(off[:, :3], axis=1), "nu2": np.linalg.norm(off[:, 3:6], axis=1),
             "qdot": np.linalg.norm(off[:, 6:], axis=1), "roll": angles[:, 0],
             "pitch": angles[:, 1], "tip_speed": np.linalg.norm(tip, axis=1)}
    if contact is not None:
        n, planned_speed = contact.direction, times(nominal.J_chi[:, :3], record.nominal_zeta)
        found |= {"depth": np.abs((record.chi - record.chi_nominal)[:, :3] @ n),
                  "depth_speed": np.abs(tip @ n), "between_knots": off_knots(
                      record.time, record.chi_nominal[:, :3] @ n, planned_speed @ n,
                      record.scenario.mpc.time_step)}
    for name, error in (("u", record.u - record.nominal_input), ("tau", record.tau - planned)):
        found |= {f"{name}_{channel}": np.abs(row) for channel, row in zip(
            input_names(model.num_joints), error.T, strict=True)}
    return found


def check_log(scenario: Scenario) -> None:
    """Raises `InvalidParameter` if `between_knots` cannot be seen in the scenario's log."""
    parts = scenario.mpc.time_step / scenario.log_period
    require(parts > 1.5 and abs(parts - round(parts)) < 1e-6, "log_period", scenario.log_period,
            f"a half, a third, ... of mpc.time_step, {scenario.mpc.time_step:g} s: depth between "
            "two knots of the plan is watched in the log")


def off_knots(time: np.ndarray, depth: np.ndarray, speed: np.ndarray, step: float) -> np.ndarray:
    """Returns the distances (T,) [m] of a plan's depth from a parabola between two of its knots.

    It is the parabola with the depth and the speed of the knot before, and the depth of the next
    one. Zero at the knots, and in the last interval, and if no knot is logged.

    Args:
        time: Times of the samples (T,) [s].
        depth: n·𝔭̄ (T,) [m].
        speed: n·𝔭̄̇ (T,) [m/s].
        step: Time from knot to knot [s].
    """
    knots = np.flatnonzero(np.abs(time - step * np.round(time / step)) < 1e-9)
    following = np.searchsorted(knots, np.arange(len(time)), side="right")
    before, after = knots[following - 1], knots[np.minimum(following, len(knots) - 1)]
    whole = np.abs(time[after] - time[before] - step) < 1e-9
    t, rise = time - time[before], depth[after] - depth[before] - speed[before] * step
    off = np.abs(depth - depth[before] - speed[before] * t - rise * (t / step)**2)
    return np.where(whole, off, 0.0)
