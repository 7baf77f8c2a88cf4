"""Results of a campaign: pure functions from its runs to campaign.json and to a table.

They do not depend on machine, time or order of the runs.
"""

import unicodedata
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from uvms_drake.campaign.campaign import Campaign
from uvms_drake.report.metrics import WALL_SECONDS

WORST = 10
"""Number of runs listed with the command to replay them."""
SOON = 5.0
"""Time after the first touch in which the force should settle [s]."""
MEASURES = {
    "ratio_trajectory": "deviation over the bound along the run",
    "ratio_set": "deviation over the set-wise bound",
    "worst_disturbance": "whole disturbance over d̃",
    "induced": "of that, by model errors and water",
    "margin": "smallest margin over its constraint's size",
    "force_error": "force error at the end [N]",
    "settling_time_s": "settling time [s]",
}
"""Labels of the metrics in a table; only of `SMALL_IS_BAD` the smallest is the worst."""
WALL_MEASURES = {
    "static": "largest static force over the largest allowed",
    "peak": "largest force in motion over the largest allowed",
    "first_touch_s": "first touch [s]",
    "settled_s": "from the first touch to within tolerance [s]",
    "error": f"force error, mean of the last {WALL_SECONDS:g} s [N]",
}
"""Labels of the metrics of unknown walls."""
SMALL_IS_BAD = "margin"
COUNTS = ("exits_set", "exits_trajectory", "violations", "mpc_failures")
PROMISED = ("exits_set", "exits_trajectory", "violations", "limited")
OF_CLASS = ("left", "exits_bands", "mpc_failures")
"""Counts of a run that must be zero, or lists that must be empty: on any wall, and on one of the
class."""
BROKEN = ("static", "peak", "no_plan")
"""Guarantees for a wall of the class that a run may break: the largest force at rest and in motion,
and a plan at every sample."""
NOT_COVERED = 0.05
"""Largest fraction of runs whose whole disturbance may exceed d̃ unexpectedly."""

Result = Mapping[str, Any]
Results = Sequence[Result]


def summarise_campaign(campaign: Campaign, results: Results) -> dict[str, Any]:
    """Returns the content of campaign.json.

    Args:
        campaign: Campaign of the runs.
        results: The result of every run without its times, in any order. Counts and distributions
            are of the runs whose whole disturbance d̃ covered; the others are only counted, under
            `not_covered`.
    """
    # Runs without an exception, and of these the ones that count.
    results = sorted(results, key=lambda result: result["index"])
    carried = [result for result in results if result["error"] is None]
    done = [result for result in carried if result["inside"]]
    base, walls = campaign.base, summarise_walls(done)
    slack = [result["terminal_slack"] for result in done if result["terminal_slack"] is not None]
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
            "rows_left": sum(bool(result["left"]) for result in done),
            "exits_bands": sum(result["exits_bands"] for result in done),
            "retreated": sum(result["retreated_s"] is not None for result in done),
            "never_settled": sum(result["settling_time_s"] is None for result in done),
            **{name: sum(result[name] for result in done) for name in COUNTS}},
        "distributions": {name: distribution(done, name) for name in MEASURES},
        "worst_terminal_slack": max(slack, default=None),
        "largest_unknown": {
            name: max(abs(result["unknown"][name]) for result in done)
            for name in (done[0]["unknown"] if done else ())},
        "by_disturbance": _grouped(done, lambda result: result["disturbance"]),
        "by_fault": _grouped(done, lambda result: ", ".join(result["faults"]) or "none"),
        **({"walls": walls} if walls else {}),
        "worst": [_replay(result) for result in sorted(results, key=_badness)[:WORST]],
        "results": results,
    }


def distribution(results: Results, name: str) -> dict[str, Any]:
    """Returns minimum, median, 95th percentile and maximum of a metric, and the worst run.

    If small is bad the percentile is the 5th, under the name `p5`. A run may have none of it.
    """
    known = [(result[name], result["index"]) for result in results if result[name] is not None]
    small = name == SMALL_IS_BAD
    tail = "p5" if small else "p95"
    if not known:
        return {"count": 0, "min": None, "median": None, tail: None, "max": None, "worst": None}
    values = np.array([value for value, _ in known], dtype=float)
    worst = int(np.argmin(values) if small else np.argmax(values))
    return {"count": len(known), "min": float(values.min()), "median": float(np.median(values)),
            tail: float(np.percentile(values, 5.0 if small else 95.0)),
            "max": float(values.max()), "worst": known[worst][1]}


def summarise_walls(results: Results) -> dict[str, Any]:
    """Returns the `walls` of campaign.json; empty if the controller knew the surfaces.

    Runs are named by their indices: under `broken` those that broke a guarantee, under
    `not_in_class` those without one. `kinds` is by shape and by law.
    """
    results = [result for result in results if "wall" in result]
    if not results:
        return {}
    walls = [{**result["wall"], "index": result["index"]} for result in results]
    settled = [wall["settled_s"] for wall in walls if wall["settled_s"] is not None]
    return {
        "runs": len(results),
        "distributions": {name: distribution(walls, name) for name in WALL_MEASURES},
        "broken": {name: [each["index"] for each in results if name in broken_promises(each)]
                   for name in BROKEN},
        "not_in_class": [wall["index"] for wall in walls if not wall["in_class"]],
        "touched": sum(wall["first_touch_s"] is not None for wall in walls),
        "settled": len(settled), "settled_soon": sum(each <= SOON for each in settled),
        "lost": sum(wall["losses"] > 0 for wall in walls),
        "kinds": {f"{name}: {kind}": _of_kind([wall for wall in walls if wall[name] == kind])
                  for name in ("shape", "law") for kind in sorted({wall[name] for wall in walls})},
    }


def broken_promises(result: Result) -> set[str]:
    """Returns the subset of `BROKEN` that applies to a run, if its wall is of the class."""
    wall = result.get("wall")
    if wall is None or not wall["in_class"]:
        return set()
    did = (wall["static"] > 1.0, wall["peak"] > 1.0, result["mpc_failures"] > 0)
    return {name for name, done in zip(BROKEN, did, strict=True) if done}


def _of_kind(walls: Results) -> dict[str, Any]:
    return {"runs": len(walls),
            **{name: max(wall[name] for wall in walls) for name in ("static", "peak", "error")},
            "settled": sum(wall["settled_s"] is not None for wall in walls)}


def _grouped(results: Results, key: Callable[[Result], str]) -> dict[str, dict[str, Any]]:
    """Returns the number of runs and their worst metrics, by kind."""
    kinds: dict[str, list[Result]] = {}
    for result in sorted(results, key=key):
        kinds.setdefault(key(result), []).append(result)
    return {kind: {"runs": len(among), **{
        name: distribution(among, name)["max"]
        for name in ("worst_disturbance", "ratio_trajectory", "ratio_set")}}
        for kind, among in kinds.items()}


def is_broken(result: Result) -> bool:
    """Returns whether a run broke a guarantee; all but two are for a disturbance within d̃.

    A supervisor's retreat is one: inside of its class it is silent.
    """
    if result["error"] is not None or not result["finite"]:
        return True
    promised = PROMISED + OF_CLASS * result.get("wall", {}).get("in_class", True)
    return bool(result["inside"]) and bool(
        any(result[name] for name in promised) or broken_promises(result)
        or result["retreated_s"] is not None)


def _badness(result: Result) -> tuple[float, ...]:
    """Returns a sort key, worst first: exception, broken guarantee, largest deviation.

    A run whose disturbance exceeded d̃ comes last.
    """
    if result["error"] is not None:
        return (-2.0, 0.0, result["index"])
    rank = -1.0 if is_broken(result) else 0.0 if result["inside"] else 1.0
    return (rank, -(result["ratio_set"] or 0.0), result["index"])


def _replay(result: Result) -> dict[str, Any]:
    shown = ("index", "error", "disturbance", "rows", "faults", "desired_force",
             "ratio_trajectory", "ratio_set", "margin", "constraint")
    return {**{name: result.get(name) for name in shown},
            "replay": f"uvms-drake campaign --output . --replay {result['index']}"}


def all_well(summary: Mapping[str, Any]) -> bool:
    """Returns whether every guarantee was kept in every run, and nearly all runs were counted."""
    return (summary["counts"]["not_covered"] <= NOT_COVERED * summary["runs"]
            and not any(map(is_broken, summary["results"])))


def summarise_times(runs: Results) -> dict[str, Any]:
    """Returns the content of timing.json: statistics of the times of runs, and of an MPC's steps.

    Args:
        runs: `times` of the results: `seconds`, and median and longest of a run's steps [ms].
    """
    out: dict[str, Any] = {"runs": len(runs)}
    for name in ("seconds", "step_ms", "worst_step_ms"):
        values = [run[name] for run in runs if run[name] is not None]
        out[name] = {"median": float(np.median(values)), "p95": float(np.percentile(values, 95)),
                     "max": float(np.max(values))} if values else None
    return out


def format_campaign(summary: Mapping[str, Any], times: Mapping[str, Any], folder: str) -> str:
    """Returns the campaign as a table for a terminal."""
    walls, step = summary.get("walls", {}), times["step_ms"]
    lines = [f"{summary['scenario']}, seed {summary['seed']}: {summary['runs']} runs of "
             f"{'at most ' if walls else ''}{summary['duration_s']:g} s, tube "
             + ("certified" if summary["certified"] else "declared, not certified"), "",
             *_format_measures(summary["distributions"] | walls.get("distributions", {})), "",
             *_format_groups(summary), "", *_format_walls(walls), *_format_counts(summary)]
    if times["seconds"] is not None:
        lines.append(f"a run took {times['seconds']['median']:.2f} s in the median"
                     + ("" if step is None else f", a step of the MPC {step['median']:.3g} ms, "
                        f"{times['worst_step_ms']['max']:.3g} ms at most"))
    return "\n".join([*lines, *_format_worst(summary["worst"], folder)])


def _format_measures(distributions: Mapping[str, Any]) -> list[str]:
    lines = [f"{'':<46}{'min':>9}{'median':>9}{'worst 5 %':>11}{'max':>9}{'worst run':>11}"]
    for name, row in distributions.items():
        values = (row["min"], row["median"], row["p5" if name == SMALL_IS_BAD else "p95"],
                  row["max"])
        lines.append(_padded((MEASURES | WALL_MEASURES)[name], 46) + "".join(
            f"{_number(value):>{width}}" for value, width in zip(
                values, (9, 9, 11, 9), strict=True))
            + f"{'-' if row['worst'] is None else row['worst']:>11}")
    return lines


def _format_groups(summary: Mapping[str, Any]) -> list[str]:
    lines = []
    for title, name in (("disturbance", "by_disturbance"), ("samples that fail", "by_fault")):
        lines.append(f"{title:<24}{'runs':>5}{'along the run':>15}{'set-wise':>10}")
        lines += [f"{kind:<24}{row['runs']:>5}{_number(row['ratio_trajectory']):>15}"
                  f"{_number(row['ratio_set']):>10}" for kind, row in summary[name].items()]
    return lines


def _format_walls(walls: Result) -> list[str]:
    if not walls:
        return []
    lines = [f"{'wall, worst':<24}{'runs':>5}{'static':>9}{'in motion':>11}{'error [N]':>11}"
             f"{'settled':>9}"]
    lines += [f"{kind:<24}{row['runs']:>5}{row['static']:>9.3f}{row['peak']:>11.3f}"
              f"{row['error']:>11.3g}{row['settled']:>9}" for kind, row in walls["kinds"].items()]
    static, peak, no_plan = (_named(walls["broken"][name]) for name in BROKEN)
    return [
        *lines, "",
        f"walls pressed harder than allowed: {static} at rest, {peak} in motion; without a plan: "
        f"{no_plan}; touched where they are not of the class: {_named(walls['not_in_class'])}",
        f"touched: {walls['touched']} of {walls['runs']} walls, force settled: {walls['settled']}, "
        f"within {SOON:g} s of the touch: {walls['settled_soon']}; wall left again: "
        f"{walls['lost']}", ""]


def _format_counts(summary: Mapping[str, Any]) -> list[str]:
    counts = summary["counts"]
    slack = _number(summary["worst_terminal_slack"])
    lines = [f"counted {counts['counted']} of {summary['runs']} runs",
             f"exits: {counts['exits_set']} set-wise, {counts['exits_trajectory']} along the run, "
             f"{counts['exits_bands']} of force bands; radii left in {counts['rows_left']} runs; "
             f"constraint violations: {counts['violations']}; command cut in {counts['limited']} "
             f"runs; exceptions: {counts['exceptions']}; not finite: {counts['not_finite']}",
             f"failed solves: {counts['mpc_failures']}; force never settled: "
             f"{counts['never_settled']}; retreats of the supervisor: {counts['retreated']}; "
             f"terminal set missed by {slack} at most"]
    unknown = {name: value for name, value in summary["largest_unknown"].items() if value > 0.0}
    if unknown:
        lines.append("largest errors: " + ", ".join(
            _amount(name, value) for name, value in unknown.items()))
    if counts["not_covered"]:
        lines.append("not counted, because the whole disturbance exceeded d̃: "
                     f"{counts['not_covered']}")
    return lines


def _format_worst(worst: Results, folder: str) -> list[str]:
    if not worst:
        return []
    lines = ["", f"{'worst runs':<12}{'disturbance':<18}{'':<24}{'along the run':>14}"
             f"{'set-wise':>10}{'margin':>9}"]
    for run in worst:
        lines.append(f"{run['index']:<12}" + (
            run["error"] if run["error"] is not None else
            f"{run['disturbance']:<18}{', '.join(run['faults']):<24}"
            f"{_number(run['ratio_trajectory']):>14}{_number(run['ratio_set']):>10}"
            f"{_number(run['margin']):>9} {run['constraint']}"))
    return [*lines, f"replay one: uvms-drake campaign --output {folder} --replay "
            f"{worst[0]['index']}"]


def _named(indices: Sequence[int]) -> str:
    return f"{len(indices)}" + (f" (runs {', '.join(map(str, indices))})" if indices else "")


def _padded(text: str, width: int) -> str:
    """Returns the text padded on the right; combining marks have no width."""
    return text + " " * (width - sum(not unicodedata.combining(letter) for letter in text))


def _amount(name: str, value: float) -> str:
    unit = {"current": "m/s", "payload": "kg"}.get(name, "%")
    return f"{name.replace('_', ' ')} {(100.0 if unit == '%' else 1.0) * value:.2g} {unit}"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"
