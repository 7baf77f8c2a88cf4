"""The hydrodynamic parameters of a robot: one YAML file beside its SDFormat file.

Fossen's order (X, Y, Z, K, M, N), linear before angular, in axes parallel to the body's frame.
Added mass and drag coefficients are positive: M_A = −∂(X, Y, ...)/∂ν̇, f_drag = −D ν.
"""

from dataclasses import dataclass, field
from typing import Annotated

import numpy as np

from uvms_drake.common.constraints import Constraint, NotNegative, Positive, Vector
from uvms_drake.common.errors import InvalidParameter, symmetric_matrix
from uvms_drake.model.frames.spatial import skew

FARTHEST = 10.0
"""Distance from a body's origin at which nothing of a robot is: it is in another unit [m]."""
ROUNDED = 1e-3
"""Difference of mirrored entries of a matrix, over the larger one, that is taken as rounding."""
NEGLIGIBLE = 1e-6
"""The same of entries that are small, over the geometric mean of their two diagonal entries."""

Coefficients = Annotated[np.ndarray, Vector(6), NotNegative]
NEAR = Constraint(f"within {FARTHEST:g} m of the origin of its body: it is farther away, as a "
                  "number in millimetres or centimetres may be",
                  lambda x: np.linalg.norm(x) <= FARTHEST)
Place = Annotated[np.ndarray, Vector(3), NEAR]
"""A point of a robot (3,) [m]."""


@dataclass
class AddedMass:
    """A weightless inertia of the water that moves with the body."""

    matrix: np.ndarray = field(default_factory=lambda: np.zeros(6))
    """M_A about `point`: symmetric positive semidefinite 6×6, or its diagonal [kg, kg m, kg m²]."""
    point: Place = field(default_factory=lambda: np.zeros(3))
    """Point p_BoP_B about which `matrix` is [m]."""

    def check(self) -> None:
        """Raises `InvalidParameter` unless it is one that a body can have."""
        M = np.asarray(self.matrix)
        symmetric_matrix("matrix", np.diag(M) if M.shape == (6,) else _symmetrised(M), 6,
                         definite=False)


@dataclass
class Drag:
    """f = −(linear + quadratic ⊙ |v|) ⊙ v with v the velocity of `point` through the water."""

    linear: Coefficients = field(default_factory=lambda: np.zeros(6))
    """Coefficients of linear drag [N s/m (3), N m s/rad (3)]."""
    quadratic: Coefficients = field(default_factory=lambda: np.zeros(6))
    """Coefficients of quadratic drag [N s²/m² (3), N m s²/rad² (3)]."""
    point: Place = field(default_factory=lambda: np.zeros(3))
    """Point p_BoP_B at which the drag acts [m]."""


@dataclass
class BodyHydrodynamics:
    """Parameters of the water's forces on one rigid body B."""

    displaced_volume: Annotated[float, NotNegative] = 0.0
    """Displaced volume V [m³]: the buoyancy is ρ V g."""
    center_of_buoyancy: Place = field(default_factory=lambda: np.zeros(3))
    """Centre of buoyancy p_BoBb_B [m]."""
    added_mass: list[AddedMass] = field(default_factory=list)
    """External added mass and entrained water; they add up."""
    drag: list[Drag] = field(default_factory=list)
    """Drag at stated points; a slender body wants several of them, strip by strip."""


@dataclass
class HydrodynamicParameters:
    """Parameters of the water's forces on a robot."""

    fluid_density: Annotated[float, Positive] = 1000.0
    """Density ρ of the water [kg/m³]."""
    bodies: dict[str, BodyHydrodynamics] = field(default_factory=dict)
    """Bodies by name in the SDFormat file; a body that is not named feels no water."""


def added_mass_about_origin(added_mass: list[AddedMass]) -> np.ndarray:
    """Returns the sum of M_A (6, 6) about the body's origin Bo, in Fossen's order.

    The velocity of P is V_P = H V_Bo with H = [I, −S(p_BoP); 0, I], so M_Bo = Hᵀ M_P H
    (Fossen 2021, eq. 3.27). It is symmetric to the last digit, if M_P only nearly is.
    """
    total = np.zeros((6, 6))
    for item in added_mass:
        H = np.eye(6)
        H[:3, 3:] = -skew(np.asarray(item.point, dtype=float))
        M = np.asarray(item.matrix, dtype=float)
        total += H.T @ (np.diag(M) if M.ndim == 1 else M) @ H
    return 0.5 * (total + total.T)


def _symmetrised(M: np.ndarray) -> np.ndarray:
    """Returns a 6×6 matrix with its mirrored entries at their mean, or raises naming two of them.

    A published table is rounded, so that mirrored entries may differ in their last digit.
    """
    if M.shape != (6, 6):
        return M
    size = np.maximum(np.abs(M), np.abs(M.T))
    allowed = ROUNDED * size + NEGLIGIBLE * np.sqrt(np.abs(np.outer(np.diag(M), np.diag(M))))
    beyond = np.abs(M - M.T) > allowed
    if np.any(beyond):
        i, j = np.argwhere(beyond)[0]
        raise InvalidParameter(
            "matrix", f"row {i + 1}, column {j + 1}: {M[i, j]:g} against {M[j, i]:g} in row "
            f"{j + 1}, column {i + 1}", f"symmetric, to {100.0 * ROUNDED:g} % of an entry")
    return 0.5 * (M + M.T)


def unequal_entries(parameters: HydrodynamicParameters) -> list[str]:
    """Returns the pairs of mirrored entries that differ and whose mean is taken, a line each."""
    found = []
    for name, body in parameters.bodies.items():
        for k, item in enumerate(body.added_mass):
            M = np.atleast_2d(np.asarray(item.matrix, dtype=float))
            found += [f"bodies.{name}.added_mass[{k}].matrix: row {i + 1}, column {j + 1} is "
                      f"{M[i, j]:g}, and mirrored {M[j, i]:g}: their mean is taken"
                      for i, j in zip(*np.triu_indices(6, 1), strict=True)
                      if M.shape == (6, 6) and M[i, j] != M[j, i]]
    return found

