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
        return self.surface.static_force_rows(at.y[..., :6], self.upper[0]).value

    def row_slopes(self, at: Points) -> Slopes:
        """Returns the derivatives of the depth in a plane."""
        return Slopes(_by_y(self.surface.static_force_rows(at.y[..., :6], self.upper[0]), at))

    def row_bounds(self, at: Points) -> tuple[np.ndarray, np.ndarray]:
        """Returns the bound of the depth in a plane."""
        limit = self.surface.static_force_rows(at.y[..., :6], self.upper[0])
        return np.array([-np.inf]), np.array([limit.bound])

    def cone(self, at: Points) -> Cone | None:
        """Returns the stretch of a spring."""
        limit = self.surface.static_force_rows(at.y[..., :6], self.upper[0])
        return None if limit.one_sided else Cone(
            limit.value, Slopes(_by_y(limit, at)), limit.bound)

    def unit_of(self, signal: str) -> str:
        """Returns N."""
        return "N"

    @property
    def bars(self) -> list[str]:
        """Bar of the force."""
        return [f"force, at rest  ≤ {self.upper[0]:.3g} N"]

    def complaint(self, at: Points) -> str:
        """Returns the force and its tightened limit."""
        return (f"such that the static force, {self.values(at)[0]:.4g} N, is at most "
                f"{self.upper[0]:.4g} N, limits.static_force less the tube")


def _by_y(limit: StaticForceRows, at: Points) -> np.ndarray:
    """Returns the rows by y (m, 6+n), of which χ comes first."""
    return np.hstack([limit.rows, np.zeros((len(limit.rows), at.model.size - 6))])
