"""The figures of merit of a run: pure functions from a `Record` to the content of summary.json.

A figure of merit that does not exist, such as the settling time of a force that never settled, is
None. Everything is evaluated at the logged samples.
"""

import platform
from dataclasses import asdict
from importlib.metadata import version
from typing import Any

import numpy as np

from uvms_drake.certificate.assumptions import Assumption, assumptions_of, scope_of
from uvms_drake.certificate.in_probability import AnyCertificate, ProbabilityCertificate
from uvms_drake.common.jsonable import jsonable
from uvms_drake.common.program import VERSION
from uvms_drake.control.feedback.tube_monitor import TUBE_REPORT
from uvms_drake.control.mpc.planner import DROPPED, FAILED, HOVERED, KEPT, TIMED_OUT
from uvms_drake.model.frames.euler import pose_difference
from uvms_drake.model.frames.spatial import times
from uvms_drake.model.surface.law import check_surface
from uvms_drake.report.events import ALARMING, events
from uvms_drake.report.headline import headline, used
from uvms_drake.report.mission.attempts import has_mission, losses_of
from uvms_drake.report.mission.force_bands import format_bands, has_stood, summarise_bands
from uvms_drake.report.mission.mission import format_mission, summarise_mission
from uvms_drake.report.signals import (
    constraint_signals,
    constraint_units,
    disturbance_above,
    settling_index,
    wrench_unit,
)
from uvms_drake.report.surface_class_check import departures
from uvms_drake.report.thrusters import format_thrusters, summarise_thrusters
from uvms_drake.station.diagram import bounds_disturbance, monitor_begin
from uvms_drake.station.problem import true_surface
from uvms_drake.station.record import Record

LAST_SECONDS = 5.0
"""Length of the window at the end over which the force is averaged [s]."""
COUNTERS = ("solves", "failures", "late", "fallbacks", "dropped", "kept", "refused_targets")
"""Counters of the MPC; but for the first they are of exceptional samples, and usually zero."""
EVENT_LINES = 12
"""Largest number of lines for events in the table for a terminal."""


def summarise(record: Record, certificate: AnyCertificate | None = None) -> dict[str, Any]:
    """Returns the summary of a run, ready for JSON.

    Args:
        record: Record of the run.
        certificate: Certificate of the run; of one in probability the summary tells the claim.
    """
    scenario = record.scenario
    wall, contact = record.wall_time_s, summarise_contact(record)
    summary = {
        "scenario": scenario.name,
        "seed": scenario.seed,
        "versions": {"uvms_drake": VERSION, "drake": version("drake"),
                     "python": platform.python_version()},
        "duration_s": scenario.duration,
        "wall_time_s": wall,
        "real_time_factor": scenario.duration / wall if wall > 0.0 else None,
        "mpc": summarise_mpc(record),
        "task_error": summarise_task_error(record),
        "force": summarise_force(record),
        "contact": contact,
        "mission": summarise_mission(record),
        "constraints": summarise_constraints(record),
        "thrusters": summarise_thrusters(record),
        "disturbance": summarise_disturbance(record),
        "tube": summarise_tube(record),
        "assumptions": [asdict(each) for each in assumptions_of(scenario, record.model)]
        if record.certified else [],
        "in_probability": summarise_claim(record, certificate, contact),
        "events": [{"time_s": event.start, "until_s": event.end, "kind": event.kind,
                    "text": event.text} for event in events(record)],
    }
    data: dict[str, Any] = jsonable(summary)
    return data


def summarise_claim(record: Record, certificate: AnyCertificate | None, contact: dict[str, Any]
                    ) -> dict[str, Any] | None:
    """Returns the claim of a certificate in probability, and values outside of its ranges.

    The bounds of its class that the wall was seen to exceed, of `summarise_contact`, are such, too.
    """
    if not isinstance(certificate, ProbabilityCertificate):
        return None
    seen = [f"contact.{key} was seen to be {row['observed']:.4g}, declared up to "
            f"{row['specified']:.4g}" for key, row in contact.get("out_of_class", {}).items()]
    return {"verdict": certificate.verdict, "probability": certificate.probability,
            "confidence": certificate.confidence, "runs": certificate.runs,
            "failures": certificate.failures,
            "outside": seen}


def summarise_mpc(record: Record) -> dict[str, object]:
    """Returns how often the MPC was solved and failed, how well, and how long a step took.

    `fallbacks` are the samples at which the last plan was continued: `failures` of the solver, and
    `late` plans; where it was `kept` because it was sounder than the new one, nothing failed. At
    `dropped` samples there was no solve, and none while the robot hovered.
    `worst_violation` is that of the plans, in the unit of the limit that they violate.
    """
    planned = record.mpc_status != HOVERED
    status, step_ms = record.mpc_status[planned], 1e3 * record.step_seconds[planned]
    quantiles = (dict(zip(("p50", "p95", "p99"), np.percentile(step_ms, [50, 95, 99]), strict=True))
                 if len(step_ms) else dict.fromkeys(("p50", "p95", "p99")))
    return {
        "solves": np.count_nonzero(status != DROPPED),
        "failures": np.count_nonzero(status == FAILED),
        "late": np.count_nonzero(status == TIMED_OUT),
        "dropped": np.count_nonzero(status == DROPPED),
        "fallbacks": np.count_nonzero((status == FAILED) | (status == TIMED_OUT)),
        "kept": np.count_nonzero(status == KEPT),
        "step_ms": {**quantiles, "max": np.max(step_ms, initial=0.0) if len(step_ms) else None},
        "refused_targets": np.count_nonzero(record.mpc_refused),
        "worst_terminal_slack": np.max(record.mpc_terminal_slack) if len(step_ms) else None,
        "worst_violation": np.max(record.mpc_violation) if len(step_ms) else None,
    }


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
    index = settling_index(error, record.scenario.task.force_tolerance)
    magnitude = float(np.linalg.norm(desired[:3]))
    direction = desired[:3] / magnitude if magnitude > 0.0 else np.zeros(3)
    normal = record.force[:, :3] @ direction
    across = np.linalg.norm(record.force[:, :3] - np.outer(normal, direction), axis=1)
    end = record.time >= record.time[-1] - LAST_SECONDS
    return {
        "desired": desired,
        "tolerance": record.scenario.task.force_tolerance,
        "final": record.force[-1],
        "final_error_norm": error[-1],
        "final_error_normal": normal[-1] - magnitude,
        "final_error_tangential": across[-1] if magnitude > 0.0 else None,
        "worst_error_norm_after_settling": None if index is None else np.max(error[index:]),
        "worst_normal_error_after_settling": (
            None if index is None else np.max(np.abs(normal[index:] - magnitude))),
        "settling_time_s": None if index is None else record.time[index],
        "peak_normal": np.max(normal) if magnitude > 0.0 else None,
        "overshoot": None if record.penetration[0] > 0.0 else _overshoot(normal, magnitude, index),
        "last_5_s": {"mean_error_norm": np.mean(error[end]),
                     "worst_normal_error": np.max(np.abs(normal[end] - magnitude)),
                     "worst_tangential_error": np.max(across[end])},
    }


def summarise_contact(record: Record) -> dict[str, Any]:
    """Returns when the surface was first touched, how often it was left, and the static force [N].

    The static force is that of the real surface at the pose, at rest: without impact and damping.
    A loss is the end of a contact while a force is desired, once that had settled if it has; with a
    mission, in a step that needs a contact.
    """
    scenario, touching = record.scenario, record.penetration > 0.0
    error = np.linalg.norm(record.force - record.desired_force, axis=1)
    settled = settling_index(error, scenario.task.force_tolerance) or 0
    surface = check_surface(true_surface(scenario))
    wanted = np.any(record.desired_force[settled + 1:], axis=1)
    left = np.count_nonzero(wanted & (np.diff(touching[settled:].astype(int)) < 0))
    return {"first_touch_s": record.time[np.argmax(touching)] if np.any(touching) else None,
            "losses": losses_of(record) if has_mission(record) else left,
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
        has_stood(record))
    return {"out_of_class": {key: each._asdict() for key, each in observed.items()}}


def _overshoot(normal: np.ndarray, desired: float, settled: int | None) -> dict[str, object]:
    """Returns by how much the force along the desired one (T,) exceeded it before it settled."""
    stop = len(normal) if settled is None else settled + 1
    excess = max(float(np.max(normal[:stop])) - desired, 0.0)
    return {"newton": excess, "percent": 100.0 * excess / desired if desired > 0.0 else None}


def summarise_constraints(record: Record) -> dict[str, object]:
    """Returns limit, worst value, margin and unit of each constraint; negative if violated."""
    out: dict[str, object] = {}
    units = constraint_units(record)
    for name, (signal, limit) in constraint_signals(record).items():
        lower = name.endswith("_min")
        worst = np.min(signal) if lower else np.max(signal)
        out[name] = {"limit": limit, "worst": worst,
                     "margin": worst - limit if lower else limit - worst, "unit": units[name]}
    return out


def summarise_disturbance(record: Record) -> dict[str, object]:
    """Returns d̃, the largest disturbance, and how often it was above d̃.

    `worst` is of the effective disturbance, with all that the controller does not know about;
    `applied` of the simulated one alone. `exceeded` counts the separate times of being above; it is
    None where no bound is declared. With weights `bound` is d̃, the largest of the components'
    bounds `semi_axes`, and the other two are of ‖Ŵ⁻¹d‖₂, of which it is the bound.
    """
    above, declared = disturbance_above(record), record.scenario.disturbance
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
    `TubeMonitor`.
    """
    tube = record.scenario.tube
    report = dict(zip(TUBE_REPORT, record.tube_report, strict=True))
    watched = record.time >= monitor_begin(record.scenario.mpc.hover, bool(record.certified))
    return {
        "certified": bool(record.certified),
        "law": record.scenario.law,
        "error": "y" if record.scenario.ancillary.protects_joints else "chi",
        "bound_e": tube.e, "worst_e": _largest(record.deviation_of("task")[watched]),
        "bound_z": tube.z, "worst_z": _largest(record.deviation_of("z")[watched]),
        "exits": int(report["set_exits"]),
        "first_exit_s": report["set_first_exit"],
        "exits_along_the_run": int(report["trajectory_exits"]),
        "worst_ratio": _worst_ratios(record, report),
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


def format_summary(summary: dict, event_lines: int | None = EVENT_LINES) -> str:
    """Returns the summary as a table, with at most so many lines of events; None is no limit."""
    return "\n".join([
        headline(summary), "", *_format_run(summary), "", *_format_force(summary),
        *format_mission(summary["mission"]), "",
        *_format_constraints(summary["constraints"]), *format_thrusters(summary["thrusters"]), "",
        *_format_robustness(summary), "",
        *_format_events(summary["events"], event_lines)])


def _format_run(summary: dict) -> list[str]:
    mpc, step, task = summary["mpc"], summary["mpc"]["step_ms"], summary["task_error"]
    ends = [" and ".join(f"{1e3 * np.linalg.norm(task[end][part]):.3g} {unit}" for part, unit in (
        (slice(0, 3), "mm"), (slice(3, 6), "mrad"))) for end in ("initial", "final")]
    return [
        f"{'scenario':<14}{summary['scenario']}, seed {summary['seed']}: "
        f"{summary['duration_s']:g} s in {summary['wall_time_s']:.1f} s "
        f"({_number(summary['real_time_factor'], '.2f')} times real time)",
        f"{'MPC':<14}" + ", ".join(
            f"{mpc[key]} {key.replace('_', ' ')}" for key in COUNTERS
            if mpc[key] or key == "solves"),
        f"{'':<14}step {_number(step['p50'], '.1f')} ms median, "
        f"{_number(step['p99'], '.1f')} ms p99, {_number(step['max'], '.1f')} ms max",
        f"{'':<14}plans exceed a limit by {_number(mpc['worst_violation'], '.2g')} and the "
        f"terminal set by {_number(mpc['worst_terminal_slack'], '.2g')} at most",
        f"{'task error':<14}{ends[0]} at the start, {ends[1]} at the end",
    ]


def _format_force(summary: dict) -> list[str]:
    """Returns the lines of the force: along its direction first, then across, then the contact."""
    force, contact = summary["force"], summary["contact"]
    overshoot, last, unit = force["overshoot"], force["last_5_s"], wrench_unit(force["desired"])
    if summary["mission"]:
        return [f"{'force':<14}of the mission's steps, below", *_format_contact(contact)]
    if not np.any(force["desired"]):
        return [f"{'force':<14}no force desired", *_format_contact(contact)]
    settled = (f"within the tolerance for good after {force['settling_time_s']:.2f} s"
               if force["settling_time_s"] is not None else "never settled within the tolerance")
    lines = [f"{'force':<14}{np.linalg.norm(force['desired']):.4g} {unit} desired, {settled}"]
    window = f"the last {min(LAST_SECONDS, summary['duration_s']):g} s"
    if force["peak_normal"] is None:  # A torque alone.
        lines.append(f"{'':<14}error {force['final_error_norm']:.3g} {unit} at the end, "
                     f"{last['mean_error_norm']:.3g} {unit} on average in {window}")
        return [*lines, *_format_contact(contact)]
    impact = "started in contact" if overshoot is None else (
        "never in contact" if force["peak_normal"] == 0.0 else
        f"overshoot {overshoot['newton']:.3g} N ({_number(overshoot['percent'], '.3g')} %)")
    lines += [
        f"{'':<14}normal error {abs(force['final_error_normal']):.3g} N at the end, at most "
        f"{last['worst_normal_error']:.3g} N in {window}",
        f"{'':<14}tangential error {force['final_error_tangential']:.3g} N at the end, at most "
        f"{last['worst_tangential_error']:.3g} N in {window}",
        f"{'':<14}normal force {force['peak_normal']:.4g} N at its peak, {impact}"]
    return [*lines, *_format_contact(contact)]


def _format_contact(contact: dict) -> list[str]:
    if contact["first_touch_s"] is None:
        return []
    lost = f", contact lost {contact['losses']} times" if contact["losses"] else ""
    return [f"{'':<14}largest force in contact {contact['largest_force']:.4g} N, static force at "
            f"most {contact['largest_static_force']:.4g} N",
            f"{'':<14}first touch at {contact['first_touch_s']:.2f} s{lost}",
            *format_bands(contact.get("force_bands", {})), *_format_class(contact)]


def _format_class(contact: dict) -> list[str]:
    out = contact.get("out_of_class", {})
    return [f"{'' if i else 'NOT OF ITS CLASS':<18}contact.{key} is {row['specified']:.3g}, "
            f"seen was {row['observed']:.3g}" for i, (key, row) in enumerate(out.items())]


def _format_constraints(constraints: dict) -> list[str]:
    rows = [f"{'constraint':<14}{'limit':>11}{'worst':>11}{'margin':>11}"]
    for name, row in constraints.items():
        mark = "" if row["margin"] >= 0.0 else "  VIOLATED"
        numbers = "".join(f"{row[key]:>11.4g}" for key in ("limit", "worst", "margin"))
        rows.append(f"{name:<14}{numbers}  {row['unit']}{mark}".rstrip())
    return rows


def _semi_axes(bounds: list[float] | None) -> str:
    """Returns the norm that a weighted disturbance is measured in; empty without weights."""
    return "" if bounds is None else (
        " in the norm of the ellipsoid of semi-axes " + ", ".join(f"{each:.3g}" for each in bounds))


def _format_robustness(summary: dict) -> list[str]:
    tube, disturbance = summary["tube"], summary["disturbance"]
    return [
        f"{'disturbance':<14}{disturbance['worst']:.4g} at most with the part that the controller "
        f"does not know ({disturbance['applied']:.4g} applied)",
        f"{'':<14}" + ("no bound is declared" if disturbance["exceeded"] is None else
                       f"bound {disturbance['bound']:.4g} [{disturbance['unit']}]"
                       + _semi_axes(disturbance["semi_axes"])
                       + (f", exceeded {disturbance['exceeded']} times"
                          if disturbance["exceeded"] else "")),
        *_format_tube(tube, summary.get("in_probability") is not None),
        *_format_certified(summary),
        *(f"{'':<14}{about}: {statement}" for about, statement in scope_of(
            [Assumption(**each) for each in summary["assumptions"]]).items()),
    ]


def _format_certified(summary: dict) -> list[str]:
    """Returns the kind of certificate that the run has."""
    claim = summary.get("in_probability")
    if claim is None:
        known = "yes, for" if summary["tube"]["certified"] else "no (declared tube)"
        return [f"{'certified':<14}{known}"]
    kind = claim["verdict"].removeprefix("certified ")
    return [f"{'certified':<14}{kind} ({claim['failures']} of {claim['runs']} drawn runs failed)",
            *(f"{'':<14}{each}" for each in claim["outside"])]


def _format_tube(tube: dict, in_probability: bool) -> list[str]:
    error, first = tube["error"], tube["first_exit_s"]
    since = "" if first is None else f" (first at {first:.2f} s)"
    if tube["worst_e"] is None:
        return [f"{'tube':<14}law {tube['law']}; not watched: the robot hovered until the end"]
    along = tube["worst_ratio"]["trajectory"]
    exits = [f"{tube['exits']} set-wise{since}"] * bool(tube["exits"]) + [
        f"{tube['exits_along_the_run']} along the run"] * bool(tube["exits_along_the_run"])
    return [
        f"{'tube':<14}law {tube['law']}; "
        f"|{error} - {error}_nominal| {1e3 * tube['worst_e']:.3g} mm, mrad "
        f"(bound {1e3 * tube['bound_e']:.3g}),",
        f"{'':<14}|zeta - zeta_nominal| {1e3 * tube['worst_z']:.3g} mm/s, mrad/s "
        f"(bound {1e3 * tube['bound_z']:.3g})",
        f"{'':<14}{used(tube, in_probability)}"
        + ("" if along is None else f", {100.0 * along:.3g} % of the bound along the run"),
        *([f"{'':<14}exits: {', '.join(exits)}"] if exits else []),
    ]


def _format_events(events: list[dict], most: int | None) -> list[str]:
    """Returns the lines of the events: alarms, others, kept plans, each in order of time."""
    if not events:
        return [f"{'events':<14}none"]
    ordered = sorted(events, key=lambda event: (event["kind"] not in ALARMING,
                                                event["kind"] == "plan_kept"))
    shown = ordered if most is None or len(events) <= most else ordered[: most - 1]
    lines = [f"{_span(event):<18}  {event['text']}" for event in shown]
    if len(shown) < len(events):
        lines.append(f"... and {len(events) - len(shown)} more in summary.json")
    return [f"{'events' if i == 0 else '':<14}{line}" for i, line in enumerate(lines)]


def _span(event: dict) -> str:
    """Returns when an event of a summary was."""
    start, end = event["time_s"], event["until_s"]
    if end == start:
        return f"{start:.2f} s"
    return f"{start:.2f} s to " + ("the end" if end is None else f"{end:.2f} s")


def _number(value: float | None, spec: str) -> str:
    return "-" if value is None else format(value, spec)
