"""Law `transpose` of Nikou, Verginis and Dimarogonas (2018), as its proof needs it, and its tube.

    u = ū − k 𝔷 − k σ J(𝔮̄)ᵀ 𝔢,   𝔢 = χ − χ̄, 𝔷 = ζ − ζ̄, Euler angles compared modulo 2π

does not act on the arm's self-motion; with `joints`, J_x and 𝔢_y take the place of J and 𝔢, and it
does. Its tube needs these constants over a `ConstraintSet`, beside those of `tube.constants`:

    J_inv_max   sup ‖J⁺‖                   J(𝔮) of the paper, χ̇ = J ζ: inf λ_min(J Jᵀ)^(−½)
    Jx_inv_max  sup ‖J_x⁻¹‖                J_x = [J; 0 I], ẏ = J_x ζ, y = (χ, q)
    L_c         sup ‖∂(J_x ζ)/∂y‖          ζ constant [1/s]
    L_c_chi     sup ‖∂(J ζ)/∂χ‖            ζ, q constant [1/s]
    L_1         sup ‖∂f/∂y‖                ζ constant [1/s²]
    L_1_chi     sup ‖∂f/∂χ‖                ζ, q constant [1/s²]
    L_2         sup ‖∂f/∂ζ‖                𝔮 constant [1/s]

A Lipschitz constant in y is that of the whole configuration, ∂𝔮/∂y = Γ J_x⁻¹; one in χ with
constant q, the first six columns of it, is never larger, and meaningless once q ≠ q̄. All are
estimates. Theory: papers/nikou2018/theory.md#tube-of-the-law-transpose.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np

from uvms_drake.common.constraints import Positive
from uvms_drake.common.kinds import register
from uvms_drake.control.laws.law import AncillaryLaw, Deviation, Pair
from uvms_drake.control.limits import TubeRadii
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.frames.euler import pose_difference
from uvms_drake.model.frames.spatial import times
from uvms_drake.model.uvms_model import UvmsModel, configuration_rate_matrix
from uvms_drake.tube.conditions import Condition, assumption
from uvms_drake.tube.constants import (
    Constant,
    Quantity,
    checked_constants,
    register_constant,
)
from uvms_drake.tube.law_tube import Basis, LawTube, register_tube
from uvms_drake.tube.laws.resolved_remainders import jacobian_rate_times
from uvms_drake.tube.row_gains import Tube, attitude_radii, check_gains
from uvms_drake.tube.search.search_problem import Product

THEOREM = "papers/nikou2018/theory.md#tube-of-the-law-transpose"
"""Theorem of the conditions of `transpose_tube`."""
DIFFERENCE = 1e-5
"""Step of the derivatives of f [s]."""
TRANSPOSE = ("J_inv_max", "J_max", "J_dot_max", "L_c_chi", "L_1_chi", "L_2")
TRANSPOSE_JOINTS = ("Jx_inv_max", "Jx_max", "J_dot_max", "L_c", "L_1", "L_2")
"""Constants of `transpose`, in χ and in y, see `lemma_constants`."""


@register
@dataclass
class Transpose(AncillaryLaw):
    """The law `transpose` and its gains."""

    k: Annotated[float, Positive] = 20.0
    """Gain of the velocity error [1/s]."""
    sigma: Annotated[float, Positive] = 1.0
    """σ, gain of the task error [1/s]."""
    joints: bool = False
    """Whether 𝔢_y is fed back with J_x instead of 𝔢 with J: the arm's self-motion too, which the
    paper's law leaves alone, and without which no tube protects the joints."""

    @property
    def protects_joints(self) -> bool:  # noqa: D102  see AncillaryLaw
        return self.joints

    @property
    def fed_back(self) -> slice:
        """Rows of 𝔢_y and J_x that are fed back."""
        return slice(None) if self.joints else slice(0, 6)

    def command(self, model: UvmsModel, now: Pair, nominal_acceleration: Callable[[], np.ndarray],
                nominal_input: Callable[[], np.ndarray]) -> np.ndarray:
        """Returns u = ū − k𝔷 − kσJ(𝔮̄)ᵀ𝔢; it reads ū only."""
        error = pose_difference(*now.y)[self.fed_back]
        z, J = now.zeta[0] - now.zeta[1], now.J_x[1, self.fed_back]
        return nominal_input() - self.k * z - self.k * self.sigma * J.T @ error

    def deviation(self, now: Pair) -> Deviation:
        """Returns the errors; 𝔯 = 𝔷 + σJ(𝔮̄)ᵀ𝔢."""
        e_y, z = pose_difference(*now.y), now.zeta[0] - now.zeta[1]
        task = e_y[self.fed_back]
        return Deviation(task, e_y, z, z + self.sigma * now.J_x[1, self.fed_back].T @ task)


# Tube ---------------------------------------------------------------------------------------------


class LemmaConstants(NamedTuple):
    """Constants of (lemma:tube) over the constraint sets; 𝔮 is taken for a function of χ."""

    J_min: float
    """J̲, smallest eigenvalue of J Jᵀ: of order ‖J‖², in spite of its name."""
    J_max: float
    """J̄, largest ‖J‖₂."""
    J_dot: float
    """J̃, largest ‖J̇‖₂ along the nominal motion [1/s]."""
    L_c: float
    """L_𝔠: ‖(J(𝔮) − J(𝔮̄))ζ‖ ≤ L_𝔠‖𝔢‖, for the speeds of the real ζ [1/s]."""
    L_1: float
    """‖f(𝔮, ζ) − f(𝔮̄, ζ)‖ ≤ L₁‖𝔢‖ [1/s²]."""
    L_2: float
    """‖f(𝔮̄, ζ) − f(𝔮̄, ζ̄)‖ ≤ L₂‖𝔷‖ [1/s]."""


def lemma_constants(constants: dict[str, Constant], *, joints: bool = False) -> LemmaConstants:
    """Returns the constants of the paper's Lemma, Lipschitz constants in χ with q constant.

    With `joints`, those of J_x in y = (χ, q), of which 𝔮 is a function.
    """
    first, *others = (constants[name].value for name in (TRANSPOSE_JOINTS if joints else TRANSPOSE))
    return LemmaConstants(first**-2, *others)


def transpose_tube(constants: LemmaConstants, k: float, sigma: float, d_bound: float) -> Tube:
    """Returns the tube of 𝔢 = χ − χ̄ under the law `transpose`, u = ū − k𝔯, 𝔯 = 𝔷 + σJ(𝔮̄)ᵀ𝔢.

    E and R of (1) of `tube.row_gains` with

        a = σJ̲ − L_𝔠,   g = J̄,   b = k − L₂ − σJ̄²,
        G = L₁ + L₂σJ̄ + σL_𝔠J̄ + σJ̃ + σ²J̄³,

    if a > 0, b > 0 and ab > J̄G; then ‖𝔷‖ ≤ R + σJ̄E. Proof:
    papers/nikou2018/theory.md#tube-of-the-law-transpose.

    Args:
        constants: Constants of the robot over its constraint sets, with their assumptions.
        k: Velocity gain [1/s].
        sigma: σ.
        d_bound: d̃, bound of ‖d‖₂.
    """
    check_gains(k, sigma, d_bound)
    c, J = constants, constants.J_max
    a = sigma * c.J_min - c.L_c
    b = k - c.L_2 - sigma * J**2
    G = c.L_1 + sigma * (c.L_2 * J + c.L_c * J + c.J_dot) + sigma**2 * J**3
    return Tube(a, J, G, b, d_bound, (
        Condition("a = σJ̲ − L_c", a, ">", 0.0, theorem=THEOREM, topic="a"),
        Condition("b = k − L₂ − σJ̄²", b, ">", 0.0, theorem=THEOREM, topic="b"),
        # The product of two negative numbers does not count.
        Condition("ab, above J̄G", a * b if min(a, b) > 0.0 else -abs(a * b), ">", J * G,
                  theorem=THEOREM, topic="ab")))


def undetermined_joints(law: Transpose, model: ContactModel) -> Condition:
    """Returns the condition that the tube of the law `transpose` has all joints in it."""
    free = 0 if law.joints else model.num_joints
    return assumption("n", "joints that χ does not determine (the tube is in χ alone)", free,
                      theorem=THEOREM)


@register_tube(Transpose, lambda law, weights: TRANSPOSE_JOINTS if law.joints else TRANSPOSE)
def transpose_law_tube(law: Transpose, basis: Basis) -> LawTube:
    """Returns the tube of the law `transpose`, see `transpose_tube`; of the ball, for any Ŵ.

    In χ alone, the joints are not in this tube: an arm with self-motion is not certified.
    """
    model, lemma = basis.model, lemma_constants(basis.constants, joints=law.joints)
    found = transpose_tube(lemma, law.k, law.sigma, basis.d_bound)
    z = found.r + law.sigma * found.g * found.e  # 𝔷 = 𝔯 − σJ(𝔮̄)ᵀ𝔢
    u = np.full(model.size, law.k * found.r)
    joints = found.e if law.joints or model.num_joints == 0 else np.inf
    roll, pitch = attitude_radii(
        basis.declared, model.R_WT, found.e, joints, model.num_joints)
    tube = TubeRadii(e=found.e, position=found.e, orientation=found.e, joints=joints, z=z, nu1=z,
                     nu2=z, qdot=z, tip_speed=lemma.L_c * found.e + lemma.J_max * z,  # 𝔢̇ = 𝔟 + J𝔷
                     roll=roll, pitch=pitch, u=u, tau=np.full_like(u, np.inf))
    names = TRANSPOSE_JOINTS if law.joints else TRANSPOSE
    return LawTube(tube, (*found.conditions, undetermined_joints(law, model)),
                   estimated=tuple(vars(tube)), check=lambda: checked_constants(
                       model, basis.declared, tuple(basis.constants[name] for name in names),
                       basis.settings.seed))


# Constants ----------------------------------------------------------------------------------------


def pseudo_inverse(model: ContactModel, config: np.ndarray, zeta: np.ndarray, w: np.ndarray
                   ) -> np.ndarray:
    """Returns J⁺w = Jᵀ(J Jᵀ)⁻¹w (..., 6+n), of the first six of w."""
    J = model.task_jacobian(config)[..., :6, :]
    return times(J.swapaxes(-1, -2), times(np.linalg.inv(J @ J.swapaxes(-1, -2)), w[..., :6]))


def inverse(model: ContactModel, config: np.ndarray, zeta: np.ndarray, w: np.ndarray
            ) -> np.ndarray:
    """Returns J_x⁻¹w (..., 6+n)."""
    return times(np.linalg.inv(model.task_jacobian(config)), w)


def velocity_by_y(model: ContactModel, config: np.ndarray, zeta: np.ndarray, w: np.ndarray
                  ) -> np.ndarray:
    """Returns ∂(J ζ)/∂y w (..., 6): J̇ζ along 𝔮̇ = ΓJ_x⁻¹w; the other rows are constant in y."""
    kinematics = model.kinematics(config)
    along = times(np.linalg.inv(model.extended(kinematics.J_chi)), w)
    return jacobian_rate_times(kinematics, along, zeta)[..., :6]


def drift_by_y(model: ContactModel, config: np.ndarray, zeta: np.ndarray, w: np.ndarray
               ) -> np.ndarray:
    """Returns ∂f/∂y w (..., 6+n), by a difference along 𝔮̇ = ΓJ_x⁻¹w."""
    along = times(configuration_rate_matrix(config), inverse(model, config, zeta, w))
    zeta = zeta + 0.0 * along
    ends = (model.drift(config + side * along, zeta) for side in (DIFFERENCE, -DIFFERENCE))
    return np.subtract(*ends) / (2.0 * DIFFERENCE)


def drift_by_zeta(model: ContactModel, config: np.ndarray, zeta: np.ndarray, w: np.ndarray
                  ) -> np.ndarray:
    """Returns ∂f/∂ζ w (..., 6+n), likewise."""
    config = config + 0.0 * w
    ends = (model.drift(config, zeta + side * w) for side in (DIFFERENCE, -DIFFERENCE))
    return np.subtract(*ends) / (2.0 * DIFFERENCE)


def of_chi(product: Product) -> Product:
    """Returns the product of the first six columns alone."""
    def of_six(model: ContactModel, config: np.ndarray, zeta: np.ndarray, w: np.ndarray
               ) -> np.ndarray:
        return product(model, config, zeta, w * (np.arange(model.size) < 6))

    return of_six


PAPER = {
    "J_inv_max": Quantity(pseudo_inverse),
    "Jx_inv_max": Quantity(inverse),
    "L_c": Quantity(velocity_by_y, "1/s"),
    "L_c_chi": Quantity(of_chi(velocity_by_y), "1/s"),
    "L_1": Quantity(drift_by_y, "1/s²"),
    "L_1_chi": Quantity(of_chi(drift_by_y), "1/s²"),
    "L_2": Quantity(drift_by_zeta, "1/s"),
}
"""Constants by name that no law of the package needs."""
for _name, _quantity in PAPER.items():
    register_constant(_name, _quantity)
