"""Speed of this checkout beside that of an older one: a table of processor times and their ratios.

`python examples/results/speed.py OLD` takes the path of the older checkout. Every measurement is a
process of its own on one core; old and new alternate, and the table has medians of the turns.
`--only NAME` makes some of the rows, `--turns 1` is a glance.
"""

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).resolve().parents[2]


def mpc_steps(name: str, duration: float) -> dict[str, float]:
    """Returns p50 and p99 of the MPC's step in a run [ms], and the conic programs after the first.

    Args:
        name: Name of the scenario.
        duration: Simulated time [s].
    """
    import uvms_drake as uv
    from uvms_drake.control.mpc.planner import Planner
    from uvms_drake.control.ocp import scp
    from uvms_drake.station.simulation import simulate

    steps: list[float] = []
    programs: list[int] = []
    conic: list[int] = []
    again, solve = Planner.again, scp.solve_staged

    def timed(self: Planner, *args: Any) -> Any:
        programs.clear()
        begin = time.process_time()
        memory = again(self, *args)
        steps.append(1e3 * (time.process_time() - begin))
        conic.append(sum(programs))
        return memory

    def counted(program: Any) -> Any:
        solution = solve(program)
        programs.append(0 if solution is None else solution.cone_programs)
        return solution

    Planner.again = timed  # type: ignore[method-assign]
    scp.solve_staged = counted
    simulate(replace(uv.load_scenario(name), duration=duration), realtime_rate=0.0)
    p50, p99 = (float(x) for x in np.percentile(steps, [50, 99]))
    return {"p50 [ms]": p50, "p99 [ms]": p99, "conic programs": float(sum(conic))}


ROWS: dict[str, Callable[[], dict[str, float]]] = {
    "MPC step, girona500_contact": lambda: mpc_steps("girona500_contact", 12.0),
    "MPC step, girona500_ideal": lambda: mpc_steps("girona500_ideal", 10.0),
    "MPC step, jacket_inspection": lambda: mpc_steps("jacket_inspection", 20.0),
    "MPC step, bluerov2_contact": lambda: mpc_steps("bluerov2_contact", 6.0),
}
"""Measurements by the names of their rows: each returns numbers by name, the smaller the better."""


def measured(row: str, checkout: Path) -> dict[str, float]:
    """Returns a measurement of a checkout, in a process of its own."""
    environment = {**os.environ, "PYTHONPATH": str(checkout), "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run([sys.executable, __file__, "--measure", row], env=environment, text=True,
                          cwd=checkout, capture_output=True, check=False)
    if done.returncode:
        raise SystemExit(f"{row} of {checkout}: {done.stderr}")
    numbers: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return numbers


def table(rows: list[str], old: Path, turns: int) -> list[str]:
    """Returns the table's lines in Markdown."""
    lines = ["| measurement | number | old | new | new / old |", "|---|---|---|---|---|"]
    for row in rows:
        both: tuple[list[dict[str, float]], ...] = ([], [])
        for _ in range(turns):
            for checkout, found in zip((old, HERE), both, strict=True):
                found.append(measured(row, checkout))
        for name in both[0][0]:
            before, after = (float(np.median([each[name] for each in found])) for found in both)
            ratio = f"{after / before:.2f}" if before else "–"
            lines.append(f"| {row} | {name} | {before:.3g} | {after:.3g} | {ratio} |")
    return lines


def main() -> None:
    """Prints the table, or makes one measurement."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("old", type=Path, nargs="?", help="path of an older checkout")
    parser.add_argument("--only", action="append", choices=list(ROWS), help="make this row alone")
    parser.add_argument("--turns", type=int, default=5, help="measurements of each checkout")
    parser.add_argument("--measure", choices=list(ROWS), help="make one measurement of this code")
    arguments = parser.parse_args()
    if arguments.measure:
        print(json.dumps(ROWS[arguments.measure]()))
    elif arguments.old is None or not (arguments.old / "uvms_drake").is_dir():
        parser.error("old: the path of a checkout, with the folder uvms_drake")
    else:
        print("\n".join(table(arguments.only or list(ROWS), arguments.old.resolve(),
                              arguments.turns)))


if __name__ == "__main__":
    main()
