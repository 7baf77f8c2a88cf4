"""The figures of merit of a run: a pure function from a `Record` to plain data.

They are those of summary.json, of a campaign and of the benchmark. One that does not exist, such as
the settling time of a force that never settled, is None. Everything is evaluated at the logged
samples.
"""

from typing import Any

import numpy as np

from uvms_drake.common.jsonable import jsonable
from uvms_drake.control.feedback.tube_monitor import TUBE_REPORT
from uvms_drake.control.mpc.planner import DROPPED, FAILED, HOVERED, KEPT, TIMED_OUT
from uvms_drake.control.mpc.solver_faults import solver_fault
from uvms_drake.model.frames.euler import pose_difference
from uvms_drake.model.frames.spatial import times
from uvms_drake.model.surface import ShapedSurface
from uvms_drake.model.surface.law import check_surface
from uvms_drake.model.surface.unknown_contact import UnknownContact
from uvms_drake.report import signals
from uvms_drake.report.contact_check import departures, has_stood, summarise_bands
from uvms_drake.report.events import events
from uvms_drake.report.mission import summarise_mission
from uvms_drake.report.tube_use import largest_deviations, largest_use, rows_left
from uvms_drake.station.contact.bounds import mean_time
from uvms_drake.station.contact.drawn_mission import ends_of
from uvms_drake.station.contact.drawn_surfaces import across, ball_about, is_member, membership
from uvms_drake.station.diagram import bounds_disturbance
from uvms_drake.station.problem import true_surface
from uvms_drake.station.record import Record
from uvms_drake.station.scenario.parts import faults_at
from uvms_drake.tube.contact.sensor_error import ripple

LAST_SECONDS = 5.0
"""Length of the window at the end over which the force is averaged [s]."""
WALL_SECONDS = 2.0
"""Likewise, of the force on an unknown wall."""

Ends = tuple[np.ndarray, np.ndarray]
"""Start of the tip, and its desired position but for the depth (3,), (3,) [m]; see `ends_of`."""


def metrics(record: Record) -> dict[str, Any]:
    """Returns the figures of merit of a run by group, ready for JSON.

    `wall` is of a wall that the controller did not know, see `wall_metrics`; without one it is
    empty.
    """
    data: dict[str, Any] = jsonable({
        "mpc": summarise_mpc(record),
        "task_error": summarise_task_error(record),
        "force": summarise_force(record),
        "contact": summarise_contact(record),
        "wall": wall_metrics(record),
        "mission": summarise_mission(record),
        "constraints": summarise_constraints(record),
        "thrusters": summarise_thrusters(record),
        "disturbance": summarise_disturbance(record),
        "tube": summarise_tube(record),
        "events": [{"time_s": event.start, "until_s": event.end, "kind": event.kind,
                    "text": event.text} for event in events(record)],
    })
    return data


def summarise_mpc(record: Record) -> dict[str, object]:
    """Returns how often the MPC was solved and failed, how well, and how long a step took.

    `fallbacks` are the samples at which the last plan was continued: `failures` of the solver, of
    which `own_failures` are those that no fault of the scenario declares, and `late` plans; where
    it was `kept` because it was sounder than the new one, nothing failed. At `dropped` samples
    there was no solve, and none while the robot hovered.
    `worst_violation` is that of the plans, in the unit of the limit that they violate.
    """
    planned = record.mpc_status != HOVERED
    status = record.mpc_status[planned]
    step_ms = 1e3 * record.step_seconds[planned & (record.mpc_status != DROPPED)]
    quantiles = (dict(zip(("p50", "p95", "p99"), np.percentile(step_ms, [50, 95, 99]), strict=True))
                 if len(step_ms) else dict.fromkeys(("p50", "p95", "p99")))
    return {
        "solves": np.count_nonzero(status != DROPPED),
        "failures": np.count_nonzero(status == FAILED),
        "own_failures": own_failures(record),
        "late": np.count_nonzero(status == TIMED_OUT),
        "dropped": np.count_nonzero(status == DROPPED),
        "fallbacks": np.count_nonzero((status == FAILED) | (status == TIMED_OUT)),
        "kept": np.count_nonzero(status == KEPT),
        "step_ms": {**quantiles, "max": np.max(step_ms, initial=0.0) if len(step_ms) else None},
        "refused_targets": np.count_nonzero(record.mpc_refused),
        "worst_terminal_slack": np.max(record.mpc_terminal_slack) if len(step_ms) else None,
        "worst_violation": np.max(record.mpc_violation) if len(step_ms) else None,
    }


def own_failures(record: Record) -> int:
    """Returns the number of failed solves without a fault of the scenario.

    A plan that is computed in advance is reported when it comes, a sample after its own.
    """
    scenario, period = record.scenario, record.scenario.mpc.time_step
    faults = list(faults_at("solver", scenario.faults).values())
    declared = [solver_fault(faults, scenario.seed, round(
        time / period) - scenario.mpc.in_advance, period) for time in record.mpc_time]
    return int(np.count_nonzero((record.mpc_status == FAILED) & (np.array(declared) != FAILED)))


def summarise_task_error(record: Record) -> dict[str, object]:
    """Returns χ − χ_des at both ends [m, rad]."""
    error = pose_difference(record.chi[[0, -1]], record.chi_des)
    return {"initial": error[0], "final": error[1], "final_norm": np.linalg.norm(error[1])}


def summarise_force(record: Record) -> dict[str, Any]:
    """Returns how well 𝔉 came to and stayed at 𝔉_des [N, N m].

    Normal is along 𝔉_des, tangential is across it: friction, and the tilt of the surface.
    """
    desired = record.desired_force[-1]
    error = np.linalg.norm(record.force - record.desired_force, axis=1)
    index = signals.settling_index(error, record.scenario.task.force_tolerance)
    magnitude = float(np.linalg.norm(desired[:3]))
    direction = desired[:3] / magnitude if magnitude > 0.0 else np.zeros(3)
    normal, wanted = record.force[:, :3] @ direction, record.desired_force[:, :3] @ direction
    tangential = np.linalg.norm(record.force[:, :3] - np.outer(normal, direction), axis=1)
    end = record.time >= record.time[-1] - LAST_SECONDS
    return {
        "desired": desired,
        "tolerance": record.scenario.task.force_tolerance,
        "final": record.force[-1],
        "final_error_norm": error[-1],
        "final_error_normal": normal[-1] - magnitude,
        "final_error_tangential": tangential[-1] if magnitude > 0.0 else None,
        "worst_error_norm_after_settling": None if index is None else np.max(error[index:]),
        "worst_normal_error_after_settling": (
            None if index is None else np.max(np.abs((normal - wanted)[index:]))),
        "settling_time_s": None if index is None else record.time[index],
        "peak_normal": np.max(normal) if magnitude > 0.0 else None,
        "overshoot": None if record.penetration[0] > 0.0 else _overshoot(normal, wanted, index),
        "last_5_s": {"mean_error_norm": np.mean(error[end]),
                     "worst_normal_error": np.max(np.abs((normal - wanted)[end])),
                     "worst_tangential_error": np.max(tangential[end])},
    }


def summarise_contact(record: Record) -> dict[str, Any]:
    """Returns when the surface was first touched, how often it was left, and the static force [N].

    The static force is that of the real surface at the pose, at rest: without impact and damping.
    A loss is the end of a contact while a force is desired, once that had settled if it has, and
    not by a retreat; with a mission, in a step that needs a contact.
    """
    scenario, touching = record.scenario, record.penetration > 0.0
    error = np.linalg.norm(record.force - record.desired_force, axis=1)
    settled = signals.settling_index(error, scenario.task.force_tolerance) or 0
    surface = check_surface(true_surface(scenario))
    wanted = np.any(record.desired_force[settled + 1:], axis=1) & record.followed[settled + 1:]
    left = np.count_nonzero(wanted & (np.diff(touching[settled:].astype(int)) < 0))
    return {"first_touch_s": record.time[np.argmax(touching)] if np.any(touching) else None,
            "losses": signals.losses_of(record) if signals.has_mission(record) else left,
            "largest_force": np.max(np.linalg.norm(record.force[:, :3], axis=1)),
            "largest_static_force": np.max(surface.static_force(record.chi)),
            **summarise_bands(record), **_summarise_class(record)}


def _summarise_class(record: Record) -> dict[str, object]:
    """Returns `out_of_class`, the bounds of its class that the wall was seen to exceed.

    Empty without a declared wall. At the instants of the log, so at least these.
    """
    contact = record.scenario.contact.declared_wall()
    if contact is None:
        return {}
    surface = check_surface(true_surface(record.scenario))
    config, zeta = np.split(record.state, 2, axis=1)
    velocity = times(record.model.tip_kinematics(config).J_chi[:, :3], zeta)

    def static(places: np.ndarray) -> np.ndarray:
        """Returns φ at places (m, 3), in the attitude of the start."""
        attitude = np.broadcast_to(record.chi[0, 3:], (len(places), 3))
        return surface.static_force(np.concatenate([places, attitude], axis=1))

    observed = departures(
        contact, record.time, record.chi[:, :3], velocity, record.force[:, :3], static,
        has_stood(record, mean_time(record.scenario)) & record.followed)
    return {"out_of_class": {key: each._asdict() for key, each in observed.items()}}


def _overshoot(normal: np.ndarray, wanted: np.ndarray, settled: int | None) -> dict[str, object]:
    """Returns by how much the force (T,) exceeded the largest desired so far before it settled."""
    stop, desired = len(normal) if settled is None else settled + 1, float(wanted[-1])
    excess = max(float(np.max((normal - np.maximum.accumulate(wanted))[:stop])), 0.0)
    return {"newton": excess, "percent": 100.0 * excess / desired if desired > 0.0 else None}


def summarise_constraints(record: Record) -> dict[str, object]:
    """Returns limit, worst value, margin and unit of each constraint; negative if violated."""
    return {name: {"limit": each.limit, "worst": each.values[np.argmin(each.margin)],
                   "margin": np.min(each.margin), "unit": each.unit}
            for name, each in signals.constraints(record).items()}


def relative_margins(rows: dict[str, Any]) -> dict[str, float]:
    """Returns the margin of each of `summarise_constraints` over its size; negative if violated.

    The size of one with a limit on either side, such as a joint's, is the range between them. One
    whose value was not a number is violated without end.
    """
    out = {}
    for name, row in rows.items():
        other = rows.get(name[:-4] + ("_max" if name.endswith("_min") else "_min"), {"limit": 0.0})
        margin = -np.inf if row["margin"] is None else float(row["margin"])
        out[name] = margin / (abs(row["limit"] - other["limit"]) or 1.0)
    return out


def summarise_thrusters(record: Record) -> dict[str, object]:
    """Returns by name the forces [N], the limits, and the share of the time at a limit.

    The limits are those of the controller's model. Empty if the wrench is ideal.
    """
    if signals.thruster_part(record.scenario) is None:
        return {}
    thrusters, force = signals.thrusters_of(record), record.signals["thruster_force"]
    command, ends = record.signals["thruster_command"], np.array(
        [curve.command[[0, -1]] for curve in thrusters.curves])
    bound = (command <= ends[:, 0]) | (command >= ends[:, 1])
    return {name: {
        "lower": thrusters.lower[i], "upper": thrusters.upper[i], "least": np.min(force[:, i]),
        "largest": np.max(force[:, i]), "rms": np.sqrt(np.mean(force[:, i] ** 2)),
        "at_limit": np.mean(bound[:, i])} for i, name in enumerate(thrusters.names)}


def summarise_disturbance(record: Record) -> dict[str, object]:
    """Returns d̃, the largest disturbance, and how often it was above d̃.

    `worst` is of the effective disturbance, with all that the controller does not know about;
    `applied` of the simulated one alone. `exceeded` counts the separate times of being above; it is
    None where no bound is declared. With weights `bound` is d̃, the largest of the components'
    bounds `semi_axes`, and the other two are of ‖Ŵ⁻¹d‖₂, of which it is the bound.
    """
    above, declared = signals.disturbance_above(record), record.scenario.disturbance
    bounded = bounds_disturbance(declared.d_bound, bool(record.certified))
    weighted = bool(np.size(declared.weights))
    return {"bound": declared.d_bound,
            "semi_axes": (declared.d_bound * declared.relative_weights(record.disturbance.shape[1])
                          if weighted else None),
            "unit": "m/s², rad/s²",
            "worst": np.max(declared.norm(record.effective_disturbance)),
            "applied": np.max(declared.norm(record.disturbance)),
            "exceeded": (
                np.count_nonzero(np.diff(above.astype(int), prepend=0) > 0) if bounded else None)}


def summarise_tube(record: Record) -> dict[str, object]:
    """Returns the bounds, the worst deviations and how often they were left.

    `e` is the error of the law, `error`: y − ȳ, or χ − χ̄ alone; see `FIELDS`. `exits` counts
    the set-wise bounds; `worst_ratio` is the largest deviation over its bound, among the
    whole task, position, orientation, joints and velocity, set-wise and along the run; see
    `TubeMonitor`. `left` are the rows that the monitor does not watch and that were left, none
    without a tube.
    `largest_use` is the largest of all rows over its radius, of the row `most_used`.
    """
    tube, found = record.scenario.tube, largest_deviations(record)
    row, use = largest_use(record, found)
    report = dict(zip(TUBE_REPORT, record.tube_report, strict=True))
    watched = signals.watched(record)
    return {
        "certified": bool(record.certified),
        "law": record.scenario.law,
        "error": "y" if record.scenario.ancillary.protects_joints else "chi",
        "bound_e": tube.e, "worst_e": _largest(record.deviation_of("task")[watched]),
        "bound_z": tube.z, "worst_z": _largest(record.deviation_of("z")[watched]),
        "exits": int(report["set_exits"]),
        "first_exit_s": report["set_first_exit"],
        "exits_along_the_run": int(report["trajectory_exits"]),
        "left": rows_left(record, found) if tube.e > 0.0 else [],
        "worst_ratio": _worst_ratios(record, report),
        "most_used": row, "largest_use": use,
        "disturbance_excesses": int(report["disturbance_exits"]),
    }


def _largest(values: np.ndarray) -> float | None:
    """Returns the largest of some values; None if there are none."""
    return float(np.max(values)) if len(values) else None


def _worst_ratios(record: Record, report: dict[str, float]) -> dict[str, float | None]:
    """Returns the largest ratio of deviation and bound; None if there is no bound along the run."""
    parts = ("task", "position", "orientation", "joints", "z")
    along = [part for part in parts if np.any(np.isfinite(record.bound_of(part)))]
    return {"set": max(report[f"worst_set_{part}"] for part in parts),
            "trajectory": max((report[f"worst_trajectory_{part}"] for part in along),
                              default=None)}


# An unknown wall ----------------------------------------------------------------------------------


def wall_metrics(record: Record) -> dict[str, Any]:
    """Returns the metrics of a wall of any shape that `contact` declares; empty without one.

    `static` and `peak` are forces along the wall's own normal, at rest and in motion, over their
    bounds. The others are of the controlled force along n: `settled_s` is the time from the first
    touch to when it stays within the task's tolerance, `settling_time_s` that from the start,
    `losses` the number of losses of contact after it was within. `in_class` is whether the wall is
    in the class wherever it was touched.

    With a mission the desired force is that of every instant, and losses are those of steps that
    need a contact.
    """
    scenario, surface = record.scenario, check_surface(true_surface(record.scenario))
    contact = scenario.contact.declared_wall()
    if contact is None or not isinstance(surface, ShapedSurface):
        return {}
    goal = np.asarray(scenario.task.pose, dtype=float)[:3]
    ends = ends_of(scenario.mission, contact.walls, record.chi[0, :3], goal)
    found, static = membership(surface, contact, *ends), surface.static_force(record.chi)
    # A mission desires a force in some of its steps, a press always the same one.
    desired: Any = (record.desired_force[:, :3] @ contact.direction if signals.has_mission(record)
                    else scenario.task.force_along(contact.direction))
    error = np.abs(record.force[:, :3] @ contact.direction - desired)
    within, touching = error <= scenario.task.force_tolerance, record.penetration > 0.0
    index = signals.settling_index(error, scenario.task.force_tolerance)
    settled = None if index is None else record.time[index]
    touch = record.time[np.argmax(touching)] if np.any(touching) else None
    left = (np.diff(touching.astype(int), prepend=0) < 0) & record.followed
    since = int(np.argmax(within)) + 1 if np.any(within) else len(within)
    return {
        "shape": type(surface.geometry).__name__, "law": type(surface.law).__name__,
        "stiffness": None if found is None else found.stiffness,
        "angle": None if found is None else found.angle,
        "static": np.max(static) / contact.force,
        "peak": np.max(_normal_force(record, surface)) / contact.peak(
            contact.force, contact.largest_advance),
        "first_touch_s": touch,
        "settled_s": None if settled is None or touch is None else max(settled - touch, 0.0),
        "settling_time_s": settled,
        "error": np.mean(error[record.time >= record.time[-1] - WALL_SECONDS]),
        "final_error": error[-1],
        "losses": (signals.losses_of(record) if signals.has_mission(record)
                   else np.count_nonzero(left[since:])),
        "in_class": _in_class(record, surface, contact, static, ends),
    }


def _normal_force(record: Record, surface: ShapedSurface) -> np.ndarray:
    """Returns the force on the wall along its own normal (T,) [N], without friction."""
    _, into = surface.geometry.depth_and_gradient(record.chi[:, :3])
    force: np.ndarray = np.sum(record.force[:, :3] * into, axis=1) / np.linalg.norm(into, axis=1)
    return force


def _in_class(record: Record, surface: ShapedSurface, contact: UnknownContact, static: np.ndarray,
              ends: Ends) -> bool:
    """Returns whether the wall of a run is in the class wherever the tip touched it.

    The tip has to stay in the ball of proven membership, and the rate of the force normal to n
    within the class's bound; only the time before the first too large static force (T,) counts.
    """
    center, reach = ball_about(surface.anchor, contact, surface.law, *ends)
    hard = static > contact.force
    allowed = slice(int(np.argmax(hard)) if np.any(hard) else len(hard))
    far = np.linalg.norm(record.chi[allowed, :3] - center, axis=1) > reach
    tangential = ripple(record.time[allowed], across(contact.direction, record.force[allowed, :3]),
                        contact.force_rate)
    return (is_member(surface, contact, *ends)
            and not np.any(far & (record.penetration[allowed] > 0.0))
            and tangential <= contact.force_ripple)
