"""Benchmarks: wall time of a controller step, a derivative of the plant, and a simulation.

Each is warmed up before it is measured. bench.json has the fields of `Bench`; times are in ms
unless the name has another unit, and the means of the parts add up to the total's.
"""

import json
import os
import platform
import time
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

from uvms_drake.common.jsonable import jsonable
from uvms_drake.common.program import VERSION
from uvms_drake.common.progress import Progress, silent
from uvms_drake.control.ocp.ocp import MpcConfig
from uvms_drake.station.diagram import make_station
from uvms_drake.station.problem import load_model, make_ocp, start_state
from uvms_drake.station.scenario.scenario import Scenario
from uvms_drake.station.simulation import simulate
from uvms_drake.station.step_size import with_step
from uvms_drake.studies.bench.bench_controller import (
    ControllerTimes,
    HorizonTimes,
    NominalLoop,
    SolverTimes,
    measure_controller,
    measure_growth,
    measure_solvers,
)
from uvms_drake.studies.bench.bench_feedback import FeedbackTimes, measure_feedback
from uvms_drake.studies.bench.bench_plant import DerivativeTimes, measure_derivative
from uvms_drake.studies.bench.stopwatch import Effort

BENCH_FILE = "bench.json"


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
class Bench:
    """Measurements of a scenario, with versions and machine."""

    scenario: str
    """Name of the scenario."""
    versions: dict[str, str]
    """Versions of `uvms_drake`, `drake`, `numpy` and `python`."""
    machine: dict[str, Any]
    """`cpus` available to the process; `load_average` over 1, 5 and 15 minutes, before;
    `cpu_share`, processor time of the process over wall time: well below one the processor was
    shared, and only `min`, perhaps `p50`, is meaningful."""
    controller: ControllerTimes
    """Times of the controller's step."""
    derivative: DerivativeTimes
    """Times of the station's derivative."""
    feedback: FeedbackTimes | None
    """Times of the feedback's command; None if a velocity is the input."""
    simulation: SimulationTime
    """Time of a simulation."""
    solvers: list[SolverTimes]
    """Times of the controller's step by solver."""
    growth: list[HorizonTimes]
    """Times of the controller's step by horizon."""


def measure(scenario: Scenario, effort: Effort | None = None,
            progress: Progress = silent) -> Bench:
    """Returns all measurements of a scenario.

    Args:
        scenario: Scenario to measure.
        effort: Numbers of repetitions; the default takes half a minute.
        progress: Called before every measurement.

    Raises:
        InvalidParameter: A value of the scenario cannot be used.
        RunFailed: The scenario cannot be simulated.
    """
    effort = effort or Effort()
    model = load_model(scenario)
    scenario = with_step(scenario, model)
    make_station(scenario, model=model)  # A value that cannot be used is refused first.

    def loop(mpc: MpcConfig) -> NominalLoop:
        ocp = make_ocp(replace(scenario, mpc=mpc), model)
        return NominalLoop(ocp, start_state(scenario, ocp))

    # A simulation, as fast as possible.
    load, wall, cpu = load_average(), time.perf_counter(), time.process_time()
    progress("a simulation", 0.0)
    duration = min(effort.simulated, scenario.duration)
    for simulated in (min(0.1, duration), duration):  # The first is to warm up.
        took = simulate(
            replace(scenario, duration=simulated), model=model, realtime_rate=0.0).wall_time_s
    simulation = SimulationTime(duration, took, duration / took)
    # Its parts.
    progress("the controller's step", 0.25)
    controller = measure_controller(loop(scenario.mpc), effort)
    progress("the plant's derivative", 0.5)
    derivative = measure_derivative(scenario, model, effort)
    progress("the feedback's command", 0.7)
    feedback = measure_feedback(scenario, model, effort)
    # The controller's step with other settings.
    progress("the controller's step by solver", 0.72)
    solvers = measure_solvers(loop(replace(
        scenario.mpc, horizon=effort.solver_horizon, solver=effort.solvers[0])), effort)
    progress("the growth with the horizon", 0.85)
    growth = measure_growth([loop(replace(scenario.mpc, horizon=horizon))
                             for horizon in effort.horizons], effort)
    cpu_share = (time.process_time() - cpu) / (time.perf_counter() - wall)
    machine = {"cpus": available_cpus(), "load_average": load, "cpu_share": cpu_share}
    versions = {"uvms_drake": VERSION, "drake": version("drake"),
                "numpy": version("numpy"), "python": platform.python_version()}
    return Bench(scenario.name, versions, machine, controller, derivative, feedback, simulation,
                 solvers, growth)


def load_average() -> list[float] | None:
    """Returns the load average over 1, 5 and 15 minutes; None if unknown."""
    try:
        return list(os.getloadavg())
    except OSError:
        return None


def available_cpus() -> int | None:
    """Returns the number of processors available to this process; None if unknown."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()


def write_bench(bench: Bench, folder: Path) -> None:
    """Writes bench.json."""
    text = json.dumps(jsonable(asdict(bench)), indent=2, allow_nan=False, ensure_ascii=False)
    (folder / BENCH_FILE).write_text(text + "\n", encoding="utf-8")
