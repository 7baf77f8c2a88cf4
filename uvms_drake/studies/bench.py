"""How long things take: a step of the controller, a derivative of the plant, a simulation.

Nothing in the product is instrumented: its functions are replaced by timed ones while a measurement
lasts. The time of a part is its own, without that of the other parts that it calls, so the parts
add up to the total. Everything is done a few times before it is measured. Wall times depend on the
machine and on what else it does; compare them within a run only.

The content of bench.json, all times in ms where the name does not say otherwise; a *timing* has
`min`, `mean`, `p50`, `p95`, `p99` and `max`, and the means of the parts add up to the total's:

- `scenario`, `versions` (of `uvms_drake`, `drake`, `numpy`, `python`).
- `machine`: `cpus` that the process may use; `load_average` over 1, 5 and 15 minutes, before;
  `cpu_share`, processor time of the process over wall time, meanwhile: well below one, something
  else had the processor, and all but `min` and perhaps `p50` says little.
- `controller`: the nominal MPC in a closed loop with its own model, at the scenario's horizon.
    - `horizon` N, `steps` measured, `failures` among them, `total` timing of a step.
    - `parts`: timings of `linearise` (the model about the plan; in `program` where the velocity is
      the input), `program` (the rest of making the convex program), `solve` (solving it) and `rest`
      (the guess, values of plans, line search).
    - `conic_programs`: how many steps solved so many conic programs; none where no limit mattered.
    - `first_plan` timing of the first solve, iterated to convergence; `first_iterations` it takes.
- `derivative`: one evaluation of the station's time derivatives, as an integrator asks for it.
    - `evaluations` measured, at states `on_surface` and `off_surface` so many; `total` timing.
    - `parts`: timings by path of the system in the station, of systems in Python that have a share
      in the derivative; `rest` is all else: the MultibodyPlant and Drake.
- `simulation`: `simulated_s`, `wall_s` without initialization, `real_time_factor`.
- `growth`: for each `horizon` N the timing `step` of so many `steps`, `failures` among them,
  `conic_programs` on average, `per_interval`, the step's p50 over N, and `ratio`, that over the one
  of the first horizon: above one, the time grows faster than the horizon.
"""

import inspect
import json
import os
import platform
import time
from collections import Counter
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, replace
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator
from pydrake.systems.framework import Context, Diagram, LeafSystem

import uvms_drake
from uvms_drake.control import scp
from uvms_drake.control.nominal_mpc import FIRST_SOLVE_ITERATIONS
from uvms_drake.control.ocp import Ocp
from uvms_drake.control.plan import Plan
from uvms_drake.model.surface.law import make_surface_law
from uvms_drake.model.uvms_model import UvmsModel
from uvms_drake.report.summary import jsonable
from uvms_drake.station.diagram import initialize, make_station
from uvms_drake.station.problem import make_ocp, start_state
from uvms_drake.station.scenario import Scenario
from uvms_drake.station.simulation import simulate

BENCH_FILE = "bench.json"
REST = "rest"
STEP_PARTS = ("linearise", "program", "solve", REST)


@dataclass(frozen=True)
class Effort:
    """How much is measured."""

    warm_up: int = 5
    """Repetitions before each measurement."""
    steps: int = 100
    """Of the controller."""
    first_plans: int = 5
    """How often the first plan is made."""
    instants: int = 10
    """Of a simulation, at which derivatives are evaluated."""
    rounds: int = 50
    """Evaluations at each instant."""
    simulated: float = 5.0
    """[s], or the scenario's duration if that is shorter."""
    horizons: tuple[int, ...] = (5, 10, 20, 40)
    horizon_steps: int = 100
    """Steps of the controller at each of the horizons,"""
    horizon_seconds: float = 20.0
    """and no more of them than until so much time has passed [s]."""


@dataclass(frozen=True)
class Timing:
    """Statistics of a repeated measurement [ms]."""

    min: float
    mean: float
    p50: float
    p95: float
    p99: float
    max: float

    @staticmethod
    def of(seconds: Sequence[float]) -> "Timing":
        """Returns the statistics of at least one measurement [s]."""
        ms = 1e3 * np.asarray(seconds, dtype=float)
        p50, p95, p99 = (float(x) for x in np.percentile(ms, [50, 95, 99]))
        return Timing(min=float(np.min(ms)), mean=float(np.mean(ms)), p50=p50, p95=p95, p99=p99,
                      max=float(np.max(ms)))


@dataclass(frozen=True)
class ControllerTimes:
    """A step of the nominal MPC; the module explains the fields of this and of the following."""

    horizon: int
    steps: int
    failures: int
    total: Timing
    parts: dict[str, Timing]
    conic_programs: dict[int, int]
    first_plan: Timing
    first_iterations: int


@dataclass(frozen=True)
class DerivativeTimes:
    """An evaluation of the station's time derivatives."""

    evaluations: int
    on_surface: int
    off_surface: int
    total: Timing
    parts: dict[str, Timing]


@dataclass(frozen=True)
class SimulationTime:
    """A simulation as a whole."""

    simulated_s: float
    wall_s: float
    real_time_factor: float


@dataclass(frozen=True)
class HorizonTimes:
    """A step of the nominal MPC at another horizon."""

    horizon: int
    step: Timing
    steps: int
    failures: int
    conic_programs: float
    per_interval: float
    ratio: float


@dataclass(frozen=True)
class Bench:
    """All that is measured in a run, and on what."""

    scenario: str
    versions: dict[str, str]
    machine: dict[str, Any]
    controller: ControllerTimes
    derivative: DerivativeTimes
    simulation: SimulationTime
    growth: list[HorizonTimes]


# Timers ------------------------------------------------------------------------------------------


class Stopwatch:
    """Collects the time that functions take, each without that of the others that it calls."""

    def __init__(self) -> None:
        self._seconds: dict[Hashable, float] = {}
        self._within: list[float] = []

    def timed(self, part: Hashable, function: Callable) -> Callable:
        """Returns a function that does the same and counts as a `part`."""
        def call(*args, **kwargs):
            self._within.append(0.0)
            started = time.perf_counter()
            try:
                return function(*args, **kwargs)
            finally:
                took = time.perf_counter() - started
                own = took - self._within.pop()
                self._seconds[part] = self._seconds.get(part, 0.0) + own
                if self._within:
                    self._within[-1] += took
        return call

    def lap(self) -> dict[Hashable, float]:
        """Returns the time of every part [s] since the last lap."""
        seconds, self._seconds = self._seconds, {}
        return seconds

    def measure(self, function: Callable[[], object]) -> dict[Hashable, float]:
        """Returns the time of every part [s] in a call, with the `REST` that is in no part."""
        self.lap()
        self.timed(REST, function)()
        return self.lap()


@contextmanager
def replaced(owner: Any, name: str, value: object) -> Iterator[None]:
    """Gives an object, class or module another attribute inside the block."""
    own = vars(owner)
    old = own.get(name)
    is_own = name in own
    setattr(owner, name, value)
    try:
        yield
    finally:
        if is_own:
            setattr(owner, name, old)
        else:
            delattr(owner, name)


@contextmanager
def stopwatch(parts: Mapping[str, tuple[Any, str]]) -> Iterator[Stopwatch]:
    """Times functions inside the block.

    Args:
        parts: By name of the part, the owner of a function and the function's name there.
    """
    watch = Stopwatch()
    with ExitStack() as stack:
        for part, (owner, name) in parts.items():
            stack.enter_context(replaced(owner, name, watch.timed(part, getattr(owner, name))))
        yield watch


def timings(samples: Sequence[Mapping[str, float]]) -> tuple[Timing, dict[str, Timing]]:
    """Returns the timings of the total and of every part; a part that is missing took no time."""
    names = list(dict.fromkeys(name for sample in samples for name in sample))
    parts = {name: Timing.of([sample.get(name, 0.0) for sample in samples]) for name in names}
    return Timing.of([sum(sample.values()) for sample in samples]), parts


# Controller --------------------------------------------------------------------------------------


class NominalLoop:
    """The nominal MPC in a closed loop with its own model, as `NominalMpc` has it.

    Args:
        scenario: Model, task, start and horizon.
    """

    def __init__(self, scenario: Scenario):
        self.ocp: Ocp = make_ocp(scenario)
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

    def counting(program):
        solution = solve(program)
        counts[0] += 0 if solution is None else solution.cone_programs
        return solution

    def taken() -> int:
        count, counts[0] = counts[0], 0
        return count

    with replaced(scp, "solve_staged", counting):
        yield taken


def measure_controller(scenario: Scenario, effort: Effort) -> ControllerTimes:
    """Returns the times of the nominal MPC from the scenario's start."""
    loop = NominalLoop(scenario)
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


def measure_growth(scenario: Scenario, effort: Effort) -> list[HorizonTimes]:
    """Returns the times of a step at several horizons; these take turns, step by step."""
    loops = [NominalLoop(replace(scenario, mpc=replace(scenario.mpc, horizon=horizon)))
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


def watched_station(scenario: Scenario, watch: Stopwatch) -> Diagram:
    """Returns a station in which every system in Python is a part of `watch`.

    What is timed is what Drake calls: the functions of output ports, and time derivatives. A cache
    entry counts with the system whose function asks for it.
    """
    def watched(declare: Callable) -> Callable:
        def declare_watched(system, *args, **kwargs):
            def timed(value):
                return watch.timed(system, value) if callable(value) else value
            return declare(system, *map(timed, args),
                           **{key: timed(value) for key, value in kwargs.items()})
        return declare_watched

    with ExitStack() as stack:
        for name in ("DeclareVectorOutputPort", "DeclareAbstractOutputPort"):
            stack.enter_context(replaced(LeafSystem, name, watched(getattr(LeafSystem, name))))
        station = make_station(scenario)
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
    initialize(station, context, scenario)
    duration = min(effort.simulated, scenario.duration)
    contexts = []
    for i in range(effort.instants):
        simulator.AdvanceTo((i + 0.5) / effort.instants * duration)
        contexts.append(context.Clone())
    return contexts


def measure_derivative(scenario: Scenario, effort: Effort) -> DerivativeTimes:
    """Returns the times of the station's derivative at instants of a simulation.

    Time and state are set before each evaluation, as an integrator does, so that nothing that
    depends on them is left in a cache; the instants take turns.
    """
    watch = Stopwatch()
    station = watched_station(scenario, watch)
    names: dict[Hashable, str] = {
        system: path for path, system in leaf_systems(station).items()} | {REST: REST}
    contexts = run_instants(station, scenario, effort)
    state = station.GetOutputPort("state")
    states = np.stack([state.Eval(context) for context in contexts])
    on_surface = int(np.count_nonzero(penetrations(scenario, states) > 0.0))
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


def penetrations(scenario: Scenario, states: np.ndarray) -> np.ndarray:
    """Returns how deep the tip is in the surface [m] in states (𝔮, ζ) (K, 2(6+n))."""
    surface = make_surface_law(scenario.surface)
    model = UvmsModel.load(scenario.model, surface)
    return surface.penetration(model.task_pose(states[:, : model.size])[:, :6])


def measure_simulation(scenario: Scenario, effort: Effort) -> SimulationTime:
    """Returns the time that a simulation takes, as fast as possible.

    Raises:
        RunFailed: The scenario cannot be simulated.
    """
    duration = min(effort.simulated, scenario.duration)
    simulate(replace(scenario, duration=min(0.1, duration)), realtime_rate=0.0)
    wall = simulate(replace(scenario, duration=duration), realtime_rate=0.0).wall_time_s
    return SimulationTime(duration, wall, duration / wall)


# All of it ---------------------------------------------------------------------------------------


def measure(scenario: Scenario, effort: Effort | None = None,
            progress: Callable[[str], None] = lambda what: None) -> Bench:
    """Returns all measurements of a scenario.

    Args:
        scenario: What is run.
        effort: How much is measured; the default takes 10 s.
        progress: Called with what is measured next.

    Raises:
        InvalidParameter: A value of the scenario cannot be used.
        RunFailed: The scenario cannot be simulated.
    """
    effort = effort or Effort()
    make_station(scenario)  # A value that cannot be used is refused before anything else.
    load, wall, cpu = load_average(), time.perf_counter(), time.process_time()
    progress("a simulation")
    simulation = measure_simulation(scenario, effort)
    progress("the controller's step")
    controller = measure_controller(scenario, effort)
    progress("the plant's derivative")
    derivative = measure_derivative(scenario, effort)
    progress("the growth with the horizon")
    growth = measure_growth(scenario, effort)
    cpu_share = (time.process_time() - cpu) / (time.perf_counter() - wall)
    machine = {"cpus": available_cpus(), "load_average": load, "cpu_share": cpu_share}
    versions = {"uvms_drake": uvms_drake.__version__, "drake": version("drake"),
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


# Table -------------------------------------------------------------------------------------------


def format_bench(bench: Bench) -> str:
    """Returns the measurements as a table for a terminal."""
    versions, machine, simulation = bench.versions, bench.machine, bench.simulation
    load = ", ".join(f"{x:.2f}" for x in machine["load_average"] or ()) or "unknown"
    return "\n".join([
        f"{bench.scenario}: uvms_drake {versions['uvms_drake']}, Drake {versions['drake']}, "
        f"NumPy {versions['numpy']}, Python {versions['python']}",
        f"{machine['cpus']} processors, load average {load} before; this run got "
        f"{machine['cpu_share']:.0%} of one processor: compare times within a run only",
        "", *_controller_rows(bench.controller),
        "", *_derivative_rows(bench.derivative),
        "", f"simulation  {simulation.simulated_s:g} s in {simulation.wall_s:.2f} s, "
        f"{simulation.real_time_factor:.2f} times real time",
        "", *_growth_rows(bench.growth)])


def _controller_rows(times: ControllerTimes) -> list[str]:
    counts = ", ".join(f"{count} in {steps} steps" for count, steps in times.conic_programs.items())
    return [
        *_part_rows(f"controller step, N = {times.horizon} [ms]", times.total, times.parts),
        f"  {'first plan':<32}{_numbers(times.first_plan)}",
        f"  {times.steps} steps, {times.failures} failures; conic programs: {counts}; "
        f"the first plan takes {times.first_iterations} iterations"]


def _derivative_rows(times: DerivativeTimes) -> list[str]:
    return [
        *_part_rows("derivative of the station [ms]", times.total, times.parts),
        f"  {times.evaluations} evaluations at {times.off_surface} states off the surface and "
        f"{times.on_surface} on it"]


def _part_rows(title: str, total: Timing, parts: Mapping[str, Timing]) -> list[str]:
    head = "".join(f"{name:>9}" for name in (*vars(total), "share"))
    return [f"{title:<34}{head}", *(
        f"  {name:<32}{_numbers(part)}{part.mean / total.mean:>9.1%}"
        for name, part in {**parts, "total": total}.items())]


def _numbers(timing: Timing) -> str:
    return "".join(f"{value:>9.3f}" for value in vars(timing).values())


def _growth_rows(growth: Sequence[HorizonTimes]) -> list[str]:
    head = "".join(f"{name:>9}" for name in ("min", "p50", "p95", "p50/N", "ratio"))
    return [f"{'step at other horizons [ms]':<34}{head}{'conic programs':>16}", *(
        f"  {f'N = {row.horizon}':<32}{row.step.min:>9.3f}{row.step.p50:>9.3f}{row.step.p95:>9.3f}"
        f"{row.per_interval:>9.3f}{row.ratio:>9.2f}{row.conic_programs:>16.2f}"
        + (f"  {row.failures} failures" if row.failures else "") for row in growth)]
