"""The coupled linear budget of a scenario: its sources, margins of stability and conditions."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np

from uvms_drake.actuation.sampled_command import SampledCommand
from uvms_drake.actuation.thrusters import Thrusters, largest_error, with_errors
from uvms_drake.certificate.coupled.loop_at_task import loop_parts, press_configuration
from uvms_drake.control.laws.law import AncillaryLaw
from uvms_drake.control.laws.tip_first import BlockGains, TipFirst
from uvms_drake.control.limits import Limits, TubeRadii, joint_limits, resolved_radii
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.signals.command_path import CommandPath
from uvms_drake.model.signals.linear import Block, ErrorChannel
from uvms_drake.model.signals.sensor_actuator import Actuator
from uvms_drake.sensing.navigation import Navigation
from uvms_drake.station.command_path import command_path_of
from uvms_drake.station.contact.bounds import depth_left, pressing_force, sensed_contact
from uvms_drake.station.scenario.scenario import Scenario
from uvms_drake.tube.conditions import Condition, assumption
from uvms_drake.tube.coupled.budget import (
    APPROACH,
    DEPTH,
    PLANNED,
    PRESS,
    CoupledBudget,
    Source,
    Stability,
    Stage,
    by_chance,
    quantile,
    sources_of,
)
from uvms_drake.tube.coupled.coupled_loop import (
    FORCE_ACROSS,
    CoupledLoop,
    LoopParts,
    Wall,
    coupled_loop,
    operating_point,
)
from uvms_drake.tube.coupled.periodic import STEP
from uvms_drake.tube.settings import PlanClass

THEOREM = "tube/coupled/theory.md#gains-by-the-pattern-of-an-error"
STABILITY = "tube/coupled/theory.md#coupled-loop"
CHANCE = 1e-3
"""Probability δ of a run in which some row of the linear loop exceeds its sum by chance."""
STAGES = 2
"""Number of stages, at whose instants all rows are looked at."""
POSTURES, STABLE_AT = 2, 10
"""Number of drawn postures at which the sums are computed, and at which stability is checked."""
MARGIN = 1.5
"""Least multiple of a gain, or of the mean delay of a loop, at which it has to be stable."""
FARTHEST, HALVINGS = 4.0, 4
"""Largest multiple that is tried, and the number of halvings of the interval beside `MARGIN`."""
SAME = 1e-6
"""Part of a period by which a delay may be shorter."""
FRICTION, START = "friction as any force", "start"
THRUST = "thrusters off by other signs"
"""Names of the sources that are neither a sensor's nor the plan's."""
SIGNS = 4
"""Number of patterns of signs of the thrusters' errors at which the sums are computed."""


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
    # The loops at the task, and at drawn postures of the declared set, in open water and pressed.
    limits, friction = scenario.limits, sensed_contact(scenario).friction * pressing_force(scenario)
    parts, sticking = loop_parts(scenario, model), [wall for wall in walls if wall.slope == 0.0]
    config = press_configuration(scenario.task, model)
    loops = _loops(parts, walls, config)
    rng = np.random.default_rng(scenario.certificate.seed)
    at_drawn = [_loops(parts, walls, each) for each in drawn_postures(limits, model, config, rng)]
    signed = [_loops(other, walls, config) for other in _other_thrusters(parts, rng)]
    decay = min(loop.system.decay[0] for each in (loops, *at_drawn, *signed) for loop in each)

    # The sources of each stage: sensors and friction, the plan, the start.
    rows = loops[0].rows
    q = quantile(STAGES * len(rows), scenario.duration / STEP, CHANCE)
    stages = []
    if decay > 0.0:
        starts = _starts(scenario, model, loops[0])
        for name, of_stage in ((APPROACH, slice(0, 1)), (PRESS, slice(1, None))):
            others = (*_planned(scenario.certificate.plans, name), Source(
                START, start_rows(loops[of_stage], starts, scenario.mpc.hover), np.zeros(len(rows)),
                random=False))
            if signed:
                others += (_other_signs(loops[of_stage], [each[of_stage] for each in signed], q),)
            sensed = sources_of([(loop.system, [*loop.channels, _friction(friction, loop)])
                                 for loop in loops[of_stage]], q, (FRICTION,))
            sensed_there = [sources_of([(loop.system, loop.channels) for loop in each[of_stage]],
                                       q, phases=1) for each in at_drawn[:POSTURES]]
            elsewhere = [by_chance((*each, *others), q) for each in sensed_there]
            stages.append(Stage(name, (*sensed, *others), np.max(elsewhere, axis=0)))
    return CoupledBudget(
        rows, tuple(stages), CHANCE, q, POSTURES,
        limits_left(limits, depth_left(scenario), scenario.task.posture, model),
        _declared(scenario.tube, loops[0].own), tuple(stability(parts, sticking, config)),
        float(decay), loops[0].own)


def drawn_postures(limits: Limits, model: ContactModel, config: np.ndarray,
                   rng: np.random.Generator) -> list[np.ndarray]:
    """Returns configurations (6+n,) with the yaw of one, and joints uniform within their limits."""
    lower, upper = joint_limits(limits, model.q_lower, model.q_upper)
    return [np.concatenate([np.zeros(5), config[5:6], rng.uniform(lower, upper)])
            for _ in range(STABLE_AT)]


def _loops(parts: LoopParts, walls: Iterable[Wall], config: np.ndarray) -> list[CoupledLoop]:
    return [coupled_loop(parts, operating_point(parts, config, wall), wall) for wall in walls]


def _planned(plans: PlanClass | None, stage: str) -> tuple[Source, ...]:
    """Returns the plan of a stage as a source, if its class is declared."""
    if plans is None:
        return ()
    rows = (plans.approach if stage == APPROACH else plans.press).rows()
    return (Source(PLANNED, rows, np.zeros(len(rows)), random=False),)


def _other_thrusters(parts: LoopParts, rng: np.random.Generator) -> list[LoopParts]:
    """Returns the loop with other signs of the thrusters' errors: all turned, and drawn ones.

    It is empty without errors, and then draws nothing.
    """
    if largest_error(parts.actuation) == 0.0:
        return []

    def drawn(count: int) -> np.ndarray:
        return rng.choice([-1.0, 1.0], count)

    return [replace(parts, actuation=with_errors(parts.actuation, parts.model, shares))
            for shares in (lambda count: -np.ones(count), *[drawn] * (SIGNS - 1))]


def _other_signs(loops: Sequence[CoupledLoop], signed: Sequence[Sequence[CoupledLoop]], q: float
                 ) -> Source:
    """Returns the increase of the sensors' sums by chance by other signs of thrusters' errors.

    Args:
        loops: Loops of a stage, on each wall.
        signed: The same with other signs.
        q: q.
    """
    declared, *other = (
        by_chance(sources_of([(loop.system, loop.channels) for loop in each], q, phases=1), q)
        for each in (loops, *signed))
    more = np.maximum(np.max(other, axis=0) - declared, 0.0)
    return Source(THRUST, more, np.zeros_like(more), random=False)


def _starts(scenario: Scenario, model: ContactModel, loop: CoupledLoop) -> dict[Block, np.ndarray]:
    """Returns the largest size of each component of the blocks that a run does not begin at zero.

    Those of the observers are of masses and currents of the declared sizes and either sign, a
    current from four headings; thrusters' errors, whose effects add up, are of any signs; axes
    that nothing drives are off their equilibrium.
    """
    error, current = scenario.model_error, np.asarray(scenario.current, dtype=float)
    free = scenario.contact.linear_walls(scenario.task.force)[0]
    config = press_configuration(scenario.task, model)
    found: dict[Block, list[np.ndarray]] = {}
    for sign in (1.0, -1.0):
        for heading in (1.0, 1j, -1.0, -1j):
            turned = heading * complex(*current[:2])
            parts = loop_parts(replace(
                scenario, current=np.array([turned.real, turned.imag, current[2]]),
                model_error=replace(error, mass=1.0 + sign * (error.mass - 1.0))), model)
            for block, value in _largest_starts(parts, config, free).items():
                found.setdefault(block, []).append(value)
    out = {block: np.max(values, axis=0) for block, values in found.items()}
    plans, robot = scenario.certificate.plans, loop.robot
    off = np.zeros(robot.size)
    off[loop.undriven] = 0.0 if plans is None else plans.start
    return out | {robot: off}


def _largest_starts(parts: LoopParts, config: np.ndarray, wall: Wall) -> dict[Block, np.ndarray]:
    """Returns the largest size of each component of the blocks that do not begin at zero.

    That is with errors of the thrusters of any signs: each adds its own part.
    """
    def starts(shares: np.ndarray) -> dict[Block, np.ndarray]:
        other = replace(parts, actuation=with_errors(
            parts.actuation, parts.model, lambda count: shares))
        return coupled_loop(other, operating_point(other, config, wall), wall).loop.starts

    each = np.eye(len(parts.command_path.thruster_error) * (largest_error(parts.actuation) > 0.0))
    known = starts(np.zeros(len(each)))
    wrong = [(starts(one), starts(-one)) for one in each]
    return {block: np.abs(value) + sum(
        np.maximum(*(np.abs(other[block] - value) for other in both)) for both in wrong)
        for block, value in known.items()}


def start_rows(loops: Iterable[CoupledLoop], starts: dict[Block, np.ndarray], begin: float
               ) -> np.ndarray:
    """Returns the largest rows (rows,) from a time on by deviations at the start of a run.

    Args:
        loops: The loops.
        starts: Largest size of each component of blocks.
        begin: The time [s].
    """
    out = []
    for loop in loops:
        system = loop.system
        x = np.zeros((len(system.A), sum(len(value) for value in starts.values())))
        column = 0
        for block, value in starts.items():
            of_block = np.arange(len(value))
            x[system.states[block].start + of_block, column + of_block] = value
            column += len(value)
        cycle = system.cycle(len(system.steps) - 1)
        x = np.linalg.matrix_power(cycle, round(begin / float(system.period))) @ x
        largest = np.zeros(len(system.C))
        for _ in range(system.periods):
            largest = np.maximum(largest, np.sum(np.abs(system.C @ x), axis=1))
            x = cycle @ x
        out.append(largest)
    return np.max(out, axis=0)


def _friction(force: float, loop: CoupledLoop) -> ErrorChannel:
    return ErrorChannel(FRICTION, loop.loop.signal_of(loop.entry(FORCE_ACROSS)),
                        force * np.ones(2), kind="flow")


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


def _declared(tube: TubeRadii, own: tuple[str, ...]) -> dict[str, float]:
    """Returns the radii of a tube that have rows of errors."""
    tube = resolved_radii(tube)
    names = ("depth", "position", "roll", "pitch", "depth_speed", "tip_speed", "nu1", "nu2",
             "joints", "qdot")
    return {name: float(value) for name in names
            if name not in own and (value := getattr(tube, name)) is not None}


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

        low, high = (MARGIN, FARTHEST) if stable(MARGIN) else (1.0, MARGIN)
        if high == FARTHEST and stable(high):
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
                later_part(part, (by - 1.0) * mean, parts) if isinstance(part, delayed) else part
                for part in parts.actuation])

        out.append(Stability(f"delay of {delayed.__name__}", "delay", margin(later)))
    return out


def _age_of_joints(parts: LoopParts) -> float:
    """Returns the mean age of a reading of the joints [s]."""
    return sum(part.joints.latency + 0.5 / part.joints.rate
               for part in parts.sensing if isinstance(part, Navigation))


def later_part(part: Actuator, by: float, parts: LoopParts) -> Actuator:
    """Returns a clock, or thrusters, with a longer delay, in whole periods of thrusters."""
    if isinstance(part, Thrusters):
        now = part.known(parts.model).dead_time
        periods = math.ceil((now + by) / part.period - SAME)
        return replace(part, dead_time=part.period * periods)
    assert isinstance(part, SampledCommand)
    return replace(part, delay=part.delay + round(by, 3))


def conditions_of(budget: CoupledBudget) -> list[Condition]:
    """Returns the conditions: stability with a margin, and the sums within the declared tube.

    Without a class of plans the sums count no plan; that is one that is not met. An axis that
    nothing drives follows no plan: the limit on it is the robot's own.
    """
    out = [Condition("coupled loop, slowest decay at drawn postures and walls [1/s]",
                     budget.decay, ">", 0.0, theorem=STABILITY, topic="coupled loop")]
    out += [Condition(f"coupled loop, stable multiple of {each.loop}", each.margin, ">=",
                      MARGIN, theorem=STABILITY, topic="coupled loop")
            for each in budget.stability]
    if not budget.stages:
        return out
    out.append(assumption(
        "coupled linear budget", "whose sums count no plan: no class of plans is declared",
        0.0 if budget.planned else 1.0, topic="coupled budget", theorem=THEOREM))
    out += [Condition(f"coupled linear budget by chance, {row} in what limits leave",
                      budget.row(row), "<=", budget.left[row], theorem=THEOREM,
                      topic="coupled budget") for row in (DEPTH, *budget.own)]
    radii = budget.radii()
    return out + [
        Condition(f"coupled linear budget by chance, {name} in the declared tube", radii[name],
                  "<=", declared, theorem=THEOREM, topic="coupled budget")
        for name, declared in budget.declared.items()]
