"""Random events outside of the class of the real loops, one or two in a short run each.

`python examples/results/random_events.py --runs 1000 --output FILE` appends a line of JSON to FILE
for each run that it does not have, of some 20 s of a core; `--share I N` makes each N-th alone, so
that several processes work on one page. `--page FILE` prints the page of what FILE has.
"""

import argparse
import json
import shutil
import tempfile
from collections import defaultdict
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from make_all import provenance
from outside import at_random, failing_law, failing_planner, not_finite, raises

import uvms_drake as uv
from uvms_drake.common.keyed_random import generator_of
from uvms_drake.model.description.robot_files import model_dir
from uvms_drake.station.contact.bounds import sensed_contact

STREAM = 97
"""Key of the random numbers."""
ROBOTS = {"girona500_real_loop": ("start.eta.0=-1.12", 700.0),
          "bluerov2_real_loop": ("start.eta.0=-0.58", 400.0)}
"""Scenarios with a start near the wall, and the stiffness of that [N/m]."""
HOVER, AFTER = "mpc.hover=2.0", 5.0
"""A short hover, and the time from the last event to the end [s]."""
EARLIEST, LATEST = 3.0, 15.0
"""Range of the first event's instant [s]: the touch is in the middle of it."""
LONGEST = 0.5
"""Time above the declared force that is asked for at most [s]."""
FAILING = {"law raises": (failing_law, raises), "law is not finite": (failing_law, not_finite),
           "law is random": (failing_law, at_random), "planner raises": (failing_planner,)}
"""Failures of the program itself, of which a run has one at most."""
KINDS = ("stiffer wall", "current", "wave", "thruster stuck", "thruster dead", "no fixes",
         "no state", "force frozen", "force dead", "force jumps", *FAILING)
"""Kinds of events."""
HEAD = """# Random events outside of the class

{provenance} Command: `python examples/results/random_events.py --runs N --output FILE`, then
`--page FILE`.

Short runs of `girona500_real_loop` and `bluerov2_real_loop` with a hover of 2 s, from 4 to 6 cm off
the wall, each with one or two events of random kind, size and instant, half of the robots with a
power cut for their thrusters. Asked is that no joint is beyond its stop by more than its bumper
gives ({bumper:g} rad), the force not above the declared one for more than {longest:g} s, that no
run ends with an exception, and that nothing it has logged is lost. *Beyond* is the largest way of a
joint beyond its stop, *above* the longest time above the declared force, *peak* the largest force.

{count} runs; {trips} ended with a retreat, {none} without one since the event was too small or
within what is declared; {ended} ended early or with an exception.

| kind, alone or with another | runs | beyond [rad] | above [s] | peak [N] | missed |
|---|---|---|---|---|---|
"""
BUMPER = 0.02
"""Way of a joint into its stop that counts as the stop's own give [rad]."""


@cache
def thrusters_of(scenario: str) -> list[str]:
    """Returns the names of the thrusters of a scenario's robot."""
    thrusters = uv.Robot.load(model_dir(uv.load_scenario(scenario).model)).uvms.thrusters
    return list(thrusters.thrusters) if thrusters is not None else []


def drawn(index: int) -> tuple[str, list[tuple[str, float, str]], bool]:
    """Returns the scenario of a run, its events (kind, instant, override), and if power is cut."""
    draw = generator_of(1, (STREAM, index))
    robot = list(ROBOTS)[index % 2]
    names = thrusters_of(robot)
    cut, events = bool(draw.integers(2)), []
    instant = float(draw.uniform(EARLIEST, LATEST))
    for number in range(1 + int(draw.integers(2))):
        kind = str(draw.choice(KINDS))
        if number and (kind in FAILING or kind == events[0][0]
                       or {kind, events[0][0]} == {"current", "wave"}):  # Of one kind of fault.
            continue
        instant += float(draw.uniform(0.0, 3.0)) if number else 0.0
        heading, size = draw.uniform(-np.pi, np.pi), draw.uniform()
        flow = [float(np.cos(heading)), float(np.sin(heading)), 0.0]
        text = {
            "stiffer wall": f"{ROBOTS[robot][1] * 100.0 ** size}",
            "current": f"!UnknownFlow {{velocity: {_times(0.1 + 0.5 * size, flow)}, "
                       f"start: {instant}}}",
            "wave": f"!UnknownFlow {{velocity: {_times(0.05 + 0.25 * size, flow)}, "
                    f"period: {draw.uniform(3.0, 10.0)}, start: {instant}}}",
            "thruster stuck": f"!StuckThruster {{thruster: {draw.choice(names)}, "
                              f"share: {2.0 * size - 1.0}, start: {instant}}}",
            "thruster dead": f"!LostThruster {{thruster: {draw.choice(names)}, start: {instant}}}",
            "no fixes": f"!LostFixes {{start: {instant}, duration: {0.2 + 9.0 * size}}}",
            "no state": f"!LostState {{start: {instant}, duration: {0.1 + 5.0 * size}}}",
            "force frozen": f"!FrozenForce {{start: {instant}, duration: {0.1 + 9.0 * size}}}",
            "force dead": f"!LostForce {{start: {instant}, duration: {0.1 + 9.0 * size}}}",
            "force jumps": f"!JumpedForce {{start: {instant}, duration: 99, "
                           f"jump: {_times(40.0 * size, [*flow, 0.0, 0.0, 0.0])}}}",
        }.get(kind, "")
        events.append((kind, instant, text))
    return robot, events, cut


def _times(size: float, vector: list[float]) -> list[float]:
    return [round(size * each, 4) for each in vector]


def made(index: int, cut_robots: Path) -> dict[str, Any]:
    """Returns the result of a run."""
    robot, events, cut = drawn(index)
    near, _ = ROBOTS[robot]
    overrides = [near, HOVER, f"duration={events[-1][1] + AFTER}", f"seed={index}"]
    faults = [text for kind, _, text in events if text and kind != "stiffer wall"]
    overrides += [f"surface.law.stiffness={text}" for kind, _, text in events
                  if kind == "stiffer wall"]
    overrides += [f"faults=[{', '.join(faults)}]"] if faults else []
    if cut:
        overrides.append(f"model={cut_robots / uv.load_scenario(robot).model}")
    out: dict[str, Any] = {"index": index, "robot": robot, "cut": cut, "events": events}
    try:
        scenario = uv.load_scenario(robot, overrides)
        patch = FAILING.get(events[0][0])
        if patch is None:
            record = uv.simulate(scenario)
        else:
            with patch[0](events[0][1], *patch[1:]):
                record = uv.simulate(scenario)
        q, model, contact = record.config[:, 6:], record.model, sensed_contact(scenario)
        force = record.force[:, :3] @ np.asarray(contact.direction)
        safety = record.summary()["safety"]
        lower, upper = model.joint_range()
        return out | {
            "error": None if record.time[-1] > scenario.duration - 0.1 else "ended early",
            "beyond": float(max(np.max(q - upper), np.max(lower - q), 0.0)),
            "above": float(np.sum(force > contact.force) * scenario.log_period),
            "peak": float(np.max(force)), "rate": float(np.max(np.abs(record.zeta[:, 6:]))),
            "finite": bool(np.all(np.isfinite(record.tau))), "trip": float(record.trip),
            "cause": safety.get("cause")}
    except Exception as error:
        return out | {"error": f"{type(error).__name__}: {error}"}


def missed(run: dict[str, Any]) -> bool:
    """Returns whether a run misses what is asked."""
    return bool(run["error"] or not run["finite"] or run["beyond"] > BUMPER
                or run["above"] > LONGEST)


def page(runs: list[dict[str, Any]]) -> str:
    """Returns the page."""
    of: dict[str, list[dict[str, Any]]] = defaultdict(list)
    for run in runs:
        for kind, _, _ in run["events"]:
            of[kind].append(run)

    def largest(kind: str, key: str) -> float:
        return max((run[key] for run in of[kind] if not run["error"]), default=0.0)

    text = HEAD.format(
        provenance=provenance(), bumper=BUMPER, longest=LONGEST, count=len(runs),
        trips=sum(np.isfinite(run.get("trip", np.inf)) for run in runs),
        none=sum(not np.isfinite(run.get("trip", np.inf)) and not run["error"] for run in runs),
        ended=sum(run["error"] is not None for run in runs))
    text += "\n".join(
        f"| {kind} | {len(of[kind])} | {largest(kind, 'beyond'):.2g} | {largest(kind, 'above'):.2g}"
        f" | {largest(kind, 'peak'):.1f} | {sum(map(missed, of[kind]))} |"
        for kind in KINDS if of[kind])
    lines = [f"* {run['index']}, {run['robot']}{', power cut' if run['cut'] else ''}: "
             + "; ".join(f"{kind} at {at:.1f} s `{what}`" for kind, at, what in run["events"])
             + ": " + (run["error"] or f"{run['beyond']:.2g} rad beyond, {run['above']:.2g} s "
                       f"above, {run['peak']:.0f} N ({run['cause']})")
             for run in runs if missed(run)]
    return text + "\n\n## Runs that miss it\n\n" + ("\n".join(lines) or "None.") + "\n"


def main() -> None:
    """Makes runs, or prints the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=1000)
    parser.add_argument("--share", type=int, nargs=2, default=(0, 1), metavar=("I", "N"))
    parser.add_argument("--output", type=Path, default=Path("out/random_events.jsonl"))
    parser.add_argument("--page", type=Path)
    chosen = parser.parse_args()
    if chosen.page:
        runs = [json.loads(line) for line in chosen.page.read_text("utf-8").splitlines()]
        print(page(sorted(runs, key=lambda run: run["index"])), end="")
        return
    chosen.output.parent.mkdir(parents=True, exist_ok=True)
    known = {json.loads(line)["index"] for line in chosen.output.read_text("utf-8").splitlines()
             } if chosen.output.exists() else set()
    with tempfile.TemporaryDirectory() as folder:
        for name in ROBOTS:
            source = model_dir(uv.load_scenario(name).model)
            thrusters = Path(shutil.copytree(source, Path(folder) / source.name)) / "thrusters.yaml"
            thrusters.write_text("power_cut: true\n" + thrusters.read_text("utf-8"), "utf-8")
        for index in range(chosen.share[0], chosen.runs, chosen.share[1]):
            if index not in known:
                with chosen.output.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(made(index, Path(folder))) + "\n")


if __name__ == "__main__":
    main()
