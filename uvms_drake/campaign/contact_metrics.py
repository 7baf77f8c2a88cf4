"""Metrics of pressing unknown surfaces in a campaign, of each run and of all."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from uvms_drake.campaign.distribution import distribution_of
from uvms_drake.mission.law import DONE
from uvms_drake.model.surface import ShapedSurface
from uvms_drake.model.surface.law import check_surface
from uvms_drake.model.surface.unknown_contact import UnknownContact
from uvms_drake.report.mission import OUTCOMES, summarise_mission
from uvms_drake.report.signals import attempts_of, has_mission, settling_index
from uvms_drake.report.summary import summarise_contact
from uvms_drake.station.contact.drawn_mission import ends_of
from uvms_drake.station.contact.drawn_surfaces import across, ball_about, is_member, membership
from uvms_drake.station.problem import true_surface
from uvms_drake.station.record import Record
from uvms_drake.tube.contact.force_ripple import ripple

LAST_SECONDS = 2.0
"""Length of the window at the end over which the force is averaged [s]."""
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


def contact_metrics(record: Record) -> dict[str, Any]:
    """Returns the per-run metrics that add to or replace the default ones; none of a known surface.

    With a declared wall the press metrics as `wall`, and the force error along n in place of
    that of 𝔉: the wall's tilt and its friction exert a force normal to n, where none is desired.
    With a mission its outcome as `mission`, see `mission_metrics`.
    """
    contact = record.scenario.contact.declared_wall()
    if contact is None:
        return {}
    wall = press_metrics(record, contact)
    return {"wall": wall, "force_error": wall["final_error"],
            "settling_time_s": wall["settling_time_s"],
            **({"mission": mission_metrics(record)} if has_mission(record) else {})}


def mission_metrics(record: Record) -> dict[str, Any]:
    """Returns how the mission of a run ended.

    `done` is whether every step of it is; `failures` are the attempts that failed, also of spots
    that were retried, each by kind and reason; `over_s` is when it was over, None if it was not.
    """
    summary, steps = summarise_mission(record), record.scenario.mission.steps
    return {"done": summary["outcome"] == OUTCOMES[DONE], "outcome": summary["outcome"],
            "over_s": summary["over_s"],
            "failures": [f"{type(steps[attempt.step]).__name__} {attempt.step}: {attempt.ended}"
                         for attempt in attempts_of(record) if attempt.ended != "done"]}


def press_metrics(record: Record, contact: UnknownContact) -> dict[str, Any]:
    """Returns the press metrics of a run.

    `static` and `peak` are forces along the wall's own normal, at rest and in motion, over their
    bounds. The others are of the controlled force along n: `settled_s` is the time from the first
    touch to when it stays within the task's tolerance, `losses` the number of losses of contact
    after that, `lateral_error_m` the distance that the tip had to slide along the wall. `in_class`
    is whether the wall is in the class wherever it was touched, `worst_violation` the largest
    violation of a limit by a plan, in the limit's own unit.

    With a mission the desired force is that of every instant, `desired` the largest of a step, and
    losses are those of steps that need a contact; there is no `lateral_error_m`.
    """
    task, surface, summary = record.scenario.task, _surface(record), summarise_contact(record)
    found, mission = membership(surface, contact, *_ends(record)), record.scenario.mission
    # A mission desires a force in some of its steps, a press always the same one.
    desired: Any = task.force_along(contact.direction)
    if mission.steps:
        desired = record.desired_force[:, :3] @ contact.direction
    error = np.abs(record.force[:, :3] @ contact.direction - desired)
    tolerance = task.force_tolerance
    settled, touch = settling_index(error, tolerance), summary["first_touch_s"]
    touching = record.penetration > 0.0
    since = touching[np.argmax(error <= tolerance):] if np.any(error <= tolerance) else touching[:0]
    end = record.time >= record.time[-1] - LAST_SECONDS
    return {
        "shape": type(surface.geometry).__name__, "law": type(surface.law).__name__,
        "stiffness": None if found is None else found.stiffness,
        "angle": None if found is None else found.angle,
        "desired": np.max(desired),
        "static": summary["largest_static_force"] / contact.force,
        "peak": np.max(normal_force(record)) / contact.peak(contact.force, contact.largest_advance),
        "first_touch_s": touch,
        "settled_s": (None if settled is None or touch is None
                      else max(record.time[settled] - touch, 0.0)),
        "settling_time_s": None if settled is None else record.time[settled],
        "error": np.mean(error[end]), "final_error": error[-1],
        "lateral_error_m": None if touch is None or mission.steps else np.linalg.norm(across(
            contact.direction, record.chi[np.argmax(touching), :3] - _ends(record)[1])),
        "losses": (summary["losses"] if mission.steps
                   else np.count_nonzero(np.diff(since.astype(int)) < 0)),
        "in_class": in_class(record, contact),
        "worst_violation": np.max(record.mpc_violation, initial=0.0),
    }


def normal_force(record: Record) -> np.ndarray:
    """Returns the force on the wall along its own normal (T,) [N], without friction."""
    _, into = _surface(record).geometry.depth_and_gradient(record.chi[:, :3])
    force: np.ndarray = np.sum(record.force[:, :3] * into, axis=1) / np.linalg.norm(into, axis=1)
    return force


def in_class(record: Record, contact: UnknownContact) -> bool:
    """Returns whether the wall of a run is in the class wherever the tip touched it.

    The tip has to stay in the ball of proven membership, and the rate of the force normal to n
    within the class's bound; only the time before the first too large force counts.
    """
    surface, ends = _surface(record), _ends(record)
    center, reach = ball_about(surface.anchor, contact, surface.law, *ends)
    hard = surface.static_force(record.chi) > contact.force
    allowed = slice(int(np.argmax(hard)) if np.any(hard) else len(hard))
    touching = record.penetration[allowed] > 0.0
    far = np.linalg.norm(record.chi[allowed, :3] - center, axis=1) > reach
    tangential = ripple(record.time[allowed], across(contact.direction, record.force[allowed, :3]),
                   contact.force_rate)
    return (is_member(surface, contact, *ends) and not np.any(far & touching)
            and tangential <= contact.force_ripple)


def _surface(record: Record) -> ShapedSurface:
    surface = check_surface(true_surface(record.scenario))
    assert isinstance(surface, ShapedSurface)  # As it is drawn.
    return surface


def _ends(record: Record) -> tuple[np.ndarray, np.ndarray]:
    """Returns the start of the tip, and its desired position but for the depth (3,) [m].

    With a mission those of `ends_of`.
    """
    scenario, goal = record.scenario, np.asarray(record.scenario.task.pose, dtype=float)[:3]
    contact = scenario.contact.declared_wall()
    assert contact is not None  # It is drawn.
    return ends_of(scenario.mission, contact.walls, record.chi[0, :3], goal)


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
