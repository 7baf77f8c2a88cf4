"""The coupled linear budget of a scenario: its sources, margins of stability and conditions."""

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np

from uvms_drake.actuation.sampled_command import SampledCommand
from uvms_drake.actuation.thrusters import Thrusters
from uvms_drake.certificate.coupled.loop_at_task import (
    loop_parts,
    press_configuration,
    pressing_wall,
)
from uvms_drake.control.laws.tip_first import TipFirst
from uvms_drake.control.limits import joint_limits, resolved_radii
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.signals.linear import ErrorChannel
from uvms_drake.model.signals.sensor_actuator import Part
from uvms_drake.model.surface import SensedContact
from uvms_drake.sensing.navigation import Navigation
from uvms_drake.station.command_path import command_paths
from uvms_drake.station.contact.bounds import largest_force, pressing_force, sensed_contact
from uvms_drake.station.scenario.scenario import Scenario
from uvms_drake.tube.conditions import Condition
from uvms_drake.tube.coupled.budget import (
    CoupledBudget,
    Source,
    Stability,
    by_chance,
    quantile,
    sources_of,
)
from uvms_drake.tube.coupled.coupled_loop import (
    FORCE_ACROSS,
    PLAN,
    CoupledLoop,
    LoopParts,
    Wall,
    coupled_loop,
    operating_point,
)
from uvms_drake.tube.coupled.periodic import STEP

THEOREM = "tube/coupled/theory.md#gains-by-the-pattern-of-an-error"
STABILITY = "tube/coupled/theory.md#coupled-loop"
CHANCE = 1e-3
"""Probability δ of a run in which some row of the linear loop exceeds its sum by chance."""
SLOPES = 0.0, 300.0
"""Slopes of friction by the tip's speed at which a loop is looked at [N s/m]: of a tip that sticks,
and of one that slips at half of the creep velocity of 25 mm/s under 20 N with μ = 0.2."""
POSTURES, STABLE_AT = 3, 10
"""Number of drawn postures at which the sums are computed, and at which stability is checked."""
MARGIN = 1.5
"""Least multiple of a gain, or of the mean delay of a loop, at which it has to be stable."""
FARTHEST, HALVINGS = 4.0, 5
"""Largest multiple that is tried, and the number of halvings of the interval from 1 to it."""
FRICTION, PLANNED = "friction as any force", "plan"
"""Names of the sources that are no sensor's."""


def has_coupled_budget(scenario: Scenario, model: ContactModel) -> bool:
    """Returns whether a scenario has thrusters behind a clock, of which there is no proven tube."""
    paths = command_paths(scenario, model)
    return (isinstance(scenario.contact, SensedContact) and isinstance(scenario.ancillary, TipFirst)
            and any(path is not None and path.whole and path.period > 0.0 for path in paths)
            and any(path is not None and not path.whole for path in paths))


def coupled_budget(scenario: Scenario, model: ContactModel) -> CoupledBudget:
    """Returns the budget at the task's posture, and the largest sums at drawn ones."""
    parts, walls = loop_parts(scenario, model), walls_of(scenario)
    config = press_configuration(scenario, model)
    loops = _loops(parts, walls, config, planned=True)
    rows = loops[0].rows
    decay = min(loop.system.decay[0] for loop in loops)
    rng = np.random.default_rng(scenario.certificate.seed)
    lower, upper = joint_limits(scenario.limits, model.q_lower, model.q_upper)
    drawn = [np.append(config[:6], rng.uniform(lower, upper)) for _ in range(STABLE_AT)]
    drawn = [_at_pose(model, scenario, each[6:]) for each in drawn]
    at_drawn = [_loops(parts, walls, each, planned=False) for each in drawn]
    decay = min(decay, *(loop.system.decay[0] for each in at_drawn for loop in each))
    q = quantile(len(rows), scenario.duration / STEP, CHANCE)
    none = np.zeros(len(rows))
    sources: tuple[Source, ...] = ()
    elsewhere = none
    if decay > 0.0:
        sources = sources_of(loops, [_further(scenario, loop) for loop in loops], (FRICTION,))
        elsewhere = np.max([by_chance(_random(sources_of(
            each, [()] * len(each), phases=(len(each[0].system.steps) - 1,)), sources), q)
            for each in at_drawn[:POSTURES]], axis=0)
    return CoupledBudget(
        rows, sources, CHANCE, q, elsewhere, POSTURES, limits_left(scenario, model),
        _declared(scenario), tuple(stability(scenario, parts, walls, config)), float(decay))


def _random(sensors: tuple[Source, ...], at_task: tuple[Source, ...]) -> tuple[Source, ...]:
    """Returns the sources of the sensors elsewhere, with the plan's as at the task."""
    return (*sensors, *(each for each in at_task if each.name == PLANNED))


def walls_of(scenario: Scenario) -> list[Wall]:
    """Returns open water, and walls of the class: soft and stiff, without and with friction."""
    contact = sensed_contact(scenario)
    free = Wall(np.asarray(contact.direction, dtype=float))
    return [free, *(pressing_wall(scenario, contact.stiffness, slope) for slope in SLOPES)]


def _loops(parts: LoopParts, walls: Iterable[Wall], config: np.ndarray, *, planned: bool
           ) -> list[CoupledLoop]:
    return [coupled_loop(parts, operating_point(parts, config, wall), wall, planned=planned)
            for wall in walls]


def _at_pose(model: ContactModel, scenario: Scenario, q: np.ndarray) -> np.ndarray:
    """Returns 𝔮 of a level vehicle with these joints, at the heading of the task."""
    heading = press_configuration(scenario, model)[5]
    return np.concatenate([np.zeros(5), [heading], q])


def _further(scenario: Scenario, loop: CoupledLoop) -> list[ErrorChannel]:
    """Returns the plan's accelerations, and friction as any force."""
    entries = {block.name: loop.loop.signal_of(block) for block in loop.system.entries}
    contact = sensed_contact(scenario)
    friction = contact.friction * pressing_force(scenario) * np.ones(2)
    return [ErrorChannel(PLANNED, entries[PLAN], largest_accelerations(scenario)),
            ErrorChannel(FRICTION, entries[FORCE_ACROSS], friction, kind="flow")]


def largest_accelerations(scenario: Scenario) -> np.ndarray:
    """Returns the largest |ζ̄̇ᵢ| of a plan (6+n,), from the limits of the speeds.

    A speed that is within its limit at both ends of an interval changes by twice that at most.
    """
    limits, joints = scenario.limits, len(np.asarray(scenario.task.posture))
    speeds = np.repeat([limits.nu1, limits.nu2, limits.qdot], [3, 3, joints])
    return 2.0 * speeds / scenario.mpc.time_step


def limits_left(scenario: Scenario, model: ContactModel) -> dict[str, float]:
    """Returns the part of the limits that the task leaves to the rows."""
    limits, contact = scenario.limits, sensed_contact(scenario)
    q = np.asarray(scenario.task.posture, dtype=float)
    lower, upper = joint_limits(limits, model.q_lower, model.q_upper)
    # The depth with which the largest force is that of the task: it takes 2 κ per depth.
    depth = (resolved_radii(scenario.tube).depth or 0.0) + (
        largest_force(scenario) - pressing_force(scenario)) / (
            2.0 * contact.stiffness * contact.walls.share)
    out = {"depth": depth, "roll": limits.roll, "pitch": limits.pitch}
    out |= {f"q{j + 1}": float(each) for j, each in enumerate(np.minimum(q - lower, upper - q))}
    out |= {f"q{j + 1} rate": limits.qdot for j in range(len(q))}
    out |= dict.fromkeys(("surge", "sway", "heave"), limits.nu1)
    return out | dict.fromkeys(("roll rate", "pitch rate", "yaw rate"), limits.nu2)


def _declared(scenario: Scenario) -> dict[str, float]:
    """Returns the radii of the scenario's tube that have rows."""
    tube = resolved_radii(scenario.tube)
    names = ("depth", "position", "roll", "pitch", "depth_speed", "tip_speed", "nu1", "nu2",
             "joints", "qdot")
    return {name: float(value) for name in names if (value := getattr(tube, name)) is not None}


def stability(scenario: Scenario, parts: LoopParts, walls: list[Wall], config: np.ndarray
              ) -> list[Stability]:
    """Returns the margins of the gains, of the observers and of the delays."""
    law = scenario.ancillary
    assert isinstance(law, TipFirst)  # or `has_coupled_budget`
    points = [(wall, operating_point(parts, config, wall)) for wall in walls[:2]]

    def margin(changed: Callable[[float], LoopParts]) -> float:
        """Returns the largest multiple up to which all loops are stable."""
        def stable(multiple: float) -> bool:
            other = changed(multiple)
            return all(coupled_loop(other, at, wall).system.stable for wall, at in points)

        low, high = 1.0, FARTHEST
        if stable(high):
            return high
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if stable(middle) else (low, middle)
        return low

    out = []
    for key in ("vehicle", "tip"):
        gains = getattr(law, key)
        out.append(Stability(f"{key} gains", "gain", margin(lambda by, key=key, gains=gains: replace(
            parts, law=replace(law, **{key: replace(
                gains, k=by * gains.k, sigma=by * gains.sigma)})))))
        if gains.observer > 0.0:
            out.append(Stability(f"{key} observer", "gain", margin(
                lambda by, key=key, gains=gains: replace(parts, law=replace(law, **{
                    key: replace(gains, observer=by * gains.observer)})))))
    delays = {"command": (SampledCommand, "delay", parts.delay.joints + _age_of_joints(parts)),
              "thrusters": (Thrusters, "dead_time", parts.delay.vehicle)}
    for name, (kind, key, mean) in delays.items():
        out.append(Stability(f"delay of {name}", "delay", margin(
            lambda by, kind=kind, key=key, mean=mean: replace(parts, actuation=[
                _later(part, kind, key, (by - 1.0) * mean, parts) for part in parts.actuation]))))
    return out


def _age_of_joints(parts: LoopParts) -> float:
    """Returns the mean age of a reading of the joints [s]."""
    return sum(part.joints.latency + 0.5 / part.joints.rate
               for part in parts.sensing if isinstance(part, Navigation))


def _later(part: Part, kind: type, key: str, by: float, parts: LoopParts) -> Part:
    """Returns an actuator with a longer delay, in whole periods of thrusters."""
    if not isinstance(part, kind):
        return part
    if isinstance(part, Thrusters):
        now = part.known(parts.model).dead_time
        return replace(part, dead_time=part.period * round((now + by) / part.period))
    return replace(part, **{key: getattr(part, key) + round(by, 3)})


def conditions_of(budget: CoupledBudget) -> list[Condition]:
    """Returns the conditions: stability with a margin, and the sums within the declared tube."""
    out = [Condition("coupled loop, slowest decay at drawn postures and walls [1/s]",
                     budget.decay, ">", 0.0, theorem=STABILITY, topic="coupled loop")]
    out += [Condition(f"coupled loop, stable multiple of the {each.loop}", each.margin, ">=", MARGIN,
                      theorem=STABILITY, topic="coupled loop") for each in budget.stability]
    if not budget.sources:
        return out
    radii = budget.radii(budget.by_chance)
    return out + [
        Condition(f"coupled linear budget by chance, {name} in the declared tube", radii[name],
                  "<=", declared, theorem=THEOREM, topic="coupled budget")
        for name, declared in budget.declared.items()]
