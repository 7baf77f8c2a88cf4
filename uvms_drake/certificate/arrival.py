"""Arrival of a press: the nominal closed loop, simulated until a hold is in force.

The controller of the scenario, with its sensors, moves as its plans do: a tip without disturbance
and deviation, on the scenario's own surface. While the robot hovers at its start nothing moves: the
loop is simulated from then on, and its times count from the start of the run. A bound of the force
is worth something only if there is a contact: the plan has to touch and to reach its target within
the duration.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from pydrake.systems.analysis import Simulator

from uvms_drake.common.wiring import release
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.surface.law import check_surface
from uvms_drake.station.contact.bounds import sensed_contact
from uvms_drake.station.contact.tube_in_contact import AT_TARGET, short_of_target, stands
from uvms_drake.station.controller import make_controller
from uvms_drake.station.problem import true_surface
from uvms_drake.station.scenario.scenario import Scenario
from uvms_drake.tube.conditions import Condition, setting

PATIENCE = 6.0
"""Longest time over the duration for which a plan may take to arrive."""
LATER = 10.0
"""Longest time after the arrival until a hold is in force [s]."""
CREEP, STUCK = 1e-4, 5.0
"""Largest speed of a tip that is stuck [m/s], and the time after which it is [s]."""


@dataclass(frozen=True)
class Arrival:
    """Times of the nominal closed loop on the scenario's own surface; inf: never."""

    speed: float
    """Largest speed of the planned tip along the direction, until it touches [m/s]."""
    touch: float
    """First touch [s]."""
    target: float
    """First instant in contact at which the plan is at its target [s]."""
    hold: float
    """Instant from which on a hold is in force [s]."""


def arrival_of(scenario: Scenario, model: ContactModel, start: np.ndarray) -> Arrival:
    """Returns the arrival of a scenario with a sensed contact, and its certified tube.

    It depends on no key that `fingerprint` leaves out: in this loop are no faults, and the
    integration scheme is the default one, see `controller.IMPLICIT`.

    Args:
        scenario: The scenario.
        model: The controller's model.
        start: (𝔮, ζ) (2(6+n),).
    """
    contact, surface = sensed_contact(scenario), check_surface(true_surface(scenario))
    walls, hold, period = contact.walls, scenario.tube.hold, contact.period
    hover = scenario.mpc.hover
    controller = make_controller(replace(
        scenario, seed=0, faults=[], supervisor=None, simulator=type(scenario.simulator)(),
        mpc=replace(scenario.mpc, hover=0.0, deadline=None)), model)
    simulator = Simulator(controller)
    context, time, state = simulator.get_mutable_context(), 0.0, start
    speed, touch, target, still, moved = 0.0, math.inf, math.inf, math.inf, 0.0
    while True:
        # The robot is where its plan is, and the surface answers.
        config, zeta = np.split(state, 2)
        tip = model.tip_kinematics(config)
        velocity = tip.J_chi @ zeta
        controller.GetInputPort("state").FixValue(context, state)
        controller.GetInputPort("force").FixValue(context, surface.force(tip.chi, velocity))
        time += period
        simulator.AdvanceTo(time)
        now = {name: controller.GetOutputPort(name).Eval(context) for name in (
            "nominal_state", "touched", "unclipped_target", "stiffness_used")}
        state = now["nominal_state"]
        # The events.
        touched, stood = bool(now["touched"][0]), bool(stands(model, walls, state))
        moved = time if np.linalg.norm(velocity[:3]) > CREEP else moved
        if touched and math.isinf(touch):
            touch = time
        if math.isinf(touch):
            speed = max(speed, float(walls.depth(velocity[:3])))
        if touched and math.isinf(target) and short_of_target(
                walls, tip.chi[:3], now["unclipped_target"], now["stiffness_used"][0]) <= AT_TARGET:
            target = time
        still = min(still, time) if stood else math.inf
        in_force = hold is not None and touched and target <= time >= still + hold.time
        in_vain = hold is None and math.isfinite(target)
        over = time > (PATIENCE * scenario.duration if math.isinf(target) else target + LATER)
        if in_force or in_vain or over or time - moved > STUCK:
            break
    release(controller)
    return Arrival(speed, hover + touch, hover + target, hover + time if in_force else math.inf)


def arrives(scenario: Scenario, arrival: Arrival) -> Condition:
    """Returns the condition that the task is reached within the duration.

    That of a mission is to reach its first contact, and then takes its shortest time. The time of
    the hover before is a part of `arrival.target`.
    """
    least = sum(step.least_time for step in scenario.mission.steps[1:])
    needed, duration = arrival.target + least, scenario.duration
    return Condition(
        "task reached within the duration, contact and target of the nominal loop [s]", needed,
        "<=", duration, setting(duration=math.ceil(needed))
        if duration < needed < math.inf else "", theorem="control/theory.md#closed-loop-guarantee",
        topic="arrival")
