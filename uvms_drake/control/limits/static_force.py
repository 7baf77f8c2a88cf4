"""Limit on the static force of a known surface, at the pose of the end-effector."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from uvms_drake.control.limits.limit import AbsoluteLimit, Cone
from uvms_drake.control.limits.radii import TubeRadii
from uvms_drake.control.plan.points import Points, Slopes
from uvms_drake.model.surface.law import StaticForceRows, Surface


@dataclass
class StaticForce(AbsoluteLimit):
    """Static force ‖force part of 𝔉‖₂ ≤ bound at the pose, not moving.

    An excess is a depth [m], over the stiffness of the surface, and so are the rows of the convex
    program: all other rows there are of about that size.
    """

    name = "static_force"
    soft: ClassVar[bool] = False
    unit = "N"
    titles = ("force, at rest",)
    owner: ClassVar[str] = "force"

    bound: float
    """Largest norm of the force [N]."""
    surface: Surface
    """Surface that is pressed."""

    def __post_init__(self) -> None:
        self.surface.static_force_rows(np.zeros(6), self.bound)  # Raises if it does not have it.
        self._stiffness = self.surface.stiffness_bound

    def values(self, at: Points) -> np.ndarray:
        """Returns the force [N]."""
        return self.surface.static_force(at.y[..., :6])[..., None]

    def excess(self, at: Points) -> np.ndarray:
        """Returns the excess as a depth [m]."""
        return super().excess(at) / self._stiffness

    def tube_takes(self, tube: TubeRadii) -> np.ndarray:
        """Returns the largest change of the force within the tube [N]."""
        assert tube.position is not None and tube.orientation is not None  # They are filled in.
        return np.array([self.surface.force_radius(tube.position, tube.orientation)])

    def closed_form(self, size: int) -> list[Slopes]:
        """Returns the Lipschitz matrix of the force; a spring's may rise by less."""
        G = self.surface.force_jacobian()
        return [Slopes(np.hstack([G, np.zeros((len(G), size - 6))]))]

    def row_values(self, at: Points) -> np.ndarray:
        """Returns the depth in a plane."""
        return self._rows(at).value

    def row_slopes(self, at: Points) -> Slopes:
        """Returns the derivatives of the depth in a plane."""
        rows = self._rows(at).rows
        return Slopes(np.hstack([rows, np.zeros((len(rows), at.model.size - 6))]))

    def row_bounds(self, at: Points) -> tuple[np.ndarray, np.ndarray]:
        """Returns the bound of the depth in a plane."""
        return np.array([-np.inf]), np.array([self._rows(at).bound])

    def cone(self, at: Points) -> Cone | None:
        """Returns the stretch of a spring."""
        limit = self._rows(at)
        return None if limit.one_sided else Cone(limit.value, self.row_slopes(at), limit.bound)

    def _rows(self, at: Points) -> StaticForceRows:
        return self.surface.static_force_rows(at.y[..., :6], self.upper[0])
