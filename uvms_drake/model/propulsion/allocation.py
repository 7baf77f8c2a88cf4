"""Control allocation: forces of the thrusters for a wrench on the vehicle.

With W diagonal, one weight for each axis that is driven, and B_d their rows of the thrust map,

    f = argmin ‖W(B_d f − τ_d)‖₂² + ε²‖f − b‖₂²,   lower ≤ f ≤ upper,   ε → 0.              (1)

Where the limits do not bind, f = B_d⁺τ_d + b for every W, linear in the wrench, with a bias b in
the null space of B_d, with which opposed thrusters stay out of their dead bands (for m above the
rank of B_d). Where limits bind, W weighs the axes.
"""

import functools
from dataclasses import dataclass

import numpy as np
from pydrake.solvers import MathematicalProgram, Solve

from uvms_drake.common.errors import require
from uvms_drake.model.propulsion.thrusters import ThrusterModel

RIDGE = 1e-4
"""ε of (1) in units of the largest force, where W B_d of that force is one."""
NULL = 1e-9


def bias_against_dead_bands(B: np.ndarray, size: float) -> np.ndarray:
    """Returns b (m,) in the null space of B, whose entries are `size` at least, or zero.

    Entries of thrusters outside of the null space are zero. Of the directions N Nᵀs, s = ±1, N a
    basis of the null space, it is the one with the largest ratio of smallest entry to length.

    Args:
        B: Thrust map (r, m).
        size: Smallest force of a thruster [N].
    """
    m = B.shape[1]
    _, singular, right = np.linalg.svd(B)
    N = right[np.count_nonzero(singular > NULL * singular[0]):].T
    free = np.linalg.norm(N, axis=1) > NULL
    if size == 0.0 or not np.any(free):
        return np.zeros(m)
    signs = 1.0 - 2.0 * (np.arange(2 ** (m - 1))[:, None] >> np.arange(m) & 1)
    directions = signs @ N @ N.T
    directions /= np.linalg.norm(directions, axis=1, keepdims=True) + NULL
    least = np.min(np.abs(directions[:, free]), axis=1)
    best = int(np.argmax(least))
    return size / least[best] * np.where(free, directions[best], 0.0)


def bounded_least_squares(A: np.ndarray, y: np.ndarray, lower: np.ndarray, upper: np.ndarray
                          ) -> np.ndarray:
    """Returns the x (m,) in [lower, upper] with the smallest ‖A x − y‖₂, by active sets.

    Stark and Parker, "Bounded-variable least-squares: an algorithm and applications", 1995.

    Args:
        A: Matrix (r, m) of rank m: the solution is unique.
        y: Right side (r,).
        lower: Lower bounds (m,).
        upper: Upper bounds (m,), above.
    """
    x = 0.5 * (lower + upper)
    fixed = np.zeros(len(x), dtype=bool)
    while True:
        # The free entries go to their optimum, or up to the first bound, which becomes active.
        free = np.flatnonzero(~fixed)
        best = x.copy()
        best[free] = np.linalg.lstsq(A[:, free], y - A[:, fixed] @ x[fixed], rcond=None)[0]
        bound = np.where(best > upper, upper, lower)
        beyond = (best > upper) | (best < lower)
        if np.any(beyond):
            part = np.where(beyond, (bound - x) / np.where(beyond, best - x, 1.0), np.inf)
            first = int(np.argmin(part))
            x += max(float(part[first]), 0.0) * (best - x)
            x[first], fixed[first] = bound[first], True
            continue
        # An active bound with a gradient to the inside is released.
        x = best
        gain = A.T @ (y - A @ x) * np.where(x == lower, 1.0, -1.0) * fixed
        worst = int(np.argmax(gain))
        if gain[worst] <= NULL * np.linalg.norm(A[:, worst]) * np.linalg.norm(y):
            return x
        fixed[worst] = False


def largest_wrench(thrusters: ThrusterModel, axis: int, sign: float) -> float:
    """Returns the largest force or moment along or against an axis; zero if none drives it."""
    if axis in thrusters.undriven:
        return 0.0
    program = MathematicalProgram()
    f, size = program.NewContinuousVariables(thrusters.size), program.NewContinuousVariables(1)
    program.AddBoundingBoxConstraint(thrusters.lower, thrusters.upper, f)
    B = thrusters.B[thrusters.driven]
    direction = sign * (thrusters.driven == axis)
    program.AddLinearEqualityConstraint(
        np.column_stack([B, -direction]), np.zeros(len(B)), np.concatenate([f, size]))
    program.AddLinearCost(-size[0])
    return float(Solve(program).GetSolution(size)[0])


def weaker_wrench(thrusters: ThrusterModel, axis: int) -> float:
    """Returns the largest force or moment about an axis the weaker way; zero if none drives it."""
    return min(largest_wrench(thrusters, axis, sign) for sign in (1.0, -1.0))


@dataclass(frozen=True)
class Allocation:
    """Allocation (1) to the thrusters of a robot."""

    thrusters: ThrusterModel

    @staticmethod
    def to(thrusters: ThrusterModel) -> "Allocation":
        """Returns the allocation to thrusters whose bias is within their limits."""
        out = Allocation(thrusters)
        within = bool(np.all((thrusters.lower <= out.bias) & (out.bias <= thrusters.upper)))
        require(within, "bias", thrusters.bias,
                f"smaller: it takes forces up to {np.max(np.abs(out.bias)):.4g} N")
        return out

    @functools.cached_property
    def others(self) -> "tuple[Allocation, ...]":
        """Allocations (m) without each thruster."""
        return tuple(Allocation(self.thrusters.without(i)) for i in range(self.thrusters.size))

    @functools.cached_property
    def matrix(self) -> np.ndarray:
        """(m, 6) B_d⁺ with zeros for the undriven axes."""
        out = np.zeros((self.thrusters.size, 6))
        out[:, self.thrusters.driven] = np.linalg.pinv(self._B)
        return out

    @functools.cached_property
    def bias(self) -> np.ndarray:
        """Bias b (m,) [N]."""
        return bias_against_dead_bands(self._B, self.thrusters.bias)

    @functools.cached_property
    def weights(self) -> np.ndarray:
        """Diagonal of W: one over the largest force or moment on each driven axis [N, N m]."""
        largest = np.maximum(-self.thrusters.lower, self.thrusters.upper)
        return 1.0 / (np.abs(self._B) @ largest)

    @functools.cached_property
    def largest(self) -> np.ndarray:
        """Largest force or moment on each driven axis (r,) [N, N m]."""
        return 1.0 / self.weights

    @property
    def _B(self) -> np.ndarray:
        return self.thrusters.B[self.thrusters.driven]

    def forces(self, wrench: np.ndarray) -> np.ndarray:
        """Returns the forces (m,) [N] for a wrench τ_v (6,) in axes of B about Bo [N, N m].

        They are NaN if it is.
        """
        lower, upper = self.thrusters.lower, self.thrusters.upper
        forces = self.matrix @ wrench + self.bias
        if not np.any((forces < lower) | (forces > upper)):
            return forces
        ridge = RIDGE / np.max(np.maximum(-lower, upper))
        A = np.vstack([self.weights[:, None] * self._B, ridge * np.eye(len(forces))])
        y = np.concatenate([self.weights * wrench[self.thrusters.driven], ridge * self.bias])
        return bounded_least_squares(A, y, lower, upper)

    def forces_without(self, isolated: int, wrench: np.ndarray) -> np.ndarray:
        """Returns the forces (m,) [N] for a wrench, zero of an isolated thruster.

        Args:
            isolated: Its number, from 1; 0 for none.
            wrench: τ_v (6,) [N, N m].
        """
        if not isolated:
            return self.forces(wrench)
        return np.insert(self.others[isolated - 1].forces(wrench), isolated - 1, 0.0)

    def shortfall(self, wrench: np.ndarray) -> np.ndarray:
        """Returns the part (6,) of a wrench that the thrusters cannot exert, at rest."""
        return wrench - self.thrusters.B @ self.thrusters.within_current(self.forces(wrench))
