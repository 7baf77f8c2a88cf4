"""A discrete-time regulator whose cost weighs a − Fξ, however large F is.

    minimise Σ ξᵀQξ + (a − Fξ)ᵀR(a − Fξ),   ξ⁺ = Aξ + Ba.                                       (1)

In w = a − Fξ it is the standard regulator of ξ⁺ = (A + BF)ξ + Bw, which a Riccati solver answers
well as long as A + BF is of moderate size. A large F is no unstable loop: one joint of viscous
damping D and inertia M has −hD/M in it, while its motion decays by exp(−hD/M). But rounding grows
with it, so Newton's method takes over there (Kleinman 1968, Hewer 1971): from a controller a = Gξ
that stabilises A + BG, alternately

    P = (A + BG)ᵀP(A + BG) + Q + (G − F)ᵀR(G − F),   G = −(R + BᵀPB)⁻¹(BᵀPA − RF).              (2)

Every G stabilises, and P falls to the solution quadratically. It never forms A + BF.
"""

from typing import NamedTuple

import numpy as np
from pydrake.systems.controllers import DiscreteTimeLinearQuadraticRegulator

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
