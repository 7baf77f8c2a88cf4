"""Remainders of the law `resolved`, beyond (1) of `resolved_image`, and their search problems."""

from dataclasses import dataclass, field

import numpy as np

from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.frames.euler import wrap_angle
from uvms_drake.model.frames.spatial import times
from uvms_drake.tube.search.search_problem import (
    NominalMotion,
    SearchProblem,
    input_within,
    nominal_motion,
)


def remainders(model: ContactModel, nominal: NominalMotion, nominal_u: np.ndarray, e_y: np.ndarray,
               r: np.ndarray, k: float, sigma: float) -> np.ndarray:
    """Returns the remainders of ζ and u in (1), of τ = M𝔲, and (φ, θ) − (φ̄, θ̄) (..., 3(6+n) + 2).

    In the order ζ, (φ, θ), u, τ. The remainder of τ is τ − τ̄ − M(𝔮)[−(k + σ)𝔯 + σ²𝔭]. Any argument
    may be complex, for a derivative.

    Args:
        model: The prediction model.
        nominal: The nominal motion.
        nominal_u: ū (..., 6+n).
        e_y: 𝔢_y (..., 6+n).
        r: 𝔯 (..., 6+n).
        k: Velocity gain [1/s].
        sigma: σ [1/s].
    """
    # The nominal motion in y.
    J_bar = model.extended(nominal.kinematics.J_chi)
    y_bar = np.concatenate([nominal.kinematics.chi, nominal.config[..., 6:]], axis=-1)
    y_dot = times(J_bar, nominal.zeta)
    J_bar_rate = model.task_jacobian_rate(nominal.kinematics, nominal.zeta)
    y_ddot = times(J_bar_rate, nominal.zeta) + times(J_bar, nominal_u + nominal.drift)

    # The real state, and the input of the law in it.
    config = model.configuration(y_bar + e_y)
    real = model.kinematics(config)
    J = model.extended(real.J_chi)
    inverse = np.linalg.inv(J)
    p, seen = times(inverse, e_y), times(inverse, y_dot)
    zeta_ref = seen - sigma * p
    zeta = zeta_ref + r
    e_dot = times(J, zeta) - y_dot
    J_rate = model.task_jacobian_rate(real, zeta)
    zeta_ref_dot = times(inverse, y_ddot - sigma * e_dot - times(J_rate, zeta_ref))
    f, M = model.drift_and_inertia(real, zeta)
    u_remainder = zeta_ref_dot - f + sigma * r - sigma**2 * p - nominal_u
    # Less the linear parts of (1).
    attitude = wrap_angle(config[..., 3:5] - nominal.config[..., 3:5])
    return np.concatenate([
        seen - nominal.zeta, attitude, u_remainder,
        times(M, u_remainder + nominal_u) - times(nominal.M, nominal_u)], axis=-1)


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


def turning(model: ContactModel, config: np.ndarray, zeta: np.ndarray, w: np.ndarray
            ) -> np.ndarray:
    """Returns J_x⁻¹J̇_x w (..., 6+n) [1/s]: with w in the unit ball, its largest norm is ω."""
    kinematics = model.kinematics(config)
    return times(np.linalg.inv(model.extended(kinematics.J_chi)),
                 times(model.task_jacobian_rate(kinematics, zeta), w))
