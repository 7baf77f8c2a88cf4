"""Constants of (lemma:tube) beside those of `tube.constants`, over a `ConstraintSet`.

    J_min       inf λ_min(J Jᵀ)            J(𝔮) of the paper, χ̇ = J ζ
    Jx_inv_max  sup ‖J_x⁻¹‖                J_x = [J; 0 I], ẏ = J_x ζ, y = (χ, q)
    L_c         sup ‖∂(J_x ζ)/∂y‖          ζ constant [1/s]
    L_c_chi     sup ‖∂(J ζ)/∂χ‖            ζ, q constant [1/s]
    L_1         sup ‖∂f/∂y‖                ζ constant [1/s²]
    L_1_chi     sup ‖∂f/∂χ‖                ζ, q constant [1/s²]
    L_2         sup ‖∂f/∂ζ‖                𝔮 constant [1/s]

A Lipschitz constant in y is that of the whole configuration, ∂𝔮/∂y = Γ J_x⁻¹; one in χ with
constant q, the first six columns of it, is never larger, and meaningless once q ≠ q̄. All are
estimates. See papers/nikou2018/theory.md#tube-of-the-law-transpose.
"""

import numpy as np

from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.frames.euler import COMPLEX_STEP
from uvms_drake.model.frames.spatial import times
from uvms_drake.model.uvms_model import configuration_rate_matrix
from uvms_drake.papers.nikou2018.lemma import LemmaConstants
from uvms_drake.tube.constants import (
    JACOBIAN,
    Constant,
    Matrices,
    MatrixGroup,
    Quantity,
    register_constant,
)

TRANSPOSE = ("J_min", "J_max", "J_dot_max", "L_c_chi", "L_1_chi", "L_2")
TRANSPOSE_JOINTS = ("Jx_inv_max", "Jx_max", "J_dot_max", "L_c", "L_1", "L_2")
"""Constants of `transpose`, in χ and in y, see `lemma_constants`."""


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


def velocity_matrices(model: ContactModel, config: np.ndarray, zeta: np.ndarray) -> Matrices:
    """Returns ∂(J ζ)/∂y (m, 6, 6+n) at m states; the other rows of J_x ζ do not depend on y."""
    J_x = model.task_jacobian(config)
    # J does not depend on where the vehicle is, so three columns of ∂(Jζ)/∂𝔮 are zero.
    steps = 1j * COMPLEX_STEP * np.eye(model.size)[3:]
    J_moved = model.kinematics(config[:, None, :] + steps).J_chi.imag / COMPLEX_STEP
    by_config = np.zeros((len(config), 6, model.size))
    by_config[..., 3:] = np.swapaxes((J_moved @ zeta[:, None, :, None])[..., 0], -1, -2)
    return {"c_y": by_config @ _config_by_y(config, J_x)}


def velocity_product(model: ContactModel, matrix: str, config: np.ndarray, zeta: np.ndarray,
                     v: np.ndarray) -> np.ndarray:
    """Returns ∂(J ζ)/∂y v (m, 6); see `MatrixGroup`."""
    direction = _config_by_y(config, model.task_jacobian(config)) @ v
    moved = config + 1j * COMPLEX_STEP * direction
    return times(model.kinematics(moved).J_chi.imag / COMPLEX_STEP, zeta)


def drift_matrices(model: ContactModel, config: np.ndarray, zeta: np.ndarray) -> Matrices:
    """Returns ∂f/∂y and ∂f/∂ζ (m, 6+n, 6+n) at m states."""
    _, by_config, by_zeta = model.drift_derivatives(config, zeta)
    J_x = model.task_jacobian(config)
    return {"f_y": by_config @ _config_by_y(config, J_x), "f_zeta": by_zeta}


def drift_product(model: ContactModel, matrix: str, config: np.ndarray, zeta: np.ndarray,
                  v: np.ndarray) -> np.ndarray:
    """Returns ∂f/∂y v or ∂f/∂ζ v (m, 6+n); see `MatrixGroup`."""
    if matrix == "f_zeta":
        return model.drift(config.astype(complex), zeta + 1j * COMPLEX_STEP * v).imag / COMPLEX_STEP
    direction = _config_by_y(config, model.task_jacobian(config)) @ v
    moved = config + 1j * COMPLEX_STEP * direction
    return model.drift(moved, zeta.astype(complex)).imag / COMPLEX_STEP


def _config_by_y(config: np.ndarray, J_x: np.ndarray) -> np.ndarray:
    """Returns ∂𝔮/∂y = Γ J_x⁻¹ (m, 6+n, 6+n)."""
    return configuration_rate_matrix(config) @ np.linalg.inv(J_x)


VELOCITY = MatrixGroup(velocity_matrices, velocity_product)
DRIFT = MatrixGroup(drift_matrices, drift_product)

PAPER = {
    "J_min": Quantity(JACOBIAN, "J", sign=-1.0, power=2),
    "Jx_inv_max": Quantity(JACOBIAN, "J_x", sign=-1.0, power=-1),
    "L_c": Quantity(VELOCITY, "c_y", "1/s"),
    "L_c_chi": Quantity(VELOCITY, "c_y", "1/s", columns=slice(0, 6)),
    "L_1": Quantity(DRIFT, "f_y", "1/s²"),
    "L_1_chi": Quantity(DRIFT, "f_y", "1/s²", columns=slice(0, 6)),
    "L_2": Quantity(DRIFT, "f_zeta", "1/s"),
}
"""Constants by name that no law of the package needs."""
for _name, _quantity in PAPER.items():
    register_constant(_name, _quantity)
