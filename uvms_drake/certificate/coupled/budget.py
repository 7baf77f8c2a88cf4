"""The coupled linear budget of a scenario: its sources, margins of stability and conditions."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np

from uvms_drake.actuation.sampled_command import SampledCommand
from uvms_drake.actuation.thrusters import Thrusters
from uvms_drake.certificate.coupled.loop_at_task import loop_parts, press_configuration
from uvms_drake.control.laws.law import AncillaryLaw
from uvms_drake.control.laws.tip_first import BlockGains, TipFirst
from uvms_drake.control.limits import Limits, TubeRadii, joint_limits, resolved_radii
from uvms_drake.control.limits.plan_acceleration import PlanAcceleration
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.signals.command_path import CommandPath
from uvms_drake.model.signals.linear import ErrorChannel
from uvms_drake.model.signals.sensor_actuator import Part
from uvms_drake.sensing.navigation import Navigation
from uvms_drake.station.command_path import command_path_of
from uvms_drake.station.contact.bounds import depth_left, pressing_force, sensed_contact
from uvms_drake.station.scenario.scenario import Scenario
from uvms_drake.tube.conditions import Condition, assumption
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
PLAN_PHASES = 4
"""Number of phases between two knots of a plan at which the rows are looked at."""
POSTURES, STABLE_AT = 2, 10
"""Number of drawn postures at which the sums are computed, and at which stability is checked."""
FARTHEST_PLAN = 1.0
"""Displacement of a plan from the task along an axis without a limit [m, rad]; it has no effect but
of second order."""
MARGIN = 1.5
"""Least multiple of a gain, or of the mean delay of a loop, at which it has to be stable."""
FARTHEST, HALVINGS = 4.0, 5
"""Largest multiple that is tried, and the number of halvings of the interval from 1 to it."""
FRICTION, PLANNED = "friction as any force", "plan"
"""Names of the sources that are no sensor's."""


def has_coupled_budget(law: AncillaryLaw, walls: Sequence[Wall], path: CommandPath) -> bool:
    """Returns whether thrusters are behind a clock, of which no tube is proven.

    Args:
        law: The ancillary law.
        walls: As of `Contact.linear_walls`.
        path: Path of its commands.
    """
    return (bool(walls) and isinstance(law, TipFirst)
            and path.period > 0.0 and path.has_thrusters)


def coupled_budget(scenario: Scenario, model: ContactModel) -> CoupledBudget | None:
    """Returns the budget at the task's posture and the largest sums at drawn ones, or None."""
    walls = scenario.contact.linear_walls(scenario.task.force)
    if not has_coupled_budget(
            scenario.ancillary, walls, command_path_of(scenario.actuation, model)):
        return None
    # The loops at the task, and at drawn postures of the declared set. A plan that slides is looked
    # at on walls without a slope of friction: one that grows with its speed would have no bound.
    limits, contact, force = scenario.limits, sensed_contact(scenario), pressing_force(scenario)
    parts, sticking = loop_parts(scenario, model), [wall for wall in walls if wall.slope == 0.0]
    config = press_configuration(scenario.task, model)
    loops = _loops(parts, walls, config)
    rng = np.random.default_rng(scenario.certificate.seed)
    lower, upper = joint_limits(limits, model.q_lower, model.q_upper)
    at_drawn = [_loops(parts, walls, np.concatenate(
        [np.zeros(5), config[5:6], rng.uniform(lower, upper)])) for _ in range(STABLE_AT)]
    decay = min(loop.system.decay[0] for each in (loops, *at_drawn) for loop in each)

    # Sensors and friction, and the plan, whose own clock makes a longer period.
    rows = loops[0].rows
    q = quantile(len(rows), scenario.duration / STEP, CHANCE)
    sources: tuple[Source, ...] = ()
    elsewhere = np.zeros(len(rows))
    if decay > 0.0:
        bounded = largest_accelerations(limits) is not None
        of_plan = sources_of([
            (loop.system, [_plan(limits, scenario.tube, loop)])
            for loop in _loops(parts, sticking, config, planned=True)],
            () if bounded else (PLANNED,), phases=PLAN_PHASES)
        sources = (*sources_of([
            (loop.system, [*loop.channels, _friction(contact.friction * force, loop)])
            for loop in loops], (FRICTION,)), *of_plan)
        elsewhere = np.max([by_chance((*sources_of(
            [(loop.system, loop.channels) for loop in each], phases=1), *of_plan), q)
            for each in at_drawn[:POSTURES]], axis=0)
    return CoupledBudget(
        rows, sources, CHANCE, q, elsewhere, POSTURES,
        limits_left(limits, depth_left(scenario), scenario.task.posture, model),
        _declared(scenario.tube), tuple(stability(parts, sticking, config)), float(decay))


def _loops(parts: LoopParts, walls: Iterable[Wall], config: np.ndarray, *,
           planned: bool = False) -> list[CoupledLoop]:
    return [coupled_loop(parts, operating_point(parts, config, wall), wall, planned=planned)
            for wall in walls]


def _plan(limits: Limits, tube: TubeRadii, loop: CoupledLoop) -> ErrorChannel:
    """Returns the plan's accelerations; those of an undriven axis, which no plan decides, are 0."""
    bound = largest_accelerations(limits)
    bound = np.ones(loop.at.model.size) if bound is None else bound.copy()
    bound[loop.undriven] = 0.0
    tube, joints = resolved_radii(tube), loop.at.model.num_joints
    speeds = [getattr(limits, key) - (getattr(tube, key) or 0.0) for key in ("nu1", "nu2", "qdot")]
    lower, upper = joint_limits(limits, loop.at.model.q_lower, loop.at.model.q_upper)
    reach = np.concatenate([[FARTHEST_PLAN] * 3, [limits.roll, limits.pitch, FARTHEST_PLAN],
                            upper - lower])
    return ErrorChannel(
        PLANNED, loop.loop.signal_of(loop.entry(PLAN)), bound, kind="steps",
        sums=(np.where(bound > 0.0, np.repeat(speeds, [3, 3, joints]), 0.0),
              np.where(bound > 0.0, reach, 0.0)))


def _friction(force: float, loop: CoupledLoop) -> ErrorChannel:
    return ErrorChannel(FRICTION, loop.loop.signal_of(loop.entry(FORCE_ACROSS)),
                        force * np.ones(2), kind="flow")


def largest_accelerations(limits: Limits) -> np.ndarray | None:
    """Returns the largest |ζ̄̇ᵢ| of a plan (6+n,), if `limits.more` has a `PlanAcceleration`."""
    return next((np.asarray(limit.bound, dtype=float) for limit in limits.more
                 if isinstance(limit, PlanAcceleration)), None)


def limits_left(limits: Limits, depth: float, posture: np.ndarray, model: ContactModel
                ) -> dict[str, float]:
    """Returns the part of the limits that the task leaves to the rows; of the depth it is given."""
    q = np.asarray(posture, dtype=float)
    lower, upper = joint_limits(limits, model.q_lower, model.q_upper)
    out = {"depth": depth, "roll": limits.roll, "pitch": limits.pitch}
    out |= {f"q{j + 1}": float(each) for j, each in enumerate(np.minimum(q - lower, upper - q))}
    out |= {f"q{j + 1} rate": limits.qdot for j in range(len(q))}
    out |= dict.fromkeys(("surge", "sway", "heave"), limits.nu1)
    return out | dict.fromkeys(("roll rate", "pitch rate", "yaw rate"), limits.nu2)


def _declared(tube: TubeRadii) -> dict[str, float]:
    """Returns the radii of a tube that have rows."""
    tube = resolved_radii(tube)
    names = ("depth", "position", "roll", "pitch", "depth_speed", "tip_speed", "nu1", "nu2",
             "joints", "qdot")
    return {name: float(value) for name in names if (value := getattr(tube, name)) is not None}


def stability(parts: LoopParts, walls: Sequence[Wall], config: np.ndarray) -> list[Stability]:
    """Returns the margins of the gains, of the observers and of the delays."""
    # The largest multiple at which the loops are stable, by bisection.
    law = parts.law
    assert isinstance(law, TipFirst)  # or `has_coupled_budget`
    points = [(wall, operating_point(parts, config, wall)) for wall in walls]

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
        for name, scaled in (("gains", ("k", "sigma")), ("observer", ("observer",))):
            gains: BlockGains = getattr(law, key)
            if getattr(gains, scaled[0]) > 0.0:
                def stronger(by: float, key: str = key, gains: BlockGains = gains,
                             scaled: tuple[str, ...] = scaled) -> LoopParts:
                    changed = replace(gains, **{each: by * getattr(gains, each) for each in scaled})
                    other = replace(law)
                    setattr(other, key, changed)
                    return replace(parts, law=other)

                out.append(Stability(f"{key} {name}", "gain", margin(stronger)))
    of_vehicle, of_joints = parts.command_path.mean_delays
    for delayed, mean in ((SampledCommand, of_joints + _age_of_joints(parts)),
                          (Thrusters, of_vehicle)):
        def later(by: float, delayed: type = delayed, mean: float = mean) -> LoopParts:
            return replace(parts, actuation=[
                _later(part, (by - 1.0) * mean, parts) if isinstance(part, delayed) else part
                for part in parts.actuation])

        out.append(Stability(f"delay of {delayed.__name__}", "delay", margin(later)))
    return out


def _age_of_joints(parts: LoopParts) -> float:
    """Returns the mean age of a reading of the joints [s]."""
    return sum(part.joints.latency + 0.5 / part.joints.rate
               for part in parts.sensing if isinstance(part, Navigation))


def _later(part: Part, by: float, parts: LoopParts) -> Part:
    """Returns a clock, or thrusters, with a longer delay, in whole periods of thrusters."""
    if isinstance(part, Thrusters):
        now = part.known(parts.model).dead_time
        return replace(part, dead_time=part.period * round((now + by) / part.period))
    assert isinstance(part, SampledCommand)
    return replace(part, delay=part.delay + round(by, 3))


def conditions_of(budget: CoupledBudget) -> list[Condition]:
    """Returns the conditions: stability with a margin, and the sums within the declared tube.

    Without a bound of the plans' accelerations, the sums are of the sensors alone; that is one that
    is not met.
    """
    out = [Condition("coupled loop, slowest decay at drawn postures and walls [1/s]",
                     budget.decay, ">", 0.0, theorem=STABILITY, topic="coupled loop")]
    out += [Condition(f"coupled loop, stable multiple of {each.loop}", each.margin, ">=",
                      MARGIN, theorem=STABILITY, topic="coupled loop")
            for each in budget.stability]
    if not budget.sources:
        return out
    planned = [each.counted for each in budget.sources if each.name == PLANNED]
    out.append(assumption(
        "coupled linear budget", "whose sums count no plan: its accelerations have no bound",
        0.0 if all(planned) else 1.0, topic="coupled budget", theorem=THEOREM))
    radii = budget.radii(budget.by_chance)
    return out + [
        Condition(f"coupled linear budget by chance, {name} in the declared tube", radii[name],
                  "<=", declared, theorem=THEOREM, topic="coupled budget")
        for name, declared in budget.declared.items()]
