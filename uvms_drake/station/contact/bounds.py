"""Bounds of forces, errors and margins that follow from the declared data of a sensed contact."""

import math
from dataclasses import replace
from typing import Any

import numpy as np

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.control.contact.contact_state import EstimatorSettings
from uvms_drake.control.limits import TubeRadii, resolved_radii
from uvms_drake.model.signals.sensor_actuator import ForceReading
from uvms_drake.model.surface.unknown_contact import UnknownContact
from uvms_drake.model.uvms import STANDARD_GRAVITY
from uvms_drake.model.uvms_model import read_uvms
from uvms_drake.sensing.force_fault_detector import run_of_frozen
from uvms_drake.station.scenario.contact import SensedContact
from uvms_drake.station.scenario.scenario import Scenario
from uvms_drake.tube.conditions import Condition
from uvms_drake.tube.contact.sensor_error import MeasuredForceBounds
from uvms_drake.tube.search.constraint_set import ConstraintSet

SAFE_REGION = "control/theory.md#safe-region-of-an-unknown-wall"
"""Theorem of the conditions on readings and forces."""
BETWEEN_KNOTS = 0.12
"""Relative excess of the tip's speed over its limit between the knots of a plan."""
TENTH = 0.1
"""Part of a desired force that its error may be at the end of a hold, if nothing is declared."""
LONGEST_FREEZE = 0.25
"""Longest time for which a frozen reading is taken for a force before it is detected [s]; the safe
region allows for it at every reading. A sensor that needs longer has no detection."""

STANDING = np.array([0.002, 0.002, 0.01])
"""Largest speeds of a plan that stands: advance of the tip [m/s], ‖ν̄₂‖ and ‖q̄̇‖ [rad/s]."""
LONGEST_MEAN = 0.8
"""Longest time over which a press averages its readings [s]."""


def sensed_contact(scenario: Scenario) -> SensedContact:
    """Returns the declared data of the wall."""
    wall = scenario.contact.declared_wall()
    assert wall is not None  # Else there is another contact.
    return wall


def reading_of(scenario: Scenario) -> ForceReading:
    """Returns the error bounds of the measured force until the end."""
    reading = known_reading(scenario)
    if reading is not None:
        return reading
    raise InvalidParameter("sensing", scenario.sensing, "with a part that measures the force, such "
                           "as !ForceSensor, for a sensed contact")


def known_reading(scenario: Scenario) -> ForceReading | None:
    """Returns the error bounds of the measured force; None if no part measures it."""
    readings = {i: reading for i, part in enumerate(scenario.sensing) if (
        reading := part.reading(scenario.duration, turning_of(scenario))) is not None}
    if len(readings) > 1:
        first, second, *_ = readings
        raise InvalidParameter(f"sensing[{second}]", type(scenario.sensing[second]).__name__,
                               f"left out: sensing[{first}] measures the force already")
    return next((reading._replace(payload=_read_of_payload(scenario, reading))
                 for reading in readings.values()), None)


def _read_of_payload(scenario: Scenario, reading: ForceReading) -> tuple[float, float]:
    """Returns bounds of the force [N] and torque [N m] that are read of a payload.

    With a tare that is the change since then, at most twice the payload's own wrench:
    sensing/theory.md#reading-of-a-payload.
    """
    payload = scenario.model_error.payload
    if not payload.present:
        return 0.0, 0.0
    water = sum(wave.frequency * float(wave.speed) for wave in scenario.waves)
    force, torque = payload.largest_hold(
        read_uvms(scenario.model).hydrodynamics.fluid_density, STANDARD_GRAVITY, water)
    times = 2.0 if reading.tare > 0.0 else 1.0
    return times * force, times * torque


def largest_reading_error(scenario: Scenario, force: MeasuredForceBounds, uneven: float) -> float:
    """Returns the largest difference of a reading from the normal forces of the last `delay` [N].

    Added is the motion between two readings: damping by a velocity v off the line between them,
    see `safe_region.between_readings`, and the displacement of half a period at v. An
    acceleration that varies by a in a period h makes v = ah/4 at most.

    And 𝔉 has turned with the tip since the reading, R(t)R(s)ᵀ = exp S(ρ), ‖ρ‖ ≤ ω(t − s) in the
    mean: n·(exp S(ρ) − I)𝔉 is at most ‖ρ‖ times 𝔉 across n, F(sin θ + μ cos θ), and ½‖ρ‖² times all
    of it, F√(1 + μ²), of which the mean over ages of T + h, and T² for the spread of a lag, counts.

    Args:
        scenario: The scenario.
        force: Bounds of its forces.
        uneven: a, see `tip_motion.unevenness` [m/s²].
    """
    contact = sensed_contact(scenario)
    unseen = 0.25 * uneven * contact.period * (
        contact.force * contact.dissipation + 0.5 * contact.stiffness * contact.period)
    omega, mu = turning_of(scenario), contact.friction
    turned = contact.force * (
        omega * force.age * (np.sin(contact.angle) + mu * np.cos(contact.angle))
        + 0.5 * omega**2 * (force.age**2 + force.lag**2) * np.hypot(1.0, mu))
    missing = reading_of(scenario).missing(contact.delay)
    return float(force.error + force.size * missing + turned + unseen)


def force_line(scenario: Scenario, force: float) -> float:
    """Returns `contact.force_line` of a desired force [N], its default included [N]."""
    declared = sensed_contact(scenario).force_line
    if declared is not None:
        return declared
    return max(TENTH * force, float(np.max(reading_of(scenario).error[:3])))


def turning_of(scenario: Scenario) -> float:
    """Returns a bound of the angular velocity of the tip [rad/s], whatever the arm."""
    joints = len(np.asarray(scenario.task.posture))
    return scenario.limits.nu2 + float(np.sqrt(joints)) * scenario.limits.qdot


def sensing_of(scenario: Scenario) -> EstimatorSettings:
    """Returns the declared bounds of readings for the contact estimator.

    Equal readings are a fault only if the sensor's noise exceeds its resolution; a sensor slower
    than the detector is read several times for each value.
    """
    contact, reading = sensed_contact(scenario), known_reading(scenario)
    repeats = 0
    if reading is not None and (run := run_of_frozen(reading.repeated)):
        repeats = 2 + math.ceil((run - 1) * reading.period / contact.period - 1e-9)
    if repeats * contact.period > LONGEST_FREEZE:
        repeats = 0
    return EstimatorSettings(
        force_max=contact.force, noise=contact.force_error, period=contact.period,
        window=contact.delay, repeats=repeats, mean=mean_time(scenario))


def mean_time(scenario: Scenario) -> float:
    """Returns the time over which a press averages its readings [s].

    So long that the part of a reading's error that may change at once, of both signs, moves a
    target by κ₊ no faster than a plan that stands. Zero where plans begin at the measured state:
    no hold is claimed of them, and they follow the newest reading sooner.
    """
    if scenario.mpc.initial_state != "nominal":
        return 0.0
    reading = known_reading(scenario)
    if reading is None:
        return LONGEST_MEAN
    swing = 2.0 * float(np.max((reading.error - reading.constant)[:3]))
    return min(LONGEST_MEAN, swing / (sensed_contact(scenario).stiffness * float(STANDING[0])))


def fastest_advance(contact: UnknownContact) -> float:
    """Returns the largest speed of the tip into the wall [m/s], between knots of a plan, too."""
    return (1.0 + BETWEEN_KNOTS) * contact.largest_advance


def largest_normal_force(contact: UnknownContact) -> float:
    """Returns the largest normal force that is read [N]: that of damping, and the error, too."""
    return contact.peak(contact.force, fastest_advance(contact)) + contact.force_error


def safe_depth_margin(scenario: Scenario) -> float:
    """Returns E = E_n + √2 αE_t [m], the largest depth of the real tip beyond the planned one."""
    tube, walls = resolved_radii(scenario.tube), sensed_contact(scenario).walls
    parts = tube.depth, np.sqrt(2.0) * walls.tilt * (tube.position or 0.0), tube.between_knots
    return float(sum(part or 0.0 for part in parts))


def largest_margin(scenario: Scenario, force: float) -> float:
    """Returns the largest E + √2 αE_t [m] of a tube with which the safe region admits a force [N].

    It is half of (F_max − (F + 2ν)/a₋)/κ₊, see `largest_force`.
    """
    contact = sensed_contact(scenario)
    needed = (force + 2.0 * contact.force_error) / contact.walls.share
    return 0.5 * (contact.force - needed) / contact.stiffness


def pressing_force(scenario: Scenario) -> float:
    """Returns the desired force along n [N]."""
    return scenario.task.force_along(sensed_contact(scenario).direction)


def largest_force(scenario: Scenario) -> float:
    """Returns the largest desired force [N].

    The safe region lets the planned tip press at F as long as (F_max − (F + 2ν)/a₋)/κ₊ is more than
    2E, see `control.contact.press_target`, plus α times the tangential errors of the tip at the
    reading and in the plan: 2√2 E_t.
    """
    contact, tube = sensed_contact(scenario), resolved_radii(scenario.tube)
    tangential = contact.walls.tilt * 2.0 * float(np.sqrt(2.0)) * (tube.position or 0.0)
    lost = 2.0 * safe_depth_margin(scenario) + tangential
    left = contact.force - contact.stiffness * lost
    return contact.walls.share * left - 2.0 * contact.force_error


def mission_conditions(scenario: Scenario) -> list[Condition]:
    """Returns the conditions of each mission step on the safe region and the tangential speed.

    They do not depend on place and time of a step: model and limits are the same everywhere, and
    the target is in no limit of a plan (`TrackingOcp`).
    """
    speed = sensed_contact(scenario).speed_across - (resolved_radii(scenario.tube).tip_speed or 0.0)
    conditions = []
    for i, step in enumerate(scenario.mission.steps):
        if step.strongest > 0.0:
            conditions.append(Condition(f"mission.steps[{i}], largest force in the safe region [N]",
                                        step.strongest, "<", largest_force(scenario),
                                        theorem=SAFE_REGION, topic="mission",
                                        about=f"mission.steps[{i}]"))
        if np.any(step.fastest > 0.0):
            conditions.append(Condition(f"mission.steps[{i}], tangential speed of a plan [m/s]",
                                        float(np.max(step.fastest)), "<=", speed,
                                        theorem="control/theory.md#constraint-tightening",
                                        topic="mission", about=f"mission.steps[{i}]"))
    return conditions


def between_knots(planned: ConstraintSet, step: float) -> dict[str, Any]:
    """Returns the largest excess of a plan's angles over limits between two knots that keep them.

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
    """Returns the declared set with the tube's radii subtracted from its speed limits."""
    keys = "nu1", "nu2", "qdot"
    return replace(declared, **{
        key: max(getattr(declared, key) - (getattr(radii, key) or 0.0), 1e-6) for key in keys})
