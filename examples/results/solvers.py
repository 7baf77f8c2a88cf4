"""Closed loop with each solver of the MPC: the largest difference of the force, and step times.

`python examples/results/solvers.py > examples/results/solvers.md` certifies two scenarios and runs
them with the structured solver, with Clarabel for its convex programs and with SNOPT for the whole
problem, which takes a quarter of an hour. One iteration a sample is not the optimum, so SNOPT is
compared with the structured solver to the end. Times are processor times of the MPC's steps but the
first, which starts from a plan at rest.
"""

import argparse
import time
from collections.abc import Iterator
from dataclasses import replace
from functools import partialmethod

import numpy as np
from make_all import provenance
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator

import uvms_drake as uv
from uvms_drake.control.ocp.scp import SequentialConvexSolver

DURATIONS = {"girona500_ideal": 6.0, "girona500_contact": 9.0}
"""Scenarios and simulated time [s]: beyond touch and settling, as SNOPT takes seconds a step."""
TO_THE_END, TOLERANCE = 30, 1e-9
"""Iterations within which the structured solver converges to a tolerance, which is tighter than its
own: with that of 1e-6 the force is off by 0.13 %."""
SOLVERS = {1: ("structured", "clarabel"), TO_THE_END: ("structured", "snopt")}
"""Values of `mpc.solver` by `mpc.iterations`; a second is compared with the first beside it."""
HEAD = ("scenario", "`mpc.iterations`", "`mpc.solver`", "samples", "without a new plan",
        "touch [s]", "force at the end [N]", "largest difference of the force [N]",
        "over the desired force", "median step [ms]", "longest step [ms]", "ratio of medians")


def run(scenario: uv.Scenario, solver: str, iterations: int) -> dict[str, np.ndarray]:
    """Returns the logs of a run of a certified scenario with a solver."""
    scenario = replace(
        scenario, mpc=replace(scenario.mpc, solver=solver, iterations=iterations))
    station = uv.make_station(scenario, certified=True)
    mpc = station.GetSubsystemByName("tube_mpc").GetSubsystemByName("nominal_mpc")
    mpc.time_by(time.process_time)  # A run may share its core with others.
    simulator = Simulator(station)
    ApplySimulatorConfig(scenario.simulator, simulator)
    simulator.AdvanceTo(scenario.duration)
    return uv.read_logs(station, simulator.get_context())


def rows_of(name: str, duration: float) -> Iterator[tuple[str, ...]]:
    """Yields a row of the table for each solver."""
    scenario = uv.with_step(uv.load_scenario(name, [f"duration={duration}"]))
    certificate = uv.certify(scenario)
    if not certificate.certified:
        raise SystemExit(f"{name}: {certificate.failed}")
    scenario, desired = certificate.applied_to(scenario), np.linalg.norm(scenario.task.force)
    usual = SequentialConvexSolver.solve
    for iterations, solvers in SOLVERS.items():
        if iterations == TO_THE_END:
            SequentialConvexSolver.solve = partialmethod(usual, tolerance=TOLERANCE)
        first: dict[str, np.ndarray] = {}
        for solver in solvers:
            logs = run(scenario, solver, iterations)
            first = first or logs
            apart = np.max(np.linalg.norm((logs["force"] - first["force"])[:, :3], axis=1))
            steps, before = (1e3 * each["step_seconds"][1:] for each in (logs, first))
            yield (f"`{name}`", f"{iterations}", solver, f"{len(steps) + 1}",
                   f"{np.count_nonzero(logs['mpc_status'])}",
                   f"{logs['time'][np.argmax(logs['penetration'] > 0.0)]:.2f}",
                   f"{np.linalg.norm(logs['force'][-1, :3]):.3f}", f"{apart:.1e}",
                   f"{apart / desired:.1e}", f"{np.median(steps):.1f}", f"{np.max(steps):.1f}",
                   f"{np.median(steps) / np.median(before):.1f}")
    SequentialConvexSolver.solve = usual


def main() -> None:
    """Prints the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenarios", nargs="*", default=list(DURATIONS), help="their names")
    names = parser.parse_args().scenarios
    print("# The closed loop with each solver of the MPC\n\n"
          f"{provenance()} Command: `python examples/results/solvers.py`.\n\n"
          "`structured` is sequential convex programming with the solver that knows the stages;\n"
          "`clarabel` solves the same convex programs, one iteration a sample. `snopt` solves\n"
          "the whole problem from the plan of `structured`, so it is beside that one to the end,\n"
          "which is another loop than one iteration a sample. Differences are over all logged\n"
          "instants of approach, touch and hold. Times are processor times of the MPC's steps but\n"
          "the first.\n")
    for row in (HEAD, ["---"] * len(HEAD)):
        print(f"| {' | '.join(row)} |", flush=True)
    for name in names:
        for row in rows_of(name, DURATIONS[name]):
            print(f"| {' | '.join(row)} |", flush=True)


if __name__ == "__main__":
    main()
