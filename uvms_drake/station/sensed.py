"""Dynamic motion against a wall that nobody measured: the contact is felt."""

import math
from dataclasses import replace

import numpy as np
from pydrake.systems.framework import Diagram

from uvms_drake.common.errors import InvalidParameter, require, within
from uvms_drake.control.contact.approach import off_parabola, stopping_room
from uvms_drake.control.contact.felt import ForceSensing, felt, nothing
from uvms_drake.control.contact.front import bounds, safe_depth
from uvms_drake.control.contact.target import AHEAD
from uvms_drake.control.dynamic_ocp import DynamicOcp
from uvms_drake.control.limits import TubeRadii, resolved_radii
from uvms_drake.control.limits.contact import ForceCone, UnderContact
from uvms_drake.control.limits.inputs import InputLimit
from uvms_drake.control.ocp import Ocp
from uvms_drake.control.sensed_tube_mpc import make_sensed_tube_mpc
from uvms_drake.control.tracking_ocp import Aim, TrackingOcp
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.part import ForceReading
from uvms_drake.model.surface import SensedContact
from uvms_drake.station.dynamic import (
    Dynamic,
    command_limits,
    effective_disturbance,
    lateness_of,
    sent_input,
)
from uvms_drake.station.problem import posed_task
from uvms_drake.station.scenario import Scenario
from uvms_drake.tube.conditions import Condition
from uvms_drake.tube.constraint_set import ConstraintSet
from uvms_drake.tube.estimate import Estimate, largest_of, together
from uvms_drake.tube.law_tube import Basis, LawTube
from uvms_drake.tube.sensed import FeltForce, contact_input_rest
from uvms_drake.tube.tip_jerk import JERK, second_jerk, tip_jerk

BETWEEN_KNOTS = 0.12
"""How much faster than its limit at the knots of a plan the tip may be between them, in parts."""
UNEVEN = 1.2
"""Assumed, not proven: by how much the tip's acceleration along n changes from one reading to the
next [m/s²]. Ten times what runs show, with friction that turns and disturbances that aim; forces
aside and disturbances of the main scenario that flip at once, as none does, make 1.1."""
SAFETY_OF_JERK = 1.5
"""Factor of the largest jerk of the tip that was found; see `tip_jerk`."""


class Sensed(Dynamic):
    """Forces move the robot under water, to a wall that it feels and does not know."""

    knows_force = along_run = False
    controller_signals = (*Dynamic.controller_signals, "target", "turn", "safe_depth", "touched",
                          "slope", "contact_depth")

    def make_ocp(self, scenario: Scenario, model: ContactModel) -> TrackingOcp:
        """Returns the problem for every target, with inputs for all contact forces."""
        contact = sensed_contact(scenario)
        y_des, limits = posed_task(scenario, model, accelerations=True)
        cone = ForceCone.of_surface(contact.walls, largest_normal_force(contact))
        limits = {name: UnderContact(limit, cone) if isinstance(limit, InputLimit) else limit
                  for name, limit in limits.items()}
        with within("mpc"):
            return TrackingOcp(model, scenario.mpc, y_des, limits, contact.direction,
                               contact.walls.facets, turn=contact.turn)

    def make_controller(self, scenario: Scenario, model: ContactModel, ocp: DynamicOcp) -> Diagram:
        """Returns the tube-based NMPC that presses where it feels."""
        assert isinstance(ocp, TrackingOcp)
        contact, margin = sensed_contact(scenario), front_margin(scenario)
        force, largest = pressing_force(scenario), largest_force(scenario)
        require(force < largest, "task.force", scenario.task.force, f"less than {largest:.3g} N: "
                "contact.force less what sensor, tube, angle and stiffness take of it")
        for i, step in enumerate(scenario.mission.steps):
            require(step.strongest < largest, f"mission.steps[{i}].force", step.strongest,
                    f"less than {largest:.3g} N, like task.force")
        lateness = lateness_of(scenario, model)
        with within("ancillary"):
            return make_sensed_tube_mpc(
                ocp, scenario.ancillary, contact.walls, sensing_of(scenario),
                force=force, largest=largest, margin=margin,
                limits=command_limits(scenario), lateness=lateness)

    def contact_force(self, scenario: Scenario) -> FeltForce:
        """Returns the forces of all walls of the class, and how they are felt."""
        contact, reading = sensed_contact(scenario), reading_of(scenario)
        speed = fastest_advance(contact)
        return FeltForce(
            size=float(np.hypot(1.0, contact.friction)) * contact.peak(contact.force, speed),
            rate=contact.stiffness * speed, ripple=contact.force * contact.dissipation * speed,
            aside_rate=contact.force_rate, aside_ripple=contact.force_ripple,
            error=float(np.linalg.norm(reading.error[:3])),
            torque_error=float(np.linalg.norm(reading.error[3:])),
            lag=reading.lag, period=reading.period, tool_angle=contact.tool_angle)

    def in_contact(self, tube: LawTube, scenario: Scenario, basis: Basis) -> LawTube:
        """Returns the tube with what the contact's part of the input may differ, and conditions.

        These are that readings are off by no more than what the front is told (for one, the tip
        turns while the sensor averages), that no wall is near during the tare, that the tip is not
        much faster between the knots of a plan, and that the front lets it press as is asked. Where
        there is no tube, its conditions say why.
        """
        if not np.size(tube.radii.u):
            return tube
        contact, settings, declared = sensed_contact(scenario), basis.settings, basis.declared
        radii, felt = resolved_radii(tube.radii), self.contact_force(scenario)
        assert radii.joints is not None and radii.orientation is not None  # they are filled in
        largest = np.hypot(1.0, contact.friction) * largest_normal_force(contact)
        worst, second = contact_input_rest(
            basis.model, declared.q_lower, declared.q_upper, largest, radii.joints,
            radii.orientation, settings.seed)
        aside = np.sqrt(2.0) * contact.walls.tilt  # A facet's part across n.
        planned, cone = slower(declared, radii), contact.tool_angle + np.arctan(aside)
        tip = SAFETY_OF_JERK * tip_jerk(basis.model, planned, scenario.mpc.time_step, cone,
                                        10 * settings.constant_samples, settings.seed)
        jerk = np.hypot(1.0, aside) * tip
        rest = settings.safety_factor * worst
        u_rest, tau_rest = np.split(rest, 2)
        tau = tube.radii.tau
        radii = replace(tube.radii, u=tube.radii.u + u_rest,
                        tau=None if tau is None else tau + tau_rest,
                        between_knots=off_parabola(jerk, scenario.mpc.time_step),
                        **between_knots(planned, scenario.mpc.time_step))
        with_tube = replace(scenario, tube=radii)
        margin = front_margin(with_tube)
        reading, faster = reading_of(scenario), 0.125 * scenario.mpc.time_step**2 * jerk
        off = largest_reading_error(scenario, felt)
        share = max(contact.walls.share, np.finfo(float).tiny)
        room = stopping_room(contact.force, contact.force_error / share, contact.stiffness, margin,
                             retreat=contact.dissipation * fastest_advance(contact))
        return LawTube(radii, (
            *tube.conditions,
            Condition("contact.force_error, not less than the sensor's error",
                      contact.force_error, ">=", off),
            Condition("sensing, the force that is within the range [N]", reading.largest, ">",
                      felt.size + felt.error),
            Condition("contact.clearance, not less than the tip goes during the tare [m]",
                      contact.clearance, ">=",
                      fastest_advance(contact) * reading.tare),
            Condition("contact.speed, what comes to it between two knots [m/s]", faster, "<=",
                      BETWEEN_KNOTS * min(contact.speed, contact.speed_across)),
            Condition("front, room from a reading without touch [m]", room, ">", 0.0),
            Condition("task.force, what the front lets it press [N]", pressing_force(scenario), "<",
                      largest_force(with_tube)),
            *mission_conditions(with_tube)), tube.budget, tube.estimated,
            together(tube.check, lambda: (
                largest_of("what the contact adds to u", rest, second),
                Estimate(JERK, tip, second_jerk(
                    basis.model, planned, scenario.mpc.time_step, cone, settings.seed)))))

    def first_problem(self, scenario: Scenario, model: ContactModel, ocp: Ocp, start: np.ndarray
                      ) -> Ocp:
        """Returns the problem at t = 0: nothing is felt at the start, and the target is ahead."""
        assert isinstance(ocp, TrackingOcp)
        contact, n = sensed_contact(scenario), ocp.direction
        before, sensing = nothing(sensing_of(scenario)), sensing_of(scenario)
        tip = np.append(model.task_pose(start[: model.size])[:3], np.zeros(3))
        known = felt(contact.walls, sensing, np.zeros((2, 2)), before, tip, np.zeros(3))
        margin = front_margin(scenario)
        depth = float(safe_depth(contact.walls, known.apex, tip[:3], margin))
        across = ocp.y_des[:3] - (n @ ocp.y_des[:3]) * n
        return ocp.aimed(Aim(across + (depth + AHEAD) * n,
                             bounds(contact.walls, known.apex, margin)))

    def goal(self, scenario: Scenario, model: ContactModel, logs: dict[str, np.ndarray]
             ) -> np.ndarray:
        """Returns the last target, in the attitude of the task, turned as it is asked to be."""
        pose = super().goal(scenario, model, logs)
        return np.concatenate([logs["target"][-1], pose[3:5], pose[5:] + logs["turn"][-1]])

    def completed(self, scenario: Scenario, model: ContactModel, logs: dict[str, np.ndarray]
                  ) -> dict[str, np.ndarray]:
        """Returns the logs with the effective disturbance, which the sensor's errors are not in."""
        return logs | {"effective_disturbance": effective_disturbance(
            model, logs["state"], sent_input(model, logs), logs["acceleration"], logs["force"])}


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


def largest_reading_error(scenario: Scenario, felt: FeltForce) -> float:
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


def sensing_of(scenario: Scenario) -> ForceSensing:
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
    return ForceSensing(force_max=contact.force, noise=contact.force_error, period=contact.period,
                        window=contact.delay, repeats=repeats, tare=tare, largest=largest)


def fastest_advance(contact: SensedContact) -> float:
    """Returns how fast the tip goes deeper at most [m/s], between the knots of a plan, too."""
    return (1.0 + BETWEEN_KNOTS) * contact.largest_advance


def largest_normal_force(contact: SensedContact) -> float:
    """Returns the largest normal force that is read [N]: that of damping, and the error, too."""
    return contact.peak(contact.force, fastest_advance(contact)) + contact.force_error


def front_margin(scenario: Scenario) -> float:
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
    2E, see `control.contact.target`, and α times what the tip, where it was felt and where it is
    planned to be, may be off across n: 2√2 E_t.
    """
    contact, tube = sensed_contact(scenario), resolved_radii(scenario.tube)
    aside = contact.walls.tilt * 2.0 * float(np.sqrt(2.0)) * (tube.position or 0.0)
    lost = 2.0 * front_margin(scenario) + aside
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
                                        step.strongest, "<", largest_force(scenario)))
        if np.any(step.fastest > 0.0):
            conditions.append(Condition(f"mission.steps[{i}], how fast a plan goes across [m/s]",
                                        float(np.max(step.fastest)), "<=", speed))
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
