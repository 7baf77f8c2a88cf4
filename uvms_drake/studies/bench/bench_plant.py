"""Measures the time of the closed loop's derivative, by system."""

import inspect
from collections.abc import Callable, Hashable
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import Context, Diagram, LeafSystem

from uvms_drake.model.contact_model import ContactModel
from uvms_drake.station.diagram import make_station
from uvms_drake.station.scenario.scenario import Scenario
from uvms_drake.studies.bench.stopwatch import (
    REST,
    Effort,
    Stopwatch,
    Timing,
    replaced,
    timings,
)


@dataclass(frozen=True)
class DerivativeTimes:
    """Times of an evaluation of the station's time derivatives by an integrator."""

    evaluations: int
    """Number of measured evaluations."""
    on_surface: int
    """Number of states in contact at which it is evaluated."""
    off_surface: int
    """Number of states off the surface."""
    total: Timing
    """Time of an evaluation."""
    parts: dict[str, Timing]
    """Times by path of the system in the station, for the Python systems in the derivative; `rest`
    is everything else: the MultibodyPlant and Drake."""


def leaf_systems(diagram: Diagram, path: str = "") -> dict[str, LeafSystem]:
    """Returns the leaf systems of a Diagram by path, such as "uvms/surface"."""
    leaves: dict[str, LeafSystem] = {}
    for system in diagram.GetSystems():
        name = path + system.get_name()
        leaves.update(leaf_systems(system, f"{name}/") if isinstance(system, Diagram)
                      else {name: system})
    return leaves


def watched_station(make: Callable[[], Diagram], watch: Stopwatch) -> Diagram:
    """Returns the station that `make` returns, with every system in Python a part of `watch`.

    The functions that Drake calls are timed: those of output ports, and time derivatives. A cache
    entry counts for the system that evaluates it.
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
        station = make()
    for system in leaf_systems(station).values():
        if inspect.isfunction(getattr(type(system), "DoCalcTimeDerivatives", None)):
            system.DoCalcTimeDerivatives = watch.timed(system, system.DoCalcTimeDerivatives)
    return station


def run_instants(station: Diagram, config: SimulatorConfig, duration: float, effort: Effort
                 ) -> list[Context]:
    """Returns Contexts of a station at instants of a simulation, spread over its duration [s]."""
    simulator = Simulator(station)
    ApplySimulatorConfig(config, simulator)
    simulator.set_target_realtime_rate(0.0)
    context = simulator.get_mutable_context()
    duration = min(effort.simulated, duration)
    contexts = []
    for i in range(effort.instants):
        simulator.AdvanceTo((i + 0.5) / effort.instants * duration)
        contexts.append(context.Clone())
    return contexts


def measure_derivative(scenario: Scenario, model: ContactModel, effort: Effort) -> DerivativeTimes:
    """Returns the times of the station's derivative at instants of a simulation.

    Time and state are set before each evaluation, as an integrator does, so that no cached value
    of them remains; the instants alternate.
    """
    watch = Stopwatch()
    station = watched_station(partial(make_station, scenario, model=model), watch)
    names: dict[Hashable, str] = {
        system: path for path, system in leaf_systems(station).items()} | {REST: REST}
    contexts = run_instants(station, scenario.simulator, scenario.duration, effort)
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
    """Returns the penetration of the tip [m] in states (𝔮, ζ) (K, 2(6+n))."""
    return model.surface.penetration(model.task_pose(states[:, : model.size])[:, :6])
