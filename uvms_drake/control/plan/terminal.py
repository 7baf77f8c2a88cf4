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
from typing import NamedTuple

import numpy as np
from pydrake.systems.controllers import DiscreteTimeLinearQuadraticRegulator

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.model.description.thruster_file import AXES

INFLATION = 1.0
"""Inflation μ of the penalty P = (1 + μ)P₀."""


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
        InvalidParameter: F is so large that floating point cannot tell how to stabilise the loop;
            names the fastest mode and its cause.
    """
    size = len(J_x)
    eye, zero = np.eye(size), np.zeros((size, size))
    A = np.block([[eye, time_step * J_x], [zero, eye]])
    B = np.concatenate([0.5 * time_step**2 * J_x, time_step * eye])
    F = np.concatenate([f_y, f_zeta], axis=1)
    found = linear_regulator(A, B, F, time_step * Q, time_step * R)
    if found is None:
        raise InvalidParameter("time_step", time_step, (
            "such that floating point can tell a terminal controller: shorter, or without the "
            f"fastest mode of the loop linearised at the task, {_fastest_mode(J_x, f_y, f_zeta)}"))
    P = 0.5 * (1.0 + inflation) * (found.P + found.P.T)
    return Terminal(P=P, gain=found.gain, radius=radius)


def _fastest_mode(J_x: np.ndarray, f_y: np.ndarray, f_zeta: np.ndarray) -> str:
    """Returns the fastest mode of ẏ = J_x ζ, ζ̇ = f_y y + f_ζ ζ in words: rate, place and cause."""
    size = len(J_x)
    values, vectors = np.linalg.eig(np.block([[np.zeros((size, size)), J_x], [f_y, f_zeta]]))
    fastest = int(np.argmax(np.abs(values)))
    y, zeta = np.split(vectors[:, fastest], 2)
    most = int(np.argmax(np.abs(zeta)))
    damped = abs(f_zeta[most] @ zeta) >= abs(f_y[most] @ y)
    where = AXES[most] if most < len(AXES) else f"q{most - len(AXES) + 1}"
    cause = ("damping there, viscous or of the surface, over the inertia" if damped
             else "stiffness there, of the surface or of weight, over the inertia")
    return f"{abs(values[fastest]):.3g} 1/s, which moves {where} most, by the {cause}"


def declared_terminal(weight: np.ndarray, num_inputs: int, radius: float) -> Terminal:
    """Returns a declared penalty P = diag `weight`, without a controller."""
    return Terminal(P=np.diag(weight), gain=np.zeros((num_inputs, len(weight))), radius=radius)


# A stiff regulator --------------------------------------------------------------------------------
#
# A discrete-time regulator whose cost weighs a − Fξ, however large F is:
#
#     minimise Σ ξᵀQξ + (a − Fξ)ᵀR(a − Fξ),   ξ⁺ = Aξ + Ba.                                     (1)
#
# In w = a − Fξ it is the standard regulator of ξ⁺ = (A + BF)ξ + Bw, which a Riccati solver answers
# well as long as A + BF is of moderate size. A large F is no unstable loop: one joint of viscous
# damping D and inertia M has −hD/M in it, while its motion decays by exp(−hD/M). But rounding grows
# with it, so Newton's method takes over there (Kleinman 1968, Hewer 1971): from a controller a = Gξ
# that stabilises A + BG, alternately
#
#     P = (A + BG)ᵀP(A + BG) + Q + (G − F)ᵀR(G − F),   G = −(R + BᵀPB)⁻¹(BᵀPA − RF).            (2)
#
# Every G stabilises, and P falls to the solution quadratically. It never forms A + BF.

LARGEST_GROWTH = 100.0
"""Spectral radius of A + BF up to which the Riccati equation is solved in w, its residual then
being below 1e-8 of P."""
SOLVED = 1e-3
"""Residual of (2) over the cost of a step, in any direction, up to which it counts as solved."""
STEPS, DOUBLINGS = 100, 60
"""Most steps of Newton's method, each of which gains digits, and of `_cost_of`."""


class LinearRegulator(NamedTuple):
    """The solution of (1)."""

    gain: np.ndarray
    """G with a = Gξ (m, n)."""
    P: np.ndarray
    """Symmetric P (n, n): ξᵀPξ is the cost to go."""


def linear_regulator(A: np.ndarray, B: np.ndarray, F: np.ndarray, Q: np.ndarray, R: np.ndarray
                     ) -> LinearRegulator | None:
    """Returns the solution of (1), or None if rounding prevents it.

    Args:
        A: Matrix of the state (n, n).
        B: Matrix of the input (n, m); its pair with A is stabilisable.
        F: Gain of the input from which its cost counts (m, n).
        Q: Weight of the state (n, n).
        R: Weight of a − Fξ (m, m), positive definite.
    """
    loop = A + B @ F
    if np.max(np.abs(np.linalg.eigvals(loop))) <= LARGEST_GROWTH:
        K, P = DiscreteTimeLinearQuadraticRegulator(A=loop, B=B, Q=Q, R=R)
        return LinearRegulator(F - K, P)
    gain = -DiscreteTimeLinearQuadraticRegulator(A=A, B=B, Q=Q, R=R)[0]
    last = np.inf
    # In exact numbers P falls at every step; once it does not, the rest is rounding.
    for _ in range(STEPS):
        P = _cost_of(A + B @ gain, Q + (gain - F).T @ R @ (gain - F))
        if not np.isfinite(P).all() or np.trace(P) >= last:
            break
        last = float(np.trace(P))
        try:
            gain = -np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A - R @ F)
        except np.linalg.LinAlgError:
            return None
    closed, stage = A + B @ gain, Q + (gain - F).T @ R @ (gain - F)
    if not (np.isfinite(P).all() and _stable(closed)):
        return None
    left = _share(closed.T @ P @ closed + stage - P, stage)
    return LinearRegulator(gain, P) if left <= SOLVED else None


def _share(residual: np.ndarray, stage: np.ndarray) -> float:
    """Returns the largest |ξᵀ residual ξ| over ξᵀ stage ξ; infinite if stage is not positive."""
    try:
        root = np.linalg.inv(np.linalg.cholesky(stage))
    except np.linalg.LinAlgError:
        return np.inf
    share = root @ residual @ root.T
    return float(np.max(np.abs(np.linalg.eigvalsh(0.5 * (share + share.T)))))


def _cost_of(closed: np.ndarray, stage: np.ndarray) -> np.ndarray:
    """Returns P = closedᵀ P closed + stage of a stable loop, by doubling; not finite else."""
    P, power = stage, closed
    with np.errstate(over="ignore", invalid="ignore"):
        for _ in range(DOUBLINGS):
            more = power.T @ P @ power
            P, power = P + more, power @ power
            if not np.max(np.abs(more)) > 1e-16 * np.max(np.abs(P)):
                break
    return 0.5 * (P + P.T)


def _stable(closed: np.ndarray) -> bool:
    return bool(np.isfinite(closed).all() and np.max(np.abs(np.linalg.eigvals(closed))) < 1.0)
