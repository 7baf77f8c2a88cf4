"""The fast solver of the FHOCP: sequential convex programming with exact cones.

One `MathematicalProgram` is built once. An iteration updates the coefficients of the dynamics, the
drift and the attitude, solves the second-order cone program, and takes the longest of the steps 1,
½, ¼, ... along which the true merit (cost and violation, nothing linearised) falls. The limits on
what is linearised are softened by an exact penalty, so that the program has a solution whenever
the linear limits can be kept. One iteration
a sample is enough for what the closed loop needs: the plan is never worse than the last one
continued by the terminal controller (Scokaert, Mayne and Rawlings 1999).
"""

from dataclasses import dataclass

import numpy as np
from pydrake.solvers import ClarabelSolver, MathematicalProgram

from uvms_drake.control.ocp import TERMINAL_PENALTY, Evaluation, Linearisation, Ocp
from uvms_drake.control.plan import Plan

SHORTEST_STEP = 1.0 / 64.0
EXCESS_PENALTY = 1e5
"""Cost of relaxing all softened limits by one unit; above the sum of their multipliers."""


@dataclass(frozen=True)
class Solution:
    """What a solve found; `plan` is None if the solver failed."""

    plan: Plan | None
    evaluation: Evaluation | None
    iterations: int
    converged: bool
    """No step improved the merit by more than the tolerance."""


class SequentialConvexSolver:
    """Solves an `Ocp` from a guess."""

    def __init__(self, ocp: Ocp):
        self.ocp = ocp
        self._solver = ClarabelSolver()
        N, size = ocp.horizon, ocp.model.size
        prog = self._prog = MathematicalProgram()
        y = self._y = prog.NewContinuousVariables(N + 1, size, "y")
        zeta = self._zeta = prog.NewContinuousVariables(N + 1, size, "ζ")
        a = self._a = prog.NewContinuousVariables(N, size, "ζ̇")
        g = self._g = prog.NewContinuousVariables(N + 1, size, "−f")
        slack = prog.NewContinuousVariables(1, "s")
        excess = prog.NewContinuousVariables(1, "violation")
        self._add_cost(prog, y, zeta, a, g, slack)
        self._add_limits(prog, y, zeta, a, g, excess)
        self._add_terminal_set(prog, y, zeta, slack)
        self._add_model(prog, y, zeta, a, g, excess)

    def _add_cost(self, prog, y, zeta, a, g, slack) -> None:
        ocp, h = self.ocp, self.ocp.time_step
        target = np.concatenate([ocp.y_des, np.zeros(ocp.model.size)])
        for k in range(ocp.horizon):
            prog.AddQuadraticErrorCost(h * ocp.Q, target, np.concatenate([y[k], zeta[k]]))
            weight = np.tile(h * ocp.R, (2, 2))  # of ū = ζ̇ + g
            prog.AddQuadraticCost(
                2.0 * weight, -2.0 * weight[:, : len(ocp.u_eq)] @ ocp.u_eq,
                float(h * ocp.u_eq @ ocp.R @ ocp.u_eq), np.concatenate([a[k], g[k]]),
                is_convex=True)
        prog.AddQuadraticErrorCost(ocp.terminal.P, target, np.concatenate([y[-1], zeta[-1]]))
        prog.AddLinearCost([TERMINAL_PENALTY], slack)

    def _add_limits(self, prog, y, zeta, a, g, excess) -> None:
        limits, size = self.ocp.limits, self.ocp.model.size
        u_rows = _soft_rows(np.hstack([np.eye(size), np.eye(size)]))
        prog.AddLinearCost([EXCESS_PENALTY], excess)
        prog.AddBoundingBoxConstraint(0.0, np.inf, excess)
        for k in range(self.ocp.horizon):
            for knot in (k, k + 1):  # ū at the beginning and at the end of the interval
                prog.AddLinearConstraint(u_rows, np.full(2 * size, -np.inf), np.tile(limits.u, 2),
                                         np.concatenate([a[k], g[knot], excess]))
            for bound, block in ((limits.nu1, slice(0, 3)), (limits.nu2, slice(3, 6)),
                                 (limits.qdot, slice(6, size))):
                _add_norm_limit(prog, bound, zeta[k + 1, block])
            prog.AddBoundingBoxConstraint(-limits.tip_pitch, limits.tip_pitch, y[k + 1, 4])
            prog.AddBoundingBoxConstraint(limits.q_lower, limits.q_upper, y[k + 1, 6:])

    def _add_terminal_set(self, prog, y, zeta, slack) -> None:
        ocp = self.ocp
        root = np.linalg.cholesky(ocp.terminal.P).T
        size = len(root)
        A = np.zeros((size + 1, size + 1))
        A[0, size] = 1.0
        A[1:, :size] = root
        b = np.concatenate([[ocp.terminal.radius], -root[:, : size // 2] @ ocp.y_des])
        prog.AddLorentzConeConstraint(A, b, np.concatenate([y[-1], zeta[-1], slack]))
        prog.AddBoundingBoxConstraint(0.0, np.inf, slack)

    def _add_model(self, prog, y, zeta, a, g, excess) -> None:
        """Adds what each iteration updates, with placeholder coefficients."""
        N, size, h = self.ocp.horizon, self.ocp.model.size, self.ocp.time_step
        eye, zero = np.eye(size), np.zeros(size)
        self._start = prog.AddLinearEqualityConstraint(
            np.eye(2 * size), np.zeros(2 * size), np.concatenate([y[0], zeta[0]]))
        for k in range(N):
            prog.AddLinearEqualityConstraint(
                np.hstack([eye, h * eye, -eye]), zero, np.concatenate([zeta[k], a[k], zeta[k + 1]]))
        self._motion = [prog.AddLinearEqualityConstraint(
            np.zeros((size, 4 * size)), zero, np.concatenate([y[k], zeta[k], a[k], y[k + 1]]))
            for k in range(N)]
        self._drift = [prog.AddLinearEqualityConstraint(
            np.zeros((size, 3 * size)), zero, np.concatenate([g[k], y[k], zeta[k]]))
            for k in range(N + 1)]
        self._attitude = [prog.AddLinearConstraint(
            np.zeros((4, size + 1)), np.full(4, -np.inf), np.full(4, np.inf),
            np.concatenate([y[k], excess])) for k in range(1, N + 1)]
        self._tau = [] if self.ocp.limits.tau is None else [prog.AddLinearConstraint(
            np.zeros((2 * size, 3 * size + 1)), np.full(2 * size, -np.inf),
            np.full(2 * size, np.inf), np.concatenate([a[k], g[knot], y[knot], excess]))
            for k in range(N) for knot in (k, k + 1)]

    def solve(self, guess: Plan, iterations: int, tolerance: float = 1e-6) -> Solution:
        """Returns the best plan found from `guess`, whose first knot is the initial state.

        Args:
            guess: Where the first linearisation is taken.
            iterations: At most so many convex programs are solved.
            tolerance: Converged when a step improves the merit by less than this fraction of it.
        """
        plan, evaluation = guess, self.ocp.evaluate(guess)
        for iteration in range(1, iterations + 1):
            target = self._convex_step(plan)
            if target is None:
                return Solution(None, None, iteration, converged=False)
            step = self._line_search(plan, evaluation, target)
            if step is None:
                return Solution(plan, evaluation, iteration, converged=True)
            gain = evaluation.merit - step[1].merit
            plan, evaluation = step
            if gain <= tolerance * abs(evaluation.merit):
                return Solution(plan, evaluation, iteration, converged=True)
        return Solution(plan, evaluation, iterations, converged=False)

    def _convex_step(self, plan: Plan) -> np.ndarray | None:
        """Returns the accelerations (N, 6+n) that solve the program linearised about `plan`."""
        self._update(self.ocp.linearise(plan), plan)
        result = self._solver.Solve(self._prog)
        target = result.GetSolution(self._a)
        return target if result.is_success() and np.all(np.isfinite(target)) else None

    def _update(self, model: Linearisation, plan: Plan) -> None:
        size = self.ocp.model.size
        eye = np.eye(size)
        limits = self.ocp.limits
        self._start.evaluator().UpdateCoefficients(
            np.eye(2 * size), np.concatenate([model.y[0], plan.zeta[0]]))
        for k, binding in enumerate(self._motion):
            A = np.hstack([model.dy_dy[k], model.dy_dzeta[k], model.dy_da[k], -eye])
            now = np.concatenate([model.y[k], plan.zeta[k], plan.zeta_dot[k], model.y[k + 1]])
            binding.evaluator().UpdateCoefficients(A, A @ now)
        for k, binding in enumerate(self._drift):
            A = np.hstack([eye, model.f_y[k], model.f_zeta[k]])
            now = np.concatenate([-model.f[k], model.y[k], plan.zeta[k]])
            binding.evaluator().UpdateCoefficients(A, A @ now)
        for k, binding in enumerate(self._attitude, start=1):
            A = model.attitude_y[k]
            _update_soft(binding, A, A @ model.y[k] - model.attitude[k],
                         np.array([limits.roll, limits.pitch]))
        for i, binding in enumerate(self._tau):
            k, end = divmod(i, 2)
            M, tau_y = model.M[k + end], model.tau_y[end, k]
            _update_soft(binding, np.hstack([M, M, tau_y]), tau_y @ model.y[k + end],
                         np.asarray(limits.tau))

    def _line_search(self, plan: Plan, evaluation: Evaluation, target: np.ndarray
                     ) -> tuple[Plan, Evaluation] | None:
        step = 1.0
        while step >= SHORTEST_STEP:
            zeta_dot = plan.zeta_dot + step * (target - plan.zeta_dot)
            candidate = Plan.from_accelerations(
                plan.start_time, plan.time_step, plan.config[0], plan.zeta[0], zeta_dot)
            value = self.ocp.evaluate(candidate)
            if value.merit < evaluation.merit:
                return candidate, value
            step *= 0.5
        return None


def _soft_rows(A: np.ndarray) -> np.ndarray:
    """Returns the rows of ±A x − v ≤ ..., in the variables (x, v)."""
    return np.hstack([np.vstack([A, -A]), -np.ones((2 * len(A), 1))])


def _update_soft(binding, A: np.ndarray, offset: np.ndarray, limit: np.ndarray) -> None:
    """Makes a constraint |A x − offset| ≤ limit + v."""
    binding.evaluator().UpdateCoefficients(
        _soft_rows(A), np.full(2 * len(A), -np.inf),
        np.concatenate([limit + offset, limit - offset]))


def _add_norm_limit(prog: MathematicalProgram, bound: float, x: np.ndarray) -> None:
    """Adds ‖x‖₂ ≤ bound as a Lorentz cone."""
    A = np.vstack([np.zeros((1, len(x))), np.eye(len(x))])
    prog.AddLorentzConeConstraint(A, np.concatenate([[bound], np.zeros(len(x))]), x)
