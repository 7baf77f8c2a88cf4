"""What a campaign found, in numbers: pure functions from its runs to campaign.json and to a table.

Nothing here depends on where, when or in which order the runs were computed.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from uvms_drake.campaign.setup import Campaign

WORST = 10
"""Runs that are listed with the command to replay them."""
MEASURES = {
    "ratio_trajectory": ("deviation over the bound along the run", False),
    "ratio_set": ("deviation over the set-wise bound", False),
    "margin": ("smallest margin over its constraint's size", True),
    "force_error": ("force error at the end [N]", False),
    "settling_time_s": ("settling time [s]", False),
    "induced": ("disturbance that the model's error induces", False),
}
"""What is summarised: its name in a table, and whether small is bad."""
COUNTS = ("exits_set", "exits_trajectory", "disturbance_excesses", "violations", "mpc_failures")


def summarise_campaign(campaign: Campaign, results: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Returns the content of campaign.json.

    Args:
        campaign: What was run.
        results: The `result` of every run, in any order. What is counted and distributed is that
            of the runs in which d̃ covered all that disturbed; the others are only counted.
    """
    results = sorted(results, key=lambda result: result["index"])
    carried = [result for result in results if result["error"] is None]
    done = [result for result in carried if result["inside"]]
    base = campaign.base
    return {
        "scenario": base.name, "seed": campaign.seed, "runs": len(results),
        "identity": campaign.identity, "certified": campaign.certified,
        "versions": campaign.versions, "duration_s": base.duration,
        "d_bound": base.disturbance.bound, "model_error": campaign.model_error,
        "desired_forces": [target.factor for target in campaign.targets],
        "counts": {
            "exceptions": len(results) - len(carried),
            "not_finite": sum(not result["finite"] for result in carried),
            "outside": len(carried) - len(done),
            "never_settled": sum(result["settling_time_s"] is None for result in done),
            **{name: sum(result[name] for result in done) for name in COUNTS}},
        "distributions": {name: distribution(carried if name == "induced" else done, name)
                          for name in MEASURES},
        "by_disturbance": _by_disturbance(done),
        "worst": [_replay(result) for result in sorted(results, key=_badness)[:WORST]],
        "results": results,
    }


def distribution(results: Sequence[Mapping[str, Any]], name: str) -> dict[str, Any]:
    """Returns minimum, median, 95th percentile and maximum of a measure, and whose the worst is.

    For a measure of which small is bad the percentile is the 5th, under the name `p5`.
    """
    pairs = [(result[name], result["index"]) for result in results if result[name] is not None]
    small_is_bad = MEASURES[name][1]
    tail = "p5" if small_is_bad else "p95"
    if not pairs:
        return {"count": 0, "min": None, "median": None, tail: None, "max": None, "worst": None}
    values = np.array([value for value, _ in pairs], dtype=float)
    worst = int(np.argmin(values) if small_is_bad else np.argmax(values))
    return {"count": len(pairs), "min": float(values.min()), "median": float(np.median(values)),
            tail: float(np.percentile(values, 5.0 if small_is_bad else 95.0)),
            "max": float(values.max()), "worst": pairs[worst][1]}


def _by_disturbance(results: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """Returns the number of runs and the largest ratios, by kind of disturbance."""
    out = {}
    for kind in sorted({result["disturbance"] for result in results}):
        of_kind = [result for result in results if result["disturbance"] == kind]
        out[kind] = {"runs": len(of_kind), **{name: distribution(of_kind, name)["max"]
                                              for name in ("ratio_trajectory", "ratio_set")}}
    return out


def _badness(result: Mapping[str, Any]) -> tuple[float, ...]:
    """Returns a key that sorts the worst runs to the front: raised, left, violated, close."""
    if result["error"] is not None:
        return (-1.0, 0.0, 0.0, 0.0, result["index"])
    left = result["exits_set"] + result["exits_trajectory"] + (not result["finite"])
    return (0.0, -left, -result["violations"], -(result["ratio_set"] or 0.0), result["index"])


def _replay(result: Mapping[str, Any]) -> dict[str, Any]:
    shown = ("index", "error", "disturbance", "rows", "desired_force", "ratio_trajectory",
             "ratio_set", "margin", "constraint")
    return {**{name: result.get(name) for name in shown},
            "replay": f"uvms-drake campaign --output . --replay {result['index']}"}


def all_well(summary: Mapping[str, Any]) -> bool:
    """Returns whether nothing was left, violated or raised in any run."""
    counts = summary["counts"]
    return not any(counts[name] for name in (
        "exceptions", "not_finite", "exits_set", "exits_trajectory", "violations"))


def summarise_wall(walls: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Returns the content of timing.json: of a run [s], and of its slowest MPC step [ms]."""
    out: dict[str, Any] = {"runs": len(walls)}
    for name in ("seconds", "worst_step_ms"):
        values = [wall[name] for wall in walls if wall[name] is not None]
        out[name] = {"median": float(np.median(values)), "p95": float(np.percentile(values, 95)),
                     "max": float(np.max(values))} if values else None
    return out


def format_campaign(summary: Mapping[str, Any], wall: Mapping[str, Any], folder: str) -> str:
    """Returns the campaign as a table for a terminal."""
    counts = summary["counts"]
    lines = [f"{summary['scenario']}, seed {summary['seed']}: {summary['runs']} runs of "
             f"{summary['duration_s']:g} s, tube "
             + ("certified" if summary["certified"] else "declared, not certified"), "",
             f"{'':<46}{'min':>9}{'median':>9}{'5/95 %':>9}{'max':>9}{'worst':>7}"]
    for name, (text, small_is_bad) in MEASURES.items():
        row = summary["distributions"][name]
        tail = "p5" if small_is_bad else "p95"
        lines.append(f"{text:<46}" + "".join(
            f"{_number(row[key]):>9}" for key in ("min", "median", tail, "max"))
            + f"{'-' if row['worst'] is None else row['worst']:>7}")
    lines += ["", f"{'disturbance':<18}{'runs':>6}{'along the run':>15}{'set-wise':>10}"]
    lines += [f"{kind:<18}{row['runs']:>6}{_number(row['ratio_trajectory']):>15}"
              f"{_number(row['ratio_set']):>10}"
              for kind, row in summary["by_disturbance"].items()]
    lines += ["", f"exits: {counts['exits_set']} set-wise, {counts['exits_trajectory']} along the "
              f"run; constraint violations: {counts['violations']}; exceptions: "
              f"{counts['exceptions']}; not finite: {counts['not_finite']}",
              f"MPC failures: {counts['mpc_failures']}; d above its bound: "
              f"{counts['disturbance_excesses']}; force never settled: {counts['never_settled']}"]
    if summary["model_error"] > 0.0:
        induced = summary["distributions"]["induced"]
        lines.append(f"errors of the model of up to {100.0 * summary['model_error']:g} % induced "
                     f"{_number(induced['max'])} at most, of {summary['d_bound']:g}; where it was "
                     f"more than was left, in {counts['outside']} runs, nothing else is counted")
    if wall["seconds"] is not None:
        lines.append(f"a run took {wall['seconds']['median']:.2f} s in the median")
    if summary["worst"]:
        lines.append(f"replay the worst: uvms-drake campaign --output {folder} --replay "
                     f"{summary['worst'][0]['index']}")
    return "\n".join(lines)


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"
