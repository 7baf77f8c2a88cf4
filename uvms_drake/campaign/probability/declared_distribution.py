"""The distribution that runs of a campaign are drawn from, in words and as ranges.

It is the one of `variation.vary` for a scenario with its declared tube and without further errors
of the model.
"""

from collections.abc import Iterator

import numpy as np

from uvms_drake.actuation.thrusters import largest_error
from uvms_drake.campaign import variation
from uvms_drake.campaign.drawn_contact import about_drawn
from uvms_drake.campaign.model_uncertainty import AT_FULL_SIZE
from uvms_drake.plant.model_error import FACTORS
from uvms_drake.plant.unknowns import Unknowns
from uvms_drake.plant.waves import largest_speed
from uvms_drake.station.scenario.scenario import Scenario


def declared_distribution(scenario: Scenario) -> Iterator[str]:
    """Yields a sentence for each part of the distribution."""
    x, _, _, roll, _, yaw = variation.POSE_REACH
    yield (f"start: vehicle uniform within {x:g} m, {roll:g} rad of roll and pitch and {yaw:g} rad "
           "of yaw of the declared pose; the arm uniform on the line from its declared posture to "
           "one that is uniform within its limits; a draw without a feasible first plan is "
           "repeated")
    yield from about_drawn(scenario)
    if sizes := _sizes(scenario.unknowns, largest_error(scenario.actuation)):
        yield (f"unknown, up to: {', '.join(sizes)}; each of either sign, of its full size with "
               f"the probability {AT_FULL_SIZE:g}, else of a uniform part of it")
    if scenario.disturbance.bound > 0.0:
        yield (f"disturbance: random or of any adversary, of the full bound "
               f"{scenario.disturbance.bound:g}")
    yield "sensors: noise, bias and drift as each declares them, with a seed of the run"
    low, high = variation.FAULT_RATES
    yield (f"solver: with the probability {variation.FAULT_LIKELY:g} samples that fail, are late "
           f"or are dropped, each with a probability that is uniform from {low:g} to {high:g}")


def _sizes(unknowns: Unknowns, of_thrusters: float) -> list[str]:
    """Returns the sizes of the declared unknowns, with their names."""
    error, current = unknowns.error, unknowns.current
    sizes = [f"{name.replace('_', ' ')} {abs(getattr(error, name) - 1.0):.3g}" for name in FACTORS
             if getattr(error, name) != 1.0]
    if np.any(error.buoyancy_shift):
        sizes.append(f"centre of buoyancy {np.linalg.norm(error.buoyancy_shift):.3g} m")
    if error.payload.present:
        sizes.append(f"payload {error.payload.mass:g} kg")
    if error.joint_friction.largest > 0.0:
        sizes.append(f"joint friction {error.joint_friction.largest:g} N m")
    if np.any(current):
        sizes.append(f"current {np.hypot(*current[:2]):.3g} m/s from any heading and "
                     f"{abs(current[2]):.3g} m/s up or down")
    if unknowns.waves:
        sizes.append(f"waves {largest_speed(unknowns.waves):.3g} m/s of any heading and phase")
    if of_thrusters > 0.0:
        sizes.append(f"force of each thruster off by {of_thrusters:.3g} of it")
    return sizes


