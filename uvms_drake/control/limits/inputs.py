"""Limits of the inputs: the acceleration command 𝔲, forces τ = M(𝔮)𝔲, forces of thrusters.

Where no limit of a thruster is active, the forces for a wrench are f = B_d⁺τ_d + b (see
`Allocation`), so the limits of f are rows of τ = M(𝔮)𝔲. On axes that no thruster drives the missing
part τ − B f is limited by an allowance: the plan proceeds as if it were delivered.
"""

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar, Self

import numpy as np

from uvms_drake.common.errors import InvalidParameter, require, vector
from uvms_drake.control.limits.limit import AbsoluteLimit
from uvms_drake.control.limits.radii import TubeRadii
from uvms_drake.control.plan.points import About, Points, Slopes
from uvms_drake.model.description.thruster_file import AXES, ThrusterParameters
from uvms_drake.model.propulsion.allocation import Allocation
from uvms_drake.model.propulsion.thrusters import ThrusterModel


def input_names(num_joints: int) -> list[str]:
    """Returns the names of the 6 + n accelerations."""
    return [*AXES, *(f"q{i + 1}" for i in range(num_joints))]


@dataclass
class InputLimit(AbsoluteLimit):
    """|value of each channel| ≤ bound."""

    about: ClassVar[About] = "input"

    bound: np.ndarray
    """Largest size of each entry (6+n,)."""
    unit: str | Sequence[str] = ""
    """Unit of the channels, or of each."""

    @abstractmethod
    def by_force(self, at: Points) -> np.ndarray:
        """Returns ∂value/∂𝔣 (..., 6+n, 3), 𝔣 being a force of the tip on a surface, in Σ_I [N]."""

    @abstractmethod
    def by_force_rates(self, at: Points) -> np.ndarray:
        """Returns the derivatives of `by_force` by 𝔮 (..., 6+n, 3, 6+n)."""

    @property
    def labels(self) -> list[str]:
        """Names of the channels: u_surge, u_sway, ..."""
        return [f"{self.name}_{channel}" for channel in input_names(len(self.bound) - 6)]

    def tube_takes(self, tube: TubeRadii) -> np.ndarray | None:
        """Returns the radii of the channels, if there are any."""
        radii = getattr(tube, str(self.radius))
        return None if radii is None else np.asarray(radii, dtype=float)

    def complaint(self, at: Points) -> str:
        """Returns each value at rest and its allowed range, weight and force apart."""
        rest = np.zeros_like(at.config)
        alone = replace(at, u=-at.model.drift(at.config, rest, np.zeros(6)))
        values, by_weight = self.values(at), self.values(alone)
        i = int(np.argmax(np.maximum(values - self.upper, self.lower - values)))
        return (f"such that {self.labels[i]}, {values[i]:.3g} to hold the task, is within "
                f"{self.lower[i]:.3g} to {self.upper[i]:.3g}; weight and buoyancy take "
                f"{by_weight[i]:.3g} of it, the force {values[i] - by_weight[i]:.3g}")


@dataclass
class Accelerations(InputLimit):
    """|𝔲ᵢ| ≤ bound [m/s² (3), rad/s² (3 + n)]."""

    name = "u"
    radius = "u"

    def values(self, at: Points) -> np.ndarray:
        """Returns 𝔲."""
        return at.u

    def slopes(self, at: Points) -> Slopes:
        """Returns the identity."""
        return Slopes(u=np.eye(at.model.size))

    def by_force(self, at: Points) -> np.ndarray:
        """Returns M⁻¹J_𝔭ᵀ."""
        return at.by_tip_force

    def by_force_rates(self, at: Points) -> np.ndarray:
        """Returns ∂(M⁻¹J_𝔭ᵀ)."""
        return at.by_tip_force_rates

    @property
    def bars(self) -> list[str]:
        """Bar of all channels."""
        return [f"input u, worst of {len(self.bound)}"]

    def bar_lengths(self, at: Points) -> np.ndarray:
        """Returns the largest part of all channels."""
        return np.max(self.used(at), axis=-1, keepdims=True)


@dataclass
class Forces(InputLimit):
    """|τᵢ| = |(M(𝔮)𝔲)ᵢ| ≤ bound [N (3), N m (3 + n)]."""

    name = "tau"
    radius = "tau"

    def values(self, at: Points) -> np.ndarray:
        """Returns τ."""
        return at.tau

    def slopes(self, at: Points) -> Slopes:
        """Returns M by 𝔲, and by y the derivative of M(𝔮)𝔲."""
        by_config = np.einsum("...rcj,...c->...rj", at.mass_matrix_rates, at.u)
        return Slopes(y=by_config @ at.config_y, u=at.mass_matrix)

    def by_force(self, at: Points) -> np.ndarray:
        """Returns J_𝔭ᵀ."""
        return np.swapaxes(at.tip_jacobian, -1, -2)

    def by_force_rates(self, at: Points) -> np.ndarray:
        """Returns ∂J_𝔭ᵀ."""
        return np.swapaxes(at.tip_jacobian_rates, -2, -3)

    @property
    def bars(self) -> list[str]:
        """Returns no bars: τ is not drawn."""
        return []

    def bar_lengths(self, at: Points) -> np.ndarray:
        """Returns an array without bars."""
        return np.empty((*at.config.shape[:-1], 0))


@dataclass
class ThrusterForces(Forces):
    """Limits lower ≤ f ≤ upper of m thrusters, |τ − B f| ≤ allowance on the k undriven axes.

    `bound` has their upper bounds (m + k,).
    """

    name = "thrusters"
    absolute = False

    lowest: np.ndarray = field(kw_only=True)
    """Lower bounds (m + k,) [N, N m]."""
    matrix: np.ndarray = field(kw_only=True)
    """Derivatives by τ (m + k, 6+n)."""
    offset: np.ndarray = field(kw_only=True)
    """Values without τ (m + k,) [N, N m]."""
    names: tuple[str, ...] = field(kw_only=True)
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
            np.concatenate([known.upper, allowed]), lowest=np.concatenate([known.lower, -allowed]),
            matrix=matrix, offset=offset, names=(*known.names, *(AXES[axis] for axis in axes)))

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
    def labels(self) -> list[str]:
        """Names of the thrusters and axes."""
        return [f"{self.name}.{name}" for name in self.names]

    @property
    def units(self) -> list[str]:
        """Unit of a force, or of the wrench about an undriven axis."""
        return ["N m" if name in AXES[3:] else "N" for name in self.names]
