"""Nominal motion at an instant, with its drift and inertia, for all errors from it."""

from typing import NamedTuple

import numpy as np

from uvms_drake.model.uvms_model import Kinematics, UvmsModel


class NominalMotion(NamedTuple):
    """Nominal motion, maybe complex."""

    config: np.ndarray
    """𝔮̄ (..., 6+n) [m, rad]."""
    zeta: np.ndarray
    """ζ̄ (..., 6+n) [m/s, rad/s]."""
    kinematics: Kinematics
    """Geometry at 𝔮̄."""
    drift: np.ndarray
    """f(𝔮̄, ζ̄) (..., 6+n) [m/s², rad/s²]."""
    M: np.ndarray
    """M(𝔮̄) (..., 6+n, 6+n)."""


def nominal_motion(model: UvmsModel, config: np.ndarray, zeta: np.ndarray) -> NominalMotion:
    """Returns the nominal motion at (𝔮̄, ζ̄) (..., 6+n) each."""
    kinematics = model.kinematics(config)
    return NominalMotion(config, zeta, kinematics, *model.drift_and_inertia(kinematics, zeta))
