"""The summary of a run: its figures of merit and its claim as data, and as a table."""

import platform
from dataclasses import asdict
from importlib.metadata import version
from typing import Any

import numpy as np

from uvms_drake.certificate.assumptions import Assumption, assumptions_of, scope_of
from uvms_drake.certificate.certificate import AnyCertificate
from uvms_drake.certificate.in_probability import ProbabilityCertificate
from uvms_drake.common.jsonable import jsonable
from uvms_drake.common.program import VERSION
from uvms_drake.report.events import ALARMING
from uvms_drake.report.headline import headline, used
from uvms_drake.report.metrics import LAST_SECONDS, metrics
from uvms_drake.report.mission.force_bands import format_bands
from uvms_drake.report.mission.mission import format_mission
from uvms_drake.report.signals import wrench_unit
from uvms_drake.report.thrusters import format_thrusters
from uvms_drake.station.record import Record

COUNTERS = ("solves", "failures", "late", "fallbacks", "dropped", "kept", "refused_targets")
"""Counters of the MPC; but for the first they are of exceptional samples, and usually zero."""
EVENT_LINES = 12
"""Largest number of lines for events in the table for a terminal."""


def summarise(record: Record, certificate: AnyCertificate | None = None) -> dict[str, Any]:
    """Returns the summary of a run, ready for JSON: the content of summary.json.

    Args:
        record: Record of the run.
        certificate: Certificate of the run; of one in probability the summary tells the claim.
    """
    scenario, wall, found = record.scenario, record.wall_time_s, metrics(record)
    data: dict[str, Any] = jsonable({
        "scenario": scenario.name,
        "seed": scenario.seed,
        "versions": {"uvms_drake": VERSION, "drake": version("drake"),
                     "python": platform.python_version()},
        "duration_s": scenario.duration,
        "wall_time_s": wall,
        "real_time_factor": scenario.duration / wall if wall > 0.0 else None,
        **found,
        "assumptions": [asdict(each) for each in assumptions_of(scenario, record.model)]
        if record.certified else [],
        "in_probability": summarise_claim(certificate, found["contact"]),
    })
    return data


def summarise_claim(certificate: AnyCertificate | None, contact: dict[str, Any]
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
