"""Errors of the surface: differences of the simulated surface from the controller's."""

from dataclasses import dataclass, field
from typing import Annotated

import numpy as np

from uvms_drake.common.constraints import Between, Constraint, Vector
from uvms_drake.model.frames.spatial import skew
from uvms_drake.model.surface.law import Surface

Rotation = Constraint("a rotation of at most π", lambda x: np.linalg.norm(x) <= np.pi)


@dataclass
class SurfaceError:
    """Difference of the simulated surface from the controller's: stiffness, shift and turn."""

    stiffness: Annotated[float, Between(0.01, 100)] = 1.0
    """Factor of the stiffness: the true one over the controller's."""
    shift: Annotated[np.ndarray, Vector(3)] = field(default_factory=lambda: np.zeros(3))
    """Shift of the surface in Σ_I [m]."""
    turn: Annotated[np.ndarray, Vector(3), Rotation] = field(default_factory=lambda: np.zeros(3))
    """Rotation vector in Σ_I, about the surface's anchor [rad]."""

    @property
    def size(self) -> float:
        """Largest of relative error, ‖shift‖ and ‖turn‖; zero if there is none."""
        return max(abs(self.stiffness - 1.0), float(np.linalg.norm(self.shift)),
                   float(np.linalg.norm(self.turn)))


def displaced(surface: Surface, error: SurfaceError) -> Surface:
    """Returns the simulated surface for the controller's `surface`, turned about its anchor."""
    if error.size == 0.0:
        return surface
    R, anchor = rotation_by(error.turn), np.asarray(surface.anchor, dtype=float)
    return surface.stiffened(error.stiffness).moved(R, anchor - R @ anchor + error.shift)


def rotation_by(turn: np.ndarray) -> np.ndarray:
    """Returns R (3, 3) of a rotation vector (3,) [rad], by Rodrigues' formula."""
    S, angle = skew(np.asarray(turn, dtype=float)), float(np.linalg.norm(turn))
    return np.eye(3) + np.sinc(angle / np.pi) * S + 0.5 * np.sinc(0.5 * angle / np.pi)**2 * S @ S
