"""Distance to the end of a safe cone, see `control.contact.safe_region`."""

import numpy as np

from uvms_drake.model.surface.surface_class import SurfaceClass


def free_distance(surface: SurfaceClass, at: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Returns the distance along n from 𝔭 (..., 3) to the end of an apex's cone (...) [m].

    It is −⟨𝔭 − 𝔞⟩, below zero outside; −inf for an apex that is NaN.
    """
    distance = -surface.advance(point - at)
    return np.where(np.isnan(distance), -np.inf, distance)
