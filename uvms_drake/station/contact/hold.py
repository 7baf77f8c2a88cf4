"""Radii in a hold of a sensed contact, from the declared data of a scenario."""

from dataclasses import replace

import numpy as np

from uvms_drake.control.limits.radii import HoldRadii
from uvms_drake.station.contact.bounds import fastest_advance, sensed_contact
from uvms_drake.station.scenario.scenario import Scenario
from uvms_drake.tube.conditions import Condition
from uvms_drake.tube.contact.hold import HoldLaw, settled
from uvms_drake.tube.contact.sensor_error import MeasuredForceBounds
from uvms_drake.tube.ultimate_bounds import error_along

STANDING = np.array([0.002, 0.002, 0.01])
"""Largest speeds of a plan that stands: advance of the tip [m/s], ‖ν̄₂‖ and ‖q̄̇‖ [rad/s]."""


def hold_radii(scenario: Scenario, law: HoldLaw, approach: MeasuredForceBounds, *,
               likely: bool = False) -> tuple[HoldRadii | None, Condition]:
    """Returns the radii in a hold, None if there are none, and the condition for them.

    Args:
        scenario: The scenario.
        law: Radii of its law.
        approach: Forces while a plan moves.
        likely: Whether the tare is as good as the mean of independent noise, see `ForceReading`.
    """
    contact, limits = sensed_contact(scenario), scenario.limits
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

    found = settled(law, approach, np.array([fastest_advance(contact), limits.nu2, limits.qdot]),
                    force, STANDING, contact.walls.tilt)
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
    return HoldRadii(
        time=found.time, depth=found.bounds.depth, position=found.bounds.position,
        advance=float(found.speeds[0]), standing=float(STANDING[0]),
        reading=error_along(reading.error, contact.tool_angle) + reading.payload[0] + float(turned),
        age=age), condition
