"""The centre of a body's added mass, a check of axes and units that physics gives."""

import numpy as np

from uvms_drake.model.frames.spatial import skew

APART = 1.0
"""Distance of the centres of added mass and of buoyancy, over the edge of a cube of the displaced
volume, from which they are not of one body."""
MIRRORED = 0.1
"""The same from which the centre is looked for on the other side."""
MOST = 5.0
"""Largest added mass of a body over the water that it displaces; of a flat one it is 2 or 3."""


def water_center(M_A: np.ndarray) -> np.ndarray | None:
    """Returns the centre p (3,) [m] about which an added mass couples least; None without coupling.

    M_A about p is Hᵀ M_p H about the origin, H = [I, −S(p); 0, I], so that its upper blocks A and C
    have C = −A S(p) for a body with three planes of symmetry (Fossen 2021, eq. 3.27): p is by least
    squares.

    Args:
        M_A: Added mass (6, 6) about the origin [kg, kg m, kg m²].
    """
    A, C = M_A[:3, :3], M_A[:3, 3:]
    if np.max(np.abs(C)) <= 1e-9 * np.max(np.abs(A)):
        return None
    columns = [-(A @ skew(axis)).ravel() for axis in np.eye(3)]
    return np.asarray(np.linalg.lstsq(np.transpose(columns), C.ravel(), rcond=None)[0])


def center_of_water(M_A: np.ndarray, volume: float, center: np.ndarray, density: float
                    ) -> tuple[str, bool]:
    """Returns where an added mass acts, as a line, and whether that fits to the displaced volume.

    Args:
        M_A: Added mass (6, 6) about the body's origin [kg, kg m, kg m²].
        volume: Displaced volume [m³].
        center: Centre of buoyancy (3,) [m].
        density: Of the water [kg/m³].
    """
    largest, p, edge = float(np.max(np.abs(M_A[:3, :3]))), water_center(M_A), volume ** (1.0 / 3.0)
    if volume > 0.0 and largest > MOST * density * volume:
        return (f"added mass of {largest:.4g} kg, {largest / (density * volume):.3g} times the "
                "displaced water: of a box it is about 1"), False
    line = f"buoyancy at {_row(center)} m, added mass "
    if p is None:
        return line + "without couplings", True
    off, mirrored = float(np.linalg.norm(p - center)), p * [1.0, -1.0, -1.0]
    line += f"by its couplings at {_row(p)} m"
    if volume <= 0.0 or off <= MIRRORED * edge:
        return line, True
    far = f", {off:.3g} m away, of a body of {edge:.3g} m: it may be in other axes"
    if off > 2.0 * float(np.linalg.norm(mirrored - center)):
        return line + far + f"; turned by diag(1, -1, -1) it is at {_row(mirrored)} m", False
    return (line, True) if off <= APART * edge else (line + far + " or units", False)


def _row(values: np.ndarray) -> str:
    return "(" + ", ".join(f"{value:.3g}" for value in np.round(values, 9) + 0.0) + ")"
