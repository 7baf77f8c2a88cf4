"""The limit on the static force: how far the end-effector may go into the surface, at rest."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from uvms_drake.control.limits.limit import AbsoluteLimit, Cone, Rows
from uvms_drake.control.limits.radii import TubeRadii, resolved_radii
from uvms_drake.control.points import Points, Slopes
from uvms_drake.model.surface.law import PlaneLaw, SpringLaw, SurfaceLaw, static_force


def force_radius(tube: TubeRadii, surface: SurfaceLaw) -> float:
    """Returns by how much the tube changes the static force, at most [N].

    Of a spring it takes for granted that no Euler angle is π away from its equilibrium's.
    """
    tube = resolved_radii(tube)
    assert tube.position is not None and tube.orientation is not None  # now they are filled in
    G = surface.force_jacobian()
    return float(np.linalg.norm(G[:, :3], 2) * tube.position
                 + np.linalg.norm(G[:, 3:], 2) * tube.orientation)


@dataclass
class StaticForce(AbsoluteLimit):
    """‖force part of 𝔉‖₂ at the pose, not moving, ≤ bound.

    An excess is measured as a depth [m], over the stiffness of the surface. So is what the convex
    program has: everything else there is of about that size.
    """

    name = "static_force"
    soft: ClassVar[bool] = False
    owner: ClassVar[str] = "force"

    bound: float
    """[N]."""
    surface: SurfaceLaw
    """What is pressed."""

    def __post_init__(self) -> None:
        if not isinstance(self.surface, PlaneLaw | SpringLaw):
            raise TypeError(f"no limit on the force of a {type(self.surface).__name__}")
        self._stiffness = float(np.linalg.norm(self.surface.force_jacobian()[:, :3], 2))

    def values(self, at: Points) -> np.ndarray:
        """Returns the force [N]."""
        return static_force(self.surface, at.y[..., :6])[..., None]

    def excess(self, at: Points) -> np.ndarray:
        """Returns how much too deep it is [m]."""
        return super().excess(at) / self._stiffness

    def tube_takes(self, tube: TubeRadii) -> np.ndarray:
        """Returns by how much the tube changes the force, at most."""
        return np.array([force_radius(tube, self.surface)])

    def closed_form(self, size: int) -> list[Slopes]:
        """Returns by how much the force changes at most; a spring's may rise by less."""
        G = self.surface.force_jacobian()
        return [Slopes(np.hstack([G, np.zeros((len(G), size - 6))]))]

    def rows(self, at: Points) -> Rows:
        """Returns the depth in a plane."""
        assert isinstance(self.surface, PlaneLaw)
        slope = np.zeros((1, at.model.size))
        slope[0, :3] = -self.surface.normal
        return Rows(self.surface.depth(at.y[..., :3])[..., None], Slopes(slope),
                    np.array([-np.inf]), np.array([self.surface.depth_for(self.upper[0])]))

    def cone(self, at: Points) -> Cone | None:
        """Returns the stretch of a spring."""
        if not isinstance(self.surface, SpringLaw):
            return None
        chi = at.y[..., :6]
        stretch = self.surface.force(chi, np.zeros_like(chi))[..., :3] / self._stiffness
        slope = np.zeros((3, at.model.size))
        slope[:, :6] = self.surface.force_jacobian() / self._stiffness
        return Cone(stretch, Slopes(slope), self.upper[0] / self._stiffness)

    @property
    def bars(self) -> list[str]:
        """One for the force."""
        return ["force"]

    def complaint(self, at: Points) -> str:
        """Returns how hard it would have to press."""
        return (f"such that the static force, {self.values(at)[0]:.4g} N, is at most "
                f"{self.upper[0]:.4g} N, what the tube leaves of limits.static_force")
