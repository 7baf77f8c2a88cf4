"""Terminal ingredients of the nominal MPC: penalty P, controller 𝔎, set ‖ξ‖_P ≤ ε.

The plan's acceleration is constant over an interval of length h, so the terminal controller is
designed for exactly that: ξ = (y − y_des, ζ) about the equilibrium obeys

    ξ⁺ = A ξ + B ζ̇,   A = [I  hJ_x; 0  I],   B = [½h²J_x; hI],   ū − ū_eq = ζ̇ − F ξ,

with F = [∂f/∂y  ∂f/∂ζ]: in the input w = ζ̇ − Fξ a discrete-time regulator for h(‖ξ‖²_Q + ‖w‖²_R).
Its Riccati solution P₀ is inflated, P = (1 + μ)P₀ (Chen and Allgöwer 1998), so that the decrease
‖ξ⁺‖²_P − ‖ξ‖²_P ≤ −ℓ holds near the equilibrium of the nonlinear loop, too; the controller stays
that of P₀. Proof: control/plan/theory.md#terminal-penalty-and-controller.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from pydrake.systems.controllers import DiscreteTimeLinearQuadraticRegulator

from uvms_drake.common.errors import require

INFLATION = 1.0
"""Inflation μ of the penalty P = (1 + μ)P₀."""
LARGEST_GROWTH = 100.0
"""Spectral radius of A + BF up to which the Riccati equation is solved, its residual then being
below 1e-8 of P. The loop can be stabilised whatever F is, but from about 500 on the result is
dominated by rounding."""


@dataclass(frozen=True)
class Terminal:
    """Terminal penalty, controller and set about the equilibrium (y_des, ζ = 0)."""

    P: np.ndarray
    """Matrix P of the penalty V_f = ‖ξ‖²_P (2(6+n), 2(6+n))."""
    gain: np.ndarray
    """Gain of the terminal controller ζ̇ = gain · ξ, that is ū = ū_eq − 𝔎ξ (6+n, 2(6+n))."""
    radius: float
    """Radius ε of the terminal set ‖ξ‖_P ≤ ε."""

    @cached_property
    def root(self) -> np.ndarray:
        """Matrix T (rank of P, size of ξ) with ‖Tξ‖₂ = ‖ξ‖_P."""
        values, vectors = np.linalg.eigh(self.P)
        kept = values > 1e-12 * values[-1]
        return np.sqrt(values[kept])[:, None] * vectors[:, kept].T


def terminal_ingredients(J_x: np.ndarray, f_y: np.ndarray, f_zeta: np.ndarray, Q: np.ndarray,
                         R: np.ndarray, time_step: float, radius: float,
                         inflation: float = INFLATION) -> Terminal:
    """Returns the ingredients for the linearisation (J_x, ∂f/∂y, ∂f/∂ζ) at the equilibrium.

    Args:
        J_x: Jacobian of the extended task (6+n, 6+n).
        f_y: ∂f/∂y (6+n, 6+n) [1/s²].
        f_zeta: ∂f/∂ζ (6+n, 6+n) [1/s].
        Q: Weight of ξ (2(6+n), 2(6+n)).
        R: Weight of ū − ū_eq (6+n, 6+n).
        time_step: h [s].
        radius: ε.
        inflation: μ ≥ 0; the penalty is (1 + μ) times the Riccati solution.

    Raises:
        InvalidParameter: F is so large that floating point cannot tell how to stabilise the loop.
    """
    size = len(J_x)
    eye, zero = np.eye(size), np.zeros((size, size))
    A = np.block([[eye, time_step * J_x], [zero, eye]])
    B = np.concatenate([0.5 * time_step**2 * J_x, time_step * eye])
    F = np.concatenate([f_y, f_zeta], axis=1)
    loop = A + B @ F
    growth = float(np.max(np.abs(np.linalg.eigvals(loop))))
    require(growth <= LARGEST_GROWTH, "time_step", time_step,
            f"such that the loop linearised at the task grows at most {LARGEST_GROWTH:g}-fold in a "
            f"step without control, not {growth:.3g}-fold; the stiffer the surface, the shorter")
    K, riccati = DiscreteTimeLinearQuadraticRegulator(
        A=loop, B=B, Q=time_step * Q, R=time_step * R)
    P = 0.5 * (1.0 + inflation) * (riccati + riccati.T)
    return Terminal(P=P, gain=F - K, radius=radius)


def kinematic_terminal_ingredients(
    J_x: np.ndarray, Q: np.ndarray, R: np.ndarray, time_step: float, radius: float,
    inflation: float = INFLATION,
) -> Terminal:
    """Returns the ingredients for ξ⁺ = ξ + hJ_x ζ, ξ = y − y_des, and the input ζ.

    Args:
        J_x: Jacobian of the extended task (6+n, 6+n) at the equilibrium.
        Q: Diagonal weight of ξ (6+n, 6+n); where the joints' is zero, they are left out of the
            design, and of P.
        R: Weight of ζ (6+n, 6+n).
        time_step: h [s].
        radius: ε.
        inflation: μ ≥ 0.
    """
    size = len(J_x)
    weighted = np.diag(Q) > 0.0
    kept = np.ix_(weighted, weighted)
    K, riccati = DiscreteTimeLinearQuadraticRegulator(
        A=np.eye(size)[kept], B=time_step * J_x[weighted], Q=time_step * Q[kept], R=time_step * R)
    P, gain = np.zeros((size, size)), np.zeros((size, size))
    P[kept] = 0.5 * (1.0 + inflation) * (riccati + riccati.T)
    gain[:, weighted] = -K
    return Terminal(P=P, gain=gain, radius=radius)


def declared_terminal(weight: np.ndarray, num_inputs: int, radius: float) -> Terminal:
    """Returns a declared penalty P = diag `weight`, without a controller."""
    return Terminal(P=np.diag(weight), gain=np.zeros((num_inputs, len(weight))), radius=radius)
