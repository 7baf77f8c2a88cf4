"""Limits of the thrusters' forces in a plan, which are linear in τ.

Where no limit of a thruster is active, the forces for a wrench are f = B_d⁺τ_d + b (see
`Allocation`), so the limits of f are rows of τ = M(𝔮)𝔲. On axes that no thruster drives the missing
part τ − B f is limited by an allowance: the plan proceeds as if it were delivered.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from uvms_drake.common.errors import InvalidParameter, require, vector
from uvms_drake.control.limits.inputs import Forces
from uvms_drake.control.limits.limit import Limit
from uvms_drake.control.limits.radii import TubeRadii
from uvms_drake.control.plan.points import Points, Slopes
from uvms_drake.model.description.thruster_file import AXES, ThrusterParameters
from uvms_drake.model.propulsion.allocation import Allocation
from uvms_drake.model.propulsion.thrusters import ThrusterModel


@dataclass
class ThrusterForces(Forces):
    """Limits lower ≤ f ≤ upper of m thrusters, |τ − B f| ≤ allowance on the k undriven axes.

    `bound` has their upper bounds (m + k,).
    """

    name = "thrusters"

    lowest: np.ndarray
    """Lower bounds (m + k,) [N, N m]."""
    matrix: np.ndarray
    """Derivatives by τ (m + k, 6+n)."""
    offset: np.ndarray
    """Values without τ (m + k,) [N, N m]."""
    names: tuple[str, ...]
    """Names of the thrusters, and of the axes that none drives."""

    @classmethod
    def of(cls, thrusters: ThrusterParameters | None, allowance: np.ndarray, size: int) -> Self:
        """Returns the limit of the thrusters of a robot.

        Args:
            thrusters: Parameters from the robot's file; None if it has none.
            allowance: Largest undelivered wrench (k,) [N, N m].
            size: 6 + n.

        Raises:
            InvalidParameter: The robot has no thrusters, or the allowance has no meaning.
        """
        if thrusters is None:
            raise InvalidParameter("thrusters", allowance,
                                   "left out: the robot has no thrusters.yaml")
        known = ThrusterModel.of(thrusters)
        axes = known.undriven
        allowed = vector("thrusters", allowance, len(axes))
        require(bool(np.all(allowed > 0.0)), "thrusters", allowance, "positive numbers")
        allocation = Allocation.to(known)
        undone = np.eye(6)[axes] - known.B[axes] @ allocation.matrix
        matrix = np.vstack([allocation.matrix, undone]) @ np.eye(6, size)
        offset = np.concatenate([allocation.bias, -known.B[axes] @ allocation.bias])
        return cls(
            np.concatenate([known.upper, allowed]), np.concatenate([known.lower, -allowed]),
            matrix, offset, (*known.names, *(AXES[axis] for axis in axes)))

    def values(self, at: Points) -> np.ndarray:
        """Returns the forces, and the undelivered wrench."""
        return super().values(at) @ self.matrix.T + self.offset

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Returns the bounds, which need not be symmetric."""
        return self.lowest, self.bound

    def slopes(self, at: Points) -> Slopes:
        """Returns the derivatives of τ, through the matrix."""
        tau = super().slopes(at)
        return Slopes(y=self.matrix @ tau.y, u=self.matrix @ tau.u)

    def by_force(self, at: Points) -> np.ndarray:
        """Returns the derivative of τ by the force, through the matrix."""
        return self.matrix @ super().by_force(at)

    def by_force_rates(self, at: Points) -> np.ndarray:
        """Returns the rates of the derivative by the force, through the matrix."""
        return np.einsum("fr,...rcj->...fcj", self.matrix, super().by_force_rates(at))

    def tube_takes(self, tube: TubeRadii) -> np.ndarray | None:
        """Returns the radii of τ through the matrix, if there are any."""
        taken = super().tube_takes(tube)
        return None if taken is None else np.abs(self.matrix) @ taken

    @property
    def parts(self) -> list[str]:
        """Names of the thrusters and axes."""
        return [f"{self.name}.{name}" for name in self.names]

    def signals(self, at: Points) -> dict[str, tuple[np.ndarray, float]]:
        """Returns the values with both of their bounds."""
        return Limit.signals(self, at)

    def unit_of(self, signal: str) -> str:
        """Returns the unit of a force, or of the wrench about an undriven axis."""
        return "N m" if any(f".{axis}_" in signal for axis in AXES[3:]) else "N"
