"""Results of a campaign: pure functions from its runs to campaign.json and to a table.

They do not depend on machine, time or order of the runs.
"""

import unicodedata
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from uvms_drake.campaign.campaign import Campaign
from uvms_drake.campaign.contact_metrics import (
    PRESS_METRICS,
    broken_promises,
    format_walls,
    summarise_walls,
)
from uvms_drake.campaign.distribution import distribution_of
from uvms_drake.campaign.run import STEP_EDGES_MS

WORST = 10
"""Number of runs listed with the command to replay them."""
MEASURES = {
    "ratio_trajectory": ("deviation over the bound along the run", False),
    "ratio_set": ("deviation over the set-wise bound", False),
    "worst_disturbance": ("whole disturbance over d̃", False),
    "induced": ("of that, by model errors and water", False),
    "margin": ("smallest margin over its constraint's size", True),
    "force_error": ("force error at the end [N]", False),
    "settling_time_s": ("settling time [s]", False),
}
"""Label of each metric in a table, and whether small is bad."""
COUNTS = ("exits_set", "exits_trajectory", "violations", "mpc_failures")
PROMISES = ("exceptions", "not_finite", "exits_set", "exits_trajectory", "violations", "limited")
"""Counts that must be zero."""
NOT_COVERED = 0.05
"""Largest fraction of runs whose whole disturbance may exceed d̃ unexpectedly."""

Result = Mapping[str, Any]


def summarise_campaign(campaign: Campaign, results: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Returns the content of campaign.json.

    Args:
        campaign: Campaign of the runs.
        results: The `result` of every run, in any order. Inside of the bounds, counts and
            distributions are of the runs whose whole disturbance d̃ covered; the others are only
            counted, under `not_covered`.
    """
    # Runs without an exception, and of these the ones that count.
    results = sorted(results, key=lambda result: result["index"])
    carried = [result for result in results if result["error"] is None]
    done = [result for result in carried if result["inside"]]
    base, walls = campaign.base, summarise_walls(done)
    return {
        "scenario": base.name, "seed": campaign.seed, "runs": len(results),
        "identity": campaign.identity, "certified": campaign.certified,
        "versions": campaign.versions, "duration_s": base.duration,
        "d_bound": base.disturbance.d_bound,
        "force_tolerance": base.task.force_tolerance,
        "counts": {
            "exceptions": len(results) - len(carried),
            "not_finite": sum(not result["finite"] for result in carried),
            "counted": len(done), "not_covered": len(carried) - len(done),
            "limited": sum(result["limited"] for result in done),
            "never_settled": sum(result["settling_time_s"] is None for result in done),
            **{name: sum(result[name] for result in done) for name in COUNTS}},
        "distributions": {name: distribution(done, name) for name in MEASURES},
        "worst_terminal_slack": max((result["terminal_slack"] for result in done
                                     if result["terminal_slack"] is not None), default=None),
        "largest_unknown": _largest_unknown(done),
        "by_disturbance": _grouped(done, lambda result: result["disturbance"]),
        "by_fault": _grouped(done, lambda result: ", ".join(result["faults"]) or "none"),
        **({"walls": walls} if walls else {}),
        "worst": [_replay(result) for result in sorted(results, key=_badness)[:WORST]],
        "results": results,
    }


def distribution(results: Sequence[Result], name: str) -> dict[str, Any]:
    """Returns the distribution of a metric; see `distribution_of`."""
    return distribution_of([result[name] for result in results],
                           [result["index"] for result in results],
                           small_is_bad=MEASURES[name][1])


def _largest_unknown(results: Sequence[Result]) -> dict[str, float]:
    """Returns the largest error of every quantity among runs."""
    names = results[0]["unknown"] if results else ()
    return {name: max(abs(result["unknown"][name]) for result in results) for name in names}


def _grouped(results: Sequence[Result], key: Any) -> dict[str, dict[str, Any]]:
    """Returns the number of runs and their worst metrics, by kind; None is no kind."""
    out = {}
    for kind in sorted({key(result) for result in results} - {None}):
        of_kind = [result for result in results if key(result) == kind]
        out[kind] = {
            "runs": len(of_kind),
            **{name: distribution(of_kind, name)["max"]
               for name in ("worst_disturbance", "ratio_trajectory", "ratio_set")},
        }
    return out


def _badness(result: Result) -> tuple[float, ...]:
    """Returns a sort key, worst first: exception, broken guarantee, largest deviation.

    Inside of the bounds leaving the tube, violating or saturating a limit breaks a guarantee too.
    A run whose disturbance exceeded d̃ comes last.
    """
    index = result["index"]
    if result["error"] is not None:
        return (-2.0, 0.0, index)
    far = -(result["ratio_set"] or 0.0)
    if result["finite"] and not result["inside"]:
        return (1.0, far, index)
    broken = not result["finite"] or bool(
        result["exits_set"] + result["exits_trajectory"] + result["violations"]
        + result["limited"] + len(broken_promises(result)))
    return (-float(broken), far, index)


def _replay(result: Result) -> dict[str, Any]:
    shown = ("index", "error", "disturbance", "rows", "faults", "desired_force",
             "ratio_trajectory", "ratio_set", "margin", "constraint")
    return {**{name: result.get(name) for name in shown},
            "replay": f"uvms-drake campaign --output . --replay {result['index']}"}


def all_well(summary: Mapping[str, Any]) -> bool:
    """Returns whether every guarantee was kept in every run, and nearly all runs were counted."""
    counts = summary["counts"]
    if counts["not_covered"] > NOT_COVERED * summary["runs"]:
        return False
    if any(summary.get("walls", {}).get("broken", {}).values()):
        return False
    return not any(counts[name] for name in PROMISES)


def summarise_times(runs: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Returns the content of timing.json: times of a run [s], its slowest MPC step [ms], all steps.

    `step_ms` are the quantiles of all steps, each the upper edge of its bin, and `steps` counts the
    steps between the `edges_ms`.
    """
    out: dict[str, Any] = {"runs": len(runs)}
    for name in ("seconds", "worst_step_ms"):
        values = [run[name] for run in runs if run[name] is not None]
        out[name] = {"median": float(np.median(values)), "p95": float(np.percentile(values, 95)),
                     "max": float(np.max(values))} if values else None
    steps = np.zeros(len(STEP_EDGES_MS) - 1, dtype=int)
    for run in runs:
        for i, count in run["steps"].items():
            steps[int(i)] += count
    share = np.cumsum(steps) / max(int(np.sum(steps)), 1)
    out["step_ms"] = {f"p{q:g}": float(STEP_EDGES_MS[1 + int(np.searchsorted(share, q / 100.0))])
                      for q in (50.0, 95.0, 99.0)} if np.any(steps) else None
    return {**out, "edges_ms": STEP_EDGES_MS.tolist(), "steps": steps.tolist()}


def format_campaign(summary: Mapping[str, Any], times: Mapping[str, Any], folder: str) -> str:
    """Returns the campaign as a table for a terminal."""
    most = "at most " if summary.get("walls") else ""
    lines = [f"{summary['scenario']}, seed {summary['seed']}: {summary['runs']} runs of {most}"
             f"{summary['duration_s']:g} s, tube "
             + ("certified" if summary["certified"] else "declared, not certified"), "",
             *_format_measures(summary), "", *_format_groups(summary), "",
             *format_walls(summary.get("walls", {})), *_format_counts(summary)]
    if times["seconds"] is not None:
        step = times["step_ms"]
        lines.append(f"a run took {times['seconds']['median']:.2f} s in the median"
                     + ("" if step is None else f", a step of the MPC {step['p50']:.3g} ms, "
                        f"{step['p99']:.3g} ms at the 99th percentile"))
    return "\n".join([*lines, *_format_worst(summary, folder)])


def _format_measures(summary: Mapping[str, Any]) -> list[str]:
    lines = [f"{'':<46}{'min':>9}{'median':>9}{'worst 5 %':>11}{'max':>9}{'worst run':>11}"]
    walls = summary.get("walls", {}).get("distributions", {})
    for name, (text, small_is_bad) in {
            **MEASURES, **{name: (PRESS_METRICS[name], False) for name in walls}}.items():
        row = (summary["distributions"] | walls)[name]
        tail = row["p5" if small_is_bad else "p95"]
        lines.append(_padded(text, 46) + "".join(
            f"{_number(value):>{width}}" for value, width in zip(
                (row["min"], row["median"], tail, row["max"]), (9, 9, 11, 9), strict=True))
            + f"{'-' if row['worst'] is None else row['worst']:>11}")
    return lines


def _format_groups(summary: Mapping[str, Any]) -> list[str]:
    """Returns a table by kind of event outside of the bounds, or by disturbance and by fault."""
    lines = []
    for title, name in (("disturbance", "by_disturbance"), ("samples that fail", "by_fault")):
        lines.append(f"{title:<24}{'runs':>5}{'along the run':>15}{'set-wise':>10}")
        lines += [f"{kind:<24}{row['runs']:>5}{_number(row['ratio_trajectory']):>15}"
                  f"{_number(row['ratio_set']):>10}" for kind, row in summary[name].items()]
    return lines


def _format_counts(summary: Mapping[str, Any]) -> list[str]:
    counts = summary["counts"]
    lines = [f"counted {counts['counted']} of {summary['runs']} runs",
             f"exits: {counts['exits_set']} set-wise, {counts['exits_trajectory']} along the run; "
             f"constraint violations: {counts['violations']}; command cut in {counts['limited']} "
             f"runs; exceptions: {counts['exceptions']}; not finite: {counts['not_finite']}",
             f"failed solves: {counts['mpc_failures']}; force never settled: "
             f"{counts['never_settled']}; terminal set missed by "
             f"{_number(summary['worst_terminal_slack'])} at most"]
    unknown = {name: value for name, value in summary["largest_unknown"].items() if value > 0.0}
    if unknown:
        lines.append("largest errors: " + ", ".join(
            _amount(name, value) for name, value in unknown.items()))
    if counts["not_covered"]:
        lines.append("not counted, because the whole disturbance exceeded d̃: "
                     f"{counts['not_covered']}")
    return lines


def _padded(text: str, width: int) -> str:
    """Returns the text padded on the right; combining marks have no width."""
    return text + " " * (width - sum(not unicodedata.combining(letter) for letter in text))


_UNITS = {"shift": (1e3, "mm"), "turn": (1e3, "mrad"), "current": (1.0, "m/s"),
          "payload": (1.0, "kg")}


def _amount(name: str, value: float) -> str:
    factor, unit = _UNITS.get(name, (100.0, "%"))
    return f"{name.replace('_', ' ')} {factor * value:.2g} {unit}"


def _format_worst(summary: Mapping[str, Any], folder: str) -> list[str]:
    lines = ["", f"{'worst runs':<12}{'disturbance':<18}{'':<24}{'along the run':>14}"
             f"{'set-wise':>10}{'margin':>9}"]
    for run in summary["worst"]:
        if run["error"] is not None:
            lines.append(f"{run['index']:<12}{run['error']}")
            continue
        also = ", ".join(run["faults"])
        lines.append(f"{run['index']:<12}{run['disturbance']:<18}{also:<24}"
                     f"{_number(run['ratio_trajectory']):>14}{_number(run['ratio_set']):>10}"
                     f"{_number(run['margin']):>9} {run['constraint']}")
    return [*lines, f"replay one: uvms-drake campaign --output {folder} --replay "
            f"{summary['worst'][0]['index']}"] if summary["worst"] else []


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"
