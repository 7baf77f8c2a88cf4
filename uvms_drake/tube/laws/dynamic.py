"""Tubes of the ancillary laws on the dynamics ζ̇ = f(𝔮, ζ) + u + d, ‖Ŵ⁻¹d‖₂ ≤ d̃.

Ŵ is diagonal with a largest entry of 1: ‖d‖₂ ≤ d̃, and a proof for this ball holds.
A law has a certificate if it is in `DYNAMIC_TUBES`, by its exact type: a proof for one law is none
for a law that is derived from it. Theorems: tube/theory.md#tube-of-the-law-resolved,
tube/theory.md#tube-of-the-law-transpose, tube/theory.md#tube-of-the-law-tip-first.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from uvms_drake.control.laws import Resolved, TipFirst, Transpose
from uvms_drake.control.laws.law import AncillaryLaw
from uvms_drake.control.limits import TubeRadii
from uvms_drake.tube.conditions import Condition, LemmaConstants, paper_conditions
from uvms_drake.tube.constants.constant_check import checked_constants
from uvms_drake.tube.constants.constants import Constant
from uvms_drake.tube.contact.hold import HoldLaw, TipBounds
from uvms_drake.tube.contact.sensor_error import MeasuredForceBounds, sensor_effect_of
from uvms_drake.tube.contact.uneven_motion import TipAcceleration
from uvms_drake.tube.law_tube import PROVEN, WEIGHTED, Basis, LawTube
from uvms_drake.tube.laws.kinematic import undetermined_joints
from uvms_drake.tube.laws.tip_first import tip_first_law_tube
from uvms_drake.tube.loops.row_loop import RowLoop
from uvms_drake.tube.resolved.bounds import (
    attitude_radii,
    joint_rate_radius,
    resolved_tube,
    smallest_k,
    transpose_tube,
    transpose_velocity_radius,
)
from uvms_drake.tube.resolved.image import tube_image
from uvms_drake.tube.resolved.sensor_effect import SensorEffect
from uvms_drake.tube.search.estimate import together

ESTIMATED = ("z", "nu1", "nu2", "u", "tau", "between_knots")
"""Estimated radii of `resolved` in a ball of disturbances."""
TRANSPOSE = ("J_min", "J_max", "J_dot_max", "L_c_chi", "L_1_chi", "L_2")
TRANSPOSE_JOINTS = ("Jx_inv_max", "Jx_max", "J_dot_max", "L_c", "L_1", "L_2")
"""Constants of `transpose`, see `lemma_constants`."""


def dynamic_constants(law: AncillaryLaw, weights: np.ndarray) -> tuple[str, ...]:
    """Returns the names of the constants that the tube of a law is computed from.

    Args:
        law: A law of `DYNAMIC_TUBES`.
        weights: Diagonal of Ŵ, see `Basis`.
    """
    if isinstance(law, Transpose):
        return TRANSPOSE_JOINTS if law.joints else TRANSPOSE
    norms = (name if np.all(weights == 1.0) else WEIGHTED[name] for name in PROVEN.values())
    task, position, orientation = norms
    if isinstance(law, TipFirst):
        return position, "J_dot_max"
    return task, position, orientation


def lemma_constants(constants: dict[str, Constant], *, joints: bool = False) -> LemmaConstants:
    """Returns the constants of the paper's Lemma, Lipschitz constants in χ with q constant.

    With `joints`, those of J_x in y = (χ, q), of which 𝔮 is a function.
    """
    value = {name: constant.value for name, constant in constants.items()}
    if joints:
        return LemmaConstants(
            J_min=value["Jx_inv_max"] ** -2, J_max=value["Jx_max"], J_dot=value["J_dot_max"],
            L_c=value["L_c"], L_1=value["L_1"], L_2=value["L_2"])
    return LemmaConstants(J_min=value["J_min"], J_max=value["J_max"], J_dot=value["J_dot_max"],
                          L_c=value["L_c_chi"], L_1=value["L_1_chi"], L_2=value["L_2"])


def resolved_task_radius(law: Resolved, basis: Basis) -> float:
    """Returns the bound of ‖𝔢_y‖ under the law `resolved`."""
    return resolved_tube(law.k, law.sigma, basis.d_bound, basis.row_norm("task")).e


def transpose_task_radius(law: Transpose, basis: Basis) -> float:
    """Returns the bound of ‖𝔢‖, or of ‖𝔢_y‖ with joints, under the law `transpose`, or inf."""
    lemma = lemma_constants(basis.constants, joints=law.joints)
    determined = undetermined_joints(law, basis.model).holds
    return transpose_tube(lemma, law.k, law.sigma, basis.d_bound).e if determined else np.inf


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
                   HoldLaw(in_hold, RowLoop(k, sigma)), along)


def transpose_law_tube(law: Transpose, basis: Basis) -> LawTube:
    """Returns the tube of the law `transpose`, see `transpose_tube`; of the ball, for any Ŵ.

    In χ alone, the joints are not in this tube: an arm with self-motion is not certified.
    """
    model, lemma = basis.model, lemma_constants(basis.constants, joints=law.joints)
    found = transpose_tube(lemma, law.k, law.sigma, basis.d_bound)
    z = transpose_velocity_radius(found, law.sigma)
    u = np.full(model.size, law.k * found.r)
    joints = found.e if law.joints or model.num_joints == 0 else np.inf
    roll, pitch = attitude_radii(basis.declared, found.e, joints, model.num_joints)
    tube = TubeRadii(e=found.e, position=found.e, orientation=found.e, joints=joints, z=z, nu1=z,
                     nu2=z, qdot=z, tip_speed=lemma.L_c * found.e + lemma.J_max * z,  # 𝔢̇ = 𝔟 + J𝔷
                     roll=roll, pitch=pitch, u=u, tau=np.full_like(u, np.inf))
    names = TRANSPOSE_JOINTS if law.joints else TRANSPOSE
    return LawTube(tube, (*found.conditions, undetermined_joints(law, model)),
                   estimated=tuple(vars(tube)), check=lambda: checked_constants(
                       model, basis.declared, tuple(basis.constants[name] for name in names),
                       basis.settings.seed))


DYNAMIC_TUBES: dict[type[AncillaryLaw], Callable[..., LawTube]] = {
    Resolved: resolved_law_tube, Transpose: transpose_law_tube,
    TipFirst: tip_first_law_tube}
"""Functions from a law and a `Basis` to a `LawTube`, by the law's exact type."""

TASK_RADII: dict[type[AncillaryLaw], Callable[..., float]] = {
    Resolved: resolved_task_radius, Transpose: transpose_task_radius}
"""Functions from a law and a `Basis` to the radius [m, rad] of the error that the law feeds back,
without a search; by the law's exact type."""


def paper_radii(law: AncillaryLaw, basis: Basis) -> dict[str, float]:
    """Returns the radii of the paper's Lemma for the same constants, gains and d̃, to compare.

    They depend on the constants `TRANSPOSE`. Empty for a law whose rows have gains of their own.
    """
    if np.isnan(law.k):
        return {}
    lemma = lemma_constants(basis.constants)
    tubes = paper_conditions(lemma, law.k, law.sigma, basis.d_bound)
    least = smallest_k(lemma)
    return {"printed radius": tubes.printed.e, "corrected radius": tubes.corrected.e,
            "comparison system radius":
                transpose_tube(lemma, law.k, law.sigma, basis.d_bound).e,
            "smallest k": least.k, "at σ": least.sigma}
