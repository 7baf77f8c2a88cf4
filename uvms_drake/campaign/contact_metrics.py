"""Statistics of pressing unknown surfaces in a campaign."""

from collections.abc import Mapping, Sequence
from typing import Any

from uvms_drake.campaign.distribution import distribution_of
from uvms_drake.report.wall_metrics import LAST_SECONDS

SOON = 5.0
"""Time after the first touch in which the force should settle [s]."""
PRESS_METRICS = {
    "static": "largest static force over the largest allowed",
    "peak": "largest force in motion over the largest allowed",
    "first_touch_s": "first touch [s]",
    "settled_s": "from the first touch to within tolerance [s]",
    "error": f"force error, mean of the last {LAST_SECONDS:g} s [N]",
}
"""Labels of the metrics in a table; large is bad for all of them."""
BROKEN = ("static", "peak", "no_plan")
"""Guarantees for a wall of the class that a run may break: the largest force at rest and in motion,
and a plan at every sample."""

Result = Mapping[str, Any]


def summarise_walls(results: Sequence[Result]) -> dict[str, Any]:
    """Returns the `walls` of campaign.json; empty if the controller knew the surfaces.

    Runs are named by their indices: under `broken` those that broke a guarantee, under
    `not_in_class` those without one. `kinds` is by shape and by law.
    """
    results = [result for result in results if "wall" in result]
    if not results:
        return {}
    walls, indices = [result["wall"] for result in results], [each["index"] for each in results]
    return {
        "runs": len(results),
        "distributions": {name: distribution_of([wall[name] for wall in walls], indices)
                          for name in PRESS_METRICS},
        "broken": {name: [each["index"] for each in results if name in broken_promises(each)]
                   for name in BROKEN},
        "not_in_class": [each["index"] for each in results if not each["wall"]["in_class"]],
        "touched": sum(wall["first_touch_s"] is not None for wall in walls),
        "settled": sum(wall["settled_s"] is not None for wall in walls),
        "settled_soon": sum(wall["settled_s"] is not None and wall["settled_s"] <= SOON
                            for wall in walls),
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


def _of_kind(walls: Sequence[Result]) -> dict[str, Any]:
    return {"runs": len(walls),
            **{name: max(wall[name] for wall in walls) for name in ("static", "peak", "error")},
            "settled": sum(wall["settled_s"] is not None for wall in walls)}


def format_walls(walls: Result) -> list[str]:
    """Returns the lines of a table of `summarise_walls`, without its distributions."""
    if not walls:
        return []
    runs = walls["runs"]
    lines = [f"{'wall, worst':<24}{'runs':>5}{'static':>9}{'in motion':>11}{'error [N]':>11}"
             f"{'settled':>9}"]
    lines += [f"{kind:<24}{row['runs']:>5}{row['static']:>9.3f}{row['peak']:>11.3f}"
              f"{row['error']:>11.3g}{row['settled']:>9}" for kind, row in walls["kinds"].items()]
    static, peak, no_plan = (_runs(walls["broken"][name]) for name in BROKEN)
    return [
        *lines, "",
        f"walls pressed harder than allowed: {static} at rest, {peak} in motion; without a plan: "
        f"{no_plan}; touched where they are not of the class: {_runs(walls['not_in_class'])}",
        f"touched: {walls['touched']} of {runs} walls, force settled: {walls['settled']}, within "
        f"{SOON:g} s of the touch: {walls['settled_soon']}; wall left again: {walls['lost']}", ""]


def _runs(indices: Sequence[int]) -> str:
    return f"{len(indices)}" + (f" (runs {', '.join(map(str, indices))})" if indices else "")
