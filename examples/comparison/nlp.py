"""Reference solver of the FHOCP: the whole nonlinear program, for SNOPT or IPOPT.

It is slow and independent of `scp`: single shooting in the decision and s, all limits at once and
nonlinear, no convex program, no working set, no line search of ours. Tests compare `scp` with it.
"""

from typing import Generic

import numpy as np
from pydrake.solvers import MathematicalProgram, SolverInterface, SolverOptions

from uvms_drake.common.differentiable import differentiable
from uvms_drake.control.convex.staged_program import StagedProgram, TerminalLimit
from uvms_drake.control.ocp.ocp import TERMINAL_PENALTY, Ocp
from uvms_drake.control.ocp.scp import Solution
from uvms_drake.control.plan.plan import P


class NonlinearSolver(Generic[P]):
    """Solves an `Ocp` from a guess with a general nonlinear solver.

    Args:
        ocp: The problem.
        solver: SnoptSolver or IpoptSolver.
        options: The solver's own.
    """

    def __init__(self, ocp: Ocp[P], solver: SolverInterface, options: SolverOptions | None = None):
        self.ocp = ocp
        self._solver = solver
        self._options = options or SolverOptions()

    def solve(self, guess: P) -> Solution[P]:
        """Returns the solution of the program that starts at the guess's first knot."""
        prog = MathematicalProgram()
        x = prog.NewContinuousVariables(guess.decision.size + 1, "x")
        cost = differentiable(lambda v: self._cost(v, guess))
        prog.AddCost(lambda v: cost(v)[0], vars=x)
        lower, upper = self._bounds(guess)
        prog.AddConstraint(
            differentiable(lambda v: self._constraints(v, guess)), lb=lower, ub=upper, vars=x)
        prog.AddBoundingBoxConstraint(0.0, np.inf, x[-1])
        start = np.append(guess.decision.ravel(), self.ocp.evaluate(guess).terminal_slack)
        result = self._solver.Solve(prog, start, self._options)
        if not result.is_success():
            return Solution(None, None, 1, converged=False)
        plan = self._plan(result.GetSolution(x), guess)
        return Solution(plan, self.ocp.evaluate(plan), 1, converged=True)

    def _plan(self, v: np.ndarray, guess: P) -> P:
        return guess.redone(guess.start, v[:-1].reshape(guess.decision.shape))

    def _cost(self, v: np.ndarray, guess: P) -> tuple[np.ndarray, np.ndarray]:
        """Returns the objective (1,) and its gradient (1, number of variables)."""
        plan = self._plan(v, guess)
        program, evaluation = self.ocp.staged_program(plan), self.ocp.evaluate(plan)
        value = evaluation.cost + TERMINAL_PENALTY * (v[-1] - evaluation.terminal_slack)
        Z = _responses(program)
        gradient = np.tensordot(program.g, Z[:-1], 2) + program.g_end @ Z[-1, : len(program.g_end)]
        return np.array([value]), np.append(gradient, TERMINAL_PENALTY)[None]

    def _bounds(self, guess: P) -> tuple[np.ndarray, np.ndarray]:
        program = self.ocp.staged_program(guess)
        linear = program.linear
        norms = np.concatenate([limit.bound**2 for limit in program.norms])
        radius_bound = program.terminal.radius_bound
        ends = np.zeros(1 if radius_bound is None else 1 + 2 * len(radius_bound.size))
        return (np.concatenate([linear.lower.ravel(), np.full(len(norms) + len(ends), -np.inf)]),
                np.concatenate([linear.upper.ravel(), norms, ends]))

    def _constraints(self, v: np.ndarray, guess: P) -> tuple[np.ndarray, np.ndarray]:
        """Returns linear limits, squared norms and terminal set, and their Jacobian."""
        program = self.ocp.staged_program(self._plan(v, guess))
        Z, linear = _responses(program), program.linear
        ends, by_end = _terminal(program.terminal, v[-1], Z[-1, : len(program.g_end)])
        values = np.concatenate([
            linear.value.ravel(),
            *(np.sum(limit.value**2, axis=1) for limit in program.norms), ends])
        jacobian = np.zeros((len(values), len(v)))
        jacobian[: -len(ends), :-1] = np.concatenate([
            (linear.C @ Z).reshape(linear.value.size, -1),
            *(2.0 * np.einsum("kr,krv->kv", limit.value, limit.C @ Z)
              for limit in program.norms)])
        jacobian[-len(ends):] = by_end
        return values, jacobian


def _terminal(terminal: TerminalLimit, s: float, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns ‖value‖² − (radius + s)², and for each bound r likewise and −(r + s), all ≤ 0.

    Args:
        terminal: The terminal set.
        s: Its slack.
        x: ∂x_N/∂w (nx, N nw).

    Returns:
        Values (1,), or two more for each of the bounds, and their derivatives by w and s.
    """
    more: list[float] = []
    by_more: list[np.ndarray] = []
    square, end = terminal.value @ terminal.value, 2.0 * terminal.value @ (terminal.T @ x)
    if terminal.radius_bound is not None:
        radii, rows = terminal.radius_bound.size + s, terminal.radius_bound.rows @ x
        for bound, row in zip(radii, rows, strict=True):
            more += [square - bound**2, -bound]
            by_more += [np.append(end - 2.0 * bound * row, -2.0 * bound), np.append(-row, -1.0)]
    if np.isinf(terminal.radius):
        return np.array([0.0, *more]), np.array([np.zeros(len(end) + 1), *by_more])
    radius = terminal.radius + s
    return (np.array([square - radius**2, *more]),
            np.array([np.append(end, -2.0 * radius), *by_more]))


def _responses(program: StagedProgram) -> np.ndarray:
    """Returns ∂z/∂w (N+1, nx+nw, N nw)."""
    N, nx, nw = program.B.shape
    Z = np.zeros((N + 1, nx + nw, N * nw))
    for k in range(N):
        Z[k, nx:, k * nw: (k + 1) * nw] = np.eye(nw)
        Z[k + 1, :nx] = program.A[k] @ Z[k, :nx] + program.B[k] @ Z[k, nx:]
    return Z
