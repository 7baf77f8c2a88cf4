"""Medians and worst of the benchmark's runs, as data and as tables in Markdown."""

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any

import numpy as np

from uvms_drake.benchmark.cases import AFTER, CASES, ROBOTS
from uvms_drake.benchmark.controllers import TUBE, declared_to

Result = dict[str, Any]
METRICS = ("force_rms", "peak", "above", "off", "beyond", "impact", "settling", "touch", "lateral",
           "lost", "saturated", "chatter", "energy", "step_ms", "worst_step_ms", "exits")
"""Metrics with a median and a worst."""
OVERALL = (
    ("time to the touch [s]", "touch", 1.0), ("lateral error [mm]", "lateral", 1e3),
    ("peak within 1 s of the touch [N]", "impact", 1.0),
    ("contacts lost", "lost", 1.0), ("time saturated [%]", "saturated", 100.0),
    ("variation of a command over its largest [1/s]", "chatter", 1.0),
    ("energy [J]", "energy", 1.0),
    ("processor time of a step [ms]", "step_ms", 1.0),
    ("of the longest step [ms]", "worst_step_ms", 1.0),
    ("exits of funnels", "exits", 1.0))
"""Rows of the table over all cases: text, metric and factor of the unit."""
JUDGED = {"force_rms": "rms of the force's error", "peak": "peak", "settling": "settling time"}
"""Metrics by which a row is lost."""
OUTSIDE = {"peak": "peak", "above": "time above the declared force",
           "off": "distance off the way back", "beyond": "joints beyond their range"}
"""Metrics of the cases outside of the declared class, in which no force is held."""
CLOSE = 1.1
"""Factor within which two medians count as equal."""
NEVER = "–"


def summarise(results: Sequence[Result]) -> dict[str, Any]:
    """Returns the contents of benchmark.json: every controller's cells by robot and case.

    A cell has the median and the worst of each metric over its runs; a run that failed, ended early
    or never settled has an infinite force error and settling time, so that the median has it too.
    Outside of the class, one that failed or did not press before its event is infinite in all of
    `OUTSIDE`.
    """
    controllers, robots, cases = (list(dict.fromkeys(result[key] for result in results))
                                  for key in ("controller", "robot", "case"))
    cells = {robot: {case: {name: _cell([
        result for result in results
        if (result["robot"], result["case"], result["controller"]) == (robot, case, name)])
        for name in controllers} for case in cases} for robot in robots}
    return {
        "controllers": controllers, "robots": robots, "cases": cases,
        "runs": len(results), "draws": len({result["index"] for result in results}),
        "seed": results[0]["seed"],
        "desired": {each["robot"]: each["desired"] for each in results if "desired" in each},
        "declared": {name: declared_to(name, next(iter(ROBOTS))) for name in controllers},
        "cells": cells,
        "better_than_tube": [row for robot in robots for case in cases
                             for row in _better(robot, case, cells[robot][case])],
        "errors": [f"{r['robot']}, {r['case']}, {r['controller']}, draw {r['index']}: "
                   f"{r['error'] or r['ended']}" for r in results if r["error"] or r.get("ended")],
    }


def _cell(runs: Sequence[Result]) -> Result:
    if not runs:
        return {"runs": 0}
    out: Result = {"runs": len(runs), "failed": sum(
        run["error"] is not None or run.get("ended") is not None for run in runs)}
    outside = CASES[runs[0]["case"]].outside
    for name in METRICS:
        none = np.inf if name in (OUTSIDE if outside else ("force_rms", "settling")) else None
        values = [none if run.get(name) is None or (outside and _never_tried(run)) else run[name]
                  for run in runs]
        known = [value for value in values if value is not None]
        out[name] = _numbers(known, known) if known else None
    return out | {"limits": _worst([run.get("limits", {}) for run in runs]),
                  "broken": sum(bool(run.get("limits")) for run in runs)}


def _never_tried(run: Result) -> bool:
    """Returns whether a run outside of the class failed, or did not press before its event."""
    event, touch = run.get("event"), run.get("touch")
    return bool(run["error"] or run.get("ended") or touch is None
                or (event is not None and touch > event))


def _numbers(medians: Sequence[float], worst: Sequence[float], scale: float = 1.0
             ) -> dict[str, float]:
    return {"median": scale * float(np.median(medians)), "worst": scale * float(np.max(worst))}


def _worst(limits: Sequence[dict[str, float]]) -> dict[str, float]:
    """Returns the largest excess of each limit that is broken in any of several runs or cells."""
    return {name: max(each.get(name, 0.0) for each in limits)
            for name in dict.fromkeys(name for each in limits for name in each)}


def _better(robot: str, case: str, cells: dict[str, Result]) -> list[Result]:
    """Returns the metrics of a case by which the best other controller beats the tube MPC.

    A controller whose force never settles does not count, where there is a force to hold.
    """
    out: list[Result] = []
    if not cells.get(TUBE, {}).get("runs"):
        return out
    outside = CASES[case].outside
    for metric in OUTSIDE if outside else JUDGED:
        others = {name: cell[metric]["median"] for name, cell in cells.items()
                  if name != TUBE and cell["runs"] and cell[metric] is not None
                  and (outside or np.isfinite(cell["settling"]["median"]))}
        own = cells[TUBE][metric]
        if not others or own is None:
            continue
        best = min(others, key=lambda name: others[name])
        if others[best] * CLOSE < own["median"]:
            out.append({"robot": robot, "case": case, "metric": metric, "by": best,
                        "other": others[best], "own": own["median"]})
    return out


def format_benchmark(summary: dict[str, Any]) -> str:
    """Returns the tables in Markdown."""
    draws, close = summary["draws"], 100 * (CLOSE - 1)
    lines = [
        f"{summary['runs']} runs, at most {draws} draw{'s' * (draws > 1)} of each case "
        f"(seed {summary['seed']}), the same for all controllers. A number is a median; the worst "
        "follows in brackets where it differs.", "",
        "## Declared to each controller", "",
        "Besides the measured state and force, and the desired force:", "",
        *_table(["controller", "declared"], [
            [name, ", ".join(facts)] for name, facts in summary["declared"].items()])]
    for robot in summary["robots"]:
        lines += _of_robot(robot, summary["cells"][robot], summary["controllers"])
    lines += ["## Better than the tube MPC", "",
              f"Medians that another controller beats by more than {close:.0f} %.", "",
              *_table(["robot", "case", "metric", "best other", "its median", "tube MPC"], [
                  [row["robot"], row["case"], (JUDGED | OUTSIDE)[row["metric"]], row["by"],
                   _number(row["other"]), _number(row["own"])]
                  for row in summary["better_than_tube"]]), ""]
    if summary["errors"]:
        lines += ["## Runs that failed or ended early", "",
                  *(f"- {text}" for text in summary["errors"]), ""]
    return "\n".join(lines)


def _of_robot(robot: str, cells: dict[str, Any], controllers: Sequence[str]) -> list[str]:
    """Returns a table of all cases of a robot, and one over them."""
    cases = [case for case in cells if any(cell["runs"] for cell in cells[case].values())]

    def over(row: Callable[[list[Result]], str], among: Sequence[str] = cases) -> list[str]:
        """Returns a row over the cells of a controller's own cases."""
        return [row([cells[case][name] for case in among if cells[case][name]["runs"]])
                for name in controllers]

    lines, inside = [f"## {robot}", ""], [case for case in cases if not CASES[case].outside]
    # The force where one is to be held, and safety where there is none.
    if inside:
        lines += [
            "Force: rms of the error over the last 3 s [N] / peak [N] / time from the touch until "
            f"it stays within the tolerance [s]; {NEVER} for not within {AFTER:g} s of the touch "
            f"(soft {AFTER + CASES['soft'].further:g} s, slide {AFTER + CASES['slide'].further:g} "
            "s), at which a run ends, or a run that failed or never touched.", "",
            *_table(["case", *controllers], [
                [f"{case}: {CASES[case].text}", *(_force(cells[case][name], JUDGED)
                                                  for name in controllers)] for case in inside])]
    if len(inside) < len(cases):
        lines += [
            "Outside of the class: peak of the force [N] / time above the declared largest "
            "one [s] / distance of the vehicle off the way straight back, from the event or the "
            "touch on [m] / joints beyond their range [rad].", "",
            *_table(["case", *controllers], [
                [f"{case}: {CASES[case].text}", *(_force(cells[case][name], OUTSIDE)
                                                  for name in controllers)]
                for case in cases if case not in inside])]
    return [
        *lines, "Over each controller's own cases: the median, and the worst in brackets.", "",
        *_table(["", *controllers], [
            *([text, *over(partial(_over, metric, scale))] for text, metric, scale in OVERALL),
            ["runs that ended early", *over(lambda own: str(sum(cell["failed"] for cell in own)))],
            ["runs that broke a limit", *over(_broken)],
            *[["of those within the declared class", *over(_broken, inside)]] * bool(inside),
            ["limits broken, worst excess", *over(_limits)]])]


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    return [f"| {' | '.join(row)} |" for row in (head, ["---"] * len(head), *rows)] + [""]


def _number(value: float) -> str:
    return NEVER if not np.isfinite(value) else f"{value:.3g}"


def _pair(numbers: dict[str, float] | None) -> str:
    if numbers is None:
        return NEVER
    median, worst = (_number(numbers[key]) for key in ("median", "worst"))
    return median if median == worst else f"{median} ({worst})"


def _force(cell: Result, metrics: Iterable[str]) -> str:
    return " / ".join(_pair(cell[name]) for name in metrics) if cell["runs"] else ""


def _over(metric: str, scale: float, own: Sequence[Result]) -> str:
    found = [cell[metric] for cell in own if cell[metric] is not None]
    return _pair(_numbers([each["median"] for each in found], [each["worst"] for each in found],
                          scale)) if found else ""


def _broken(own: Sequence[Result]) -> str:
    return " of ".join(str(sum(cell[key] for cell in own)) for key in ("broken", "runs"))


def _limits(own: Sequence[Result]) -> str:
    worst = _worst([cell["limits"] for cell in own])
    return ", ".join(f"{limit} {excess:.2g}" for limit, excess in worst.items()) or "none"
