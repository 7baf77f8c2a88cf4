"""Tube of a law in contact with an unknown wall, and the conditions of its safe region."""

from dataclasses import replace

import numpy as np

from uvms_drake.common.errors import require
from uvms_drake.control.limits import TubeRadii, resolved_radii
from uvms_drake.control.limits.radii import HoldRadii
from uvms_drake.control.plan.plan import off_parabola, stopping_distance
from uvms_drake.model.frames.spatial import times
from uvms_drake.model.surface.surface_class import SurfaceClass
from uvms_drake.model.surface.unknown_contact import UnknownContact
from uvms_drake.model.uvms_model import UvmsModel
from uvms_drake.sensing.force_fault_detector import CHANCE, chance_of_run, run_of_frozen
from uvms_drake.station.contact import bounds
from uvms_drake.station.scenario.scenario import Scenario
from uvms_drake.tube.conditions import Condition
from uvms_drake.tube.contact.hold import HoldLaw, settled
from uvms_drake.tube.contact.sensor_error import MeasuredForceBounds, contact_input_remainder
from uvms_drake.tube.contact.tip_motion import tip_jerk, unevenness
from uvms_drake.tube.estimates import Check, together
from uvms_drake.tube.law_tube import Basis, LawTube
from uvms_drake.tube.search.constraint_set import ConstraintSet
from uvms_drake.tube.ultimate_bounds import error_along

AT_TARGET = 1.0
"""Largest κ̂ℓ of a plan at its target, ℓ its distance from it [N]."""


def stands(model: UvmsModel, walls: SurfaceClass, state: np.ndarray) -> np.ndarray:
    """Returns whether a plan is no faster than `STANDING` (...), in |n·v| + 2α‖P_t v‖.

    Twice, for across n a motion acts on both the target and the force.

    Args:
        model: The controller's model.
        walls: The class of walls.
        state: (𝔮̄, ζ̄) of the plan (..., 2(6+n)).
    """
    config, zeta = np.split(state, 2, axis=-1)
    velocity = times(model.tip_kinematics(config).J_chi[..., :3, :], zeta)
    speeds = np.stack([np.abs(walls.depth(velocity)) + 2.0 * walls.tilt * walls.lateral(velocity),
                       *(np.linalg.norm(zeta[..., part], axis=-1)
                         for part in (slice(3, 6), slice(6, None)))], axis=-1)
    still: np.ndarray = np.all(speeds <= bounds.STANDING, axis=-1)
    return still


def short_of_target(walls: SurfaceClass, tip: np.ndarray, target: np.ndarray,
                    stiffness: np.ndarray) -> np.ndarray:
    """Returns κ̂ℓ of a plan's tip (..., 3), ℓ = |n·𝔪| + α‖P_t 𝔪‖ its distance from a target [N].

    Args:
        walls: The class of walls.
        tip: The plan's tip (..., 3) [m].
        target: The target (..., 3) [m].
        stiffness: κ̂ that it is of (...) [N/m].
    """
    short = target - tip
    size: np.ndarray = stiffness * np.maximum(walls.advance(short), walls.advance(-short))
    return size


def hold_radii(scenario: Scenario, law: HoldLaw, approach: MeasuredForceBounds, *,
               likely: bool = False) -> tuple[HoldRadii | None, Condition]:
    """Returns the radii in a hold, None if there are none, and the condition for them.

    Args:
        scenario: The scenario.
        law: Radii of its law.
        approach: Forces while a plan moves.
        likely: Whether the tare is as good as the mean of independent noise, see `ForceReading`.
    """
    contact, limits = bounds.sensed_contact(scenario), scenario.limits
    reading = approach.reading.likely() if likely else approach.reading
    approach = replace(approach, reading=reading, constant_apart=True)

    def force(advance: float) -> MeasuredForceBounds:
        """Returns the forces of a hold in which the tip advances at no more than that."""
        peak = contact.peak(contact.force, advance)
        return replace(
            approach, size=float(np.hypot(1.0, contact.friction)) * peak,
            rate=contact.stiffness * advance, ripple=peak - contact.force,
            tangential_rate=contact.hold_forces.force_rate,
            tangential_ripple=contact.hold_forces.force_ripple)

    fastest = np.array([bounds.fastest_advance(contact), limits.nu2, limits.qdot])
    found = settled(law, approach, fastest, force, bounds.STANDING, contact.walls.tilt)
    condition = Condition(
        "hold, decay of the speeds to those of the deviation alone, ratio", found.ratio, "<", 1.0,
        theorem="tube/contact/theory.md#tube-in-a-hold", topic="hold")
    if not condition.holds:
        return None, condition
    # The reading turns with the tip, see `bounds.largest_reading_error`.
    joints = len(np.asarray(scenario.task.posture))
    omega = float(found.speeds[1] + np.sqrt(joints) * found.speeds[2])
    mu, age = contact.friction, approach.age
    turned = force(float(found.speeds[0])).size * (
        omega * age * (np.sin(contact.angle) + mu * np.cos(contact.angle)) / np.hypot(1.0, mu)
        + 0.5 * omega**2 * (age**2 + approach.lag**2))
    readings = max(round(bounds.mean_time(scenario) / contact.period), 1)
    return HoldRadii(
        time=found.time + readings * contact.period,
        depth=found.bounds.depth, position=found.bounds.position,
        advance=float(found.speeds[0]), standing=float(bounds.STANDING[0]),
        reading=error_along(reading.error, contact.tool_angle) + reading.payload[0] + float(turned),
        age=age, since=0.5 * contact.period * (1 + readings)), condition


def force_bounds(scenario: Scenario) -> MeasuredForceBounds | None:
    """Returns the bounds of the force of all walls of the class, and of its measurement.

    None: the surface is known, and its force is modelled.
    """
    if scenario.contact.declared_wall() is None:
        return None
    contact, reading = bounds.sensed_contact(scenario), bounds.reading_of(scenario)
    speed = bounds.fastest_advance(contact)
    return MeasuredForceBounds(
        size=float(np.hypot(1.0, contact.friction)) * contact.peak(contact.force, speed),
        rate=contact.stiffness * speed, ripple=contact.force * contact.dissipation * speed,
        tangential_rate=contact.force_rate, tangential_ripple=contact.force_ripple,
        reading=reading, tool_angle=contact.tool_angle)


def in_contact(tube: LawTube, scenario: Scenario, basis: Basis) -> LawTube:
    """Returns the tube with the contact's input error, and the contact's conditions.

    With a known surface, and where a law has no radii of the input, it is the tube as it is.
    """
    measured = force_bounds(scenario)
    if measured is None or not np.size(tube.radii.u):
        return tube
    contact, step = bounds.sensed_contact(scenario), scenario.mpc.time_step
    own = resolved_radii(tube.radii)
    planned = bounds.slower(basis.declared, own)
    remainder, check_remainder = _input_remainder(contact, own, basis)
    jerk, check_jerk = _plan_jerk(contact, planned, basis, step)
    # The tube that plans are tightened by: input errors in contact, and the way between knots.
    u_remainder, tau_remainder = np.split(remainder, 2)
    tau = tube.radii.tau
    radii = replace(tube.radii, u=tube.radii.u + u_remainder,
                    tau=None if tau is None else tau + tau_remainder,
                    between_knots=off_parabola(jerk, step), **bounds.between_knots(planned, step))
    widened = replace(scenario, tube=radii)
    conditions = [
        *_of_sensor(scenario, measured, _unevenness(scenario, tube, measured, jerk)),
        *_of_safe_region(widened, 0.125 * step**2 * jerk), *bounds.mission_conditions(widened)]
    # Smaller radii once a plan stands.
    if tube.hold is not None:
        hold, decay = hold_radii(scenario, tube.hold, measured)
        likely_hold, _ = hold_radii(scenario, tube.hold, measured, likely=True)
        radii = replace(radii, hold=hold, likely_hold=likely_hold)
        conditions.insert(0, decay)
    return tube._replace(
        radii=radii, conditions=(*tube.conditions, *conditions),
        check=together(tube.check, check_remainder, check_jerk))


def _input_remainder(contact: UnknownContact, radii: TubeRadii, basis: Basis
                     ) -> tuple[np.ndarray, Check]:
    """Returns the contact's part of the tube of u and τ (2(6+n),), and its second search."""
    assert radii.joints is not None and radii.orientation is not None  # They are filled in.
    return contact_input_remainder(
        basis.model, basis.declared,
        np.hypot(1.0, contact.friction) * bounds.largest_normal_force(contact),
        radii.joints, radii.orientation, basis.settings)


def _plan_jerk(contact: UnknownContact, planned: ConstraintSet, basis: Basis, step: float
               ) -> tuple[float, Check]:
    """Returns the jerk of a planned tip [m/s³], and its second search.

    By it a plan leaves its limits between knots, with a facet's part across n.
    """
    tangential = np.sqrt(2.0) * contact.walls.tilt
    cone = contact.tool_angle + np.arctan(tangential)
    tip, check = tip_jerk(basis.model, planned, step, cone, 10 * basis.settings.constant_samples,
                          basis.settings.seed)
    return np.hypot(1.0, tangential) * tip, check


def _of_sensor(scenario: Scenario, measured: MeasuredForceBounds, uneven: float
               ) -> list[Condition]:
    """Returns the conditions that a reading has no more than the declared error.

    Nor leaves the sensor's range, nor counts as frozen while the sensor works; and that no wall is
    near during the tare.
    """
    contact, reading = bounds.sensed_contact(scenario), bounds.reading_of(scenario)
    off = bounds.largest_reading_error(scenario, measured, uneven)
    path = bounds.fastest_advance(contact) * reading.tare
    return [
        Condition("contact.force_error, not less than the sensor's error", contact.force_error,
                  ">=", off, f"--set contact.force_error={np.ceil(10.0 * off) / 10.0:.3g}"
                  if np.isfinite(off) else "", theorem=bounds.SAFE_REGION,
                  topic="contact.force_error"),
        Condition("sensing, largest force within the range [N]", reading.largest, ">",
                  measured.size + measured.error, theorem=bounds.SAFE_REGION),
        Condition("sensing, probability that a working sensor is taken for frozen, a reading",
                  chance_of_run(reading.repeated, run_of_frozen(reading.repeated))
                  if bounds.sensing_of(scenario).repeats else 0.0, "<=", CHANCE,
                  theorem="sensing/theory.md#detection-of-a-frozen-force"),
        Condition("contact.clearance, not less than the path of the tip in the tare [m]",
                  contact.clearance, ">=", path,
                  f"--set contact.clearance={np.ceil(1e3 * path) / 1e3:.3g}",
                  theorem=bounds.SAFE_REGION, topic="contact.clearance")]


def _of_safe_region(scenario: Scenario, faster: float) -> list[Condition]:
    """Returns the conditions that the safe region admits the desired force, with the tube in it.

    And that the tip is not much faster between the knots of a plan: by `faster` [m/s].
    """
    contact, margin = bounds.sensed_contact(scenario), bounds.safe_depth_margin(scenario)
    share = max(contact.walls.share, np.finfo(float).tiny)
    free = stopping_distance(
        contact.force, contact.force_error / share, contact.stiffness, margin,
        retreat=contact.dissipation * bounds.fastest_advance(contact))
    most = bounds.BETWEEN_KNOTS * min(contact.speed, contact.speed_across)
    # It is in proportion to the step.
    shorter = np.floor(100.0 * scenario.mpc.time_step * most / max(faster, 1e-9)) / 100.0
    return [
        Condition("contact.speed, excess between two knots [m/s]", faster, "<=", most,
                  f"--set mpc.time_step={shorter:g}" if shorter > 0.0 else "",
                  theorem="control/theory.md#motion-between-two-knots", topic="contact.speed"),
        Condition("safe region, margin from a reading without touch [m]", free, ">", 0.0,
                  theorem=bounds.SAFE_REGION, topic="safe region"),
        Condition("task.force, largest force in the safe region [N]",
                  bounds.pressing_force(scenario), "<", bounds.largest_force(scenario),
                  theorem=bounds.SAFE_REGION, topic="task.force")]


def _unevenness(scenario: Scenario, tube: LawTube, force: MeasuredForceBounds, jerk: float
                ) -> float:
    """Returns the largest variation of the tip's acceleration between two readings [m/s²].

    A knot of a plan is between two readings unless its step is a multiple of their period. The
    velocity of a plan is within its limit at its knots.
    """
    contact, step = bounds.sensed_contact(scenario), scenario.mpc.time_step
    if tube.along is None:
        return np.inf
    require(_multiple(force.period, contact.period), "contact.period", contact.period,
            f"the period of the force sensor, {force.period:g} s, or a whole part of it: a reading "
            "between two instants jumps")
    planned = jerk * contact.period
    if not _multiple(step, contact.period):
        planned += 2.0 * (2.0 * contact.largest_advance / step + 0.5 * jerk * step)
    return unevenness(tube.along, force, contact.period, planned, contact.walls.tilt)


def _multiple(longer: float, period: float) -> bool:
    """Returns whether a time is a whole number of periods, but for rounding."""
    return round(longer / period) >= 1 and bool(
        np.isclose(longer / period, round(longer / period), rtol=0.0, atol=1e-6))
