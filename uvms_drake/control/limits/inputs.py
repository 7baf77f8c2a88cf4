"""Limits on the acceleration command 𝔲 and on the forces τ = M(𝔮)𝔲, channel by channel."""

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from uvms_drake.control.limits.limit import Limit
from uvms_drake.control.limits.radii import TubeRadii
from uvms_drake.control.plan.points import About, Points, Slopes


def input_names(num_joints: int) -> list[str]:
    """Returns the names of the 6 + n accelerations."""
    return ["surge", "sway", "heave", "roll", "pitch", "yaw",
            *(f"q{i + 1}" for i in range(num_joints))]


@dataclass
class InputLimit(Limit):
    """|value of each channel| ≤ bound."""

    about: ClassVar[About] = "input"
    units: ClassVar[tuple[str, str]]
    """Units of the channels of translation and of rotation."""

    bound: np.ndarray
    """Largest size of each entry (6+n,)."""
    slides: Sequence[bool] | np.ndarray = field(default=(), kw_only=True)
    """Whether a joint is prismatic (n,); none is, if left out."""

    @abstractmethod
    def by_force(self, at: Points) -> np.ndarray:
        """Returns ∂value/∂𝔣 (..., 6+n, 3), 𝔣 being a force of the tip on a surface, in Σ_I [N]."""

    @abstractmethod
    def by_force_rates(self, at: Points) -> np.ndarray:
        """Returns the derivatives of `by_force` by 𝔮 (..., 6+n, 3, 6+n)."""

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Returns ∓bound."""
        return -self.bound, self.bound

    def signals(self, at: Points) -> dict[str, tuple[np.ndarray, float]]:
        """Returns the absolute values, by the names of the channels."""
        values, upper = np.abs(self.values(at)), self.upper
        return {f"{self.name}_{channel}": (values[..., i], float(upper[i]))
                for i, channel in enumerate(input_names(len(upper) - 6))}

    def unit_of(self, signal: str) -> str:
        """Returns the unit of translation or of rotation."""
        channels = input_names(len(self.slides))
        straight = dict(zip(channels, [*[True] * 3, *[False] * 3, *self.slides], strict=True))
        return self.units[0 if straight.get(signal.rsplit("_", 1)[1]) else 1]

    def complaint(self, at: Points) -> str:
        """Returns each value at rest and its allowed range, weight and force apart."""
        rest = np.zeros_like(at.config)
        alone = replace(at, u=-at.model.drift(at.config, rest, np.zeros(6)))
        values, by_weight = self.values(at), self.values(alone)
        i = int(np.argmax(np.maximum(values - self.upper, self.lower - values)))
        return (f"such that {self.parts[i]}, {values[i]:.3g} to hold the task, is within "
                f"{self.lower[i]:.3g} to {self.upper[i]:.3g}; weight and buoyancy take "
                f"{by_weight[i]:.3g} of it, the force {values[i] - by_weight[i]:.3g}")


@dataclass
class Accelerations(InputLimit):
    """|𝔲ᵢ| ≤ bound [m/s² (3), rad/s² (3 + n)]."""

    name = "u"
    units: ClassVar[tuple[str, str]] = "m/s²", "rad/s²"

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

    def tube_takes(self, tube: TubeRadii) -> np.ndarray:
        """Returns the radii of 𝔲."""
        return np.asarray(tube.u, dtype=float)

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
    units: ClassVar[tuple[str, str]] = "N", "N m"

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

    def tube_takes(self, tube: TubeRadii) -> np.ndarray | None:
        """Returns the radii of τ, if there are any."""
        return None if tube.tau is None else np.asarray(tube.tau, dtype=float)

    @property
    def bars(self) -> list[str]:
        """Returns no bars: τ is not drawn."""
        return []

    def bar_lengths(self, at: Points) -> np.ndarray:
        """Returns an array without bars."""
        return np.empty((*at.config.shape[:-1], 0))
