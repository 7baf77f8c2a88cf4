"""Second-order correction of a step of sequential convex programming.

A convex program keeps the limits to first order, so a long step along a curved limit leaves it by
the second-order remainder. A line search then cuts the step however good it is (Maratos 1978), the
shorter the closer the plan already is to the limit. Instead the plan after the step is moved back
by the least-norm r, in the metric of the cost, that gives every limit which is reached or exceeded
there the value that the program predicted. The error is then of the order of the remainder's square
with slopes at the new plan; with those of the old plan, which are known, of the remainder times the
step.
"""

from typing import NamedTuple

import numpy as np

from uvms_drake.control.convex.regulator import responses, riccati
from uvms_drake.control.convex.staged_program import StagedProgram
from uvms_drake.model.frames.spatial import times

REACHED = 1e-5
"""Distance to a bound, in the limit's own unit, that counts as none."""
INSIDE = 1e-7
"""Distance to its bound that a limit gets which the program had not reached, likewise."""
ROUNDS = 5
"""Newton steps; the limits that one of them exceeds are active in the next."""
DEPENDENT = 1e-3
"""Smallest singular value of the unit gradients of limits, over the largest, that counts as
independent."""


class Excesses(NamedTuple):
    """Excesses of limits and their gradients by z; negative inside."""

    value: np.ndarray
    """Excesses (N+1, m); −∞ where there is no limit."""
    C: np.ndarray
    """Their gradients (N+1, m, nx+nw)."""


def excesses(program: StagedProgram, z: np.ndarray | float = 0.0) -> Excesses:
    """Returns the program's excesses after a motion z (N+1, nx+nw), without the terminal set."""
    (N, nx, nw), linear = program.B.shape, program.linear
    z = np.broadcast_to(z, (N + 1, nx + nw))
    value = linear.value + times(linear.C, z)
    values, rows = [value - linear.upper, linear.lower - value], [linear.C, -linear.C]
    for limit in program.norms:
        vector = limit.value + z @ limit.C.T
        size = np.linalg.norm(vector, axis=1, keepdims=True)
        values.append(size - limit.bound[:, None])
        rows.append((vector / np.maximum(size, INSIDE) @ limit.C)[:, None])
    return Excesses(np.concatenate(values, axis=1), np.concatenate(rows, axis=1))


class Correction:
    """Correction of a step to the values of the limits that its convex program predicted.

    Args:
        program: The program that the step is the solution of.
        w: The step (N, nw).

    Raises:
        LinAlgError: A cost is not convex, or an entry not finite.
    """

    def __init__(self, program: StagedProgram, w: np.ndarray):
        N, nx, nw = program.B.shape
        z = np.zeros((N + 1, nx + nw))
        z[:-1, nx:] = w
        for k in range(N):
            z[k + 1, :nx] = program.A[k] @ z[k, :nx] + program.B[k] @ w[k]
        self._response = responses(program, riccati(program))
        predicted = excesses(program, z).value
        self._wanted = np.where(predicted > -REACHED, np.minimum(predicted, -INSIDE), -INSIDE)
        self._goal = program.terminal.value + program.terminal.T @ z[-1, :nx]

    def of(self, program: StagedProgram) -> np.ndarray:
        """Returns the change of the decision (N, nw) that removes the remainder of the limits.

        Where the end is outside of the terminal set, all of value + T x_N gets its predicted value,
        not its norm alone: where the radius is nearly zero, the norm has a kink.

        Args:
            program: The program with the values at the plan after the step, and with the slopes
                there or, nearly as good after a short step, those before it.
        """
        response, wanted = self._response, self._wanted
        (_, nx, nw), end, goal = program.B.shape, program.terminal, self._goal
        end_r, radius = response[-1, :nx], program.terminal.radius_bounds(np.zeros(nx))
        least = np.linalg.norm(goal) + INSIDE
        active, r = np.zeros(wanted.shape, dtype=bool), np.zeros(response.shape[-1])
        ends, tight = False, np.zeros(len(radius.size), dtype=bool)
        for _ in range(ROUNDS):
            # Norms are not linear: their gradients are taken after the last round.
            value, C = excesses(program, response @ r)
            active |= value > wanted
            x = end_r @ r
            ends = ends or end.excess(x) > -INSIDE
            size = radius.size + radius.rows @ x
            tight |= ends & (size < least)
            residual = np.concatenate([
                (wanted - value)[active], (least - size)[tight],
                goal - end.value - end.T @ x if ends else []])
            if np.max(np.abs(residual), initial=0.0) < INSIDE:
                break
            F = np.concatenate([
                *(C[k, active[k]] @ response[k] for k in range(len(C))), radius.rows[tight] @ end_r,
                end.T @ end_r if ends else end.T[:0] @ end_r])
            sizes = np.linalg.norm(F, axis=1)
            moves = sizes > 0.0
            F, residual = F[moves] / sizes[moves, None], residual[moves] / sizes[moves]
            r = least_norm_solution(F, residual + F @ r)
        return (response @ r)[:-1, nx:].reshape(-1, nw)


def least_norm_solution(F: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Returns the least-norm r with F r = b in the range of F (m, n), by its Gram matrix (m, m)."""
    squares, directions = np.linalg.eigh(F @ F.T)
    spanned = squares > DEPENDENT**2 * squares[-1:]
    directions = directions[:, spanned]
    return F.T @ (directions @ (directions.T @ b / squares[spanned]))
