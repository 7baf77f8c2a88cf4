"""Law `resolved`: resolved acceleration on the extended task y = (χ, q).

With J_x = [J; 0 I], 𝔢_y = y − ȳ and Euler angles compared modulo 2π,

    ζ_ref = J_x(𝔮)⁻¹ [J_x(𝔮̄) ζ̄ − σ 𝔢_y],   𝔯 = ζ − ζ_ref,   u = ζ̇_ref − f(𝔮, ζ) − k 𝔯,

leaves exactly 𝔢̇_y = −σ 𝔢_y + J_x(𝔮) 𝔯 and 𝔯̇ = −k 𝔯 + d: a cascade without f in it, and
‖𝔢_y‖ ≤ J̄ d̃/(kσ), ‖𝔯‖ ≤ d̃/k for every k, σ > 0. τ = M(𝔮)u is the inverse dynamics at ζ̇_ref − k𝔯,
with the measured contact force 𝔉_s in place of the model's, if there is one. Proof:
control/laws/theory.md#law-resolved.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Annotated

import numpy as np

from uvms_drake.common.constraints import Positive
from uvms_drake.control.laws.law import AncillaryLaw, Command, Deviation, Pair, RunBound
from uvms_drake.model.frames.euler import pose_difference
from uvms_drake.model.uvms_model import UvmsModel


@dataclass
class Resolved(AncillaryLaw):
    """The law `resolved` and its gains."""

    k: Annotated[float, Positive] = 20.0
    """Gain of the velocity error [1/s]."""
    sigma: Annotated[float, Positive] = 5.0
    """σ, gain of the task error [1/s]."""

    takes_force = True

    def command(self, model: UvmsModel, now: Pair, nominal_acceleration: Callable[[], np.ndarray],
                nominal_input: Callable[[], np.ndarray]) -> Command:
        """Returns τ of the inverse dynamics at ζ̇_ref − k𝔯; it reads ζ̄̇ only."""
        (zeta, nominal_zeta), (J, J_nominal) = now.zeta, now.J_x
        J_dot, J_dot_nominal = now.J_x_dot
        velocity = J_nominal @ nominal_zeta
        acceleration = J_dot_nominal @ nominal_zeta + J_nominal @ nominal_acceleration()
        zeta_ref = now.inverse @ (velocity - self.sigma * pose_difference(*now.y))
        error_rate = J @ zeta - velocity
        zeta_ref_dot = now.inverse @ (acceleration - self.sigma * error_rate - J_dot @ zeta_ref)
        measured = now.kinematics.at(0)
        tau = model.inverse_dynamics(
            measured, zeta, zeta_ref_dot - self.k * (zeta - zeta_ref), now.contact)
        M = model.mass_matrix(measured)
        return Command(np.linalg.solve(M, tau), tau, M)

    def deviation(self, now: Pair) -> Deviation:
        """Returns the errors; 𝔯 = ζ − J_x(𝔮)⁻¹[J_x(𝔮̄)ζ̄ − σ𝔢_y]."""
        e_y, z = pose_difference(*now.y), now.zeta[0] - now.zeta[1]
        return Deviation(e_y, e_y, z, z - reference_offset(now) + self.sigma * now.inverse @ e_y)

    def run_bound(self, d_bound: float, weights: np.ndarray) -> RunBound:
        """Returns the bound along a run of the dynamics.

        From zero, for blocks b of rows of J_x,

            Ṙ = −k R + d̃,    Ė_b = −σ E_b + ‖J_b(𝔮(t))Ŵ‖₂ R,    Ṗ = −(σ − μ(t)) P + R,

        μ the largest eigenvalue of the symmetric part of −J_x⁻¹J̇_x. By the proofs in
        `tube.row_gains` ‖𝔯‖ ≤ ‖Ŵ⁻¹𝔯‖ ≤ R, ‖𝔢_b‖ ≤ E_b, ‖J_x⁻¹𝔢_y‖ ≤ P, and so
        ‖𝔷‖ ≤ R + σP + ‖J_x(𝔮)⁻¹(J_x(𝔮̄) − J_x(𝔮))ζ̄‖. Only the E_b depend on Ŵ; R and P are those of
        the ball ‖d‖ ≤ d̃ too. The states are R, the E_b of task, position, orientation and joints,
        and P.
        """
        return RunBound(6, partial(self._rate, d_bound, weights), self._bounds)

    def _rate(self, d_bound: float, weights: np.ndarray, x: np.ndarray, now: Pair) -> np.ndarray:
        gains, mu = gains_and_growth(now, weights)
        x_dot = -self.sigma * x
        x_dot[0] = d_bound - self.k * x[0]
        x_dot[1:] += gains * x[0]
        x_dot[-1] += mu * x[-1]
        return x_dot

    def _bounds(self, x: np.ndarray, now: Pair) -> np.ndarray:
        R, blocks, P = x[0], x[1:5], x[5]
        return np.array([*blocks, R + self.sigma * P + _size(reference_offset(now)), R])


def gains_and_growth(now: Pair, weights: np.ndarray) -> tuple[np.ndarray, float]:
    """Returns the norms (5,) of J_xŴ, of its position, orientation and joint rows, 1; and μ [1/s].

    ‖J‖² is the largest eigenvalue of J Jᵀ. The rows of the joints are unit vectors.
    """
    J = now.J_x[0] * weights
    both = np.empty((2, *J.shape))
    both[0], turning = J @ J.T, now.inverse @ now.J_x_dot[0]
    both[1] = -0.5 * (turning + turning.T)
    whole, mu = np.linalg.eigvalsh(both)[:, -1].tolist()
    squares = np.array([both[0, :3, :3], both[0, 3:6, 3:6]])
    position, orientation = np.linalg.eigvalsh(squares)[:, -1].tolist()
    gains = [math.sqrt(whole), math.sqrt(position), math.sqrt(orientation)]
    return np.array([*gains, weights[6:].max(initial=0.0), 1.0]), mu


def reference_offset(now: Pair) -> np.ndarray:
    """Returns ζ_ref − ζ̄ at 𝔢_y = 0, J_x(𝔮)⁻¹(J_x(𝔮̄) − J_x(𝔮))ζ̄ (6+n,)."""
    return now.inverse @ (now.J_x[1] @ now.zeta[1]) - now.zeta[1]


def _size(x: np.ndarray) -> float:
    return math.sqrt(x @ x)
