"""Measures the time of a feedback command, compared with the law `resolved`."""

import time
from dataclasses import dataclass

from pydrake.systems.framework import Context

from uvms_drake.control.feedback.ancillary import AncillaryFeedback
from uvms_drake.control.laws import Resolved
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.station.command_path import command_limits
from uvms_drake.station.diagram import make_station
from uvms_drake.station.scenario.scenario import Scenario
from uvms_drake.studies.bench.bench_plant import leaf_systems, run_instants
from uvms_drake.studies.bench.stopwatch import Effort, Timing


@dataclass(frozen=True)
class FeedbackTimes:
    """Times of a command τ with its limits and geometry, without observers."""

    law: str
    """Name of the scenario's law."""
    command: Timing
    """Time of a command of that law."""
    resolved: Timing
    """Time of a command of `resolved` at the same states, alternating with it."""
    ratio: float
    """Ratio of the medians."""


def measure_feedback(scenario: Scenario, model: ContactModel, effort: Effort
                     ) -> FeedbackTimes | None:
    """Returns the times of commands at instants of a simulation; None if a velocity is the input.

    The inputs of the feedback are fixed beforehand, so that nothing else is timed.
    """
    station = make_station(scenario, model=model)
    found = [leaf for leaf in leaf_systems(station).values() if isinstance(leaf, AncillaryFeedback)]
    if not found:
        return None
    own, other = found[0], AncillaryFeedback(model, Resolved(), command_limits(scenario))
    instants = [own.GetMyContextFromRoot(context) for context in run_instants(
        station, scenario.simulator, scenario.duration, effort)]
    seconds: tuple[list[float], list[float]] = ([], [])
    for i in range(effort.warm_up + effort.rounds * effort.instants):
        for feedback, spent in zip((own, other), seconds, strict=True):
            fixed = _fixed(feedback, own, instants[i % effort.instants])
            begin = time.perf_counter()
            feedback.GetOutputPort("tau").Eval(fixed)
            if i >= effort.warm_up:
                spent.append(time.perf_counter() - begin)
    command, resolved = map(Timing.of, seconds)
    return FeedbackTimes(scenario.law, command, resolved, command.p50 / resolved.p50)


def _fixed(feedback: AncillaryFeedback, own: AncillaryFeedback, context: Context) -> Context:
    """Returns a Context of a feedback with the inputs that the station's own has in another."""
    fixed = feedback.CreateDefaultContext()
    for index in range(own.num_input_ports()):
        port = own.get_input_port(index)
        if port.HasValue(context):
            feedback.get_input_port(index).FixValue(fixed, port.Eval(context))
    return fixed
