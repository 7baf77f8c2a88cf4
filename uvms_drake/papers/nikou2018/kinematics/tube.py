"""Tubes of both laws on the kinematics χ̇ = J(𝔮)ζ + w, ‖w‖₂ ≤ w̃, whose input is ζ.

The radii of 𝔢 are in closed form, the attitude of the vehicle is proven by `attitude_radii`.
Theorem: papers/nikou2018/theory.md#kinematic-tubes.
"""

import math
from typing import NamedTuple

import numpy as np

from uvms_drake.control.laws.resolved import Resolved
from uvms_drake.control.limits import TubeRadii
from uvms_drake.papers.nikou2018.kinematics.velocity_radii import second_velocities, velocity_radii
from uvms_drake.papers.nikou2018.transpose import Transpose
from uvms_drake.papers.nikou2018.transpose_tube import undetermined_joints
from uvms_drake.tube.conditions import Condition
from uvms_drake.tube.constants import checked_constants
from uvms_drake.tube.law_tube import Basis, LawTube, Theories, register_tube
from uvms_drake.tube.row_gains import attitude_radii

KINEMATIC_TUBES: Theories = {}
"""Theories of the laws that have a tube where the velocity is the input."""
KINEMATIC = ("J_min", "J_max", "L_c_chi")
KINEMATIC_JOINTS = ("Jx_inv_max", "Jx_max", "L_c")
"""Constants of the law `transpose`, in χ and in y."""


class KinematicTubes(NamedTuple):
    """Radii of the tube of χ̇ = J(𝔮)ζ + w with the input ζ, the paper's simulation."""

    printed: float
    """Radius w̃/(σJ̲ + L_𝔠) of the paper."""
    corrected: float
    """Radius w̃/(σJ̲ − L_𝔠); inf if the condition fails."""
    resolved: float
    """Radius w̃/σ of the law `resolved`."""
    condition: Condition
    """Condition σJ̲ > L_𝔠 of the law `transpose`; `resolved` needs none."""


def kinematic_tubes(J_min: float, L_c: float, sigma: float, w_bound: float) -> KinematicTubes:
    """Returns the tubes of the kinematic model χ̇ = J(𝔮)ζ + w, ‖w‖₂ ≤ w̃, with the input ζ.

    From 0, `transpose` has ‖𝔢(t)‖ ≤ w̃(1 − e^{−at})/a with a = σJ̲ − L_𝔠, and `resolved` has
    ‖𝔢_y‖ ≤ w̃(1 − e^{−σt})/σ, which a constant w attains. Proof:
    papers/nikou2018/theory.md#kinematic-tubes.

    Args:
        J_min: J̲, smallest eigenvalue of J Jᵀ.
        L_c: L_𝔠, see `LemmaConstants`.
        sigma: σ.
        w_bound: w̃, bound of ‖w‖₂; of w̃ sin(t) in six components it is √6 times the amplitude.
    """
    condition = Condition("σJ̲, above L_c", sigma * J_min, ">", L_c,
                          theorem="papers/nikou2018/theory.md#kinematic-tubes", topic="σ")
    corrected = w_bound / (sigma * J_min - L_c) if condition.holds else math.inf
    return KinematicTubes(
        w_bound / (sigma * J_min + L_c), corrected, w_bound / sigma, condition)


@register_tube(Resolved, theories=KINEMATIC_TUBES)
def resolved_kinematic_tube(law: Resolved, basis: Basis) -> LawTube:
    """Returns the tube of ζ = J_x(𝔮)⁻¹[J_x(𝔮̄)ζ̄ − σ𝔢_y]; it needs no constant."""
    settings, e = basis.settings, basis.d_bound / law.sigma
    nu1, nu2 = velocity_radii(
        basis.model, basis.declared, radius=e, sigma=law.sigma, samples=settings.tube_samples,
        safety_factor=settings.safety_factor, seed=settings.seed)
    roll, pitch = attitude_radii(basis.declared, e)
    tube = TubeRadii(e=e, position=e, orientation=e, joints=0.0, z=float(np.hypot(nu1, nu2)),
                     nu1=nu1, nu2=nu2, qdot=0.0, tip_speed=2.0 * law.sigma * e, roll=roll,
                     pitch=pitch)
    return LawTube(tube, (), estimated=("z", "nu1", "nu2"), check=lambda: second_velocities(
        basis.model, basis.declared, e, law.sigma, (nu1, nu2), settings.seed))


def kinematic_constants(law: Transpose, weights: np.ndarray) -> tuple[str, ...]:
    """Returns the names of the constants of the law `transpose` on the kinematics."""
    return KINEMATIC_JOINTS if law.joints else KINEMATIC


@register_tube(Transpose, kinematic_constants, KINEMATIC_TUBES)
def transpose_kinematic_tube(law: Transpose, basis: Basis) -> LawTube:
    """Returns the tube of ζ = ζ̄ − σJ(𝔮̄)ᵀ𝔢, ‖ζ − ζ̄‖ ≤ σJ̄E; χ has to determine the joints."""
    names = kinematic_constants(law, basis.weights)
    J_min, J_max, L_c = (basis.value(name) for name in names)
    found = kinematic_tubes(J_min**-2 if law.joints else J_min, L_c, law.sigma, basis.d_bound)
    e, num_joints = found.corrected, basis.model.num_joints
    z = law.sigma * J_max * e
    joints = e if law.joints or num_joints == 0 else np.inf
    roll, pitch = attitude_radii(basis.declared, e, joints, num_joints)
    tube = TubeRadii(e=e, position=e, orientation=e, joints=joints, z=z, nu1=z, nu2=z, qdot=z,
                     tip_speed=L_c * e + J_max * z + basis.d_bound,  # 𝔢̇ = 𝔟 + J𝔷 + w
                     roll=roll, pitch=pitch)
    return LawTube(tube, (found.condition, undetermined_joints(law, basis.model)),
                   estimated=tuple(vars(tube)), check=lambda: checked_constants(
                       basis.model, basis.declared,
                       tuple(basis.constants[name] for name in names), basis.settings.seed))
