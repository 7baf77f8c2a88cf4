"""What follows from the numbers that are told of a felt contact: forces, errors, margins."""

import math
from dataclasses import replace

import numpy as np

from uvms_drake.common.errors import InvalidParameter, within
from uvms_drake.control.contact.contact_state import ForceSensorModel
from uvms_drake.control.limits import TubeRadii, resolved_radii
from uvms_drake.model.signals.sensor_actuator import ForceReading
from uvms_drake.model.surface import SensedContact
from uvms_drake.station.scenario.scenario import Scenario
from uvms_drake.tube.conditions import Condition
from uvms_drake.tube.contact.sensor_error import MeasuredForceBounds
from uvms_drake.tube.search.constraint_set import ConstraintSet

SAFE_REGION = "control/theory.md#safe-region-of-an-unknown-wall"
"""Theorem of the conditions on readings and forces."""
BETWEEN_KNOTS = 0.12
"""How much faster than its limit at the knots of a plan the tip may be between them, in parts."""
UNEVEN = 1.2
"""Assumed, not proven: by how much the tip's acceleration along n changes from one reading to the
next [m/s²]. Ten times what runs show, with friction that turns and disturbances that aim; forces
aside and disturbances of the main scenario that flip at once, as none does, make 1.1."""


def sensed_contact(scenario: Scenario) -> SensedContact:
    """Returns what the controller is told of the wall."""
    assert isinstance(scenario.contact, SensedContact)  # Else there is another motion.
    with within("contact"):
        return scenario.contact.checked()


def reading_of(scenario: Scenario) -> ForceReading:
    """Returns what is known of the measured force, until the end."""
    reading = _known_reading(scenario)
    if reading is not None:
        return reading
    raise InvalidParameter("sensing", scenario.sensing, "with a part that measures the force, such "
                           "as !ForceSensor, for a contact that is felt")


def _known_reading(scenario: Scenario) -> ForceReading | None:
    """Returns what is known of the measured force; None: nothing."""
    readings = (part.reading(scenario.duration, turning_of(scenario)) for part in scenario.sensing)
    return next((reading for reading in readings if reading is not None), None)


def largest_reading_error(scenario: Scenario, felt: MeasuredForceBounds) -> float:
    """Returns how far the normal force of a reading may be off those of the last `delay` [N].

    What the front does not see between two readings comes to it: damping by a velocity v off the
    line between them, see `front.between_readings`, and the way of half a period at v. An
    acceleration that changes by a in a period h makes v = ah/4 at most.

    And 𝔉 has turned with the tip since the reading, R(t)R(s)ᵀ = exp S(ρ), ‖ρ‖ ≤ ω(t − s) in the
    mean: n·(exp S(ρ) − I)𝔉 is at most ‖ρ‖ times 𝔉 across n, F(sin θ + μ cos θ), and ½‖ρ‖² times all
    of it, F√(1 + μ²), of which the mean over ages of T + h, and T² for the spread of a lag, counts.
    """
    contact = sensed_contact(scenario)
    unseen = 0.25 * UNEVEN * contact.period * (
        contact.force * contact.dissipation + 0.5 * contact.stiffness * contact.period)
    omega, mu = turning_of(scenario), contact.friction
    turned = contact.force * (
        omega * felt.age * (np.sin(contact.angle) + mu * np.cos(contact.angle))
        + 0.5 * omega**2 * (felt.age**2 + felt.lag**2) * np.hypot(1.0, mu))
    missing = reading_of(scenario).missing(contact.delay)
    return float(felt.error + felt.size * missing + turned + unseen)


def turning_of(scenario: Scenario) -> float:
    """Returns a bound of the angular velocity of the tip [rad/s], whatever the arm."""
    joints = len(np.asarray(scenario.task.posture))
    return scenario.limits.nu2 + float(np.sqrt(joints)) * scenario.limits.qdot


def sensing_of(scenario: Scenario) -> ForceSensorModel:
    """Returns what front and watch are told of the sensor.

    Readings that repeat are looked for only where noise forbids that they do; a sensor that is
    slower than the watch is then seen several times for each reading.
    """
    contact, reading = sensed_contact(scenario), _known_reading(scenario)
    repeats, tare, largest = 0, 0.0, np.inf
    if reading is not None:
        tare, largest = reading.tare, reading.largest
        if reading.noisy:
            repeats = 2 + math.ceil(reading.period / contact.period - 1e-9)
    return ForceSensorModel(force_max=contact.force, noise=contact.force_error, period=contact.period,
                        window=contact.delay, repeats=repeats, tare=tare, largest=largest)


def fastest_advance(contact: SensedContact) -> float:
    """Returns how fast the tip goes deeper at most [m/s], between the knots of a plan, too."""
    return (1.0 + BETWEEN_KNOTS) * contact.largest_advance


def largest_normal_force(contact: SensedContact) -> float:
    """Returns the largest normal force that is read [N]: that of damping, and the error, too."""
    return contact.peak(contact.force, fastest_advance(contact)) + contact.force_error


def safe_depth_margin(scenario: Scenario) -> float:
    """Returns E = E_n + √2 αE_t [m], how far the real tip may be beyond the planned one."""
    tube, walls = resolved_radii(scenario.tube), sensed_contact(scenario).walls
    parts = tube.depth, np.sqrt(2.0) * walls.tilt * (tube.position or 0.0), tube.between_knots
    return float(sum(part or 0.0 for part in parts))


def pressing_force(scenario: Scenario) -> float:
    """Returns the desired force along n [N]."""
    return float(np.asarray(scenario.task.force)[:3] @ sensed_contact(scenario).direction)


def largest_force(scenario: Scenario) -> float:
    """Returns the largest force that may be asked for [N].

    The front lets the planned tip press on at F as long as (F_max − (F + 2ν)/a₋)/κ₊ is more than
    2E, see `control.contact.press_target`, and α times what the tip, where it was felt and where
    it is planned to be, may be off across n: 2√2 E_t.
    """
    contact, tube = sensed_contact(scenario), resolved_radii(scenario.tube)
    aside = contact.walls.tilt * 2.0 * float(np.sqrt(2.0)) * (tube.position or 0.0)
    lost = 2.0 * safe_depth_margin(scenario) + aside
    left = contact.force - contact.stiffness * lost
    return contact.walls.share * left - 2.0 * contact.force_error


def mission_conditions(scenario: Scenario) -> list[Condition]:
    """Returns what each step of a mission needs of the front and of the plan's speed across.

    Where it presses, and when it asks for another place or force, is in none of them: model and
    limits are the same everywhere, and the target is in no limit of a plan (`TrackingOcp`).
    """
    speed = sensed_contact(scenario).speed_across - (resolved_radii(scenario.tube).tip_speed or 0.0)
    conditions = []
    for i, step in enumerate(scenario.mission.steps):
        if step.strongest > 0.0:
            conditions.append(Condition(f"mission.steps[{i}], what the front lets it press [N]",
                                        step.strongest, "<", largest_force(scenario),
                                        theorem=SAFE_REGION))
        if np.any(step.fastest > 0.0):
            conditions.append(Condition(f"mission.steps[{i}], how fast a plan goes across [m/s]",
                                        float(np.max(step.fastest)), "<=", speed,
                                        theorem="control/theory.md#constraint-tightening"))
    return conditions


def between_knots(planned: ConstraintSet, step: float) -> dict[str, float]:
    """Returns how far angles of a plan may be beyond limits between two knots that keep them.

    A joint has a constant acceleration in an interval of length h: if it comes with v and leaves
    with −v, it is vh/4 further in between, and no other with |q̇| ≤ v at both ends is. Of an angle
    that turns by ω at most, it is less than ωh/2: half of the time there, half of it back. Roll and
    pitch change by ‖ν₂‖/cos θ at most, the end-effector turns by ‖ν₂‖ + √n‖q̇‖.

    Args:
        planned: The set of the plans' states.
        step: h [s].
    """
    tool = planned.nu2 + np.sqrt(len(planned.q_lower)) * planned.qdot
    return {"joints_between": 0.25 * step * planned.qdot,
            "attitude_between": 0.5 * step * planned.nu2 / float(np.cos(planned.pitch)),
            "tool_between": 0.5 * step * float(tool)}


def slower(declared: ConstraintSet, radii: TubeRadii) -> ConstraintSet:
    """Returns the set of the planned motion, as far as speeds go."""
    keys = "nu1", "nu2", "qdot"
    return replace(declared, **{
        key: max(getattr(declared, key) - (getattr(radii, key) or 0.0), 1e-6) for key in keys})
