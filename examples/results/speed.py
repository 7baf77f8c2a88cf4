"""Speed of this checkout beside that of an older one: a table of processor times and their ratios.

`python examples/results/speed.py OLD` takes the path of the older checkout. Every measurement is a
process of its own on one core; old and new alternate, and the table has medians of the turns.
`--only NAME` makes some of the rows, `--turns 1` is a glance.
"""

import argparse
import copy
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
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


def simulation(name: str, duration: float) -> dict[str, float]:
    """Returns the processor time of a run with everything that it loads [s]."""
    import uvms_drake as uv
    from uvms_drake.station.simulation import simulate

    scenario = replace(uv.load_scenario(name), duration=duration)
    begin = time.process_time()
    simulate(scenario, realtime_rate=0.0)
    return {"[s]": time.process_time() - begin}


def campaign_run(name: str) -> dict[str, float]:
    """Returns the processor time of a campaign's second run [s], and the part beside simulation.

    A worker has loaded all modules and the robot's files in the first one. The certificate is made
    before, once for all runs; here the declared tube is taken.
    """
    import uvms_drake as uv
    from uvms_drake.campaign import run
    from uvms_drake.campaign.campaign import make_campaign

    spent: list[float] = []
    simulate = run.simulate

    def timed(scenario: Any) -> Any:
        begin = time.process_time()
        record = simulate(scenario)
        spent.append(time.process_time() - begin)
        return record

    campaign = make_campaign(stepping(uv.load_scenario(name)), 0, None)
    run.simulate = timed
    run.run_one(campaign, 0)
    begin = time.process_time()
    run.run_one(campaign, 1)
    whole = time.process_time() - begin
    return {"[s]": whole, "beside the simulation [%]": 100.0 * (whole / spent[-1] - 1.0)}


def certificate(name: str) -> dict[str, float]:
    """Returns the processor time of a certificate from an empty cache [s]."""
    import uvms_drake as uv
    from uvms_drake.certificate.certify import certify

    scenario = uv.load_scenario(name)
    with tempfile.TemporaryDirectory() as cache:
        os.environ["XDG_CACHE_HOME"] = cache
        begin = time.process_time()
        certify(scenario)
        return {"[s]": time.process_time() - begin}


def effect_of_step(name: str, duration: float) -> dict[str, float]:
    """Returns the largest changes of state and force [N] in a run as the step is halved."""
    import uvms_drake as uv
    from uvms_drake.station.simulation import simulate

    scenario = stepping(replace(uv.load_scenario(name), duration=duration))
    finer = replace(scenario, simulator=copy.copy(scenario.simulator))
    finer.simulator.max_step_size *= 0.5
    one, other = (simulate(each, realtime_rate=0.0) for each in (scenario, finer))
    return {"step [ms]": 1e3 * scenario.simulator.max_step_size,
            "state [m, rad, m/s, rad/s]": float(np.max(np.abs(one.state - other.state))),
            "force [N]": float(np.max(np.linalg.norm((one.force - other.force)[:, :3], axis=1)))}


def stepping(scenario: Any) -> Any:
    """Returns a scenario with the step that is chosen for it, if this code chooses one."""
    from uvms_drake.station import step_size
    from uvms_drake.station.problem import load_model

    with_step = getattr(step_size, "with_step", None)
    return scenario if with_step is None else with_step(scenario, load_model(scenario))


ROWS: dict[str, Callable[[], dict[str, float]]] = {
    "simulation, girona500_contact": lambda: simulation("girona500_contact", 12.0),
    "simulation, girona500_ideal": lambda: simulation("girona500_ideal", 5.0),
    "simulation, girona500_real_loop": lambda: simulation("girona500_real_loop", 12.0),
    "campaign, girona500_contact": lambda: campaign_run("girona500_contact"),
    "step, girona500_contact": lambda: effect_of_step("girona500_contact", 12.0),
    **{f"certify {name}": partial(certificate, name)
       for name in ("girona500_contact", "girona500_tip_first", "bluerov2_contact")},
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
