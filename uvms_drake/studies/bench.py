"""How long things take: a step of the controller, a derivative of the plant, a simulation.

Everything is done a few times before it is measured. bench.json has the fields of `Bench`; times
are in ms where a name does not say otherwise, and the means of the parts add up to the total's.
"""

import inspect
import json
import os
import platform
import time
from collections import Counter
from collections.abc import Callable, Hashable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, replace
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator
from pydrake.systems.framework import Context, Diagram, LeafSystem

from uvms_drake.common.jsonable import jsonable
from uvms_drake.common.program import VERSION
from uvms_drake.common.progress import Progress, silent
from uvms_drake.control import scp
from uvms_drake.control.nominal_mpc import FIRST_SOLVE_ITERATIONS
from uvms_drake.control.ocp import Ocp
from uvms_drake.control.plan import Plan
from uvms_drake.control.staged_program import StagedProgram, StagedSolution
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.station.diagram import make_station
from uvms_drake.station.motions import make_ocp
from uvms_drake.station.problem import load_model, start_state
from uvms_drake.station.scenario import Scenario
from uvms_drake.station.simulation import simulate
from uvms_drake.studies.stopwatch import (
    REST,
    Stopwatch,
    Timing,
    replaced,
    stopwatch,
    timings,
)

BENCH_FILE = "bench.json"
STEP_PARTS = ("linearise", "program", "solve", REST)


@dataclass(frozen=True)
class Effort:
    """How much is measured."""

    warm_up: int = 5
    """Repetitions before each measurement."""
    steps: int = 100
    """Measured steps of the controller."""
    first_plans: int = 5
    """Number of times that the first plan is made."""
    instants: int = 10
    """Instants of a simulation at which derivatives are evaluated."""
    rounds: int = 50
    """Evaluations at each instant."""
    simulated: float = 5.0
    """Simulated time, or the scenario's duration if that is shorter [s]."""
    horizons: tuple[int, ...] = (5, 10, 20, 40)
    """Numbers of intervals N at which the growth is measured."""
    horizon_steps: int = 100
    """Largest number of steps at each of the horizons."""
    horizon_seconds: float = 20.0
    """Wall time after which no further step at the horizons is begun [s]."""


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
    """Times of `linearise` (the model about the plan; in `program` where the velocity is the
    input), `program` (the rest of making the convex program), `solve` (solving it) and `rest` (the
    guess, values of plans, line search)."""
    conic_programs: dict[int, int]
    """Number of steps by the conic programs that they solved; none where no limit mattered."""
    first_plan: Timing
    """Time of the first solve, iterated to convergence."""
    first_iterations: int
    """Convex programs of the first solve."""


@dataclass(frozen=True)
class DerivativeTimes:
    """An evaluation of the station's time derivatives, as an integrator asks for it."""

    evaluations: int
    """Number of measured evaluations."""
    on_surface: int
    """Number of states in contact at which it is evaluated."""
    off_surface: int
    """Number of states off the surface."""
    total: Timing
    """Time of an evaluation."""
    parts: dict[str, Timing]
    """Times by path of the system in the station, of systems in Python that have a share in the
    derivative; `rest` is all else: the MultibodyPlant and Drake."""


@dataclass(frozen=True)
class SimulationTime:
    """A simulation as a whole."""

    simulated_s: float
    """Simulated time [s]."""
    wall_s: float
    """Wall time without initialization [s]."""
    real_time_factor: float
    """Simulated over wall time."""


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
class Bench:
    """All that is measured in a run, and on what."""

    scenario: str
    """Name of the scenario."""
    versions: dict[str, str]
    """Versions of `uvms_drake`, `drake`, `numpy` and `python`."""
    machine: dict[str, Any]
    """`cpus` that the process may use; `load_average` over 1, 5 and 15 minutes, before;
    `cpu_share`, processor time of the process over wall time, meanwhile: well below one, something
    else had the processor, and all but `min` and perhaps `p50` says little."""
    controller: ControllerTimes
    """Times of the controller's step."""
    derivative: DerivativeTimes
    """Times of the station's derivative."""
    simulation: SimulationTime
    """Time of a simulation."""
    growth: list[HorizonTimes]
    """Times of the controller's step by horizon."""


# Controller --------------------------------------------------------------------------------------


class NominalLoop:
    """The nominal MPC in a closed loop with its own model, as `NominalMpc` has it.

    Args:
        scenario: Task, start and horizon.
        model: The controller's.
    """

    def __init__(self, scenario: Scenario, model: ContactModel):
        self.ocp: Ocp = make_ocp(scenario, model)
        self._solver: scp.SequentialConvexSolver = scp.SequentialConvexSolver(self.ocp)
        self._start = start_state(scenario, self.ocp)[: self.ocp.state_size]
        self.plan: Plan = self.ocp.resting_plan(0.0, self._start)
        self.solution: scp.Solution | None = None
        """Of the last solve."""

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
    """Gives a function that returns how many conic programs were solved since its last call.

    One that has no solution is not counted.
    """
    solve, counts = scp.solve_staged, [0]

    def counting(program: StagedProgram) -> StagedSolution | None:
        """Solves a program and counts what that took."""
        solution = solve(program)
        counts[0] += 0 if solution is None else solution.cone_programs
        return solution

    def taken() -> int:
        count, counts[0] = counts[0], 0
        return count

    with replaced(scp, "solve_staged", counting):
        yield taken


def measure_controller(scenario: Scenario, model: ContactModel, effort: Effort) -> ControllerTimes:
    """Returns the times of the nominal MPC from the scenario's start."""
    loop = NominalLoop(scenario, model)
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


def measure_growth(scenario: Scenario, model: ContactModel, effort: Effort) -> list[HorizonTimes]:
    """Returns the times of a step at several horizons; these take turns, step by step."""
    loops = [NominalLoop(replace(scenario, mpc=replace(scenario.mpc, horizon=horizon)), model)
             for horizon in effort.horizons]
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


# Plant -------------------------------------------------------------------------------------------


def leaf_systems(diagram: Diagram, path: str = "") -> dict[str, LeafSystem]:
    """Returns the leaf systems of a Diagram by path, such as "uvms/surface"."""
    leaves: dict[str, LeafSystem] = {}
    for system in diagram.GetSystems():
        name = path + system.get_name()
        leaves.update(leaf_systems(system, f"{name}/") if isinstance(system, Diagram)
                      else {name: system})
    return leaves


def watched_station(scenario: Scenario, model: ContactModel, watch: Stopwatch) -> Diagram:
    """Returns a station in which every system in Python is a part of `watch`.

    The functions that Drake calls are timed: those of output ports, and time derivatives. A cache
    entry counts with the system whose function asks for it.
    """
    def watched(declare: Callable) -> Callable:
        """Returns a function that declares a port and has its callbacks timed."""
        def declare_watched(system: LeafSystem, *args: Any, **kwargs: Any) -> Any:
            def timed(value: Any) -> Any:
                return watch.timed(system, value) if callable(value) else value
            return declare(system, *map(timed, args),
                           **{key: timed(value) for key, value in kwargs.items()})
        return declare_watched

    with ExitStack() as stack:
        for name in ("DeclareVectorOutputPort", "DeclareAbstractOutputPort"):
            stack.enter_context(replaced(LeafSystem, name, watched(getattr(LeafSystem, name))))
        station = make_station(scenario, model=model)
    for system in leaf_systems(station).values():
        if inspect.isfunction(getattr(type(system), "DoCalcTimeDerivatives", None)):
            system.DoCalcTimeDerivatives = watch.timed(system, system.DoCalcTimeDerivatives)
    return station


def run_instants(station: Diagram, scenario: Scenario, effort: Effort) -> list[Context]:
    """Returns Contexts of a station at instants of a simulation, spread over its duration."""
    simulator = Simulator(station)
    ApplySimulatorConfig(scenario.simulator, simulator)
    simulator.set_target_realtime_rate(0.0)
    context = simulator.get_mutable_context()
    duration = min(effort.simulated, scenario.duration)
    contexts = []
    for i in range(effort.instants):
        simulator.AdvanceTo((i + 0.5) / effort.instants * duration)
        contexts.append(context.Clone())
    return contexts


def measure_derivative(scenario: Scenario, model: ContactModel, effort: Effort) -> DerivativeTimes:
    """Returns the times of the station's derivative at instants of a simulation.

    Time and state are set before each evaluation, as an integrator does, so that nothing that
    depends on them is left in a cache; the instants take turns.
    """
    watch = Stopwatch()
    station = watched_station(scenario, model, watch)
    names: dict[Hashable, str] = {
        system: path for path, system in leaf_systems(station).items()} | {REST: REST}
    contexts = run_instants(station, scenario, effort)
    state = station.GetOutputPort("state")
    states = np.stack([state.Eval(context) for context in contexts])
    on_surface = int(np.count_nonzero(penetrations(model, states) > 0.0))
    samples = []
    for i in range(effort.warm_up + effort.rounds * effort.instants):
        context = contexts[i % effort.instants]
        context.SetTimeAndContinuousState(
            context.get_time(), context.get_continuous_state_vector().CopyToVector())
        seconds = watch.measure(partial(station.EvalTimeDerivatives, context))
        if i >= effort.warm_up:
            samples.append({names[part]: own for part, own in seconds.items()})
    total, parts = timings(samples)
    rest = parts.pop(REST)
    return DerivativeTimes(
        evaluations=len(samples), on_surface=on_surface,
        off_surface=effort.instants - on_surface, total=total,
        parts={**dict(sorted(parts.items(), key=lambda item: -item[1].mean)), REST: rest})


def penetrations(model: ContactModel, states: np.ndarray) -> np.ndarray:
    """Returns how deep the tip is in the surface [m] in states (𝔮, ζ) (K, 2(6+n))."""
    return model.surface.penetration(model.task_pose(states[:, : model.size])[:, :6])


def measure_simulation(scenario: Scenario, model: ContactModel, effort: Effort) -> SimulationTime:
    """Returns the time that a simulation takes, as fast as possible.

    Raises:
        RunFailed: The scenario cannot be simulated.
    """
    duration = min(effort.simulated, scenario.duration)
    for simulated in (min(0.1, duration), duration):  # The first is to warm up.
        wall = simulate(
            replace(scenario, duration=simulated), model=model, realtime_rate=0.0).wall_time_s
    return SimulationTime(duration, wall, duration / wall)


# All of it ---------------------------------------------------------------------------------------


def measure(scenario: Scenario, effort: Effort | None = None,
            progress: Progress = silent) -> Bench:
    """Returns all measurements of a scenario.

    Args:
        scenario: Scenario to measure.
        effort: How much is measured; the default takes 10 s.
        progress: Called before every measurement.

    Raises:
        InvalidParameter: A value of the scenario cannot be used.
        RunFailed: The scenario cannot be simulated.
    """
    effort = effort or Effort()
    model = load_model(scenario)
    make_station(scenario, model=model)  # A value that cannot be used is refused first.
    load, wall, cpu = load_average(), time.perf_counter(), time.process_time()
    progress("a simulation", 0.0)
    simulation = measure_simulation(scenario, model, effort)
    progress("the controller's step", 0.25)
    controller = measure_controller(scenario, model, effort)
    progress("the plant's derivative", 0.5)
    derivative = measure_derivative(scenario, model, effort)
    progress("the growth with the horizon", 0.75)
    growth = measure_growth(scenario, model, effort)
    cpu_share = (time.process_time() - cpu) / (time.perf_counter() - wall)
    machine = {"cpus": available_cpus(), "load_average": load, "cpu_share": cpu_share}
    versions = {"uvms_drake": VERSION, "drake": version("drake"),
                "numpy": version("numpy"), "python": platform.python_version()}
    return Bench(scenario.name, versions, machine, controller, derivative, simulation, growth)


def load_average() -> list[float] | None:
    """Returns how many processes wanted to run, over 1, 5 and 15 minutes; None if unknown."""
    try:
        return list(os.getloadavg())
    except OSError:
        return None


def available_cpus() -> int | None:
    """Returns how many processors this process may use; None if unknown."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()


def write_bench(bench: Bench, folder: Path) -> None:
    """Writes bench.json."""
    text = json.dumps(jsonable(asdict(bench)), indent=2, allow_nan=False, ensure_ascii=False)
    (folder / BENCH_FILE).write_text(text + "\n", encoding="utf-8")
