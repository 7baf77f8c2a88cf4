"""Solves ocp-k and ocp-d with this project and with CasADi, and prints the ratios.

    python examples/comparison/run.py [--problem ocp-k|ocp-d] [--repetitions R] [--reference]
                                      [--output FILE]

needs the extra `comparison` (`pip install '.[comparison]'`) and gcc. All controllers run in turn
in one process on one core, R times over, so that disturbances of the machine affect them all; a
time is the median over the repetitions of the percentile in each, and a ratio that of two medians.
Compare ratios, not milliseconds. `--reference` adds SNOPT on the whole problem (minutes).

Every controller sees the same plant, problem, horizon, limits and tolerance (a KKT residual of
1e-6; here, a step that improves the cost by less than 1e-6 of it). J is the closed-loop cost,
"violation" the largest one of a limit in closed loop.
"""

import argparse
import json
import os
import platform
from importlib.metadata import version
from pathlib import Path

# One core each: BLAS threads gain nothing here, and would compare numbers of cores.
for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ[_variable] = "1"

import numpy as np
from casadi_controllers import make_controllers
from closed_loop import Controller, History, make_plant_step, run
from problems import CLOSED_LOOP_STEPS, PROBLEM, Problem
from this_project import FastController, ReferenceController

CONVERGED = 50
"""Most convex programs a step of the converged row."""


def main() -> None:
    """Measures and prints."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repetitions", type=int, default=3, help="default: %(default)s")
    parser.add_argument("--reference", action="store_true", help="also SNOPT on the whole problem")
    parser.add_argument("--output", type=Path, help="write the numbers as JSON")
    arguments = parser.parse_args()
    out = {"versions": {"python": platform.python_version(), **{
        name: version(name) for name in ("casadi", "drake", "numpy")}}}
    ours = [FastController(PROBLEM, 1), FastController(PROBLEM, CONVERGED)]
    if arguments.reference:
        ours.append(ReferenceController(PROBLEM))
    rows = compare(PROBLEM, [*ours, *make_controllers(PROBLEM)], arguments.repetitions)
    print(format_rows(PROBLEM, rows), flush=True)
    out[PROBLEM.name] = rows
    if arguments.output is not None:
        arguments.output.write_text(json.dumps(out, indent=2) + "\n", encoding="utf-8")


def compare(problem: Problem, controllers: list[Controller], repetitions: int) -> list[dict]:
    """Returns a row of numbers for each controller."""
    plant_step = make_plant_step(problem)
    histories: list[list[History]] = [[] for _ in controllers]
    for _ in range(repetitions):
        for controller, seen in zip(controllers, histories, strict=True):
            seen.append(run(controller, plant_step, problem.start, CLOSED_LOOP_STEPS))
    return [_row(problem, controller, seen)
            for controller, seen in zip(controllers, histories, strict=True)]


def _row(problem: Problem, controller: Controller, seen: list[History]) -> dict:
    p50, p95, worst = np.median(
        [np.percentile(1e3 * history.seconds, [50, 95, 100]) for history in seen], axis=0)
    first = seen[0]
    return {"name": controller.name, "p50_ms": p50, "p95_ms": p95, "max_ms": worst,
            "cost": problem.closed_loop_cost(first.states, first.inputs),
            "violation": problem.violation(first.states, first.inputs),
            "failures": int(np.sum(~first.converged))}


def format_rows(problem: Problem, rows: list[dict]) -> str:
    """Returns the table of a problem; the last columns are p50 over that of this project's rows."""
    one, converged = (row["p50_ms"] for row in rows[:2])
    lines = [f"{problem.name:<42}{'p50':>8}{'p95':>8}{'max':>8}{'J':>10}{'violation':>11}"
             f"{'failed':>8}{'/ one':>8}{'/ conv.':>8}"]
    for row in rows:
        lines.append(
            f"{row['name']:<42}{row['p50_ms']:>8.2f}{row['p95_ms']:>8.2f}{row['max_ms']:>8.2f}"
            f"{row['cost']:>10.4f}{row['violation']:>11.1e}{row['failures']:>8d}"
            f"{row['p50_ms'] / one:>8.2f}{row['p50_ms'] / converged:>8.2f}")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main()
