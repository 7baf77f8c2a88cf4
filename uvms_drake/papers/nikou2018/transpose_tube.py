"""Tube of the law `transpose` on the dynamics, in χ or, with its joints, in y = (χ, q).

Theorem: papers/nikou2018/theory.md#tube-of-the-law-transpose.
"""

import numpy as np

from uvms_drake.control.limits import TubeRadii
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.papers.nikou2018.comparison_system import (
    THEOREM,
    transpose_tube,
    transpose_velocity_radius,
)
from uvms_drake.papers.nikou2018.constants import TRANSPOSE, TRANSPOSE_JOINTS, lemma_constants
from uvms_drake.papers.nikou2018.transpose import Transpose
from uvms_drake.tube.conditions import Condition, assumption
from uvms_drake.tube.constants import checked_constants
from uvms_drake.tube.law_tube import Basis, LawTube, register_tube
from uvms_drake.tube.row_gains import attitude_radii


def transpose_constants(law: Transpose, weights: np.ndarray) -> tuple[str, ...]:
    """Returns the names of the constants of the law `transpose`."""
    return TRANSPOSE_JOINTS if law.joints else TRANSPOSE


def undetermined_joints(law: Transpose, model: ContactModel) -> Condition:
    """Returns the condition that the tube of the law `transpose` has all joints in it."""
    free = 0 if law.joints else model.num_joints
    return assumption("n", "joints that χ does not determine (the tube is in χ alone)", free,
                      theorem=THEOREM)


def transpose_task_radius(law: Transpose, basis: Basis) -> float:
    """Returns the bound of ‖𝔢‖, or of ‖𝔢_y‖ with joints, under the law `transpose`, or inf."""
    lemma = lemma_constants(basis.constants, joints=law.joints)
    determined = undetermined_joints(law, basis.model).holds
    return transpose_tube(lemma, law.k, law.sigma, basis.d_bound).e if determined else np.inf


@register_tube(Transpose, transpose_constants)
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
    names = transpose_constants(law, basis.weights)
    return LawTube(tube, (*found.conditions, undetermined_joints(law, model)),
                   estimated=tuple(vars(tube)), check=lambda: checked_constants(
                       model, basis.declared, tuple(basis.constants[name] for name in names),
                       basis.settings.seed))

