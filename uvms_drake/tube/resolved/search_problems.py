"""Search problems of the law `resolved`: its remainder terms, and the growth rate of J_x⁻¹."""

from dataclasses import dataclass, field

import numpy as np

from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.frames.spatial import times
from uvms_drake.tube.resolved.remainders import jacobian_rate_times, remainders
from uvms_drake.tube.search.constraint_set import ConstraintSet
from uvms_drake.tube.search.nominal_motion import nominal_motion
from uvms_drake.tube.search.search_problem import SearchProblem, input_within


@dataclass(frozen=True)
class RemainderProblem(SearchProblem):
    """Remainders of the law `resolved`; see `remainders`."""

    u_limits: np.ndarray
    """|ūᵢ| (6+n,)."""
    k: float
    """Velocity gain [1/s]."""
    sigma: float
    """σ [1/s]."""
    preimage: bool = False
    """True if the errors are (𝔭, 𝔯), 𝔢_y = J_x(𝔮)𝔭, instead of (𝔢_y, 𝔯)."""
    forces: bool = False
    """True if the remainders of τ count, too."""
    largest_rate: np.ndarray | float = field(default=np.inf)
    """|ζ̄̇ᵢ| (6+n,), in addition to the bound by |ūᵢ|."""

    @property
    def channels(self) -> list[slice]:
        """Channels of ν₁, ν₂, φ, θ, uᵢ and τᵢ."""
        last = (3 if self.forces else 2) * self.size + 2
        return [slice(0, 3), slice(3, 6), *(slice(i, i + 1) for i in range(self.size, last))]

    def values(self, x: np.ndarray, error: np.ndarray) -> np.ndarray:
        """Returns the remainders (..., 3(6+n) + 2)."""
        pose, zeta, share = np.split(x, 3, axis=-1)
        nominal = nominal_motion(self.model, self.config(pose), zeta)
        u = input_within(nominal.drift, share, self.u_limits, self.largest_rate)
        e_y, r = error[..., : self.size], error[..., self.size:]
        if self.preimage:  # J_x at the real configuration, to second order.
            at = nominal.kinematics
            y = np.concatenate([at.chi, nominal.config[..., 6:]], axis=-1)
            real = self.model.configuration(y + times(self.model.extended(at.J_chi), e_y))
            e_y = times(self.model.task_jacobian(real), e_y)
        return remainders(self.model, nominal, u, e_y, r, self.k, self.sigma)


@dataclass(frozen=True)
class TurningProblem(SearchProblem):
    """J_x⁻¹J̇_x w for an error (0, w): with w in the unit ball, its largest norm is ω."""

    @property
    def channels(self) -> list[slice]:
        """The only channel."""
        return [slice(0, self.size)]

    def values(self, x: np.ndarray, error: np.ndarray) -> np.ndarray:
        """Returns J_x⁻¹J̇_x w (..., 6+n) [1/s]."""
        pose, zeta, _ = np.split(x, 3, axis=-1)
        kinematics = self.model.kinematics(self.config(pose))
        rate = jacobian_rate_times(kinematics, zeta, error[..., self.size:])
        return times(np.linalg.inv(self.model.extended(kinematics.J_chi)), rate)


def turning_problem(model: ContactModel, declared: ConstraintSet, weights: np.ndarray
                    ) -> TurningProblem:
    """Returns the problem whose largest value is sup‖J_x⁻¹J̇_xŴ‖₂."""
    matrix = np.concatenate([np.zeros((model.size, model.size)), np.diag(weights)])
    return TurningProblem(model, declared, [(matrix, 1.0)])
