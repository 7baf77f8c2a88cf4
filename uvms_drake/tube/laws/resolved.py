"""Tube of the law `resolved` on the dynamics ζ̇ = f(𝔮, ζ) + u + d, ‖Ŵ⁻¹d‖₂ ≤ d̃.

Ŵ is diagonal with a largest entry of 1: ‖d‖₂ ≤ d̃, and a proof for this ball holds. Theorem:
tube/theory.md#tube-of-the-law-resolved.
"""

from dataclasses import replace

import numpy as np

from uvms_drake.control.laws.resolved import Resolved
from uvms_drake.control.limits import TubeRadii
from uvms_drake.tube.conditions import Condition
from uvms_drake.tube.contact.hold import HoldLaw, TipBounds
from uvms_drake.tube.contact.sensor_error import MeasuredForceBounds, SensorEffect, sensor_effect_of
from uvms_drake.tube.contact.tip_motion import TipAcceleration
from uvms_drake.tube.estimates import together
from uvms_drake.tube.law_tube import PROVEN, WEIGHTED, Basis, LawTube, register_tube
from uvms_drake.tube.laws.resolved_image import tube_image
from uvms_drake.tube.row_gains import joint_rate_radius, resolved_tube

ESTIMATED = ("z", "nu1", "nu2", "u", "tau", "between_knots")
"""Estimated radii of `resolved` in a ball of disturbances."""


def resolved_constants(law: Resolved, weights: np.ndarray) -> tuple[str, ...]:
    """Returns the names of the constants of the law `resolved`: norms of the rows of J_xŴ."""
    return tuple(name if np.all(weights == 1.0) else WEIGHTED[name] for name in PROVEN.values())


def resolved_task_radius(law: Resolved, basis: Basis) -> float:
    """Returns the bound of ‖𝔢_y‖ under the law `resolved`."""
    return resolved_tube(law.k, law.sigma, basis.d_bound, basis.row_norm("task")).e


@register_tube(Resolved, resolved_constants)
def resolved_law_tube(law: Resolved, basis: Basis) -> LawTube:
    """Returns the tube of the law `resolved`; see `resolved_tube` and `tube_image`.

    With a sensed contact, the effects of d and of the sensor's errors add up.
    """
    # The rows under d alone, and the additional effect of the force sensor.
    k, sigma, d, settings = law.k, law.sigma, basis.d_bound, basis.settings
    gains = basis.row_norm("position"), basis.row_norm("orientation")
    position, orientation = (resolved_tube(k, sigma, d, each).e for each in gains)
    sensor_effect = SensorEffect() if basis.contact is None else sensor_effect_of(
        basis.model, basis.declared, basis.contact, k, sigma,
        safety_factor=settings.safety_factor, seed=settings.seed)
    image = tube_image(
        basis.model, basis.declared, basis.u_limit, d_bound=d, weights=basis.weights, gains=gains,
        k=k, sigma=sigma, samples=settings.tube_samples, safety_factor=settings.safety_factor,
        seed=settings.seed, sensor_effect=sensor_effect, largest_rate=basis.largest_rate,
        forces=basis.forces)

    # Both parts of each radius add up; along n the sensor's part is smaller than in all directions.
    tip_speed = 2.0 * sigma * position
    sensor_norm = float(np.linalg.norm(
        [sensor_effect.position, sensor_effect.orientation, sensor_effect.p[2]]))
    tube = TubeRadii(
        e=resolved_task_radius(law, basis) + sensor_norm,
        position=position + sensor_effect.position,
        orientation=orientation + sensor_effect.orientation,
        joints=resolved_tube(k, sigma, d, float(np.max(basis.weights[6:], initial=0.0))).e
        + float(sensor_effect.p[2]),
        z=float(np.linalg.norm([image.nu1, image.nu2, image.qdot])), nu1=image.nu1, nu2=image.nu2,
        qdot=image.qdot, tip_speed=tip_speed + sensor_effect.tip_speed, roll=image.roll,
        pitch=image.pitch, u=image.u, tau=image.tau)
    if basis.contact is not None:
        tube = replace(tube, depth=position + sensor_effect.depth,
                       depth_speed=tip_speed + sensor_effect.depth_speed)
    by_d = {"depth": position, "depth_speed": tip_speed, "position": position}
    budget = {name: {"d": by_d[name], **parts} for name, parts in sensor_effect.budget.items()}

    # Radii that are searched for, besides those with a proof.
    condition = Condition("σ, above ω = sup‖J_x⁻¹J̇_x‖", sigma, ">", image.omega,
                          theorem="tube/theory.md#image-of-the-tube-under-the-law-resolved",
                          topic="σ")
    estimated: tuple[str, ...] = ESTIMATED
    if np.any(basis.weights != 1.0) or np.any(sensor_effect.p):
        estimated += ("roll", "pitch")
    if basis.contact is not None and not sensor_effect.proven:
        estimated = tuple(vars(tube))
    check = together(image.check, sensor_effect.check)
    of_others = sensor_effect.of_others
    if of_others is None:
        return LawTube(tube, (condition,), budget, estimated, check)

    def in_hold(force: MeasuredForceBounds, nu2: float, qdot: float) -> TipBounds:
        """Returns the radii for other forces, with the same remainders.

        d moves the tip's rows like the sensor does, by the gain of a rate and with J̃‖𝔯‖.
        """
        effect = of_others(force, nu2, qdot)
        more = effect.z - sensor_effect.z
        by_d = min(tip_speed, joint_rate_radius(
            k, sigma, d * gains[0] + effect.jacobian_rate * d / k))
        return TipBounds(position + effect.depth, position + effect.position,
                         by_d + effect.depth_speed, by_d + effect.tip_speed,
                         image.nu2 + float(more[1]), image.qdot + float(more[2]))

    # The rows turn with J under the filter of k: J̃‖𝔯‖ is an acceleration of its own.
    turned = sensor_effect.jacobian_rate * (float(np.linalg.norm(sensor_effect.r)) + d / k)
    along = TipAcceleration(sensor_effect.depth_by_force, sensor_effect.depth_by_normal,
                            sensor_effect.turning, d * gains[0] + turned)
    return LawTube(tube, (condition,), budget, estimated, check,
                   HoldLaw(in_hold, k, sigma), along)
