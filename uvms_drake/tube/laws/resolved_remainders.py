"""Remainders of the law `resolved`, beyond (1) of `resolved`, and their search problems."""

from dataclasses import dataclass, field

import numpy as np

from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.frames.euler import wrap_angle
from uvms_drake.model.frames.spatial import cross, cross_motion, times
from uvms_drake.model.uvms_model import Kinematics
from uvms_drake.tube.search import search_problem


def remainders(model: ContactModel, nominal: search_problem.NominalMotion, nominal_u: np.ndarray,
               e_y: np.ndarray, r: np.ndarray, k: float, sigma: float) -> np.ndarray:
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
    y_ddot = jacobian_rate_times(nominal.kinematics, nominal.zeta, nominal.zeta) + times(
        J_bar, nominal_u + nominal.drift)

    # The real state, and the input of the law in it.
    config = model.configuration(y_bar + e_y)
    real = model.kinematics(config)
    J = model.extended(real.J_chi)
    inverse = np.linalg.inv(J)
    p, seen = times(inverse, e_y), times(inverse, y_dot)
    zeta_ref = seen - sigma * p
    zeta = zeta_ref + r
    e_dot = times(J, zeta) - y_dot
    zeta_ref_dot = times(inverse, y_ddot - sigma * e_dot - jacobian_rate_times(
        real, zeta, zeta_ref))
    f, M = model.drift_and_inertia(real, zeta)
    u_remainder = zeta_ref_dot - f + sigma * r - sigma**2 * p - nominal_u
    # Less the linear parts of (1).
    attitude = wrap_angle(config[..., 3:5] - nominal.config[..., 3:5])
    return np.concatenate([
        seen - nominal.zeta, attitude, u_remainder,
        times(M, u_remainder + nominal_u) - times(nominal.M, nominal_u)], axis=-1)


def jacobian_rate_times(kinematics: Kinematics, zeta: np.ndarray, w: np.ndarray) -> np.ndarray:
    """Returns J̇_x w (..., 6+n) along 𝔮̇ = Γζ, of real or complex numbers.

    As in `UvmsModel.task_jacobian_rate`, J = A X_E [I, s₁ … s_n], and a screw is carried along by
    its link: d/dt(X_E s) = X_E (V − V_E) × s. With ȯ = T ω_E, Ṫ = −T Ė T for E = T⁻¹.
    """
    screw, A_E, X_E = kinematics.screw, kinematics.A_E, kinematics.J_links[..., -1, :, :6]
    carried = np.cumsum(screw * zeta[..., 6:, None], axis=-2)  # Vⱼ − V₀ of the joints
    V_E = zeta[..., :6] + (carried[..., -1, :] if screw.shape[-2] else 0.0)
    tip = w[..., :6] + np.sum(screw * w[..., 6:, None], axis=-2)
    moved = cross_motion(zeta[..., :6] - V_E, w[..., :6]) + np.sum(cross_motion(
        zeta[..., None, :6] + carried - V_E[..., None, :], screw) * w[..., 6:, None], axis=-2)
    own, along = times(X_E, V_E), times(X_E, tip)
    o_zeta, o_w = times(A_E, own)[..., 3:], times(A_E, along)[..., 3:]
    turned = np.concatenate([cross(own[..., 3:], along[..., :3]),
                             -_rate_of_inverse(kinematics.chi[..., 3:], o_zeta, o_w)], axis=-1)
    rate = times(A_E, turned + times(X_E, moved))
    return np.concatenate([rate, np.zeros_like(w[..., 6:] * rate[..., :1])], axis=-1)


def _rate_of_inverse(rpy: np.ndarray, rate: np.ndarray, w: np.ndarray) -> np.ndarray:
    """Returns Ė w (..., 3), E = T⁻¹ of `euler.inverse_rate_matrix`, with `rate` = ȯ (..., 3)."""
    sin, cos = np.sin(rpy), np.cos(rpy)
    sf, st, cf, ct = sin[..., 0], sin[..., 1], cos[..., 0], cos[..., 1]
    across = rate[..., 0] * w[..., 1] + rate[..., 1] * w[..., 2] * st
    about = rate[..., 0] * w[..., 2] * ct
    return np.stack([-rate[..., 1] * w[..., 2] * ct, cf * about - sf * across,
                     -sf * about - cf * across], axis=-1)


@dataclass(frozen=True)
class RemainderProblem(search_problem.SearchProblem):
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
        nominal = search_problem.nominal_motion(self.model, self.config(pose), zeta)
        u = search_problem.input_within(nominal.drift, share, self.u_limits, self.largest_rate)
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
