"""Second-order correction of a step of sequential convex programming.

A convex program keeps the limits to first order, so a long step along a curved limit leaves it by
the second-order remainder. A line search then cuts the step however good it is (Maratos 1978), the
shorter the closer the plan already is to the limit. Instead the plan after the step is moved back
by the least-norm r, in the metric of the cost, that gives every limit which is reached or exceeded
there the value that the program predicted. The error is then of the order of the remainder's square
with slopes at the new plan; with those of the old plan, which are known, of the remainder times the
step.
"""

import numpy as np

from uvms_drake.control.convex.regulator import Regulator
from uvms_drake.control.convex.staged_program import StagedProgram
from uvms_drake.model.frames.spatial import times

REACHED = 1e-5
"""Distance to a bound, in the limit's own unit, that counts as none."""
INSIDE = 1e-7
"""Distance to its bound that a limit gets which the program had not reached, likewise."""
SETTLED = 1e-10
"""Change of a limit by the curvature of norms, in its own unit, that counts as none."""
ROUNDS = 5
"""Newton steps; the limits that one of them exceeds are active in the next."""
DEPENDENT = 1e-3
"""Smallest singular value of the unit gradients of limits, over the largest, that counts as
independent."""


def excesses(program: StagedProgram, z: np.ndarray | None = None) -> np.ndarray:
    """Returns the excesses (N+1, m) of the program's limits but for the terminal set after z.

    Those of upper bounds, lower bounds and norms; negative inside, −∞ where there is no limit.

    Args:
        program: The program.
        z: Motion (N+1, nx+nw); None for none.
    """
    linear = program.linear
    value = linear.value if z is None else linear.value + times(linear.C, z)
    values = [value - linear.upper, linear.lower - value]
    for limit in program.norms:
        values.append((limit.norms(z) - limit.bound)[:, None])
    return np.concatenate(values, axis=1)


def excess_rows(program: StagedProgram, which: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Returns the gradients (k, nx+nw) by z of some of the `excesses` after z, stage by stage.

    Args:
        program: The program.
        which: Mask of them (N+1, m), with k entries.
        z: Motion (N+1, nx+nw).
    """
    stage, column = np.nonzero(which)
    count = program.linear.value.shape[1]
    C = np.zeros((len(stage), z.shape[1]))
    for sign, first in ((1.0, 0), (-1.0, count)):
        own = (column >= first) & (column < first + count)
        C[own] = sign * program.linear.C[stage[own], column[own] - first]
    for i, limit in enumerate(program.norms, start=2 * count):
        own = column == i
        vector = limit.value[stage[own]] + z[stage[own]] @ limit.C.T
        C[own] = vector / np.maximum(
            np.linalg.norm(vector, axis=1, keepdims=True), INSIDE) @ limit.C
    return C


class Correction:
    """Correction of a step to the values of the limits that its convex program predicted.

    Args:
        program: The program that the step is the solution of.
        regulator: Its regulator.
        w: The step (N, nw).
    """

    def __init__(self, program: StagedProgram, regulator: Regulator, w: np.ndarray):
        N, nx, nw = program.B.shape
        z, x = np.zeros((N + 1, nx + nw)), np.zeros(nx)
        z[:-1, nx:] = w
        for k, by_w in enumerate(times(program.B, w)):
            z[k + 1, :nx] = x = program.A[k] @ x + by_w
        self._regulator = regulator
        predicted = excesses(program, z)
        self._wanted = np.where(predicted > -REACHED, np.minimum(predicted, -INSIDE), -INSIDE)
        self._goal = program.terminal.value + program.terminal.T @ z[-1, :nx]

    def of(self, program: StagedProgram) -> np.ndarray:
        """Returns the change of the decision (N, nw) that removes the remainder of the limits.

        Where the end is outside of the terminal set, all of value + T x_N gets its predicted value,
        not its norm alone: where the radius is nearly zero, the norm has a kink.

        Args:
            program: The program with the values at the plan after the step, and with the slopes
                there or, nearly as good after a short step, those before it.

        Raises:
            LinAlgError: An entry is not finite.
        """
        wanted = self._wanted
        (N, nx, nw), end, goal = program.B.shape, program.terminal, self._goal
        radius = end.radius_bounds(np.zeros(nx))
        least = np.linalg.norm(goal) + INSIDE
        active, z = np.zeros(wanted.shape, dtype=bool), np.zeros((N + 1, nx + nw))
        ends, tight, left = False, np.zeros(len(radius.size), dtype=bool), np.zeros(0)
        for _ in range(ROUNDS):
            # Norms are not linear: their gradients are taken after the last round.
            value, x = excesses(program, z), z[-1, :nx]
            active |= value > wanted
            ends = ends or end.excess(x) > -INSIDE
            size = radius.size + radius.rows @ x
            tight |= ends & (size < least)
            residual = np.concatenate([
                (wanted - value)[active], (least - size)[tight],
                goal - end.value - end.T @ x if ends else []])
            # While the same limits are active, the remainder of linear ones stays as it is.
            if np.max(np.abs(residual), initial=0.0) < INSIDE or (
                    len(left) == len(residual) and np.max(np.abs(residual - left)) < SETTLED):
                break
            last = np.zeros((np.count_nonzero(tight) + len(end.T) * ends, nx + nw))
            last[:, :nx] = np.concatenate([radius.rows[tight], end.T[: len(end.T) * ends]])
            rows = np.concatenate([excess_rows(program, active, z), last])
            stages = np.concatenate([np.nonzero(active)[0], np.full(len(last), N)])
            F, b = self._regulator.row_gradients(stages, rows), residual + _along(rows, z[stages])
            sizes = np.sqrt(_along(F, F))
            moves = sizes > 0.0
            r = least_norm_solution(F[moves] / sizes[moves, None], b[moves] / sizes[moves])
            z = self._regulator.moved(r)
            left = b - _along(rows, z[stages])
        return z[:-1, nx:]


def _along(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Returns the products (m,) of the rows of a with those of b (m, n)."""
    return np.einsum("ij,ij->i", a, b)


def least_norm_solution(F: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Returns the least-norm r with F r = b in the range of F (m, n), by its Gram matrix (m, m)."""
    gram = F @ F.T
    try:  # Its inverse bounds its eigenvalues: where all are large enough, it is the fastest way.
        inverse = np.linalg.inv(gram)
        if np.trace(gram) * np.linalg.norm(inverse) < DEPENDENT**-2:
            return F.T @ (inverse @ b)
    except np.linalg.LinAlgError:
        pass
    squares, directions = np.linalg.eigh(gram)
    spanned = squares > DEPENDENT**2 * squares[-1:]
    directions = directions[:, spanned]
    return F.T @ (directions @ (directions.T @ b / squares[spanned]))
