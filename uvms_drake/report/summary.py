"""The summary of a run: its figures of merit and its claim as data, and as a table."""

import platform
from collections.abc import Iterable
from dataclasses import asdict
from importlib.metadata import version
from typing import Any

import numpy as np

from uvms_drake.certificate.assumptions import Assumption, assumptions_of, scope_of
from uvms_drake.certificate.certificate import AnyCertificate
from uvms_drake.certificate.in_probability import ProbabilityCertificate
from uvms_drake.certificate.run_verdict import BANDS, is_violated, verdict_of
from uvms_drake.common.jsonable import jsonable
from uvms_drake.common.program import VERSION
from uvms_drake.report.events import ALARMING
from uvms_drake.report.metrics import LAST_SECONDS, metrics, relative_margins
from uvms_drake.station.record import Record
from uvms_drake.station.safety import summarise_safety

COUNTERS = ("solves", "failures", "late", "fallbacks", "dropped", "kept", "refused_targets")
"""Counters of the MPC; but for the first they are of exceptional samples, and usually zero."""
EVENT_LINES, TIGHTEST = 12, 5
"""Largest number of lines for events in the table for a terminal, and of limits in short."""
MISSION_COLUMNS = (
    ("begin_s", "", "from", "s", 1.0, ".1f"), ("seconds", "", "for", "s", 1.0, ".1f"),
    ("mean_force", "force", "mean", "N", 1.0, ".2f"),
    ("force_rms", "error", "rms", "N", 1.0, ".2f"),
    ("force_worst", "error", "worst", "N", 1.0, ".2f"),
    ("certified", "error", "bound", "N", 1.0, ".2f"),
    ("held", "in hold", "worst", "N", 1.0, ".2f"),
    ("certified_hold", "in hold", "bound", "N", 1.0, ".2f"),
    ("within", "in its", "band", "%", 100.0, ".1f"), ("off_rms", "place", "rms", "mm", 1e3, ".2f"),
    ("off_worst", "place", "worst", "mm", 1e3, ".2f"), ("behind", "line", "lag", "mm", 1e3, ".1f"))
"""Columns of the table of a mission: key, both lines of its head, unit, factor, and format."""


def summarise(record: Record, certificate: AnyCertificate | None = None) -> dict[str, Any]:
    """Returns the summary of a run, ready for JSON: the content of summary.json.

    Args:
        record: Record of the run.
        certificate: Certificate of the run; of one in probability the summary tells the claim.
    """
    scenario, wall, found = record.scenario, record.wall_time_s, metrics(record)
    seconds = float(record.time[-1]) if record.failure else scenario.duration
    data: dict[str, Any] = jsonable({
        "scenario": scenario.name,
        "seed": scenario.seed,
        "versions": {"uvms_drake": VERSION, "drake": version("drake"),
                     "python": platform.python_version()},
        "duration_s": seconds,
        "wall_time_s": wall,
        "real_time_factor": seconds / wall if wall > 0.0 else None,
        "failure": str(record.failure),
        **found,
        "safety": summarise_safety(record),
        "assumptions": [asdict(each) for each in assumptions_of(scenario, record.model)]
        if record.certified else [],
        "in_probability": summarise_claim(record, certificate, found),
    })
    return {"verdict": verdict_of(data), **data}


def summarise_claim(record: Record, certificate: AnyCertificate | None, found: dict[str, Any]
                    ) -> dict[str, Any] | None:
    """Returns the claim of a certificate in probability, and values outside of its ranges.

    The bounds of its class that the wall was seen to exceed, of `metrics`, are such, too, and so is
    a run that was stopped before its duration, or before its mission was over.
    """
    if not isinstance(certificate, ProbabilityCertificate):
        return None
    asked, lasted = float(record.declared_duration), record.scenario.duration
    stopped = [f"stopped at {lasted:.4g} s of {asked:g} s"] * (
        asked > lasted and found["mission"].get("over_s") is None)
    departed = found["contact"].get("out_of_class", {})
    seen = [f"contact.{key} was seen to be {row['observed']:.4g}, declared up to "
            f"{row['specified']:.4g}" for key, row in departed.items()]
    return {"verdict": certificate.verdict, "probability": certificate.probability,
            "confidence": certificate.confidence, "runs": certificate.runs,
            "failures": certificate.failures, "attempt": certificate.attempt,
            "outside": [*(f"never drawn: {value}" for value in certificate.never_drawn), *stopped,
                        *seen]}


def used(tube: dict[str, Any], in_probability: bool = False) -> str:
    """Returns the share of the tube that the run used, the largest of its rows.

    Args:
        tube: As of the summary.
        in_probability: Whether the run has a certificate in probability.
    """
    kind = "certified in probability" if in_probability else "not certified"
    name = "certified tube" if tube["certified"] else f"declared tube ({kind})"
    if tube["worst_e"] is None:
        return f"{name} not watched"
    if tube["most_used"] is None:
        return f"{name}: no radius"
    return (f"at most {100.0 * tube['largest_use']:.3g} % of a radius of the {name} used "
            f"({tube['most_used'].replace('_', ' ')})")


def _task(summary: dict[str, Any]) -> str:
    """Returns the outcome of the mission, of the desired force, or of the pose without one."""
    force, mission, contact = summary["force"], summary["mission"], summary["contact"]
    if mission:
        return _mission(mission)
    magnitude = float(np.linalg.norm(force["desired"][:3]))
    if not np.any(force["desired"]):
        return f"no force desired, end-effector off by {_pose_error(summary, 'final')} at the end"
    if magnitude == 0.0:
        return f"torque desired, off by {force['final_error_norm']:.3g} N m at the end"
    if contact["first_touch_s"] is None:
        return f"{magnitude:.4g} N desired, the surface was never touched"
    settled = force["settling_time_s"]
    when = ("not held within the tolerance" if settled is None else
            f"held within {force['tolerance']:.3g} N from {settled:.2f} s on")
    return (f"{magnitude:.4g} N {when}, normal force off by "
            f"{abs(force['final_error_normal']):.2g} N at the end")


def _mission(mission: dict[str, Any]) -> str:
    """Returns how a mission went: its outcome, its steps, and the force of those in contact."""
    steps = mission["steps"]
    done = len({row["step"] for row in steps if row["ended"] == "done"})
    total = len({row["step"] for row in steps}) + mission["not_begun"]
    when = "" if mission["over_s"] is None else f" after {mission['over_s']:.1f} s"
    text = f"mission {mission['outcome']}{when}, {done} of {total} steps done"
    pressed = [row for row in steps if "force_rms" in row]
    if pressed:
        text += (f", normal force off by {max(row['force_rms'] for row in pressed):.2g} N rms in "
                 f"the worst of {len(pressed)} measurements")
    return text


def format_summary(summary: dict[str, Any], *, full: bool = False) -> str:
    """Returns a run in words: verdict, five numbers, limits, mission and events.

    Args:
        summary: As of `summarise`.
        full: Whether all lines, limits and events are printed, and not a screen of them.
    """
    # Five numbers, and the details of each.
    contact, mpc, step = summary["contact"], summary["mpc"], summary["mpc"]["step_ms"]
    touch, limits = contact["first_touch_s"], summary["constraints"]
    lost = f", lost {contact['losses']} times" if contact["losses"] else ""
    in_short = {
        "task": [_task(summary)],
        "contact": ["never" if touch is None else
                    f"first at {touch:.2f} s, at most {contact['largest_force']:.3g} N{lost}"],
        "end-effector": [f"off by {_pose_error(summary, 'final')} at the end"],
        "tube": [used(summary["tube"], summary["in_probability"] is not None)],
        "MPC": [f"{_counts(mpc)}; step {_number(step['p50'], '.1f')} ms median, "
                f"{_number(step['max'], '.1f')} ms at most"]}
    details = {
        "task": _format_force(summary), "contact": _format_contact(contact),
        "end-effector": [f"off by {_pose_error(summary, 'initial')} at the start"],
        "tube": _format_tube(summary["tube"]),
        "MPC": [f"step {_number(step['p99'], '.1f')} ms p99"],
        "thrusters": _format_thrusters(summary["thrusters"]),
        "disturbance": _format_disturbance(summary["disturbance"]),
        "certified": _format_certified(summary),
        "run": [f"seed {summary['seed']}: {summary['duration_s']:g} s in "
                f"{summary['wall_time_s']:.1f} s ({_number(summary['real_time_factor'], '.2f')} "
                "times real time)"]} if full else {}
    # All limits, or the tightest ones.
    margins = relative_margins(limits)
    shown = limits if full else {name: limits[name] for name in sorted(
        margins, key=lambda name: margins[name])[:TIGHTEST]}
    return "\n".join([
        f"{summary['scenario']}: {summary['verdict']['text']}", "",
        *(line for name in in_short | details
          for line in _block(name, [*in_short.get(name, []), *details.get(name, [])])),
        *_format_mission(summary["mission"]), "",
        *_format_constraints(shown, "constraint" if full else "tightest"), "",
        *_block("events", _format_events(summary["events"], full))])


def _block(label: str, lines: Iterable[str]) -> list[str]:
    """Returns lines with a label beside the first one."""
    return [f"{'' if i else label:<14}{line}" for i, line in enumerate(lines)]


def _counts(mpc: dict) -> str:
    return ", ".join(f"{mpc[key]} {key.replace('_', ' ')}" for key in COUNTERS
                     if mpc[key] or key == "solves")


def _pose_error(summary: dict, end: str) -> str:
    """Returns the size of χ − χ_des at the `initial` or `final` instant."""
    error = 1e3 * np.asarray(summary["task_error"][end])
    return f"{np.linalg.norm(error[:3]):.3g} mm and {np.linalg.norm(error[3:]):.3g} mrad"


def _format_force(summary: dict) -> list[str]:
    """Returns further lines of the force: along its direction first, then across."""
    force = summary["force"]
    overshoot, last = force["overshoot"], force["last_5_s"]
    if summary["mission"] or not np.any(force["desired"]):
        return []
    window = f"the last {min(LAST_SECONDS, summary['duration_s']):g} s"
    if force["peak_normal"] is None:  # A torque alone.
        return [f"error {last['mean_error_norm']:.3g} N m on average in {window}"]
    impact = "started in contact" if overshoot is None else (
        "never in contact" if force["peak_normal"] == 0.0 else
        f"overshoot {overshoot['newton']:.3g} N ({_number(overshoot['percent'], '.3g')} %)")
    return [*(
        f"{name} error {abs(force[f'final_error_{name}']):.3g} N at the end, at most "
        f"{last[f'worst_{name}_error']:.3g} N in {window}" for name in ("normal", "tangential")),
        f"normal force {force['peak_normal']:.4g} N at its peak, {impact}"]


def _format_contact(contact: dict) -> list[str]:
    """Returns further lines of the contact: static force, bands, bounds of its class."""
    if contact["first_touch_s"] is None:
        return []
    bands = [f"{BANDS[name]}: never" if row is None else
             f"{BANDS[name]} ({100.0 * row['share']:.0f} % of the run, from "
             f"{row['after_touch_s']:.2g} s after the touch) off by at most "
             f"{row['worst_error']:.3g} N, at most {row['worst_ratio']:.3g} of the certified band "
             f"of its instant: {row['at']['error']:.3g} of {row['at']['bound']:.3g} N at "
             f"{row['at']['time_s']:.2f} s" for name, row in contact.get("force_bands", {}).items()]
    departed = [f"NOT OF ITS CLASS: contact.{key} is {row['specified']:.3g}, seen was "
                f"{row['observed']:.3g}" for key, row in contact.get("out_of_class", {}).items()]
    return [f"static force at most {contact['largest_static_force']:.4g} N", *bands, *departed]


def _format_constraints(constraints: dict, title: str = "constraint") -> list[str]:
    width = max(14, *(len(name) + 1 for name in constraints)) if constraints else 14
    rows = [f"{title:<{width}}{'limit':>11}{'worst':>11}{'margin':>11}"]
    for name, row in constraints.items():
        mark = "  VIOLATED" if is_violated(row) else ""
        numbers = "".join(
            f"{np.nan if row[key] is None else row[key]:>11.4g}"
            for key in ("limit", "worst", "margin"))
        rows.append(f"{name:<{width}}{numbers}  {row['unit']}{mark}".rstrip())
    return rows


def _format_thrusters(rows: dict[str, dict[str, float]]) -> list[str]:
    return [f"{name}: {row['least']:.3g} to {row['largest']:.3g} N of {row['lower']:.4g} to "
            f"{row['upper']:.4g} N, {row['rms']:.3g} N rms, at a limit "
            f"{100.0 * row['at_limit']:.2g} % of the time" for name, row in rows.items()]


def _format_mission(mission: dict[str, Any]) -> list[str]:
    """Returns the table of the steps; empty without a mission."""
    if not mission:
        return []
    when = "" if mission["over_s"] is None else f" after {mission['over_s']:.1f} s"
    left = f", {mission['not_begun']} steps not begun" if mission["not_begun"] else ""
    heads = ("".join(f"{cell:>8}" for cell in row) for row in zip(
        *(column[1:4] for column in MISSION_COLUMNS), strict=True))
    lines = [f"{mission['outcome']}{when}, {mission['failures']} steps failed{left}",
             *(f"{'':<11}{head}" for head in heads)]
    for row in mission["steps"]:
        cells = [f"{'-' if row[key] is None else format(factor * row[key], spec):>8}"
                 for key, _, _, _, factor, spec in MISSION_COLUMNS if key in row]
        lines.append(f"{row['step']:>2} {row['kind']:<8}{''.join(cells):<96}  {row['ended']}")
    return ["", *_block("mission", lines)]


def _format_disturbance(disturbance: dict) -> list[str]:
    axes, exceeded = disturbance["semi_axes"], disturbance["exceeded"]
    norm = "" if axes is None else " in the norm of the ellipsoid of semi-axes " + ", ".join(
        f"{each:.3g}" for each in axes)
    return [f"{disturbance['worst']:.4g} at most with the part that the controller does not know "
            f"({disturbance['applied']:.4g} applied)",
            "no bound is declared" if exceeded is None else
            f"bound {disturbance['bound']:.4g} [{disturbance['unit']}]{norm}"
            + (f", exceeded {exceeded} times" if exceeded else "")]


def _format_certified(summary: dict) -> list[str]:
    """Returns the kind of certificate that the run has, and the scope of a worst-case one."""
    claim = summary["in_probability"]
    if claim is not None:
        kind = claim["verdict"].removeprefix("certified ")
        return [f"{kind} ({claim['failures']} of {claim['runs']} drawn runs failed)",
                *claim["outside"]]
    scope = scope_of([Assumption(**each) for each in summary["assumptions"]])
    return ["yes, for" if summary["tube"]["certified"] else "no (declared tube)",
            *(f"{about}: {statement}" for about, statement in scope.items())]


def _format_tube(tube: dict) -> list[str]:
    """Returns further lines of the tube: law, sizes, bound along the run, exits."""
    error, first = tube["error"], tube["first_exit_s"]
    if tube["worst_e"] is None:
        return [f"law {tube['law']}; not watched: the robot hovered until the end"]
    along, since = tube["worst_ratio"]["trajectory"], "" if first is None else (
        f" (first at {first:.2f} s)")
    exits = [f"{tube['exits']} set-wise{since}"] * bool(tube["exits"]) + [
        f"{tube['exits_along_the_run']} along the run"] * bool(tube["exits_along_the_run"])
    return [
        f"law {tube['law']}; |{error} - {error}_nominal| {1e3 * tube['worst_e']:.3g} mm, mrad "
        f"(bound {1e3 * tube['bound_e']:.3g}),",
        f"|zeta - zeta_nominal| {1e3 * tube['worst_z']:.3g} mm/s, mrad/s "
        f"(bound {1e3 * tube['bound_z']:.3g})",
        *([f"{100.0 * along:.3g} % of the bound along the run"] if along is not None else []),
        *([f"exits: {', '.join(exits)}"] if exits else [])]


def _format_events(events: list[dict], full: bool) -> list[str]:
    """Returns the lines of the events: alarms, others, kept plans, each in order of time."""
    ordered = sorted(events, key=lambda event: (event["kind"] not in ALARMING,
                                                event["kind"] == "plan_kept"))
    shown = ordered if full or len(events) <= EVENT_LINES else ordered[: EVENT_LINES - 1]
    lines = [f"{_span(event):<18}  {event['text']}" for event in shown]
    if len(shown) < len(events):
        lines.append(f"... and {len(events) - len(shown)} more")
    return lines or ["none"]


def _span(event: dict) -> str:
    """Returns when an event of a summary was."""
    start, end = event["time_s"], event["until_s"]
    if end == start:
        return f"{start:.2f} s"
    return f"{start:.2f} s to " + ("the end" if end is None else f"{end:.2f} s")


def _number(value: float | None, spec: str) -> str:
    return "-" if value is None else format(value, spec)
