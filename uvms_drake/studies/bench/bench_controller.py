"""Measures step times of the nominal MPC, by solver, and their growth with the horizon."""

import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from uvms_drake.control.convex.staged_program import StagedProgram
from uvms_drake.control.convex.staged_solver import StagedSolution
from uvms_drake.control.mpc.planner import FIRST_SOLVE_ITERATIONS
from uvms_drake.control.ocp import scp
from uvms_drake.control.ocp.ocp import Ocp
from uvms_drake.control.ocp.solver import Solution
from uvms_drake.control.ocp.solvers import make_solver
from uvms_drake.control.plan.plan import Plan
from uvms_drake.studies.bench.stopwatch import (
    REST,
    Effort,
    Stopwatch,
    Timing,
    replaced,
    stopwatch,
    timings,
)

STEP_PARTS = ("linearise", "program", "solve", REST)


@dataclass(frozen=True)
class ControllerTimes:
    """A step of the nominal MPC in a closed loop with its own model, at the scenario's horizon."""

    horizon: int
    """Number of intervals N."""
    steps: int
    """Number of measured steps."""
    failures: int
    """Steps at which the solver found no plan."""
    total: Timing
    """Time of a step."""
    parts: dict[str, Timing]
    """Times of `linearise` (the model about the plan; in `program` if the velocity is the input),
    `program` (the other set-up of the convex program), `solve` (its solution) and `rest` (the
    guess, values of plans, line search)."""
    conic_programs: dict[int, int]
    """Number of steps by their number of conic programs; none without active limits."""
    first_plan: Timing
    """Time of the first solve, iterated to convergence."""
    first_iterations: int
    """Convex programs of the first solve."""


@dataclass(frozen=True)
class HorizonTimes:
    """A step of the nominal MPC at another horizon."""

    horizon: int
    """Number of intervals N."""
    step: Timing
    """Time of a step."""
    steps: int
    """Number of measured steps."""
    failures: int
    """Steps at which the solver found no plan."""
    conic_programs: float
    """Mean number of conic programs a step."""
    per_interval: float
    """Median of the step over N [ms]."""
    ratio: float
    """`per_interval` over that of the first horizon: above one, the time grows faster than N."""


@dataclass(frozen=True)
class SolverTimes:
    """A step of the nominal MPC by one of its solvers."""

    solver: str
    """Name, see `MpcConfig.solver`."""
    horizon: int
    """Number of intervals N, the same for all of them."""
    step: Timing
    """Time of a step."""
    steps: int
    """Number of measured steps."""
    failures: int
    """Steps at which the solver found no plan."""
    ratio: float
    """Ratio of the medians, of this solver's over that of the first."""


class NominalLoop:
    """The nominal MPC in a closed loop with its own model, as `NominalMpc` has it.

    Args:
        ocp: Its problem.
        start: (𝔮, ζ) at t = 0 (2(6+n),).
    """

    def __init__(self, ocp: Ocp, start: np.ndarray):
        self.ocp, self._solver = ocp, make_solver(ocp)
        self._start = start[: ocp.state_size]
        self.plan: Plan = self.ocp.resting_plan(0.0, self._start)
        self.solution: Solution | None = None
        """Solution of the last solve."""

    def first(self) -> None:
        """Makes the first plan."""
        self._solve(self.ocp.resting_plan(0.0, self._start), FIRST_SOLVE_ITERATIONS)

    def step(self) -> None:
        """Makes the plan of the next sample."""
        self._solve(self.ocp.continued(self.plan), self.ocp.iterations)

    def _solve(self, guess: Plan, iterations: int) -> None:
        self.solution = self._solver.solve(guess, iterations)
        self.plan = self.solution.plan or guess

    def failed(self) -> bool:
        """Returns whether the last solve failed."""
        return self.solution is None or self.solution.plan is None


@contextmanager
def conic_programs() -> Iterator[Callable[[], int]]:
    """Context manager of a counter: the number of conic programs solved since its last call.

    Infeasible ones are not counted.
    """
    solve, counts = scp.solve_staged, [0]

    def counting(program: StagedProgram) -> StagedSolution | None:
        """Solves a program and counts the conic programs."""
        solution = solve(program)
        counts[0] += 0 if solution is None else solution.cone_programs
        return solution

    def taken() -> int:
        count, counts[0] = counts[0], 0
        return count

    with replaced(scp, "solve_staged", counting):
        yield taken


def measure_controller(loop: NominalLoop, effort: Effort) -> ControllerTimes:
    """Returns the times of the nominal MPC from the scenario's start."""
    watched = {"program": (loop.ocp, "staged_program"), "solve": (scp, "solve_staged")}
    if hasattr(loop.ocp, "linearise"):
        watched["linearise"] = (loop.ocp, "linearise")
    samples, counts, failures = [], [], 0
    with conic_programs() as taken, stopwatch(watched) as watch:
        loop.first()
        firsts = [sum(watch.measure(loop.first).values()) for _ in range(effort.first_plans)]
        first_plan, iterations = loop.plan, loop.solution.iterations if loop.solution else 0
        for _ in range(effort.warm_up):
            loop.step()
        loop.plan = first_plan
        taken()
        for _ in range(effort.steps):
            sample = watch.measure(loop.step)
            samples.append({part: sample.get(part, 0.0) for part in STEP_PARTS})
            counts.append(taken())
            failures += loop.failed()
    total, parts = timings(samples)
    return ControllerTimes(
        horizon=loop.ocp.horizon, steps=effort.steps, failures=failures, total=total, parts=parts,
        conic_programs=dict(sorted(Counter(counts).items())), first_plan=Timing.of(firsts),
        first_iterations=iterations)


def measure_solvers(loop: NominalLoop, effort: Effort) -> list[SolverTimes]:
    """Returns the times of a step by solver; all solvers start from the plans of the loop's own.

    Raises:
        InvalidParameter: One of the solvers cannot be used.
    """
    solvers = {name: make_solver(loop.ocp, name) for name in effort.solvers}
    seconds: dict[str, list[float]] = {name: [] for name in solvers}
    failures = dict.fromkeys(solvers, 0)
    loop.first()
    end = time.perf_counter() + effort.solver_seconds
    steps = 0
    while steps < effort.solver_steps and (steps < 1 or time.perf_counter() < end):
        guess = loop.ocp.continued(loop.plan)
        for name, solver in solvers.items():
            begin = time.perf_counter()
            solution = solver.solve(guess, loop.ocp.iterations)
            seconds[name].append(time.perf_counter() - begin)
            failures[name] += solution.plan is None
        loop.step()
        steps += 1
    timings = {name: Timing.of(each) for name, each in seconds.items()}
    first = timings[effort.solvers[0]].p50
    return [SolverTimes(name, loop.ocp.horizon, timing, steps, failures[name],
                        timing.p50 / first) for name, timing in timings.items()]


def measure_growth(loops: Sequence[NominalLoop], effort: Effort) -> list[HorizonTimes]:
    """Returns the times of a step of loops of several horizons, which alternate step by step."""
    seconds: list[list[float]] = [[] for _ in loops]
    counts, failures = np.zeros(len(loops)), np.zeros(len(loops), dtype=int)
    watch = Stopwatch()
    with conic_programs() as taken:
        for loop in loops:
            loop.first()
            first_plan = loop.plan
            for _ in range(effort.warm_up):
                loop.step()
            loop.plan = first_plan
        taken()
        # Steps in turn, so that all horizons meet the same load of the machine.
        end = time.perf_counter() + effort.horizon_seconds
        while not seconds[0] or (
                len(seconds[0]) < effort.horizon_steps and time.perf_counter() < end):
            for i, loop in enumerate(loops):
                seconds[i].append(watch.measure(loop.step)[REST])
                counts[i] += taken()
                failures[i] += loop.failed()
    steps = [Timing.of(each) for each in seconds]
    per_interval = [step.p50 / loop.ocp.horizon for step, loop in zip(steps, loops, strict=True)]
    return [HorizonTimes(
        horizon=loop.ocp.horizon, step=steps[i], steps=len(seconds[i]), failures=int(failures[i]),
        conic_programs=float(counts[i]) / len(seconds[i]), per_interval=per_interval[i],
        ratio=per_interval[i] / per_interval[0]) for i, loop in enumerate(loops)]
