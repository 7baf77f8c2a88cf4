"""The reference solver of the FHOCP: the whole nonlinear program, for SNOPT or IPOPT.

It is slow and it shares with `scp` only the model: multiple shooting in (𝔮, ζ, ζ̇, s), every
constraint as it stands in `ocp`, no convex subproblem. Tests hold the fast solver against it.
"""

from collections.abc import Callable

import numpy as np
from pydrake.autodiffutils import AutoDiffXd, ExtractGradient, ExtractValue
from pydrake.solvers import MathematicalProgram, SolverInterface, SolverOptions

from uvms_drake.control.dynamic_ocp import DynamicOcp
from uvms_drake.control.ocp import TERMINAL_PENALTY
from uvms_drake.control.plan import DynamicPlan, advance
from uvms_drake.control.scp import Solution
from uvms_drake.model.uvms_model import COMPLEX_STEP, configuration_rate_matrix


class NonlinearSolver:
    """Solves an `DynamicOcp` from a guess with a general nonlinear solver.

    Args:
        ocp: The problem.
        solver: SnoptSolver or IpoptSolver.
        options: The solver's own.
    """

    def __init__(self, ocp: DynamicOcp, solver: SolverInterface,
                 options: SolverOptions | None = None):
        self.ocp = ocp
        self._solver = solver
        self._options = options or SolverOptions()

    def solve(self, guess: DynamicPlan) -> Solution:
        """Returns the solution of the program that starts at the guess's first knot."""
        N, size = self.ocp.horizon, self.ocp.model.size
        prog = MathematicalProgram()
        x = prog.NewContinuousVariables(3 * N * size + 1, "x")
        prog.AddCost(_differentiable(lambda v: self._cost(v, guess)), vars=x)
        lower, upper = self._bounds()
        prog.AddConstraint(
            _differentiable(lambda v: self._constraints(v, guess)), lb=lower, ub=upper, vars=x)
        self._add_simple_bounds(prog, x)
        start = np.concatenate([guess.config[1:].ravel(), guess.zeta[1:].ravel(),
                                guess.zeta_dot.ravel(), [self.ocp.evaluate(guess).terminal_slack]])
        result = self._solver.Solve(prog, start, self._options)
        if not result.is_success():
            return Solution(None, None, 1, converged=False)
        _, _, zeta_dot, _ = self._unpack(result.GetSolution(x), guess)
        plan = DynamicPlan.from_accelerations(
            guess.start_time, guess.time_step, guess.config[0], guess.zeta[0], zeta_dot)
        return Solution(plan, self.ocp.evaluate(plan), 1, converged=True)

    def _unpack(self, v: np.ndarray, guess: DynamicPlan):
        """Returns 𝔮, ζ (N+1, 6+n), ζ̇ (N, 6+n) and s."""
        N, size = self.ocp.horizon, self.ocp.model.size
        config, zeta, zeta_dot = v[:-1].reshape(3, N, size)
        return (np.concatenate([guess.config[:1], config]),
                np.concatenate([guess.zeta[:1], zeta]), zeta_dot, v[-1])

    def _cost(self, v: np.ndarray, guess: DynamicPlan) -> tuple[np.ndarray, np.ndarray]:
        """Returns the objective (1,) and its gradient (1, number of variables)."""
        ocp = self.ocp
        N, size, h = ocp.horizon, ocp.model.size, ocp.time_step
        config, zeta, zeta_dot, slack = self._unpack(v, guess)
        y, y_config, f, f_config, f_zeta = self._model(config, zeta)
        xi = np.concatenate([y - ocp.y_des, zeta], axis=1)
        du = zeta_dot - f[:-1] - ocp.u_eq
        weights = [h * ocp.Q] * N + [ocp.terminal.P]
        value = sum(e @ W @ e for e, W in zip(xi, weights, strict=True))
        value += h * np.sum((du @ ocp.R) * du) + TERMINAL_PENALTY * slack
        by_xi = np.array([2.0 * W @ e for e, W in zip(xi, weights, strict=True)])
        by_u = 2.0 * h * du @ ocp.R
        by_config = (np.swapaxes(y_config, 1, 2) @ by_xi[:, :size, None])[..., 0]
        by_zeta = by_xi[:, size:].copy()
        by_config[:-1] -= (np.swapaxes(f_config[:-1], 1, 2) @ by_u[..., None])[..., 0]
        by_zeta[:-1] -= (np.swapaxes(f_zeta[:-1], 1, 2) @ by_u[..., None])[..., 0]
        gradient = np.concatenate(
            [by_config[1:].ravel(), by_zeta[1:].ravel(), by_u.ravel(), [TERMINAL_PENALTY]])
        return np.array([value]), gradient[None]

    def _model(self, config: np.ndarray, zeta: np.ndarray):
        """Returns y, ∂y/∂𝔮, f, ∂f/∂𝔮 and ∂f/∂ζ at the knots."""
        y, J_x, _ = self.ocp.model.task_motion(config, np.zeros_like(zeta))
        y_config = J_x @ np.linalg.inv(configuration_rate_matrix(config))
        return (self.ocp.unwrapped(y), y_config, *self.ocp.model.drift_derivatives(config, zeta))

    def _bounds(self) -> tuple[np.ndarray, np.ndarray]:
        ocp, N, size = self.ocp, self.ocp.horizon, self.ocp.model.size
        limits = ocp.limits
        norms = np.tile(np.square([limits.nu1, limits.nu2, limits.qdot]), N)
        u, tip = np.tile(limits.u, 2 * N), np.full(N, limits.tip_pitch)
        tau = np.full(2 * N * size, np.inf) if limits.tau is None else np.tile(limits.tau, 2 * N)
        zero = np.zeros(2 * N * size)
        return (np.concatenate([zero, -u, -tau, np.full(3 * N, -np.inf), -tip, [-np.inf]]),
                np.concatenate([zero, u, tau, norms, tip, [0.0]]))

    def _constraints(self, v: np.ndarray, guess: DynamicPlan) -> tuple[np.ndarray, np.ndarray]:
        """Returns motion, inputs, forces, speeds, tip pitch, terminal set, and their Jacobian."""
        ocp = self.ocp
        N, size, h = ocp.horizon, ocp.model.size, ocp.time_step
        config, zeta, zeta_dot, slack = self._unpack(v, guess)
        y, y_config, f, f_config, f_zeta = self._model(config, zeta)
        steps = 1j * COMPLEX_STEP * np.eye(3 * size)
        moved = advance(config[:-1, None] + steps[:, :size],
                        zeta[:-1, None] + steps[:, size: 2 * size],
                        zeta_dot[:, None] + steps[:, 2 * size:], h)
        rates = np.swapaxes(moved.imag / COMPLEX_STEP, 1, 2)
        inputs = np.stack([zeta_dot - f[:-1], zeta_dot - f[1:]])
        M, force_config = self._forces(config, inputs)
        blocks = (slice(0, 3), slice(3, 6), slice(6, size))
        xi = np.concatenate([y[-1] - ocp.y_des, zeta[-1]])
        P = ocp.terminal.P
        values = np.concatenate([
            (moved[:, 0].real - config[1:]).ravel(),
            (zeta[:-1] + h * zeta_dot - zeta[1:]).ravel(),
            inputs.ravel(), (np.stack([M[:-1], M[1:]]) @ inputs[..., None]).ravel(),
            np.array([[z[block] @ z[block] for block in blocks] for z in zeta[1:]]).ravel(),
            y[1:, 4],
            [xi @ P @ xi - (ocp.terminal.radius + slack) ** 2]])

        # Rows as in `values`; columns by (kind, knot or interval): 𝔮, ζ at 1..N and ζ̇ at 0..N−1.
        J = np.zeros((len(values), 3 * N * size + 1))
        motion, velocity, begin, end, force_begin, force_end = J[: 6 * N * size].reshape(
            6, N, size, -1)
        speed = J[6 * N * size: 6 * N * size + 3 * N].reshape(N, 3, -1)
        tip, terminal = J[-N - 1: -1], J[-1]

        def columns(kind: int, k: int) -> slice:
            first = (kind * N + k) * size
            return slice(first, first + size)

        eye = np.eye(size)
        for k in range(N):  # knot k+1 ends interval k
            q_next, z_next, a = columns(0, k), columns(1, k), columns(2, k)
            motion[k, :, q_next] = -eye
            motion[k, :, a] = rates[k, :, 2 * size:]
            velocity[k, :, z_next] = -eye
            velocity[k, :, a] = h * eye
            begin[k, :, a] = end[k, :, a] = eye
            end[k, :, q_next], end[k, :, z_next] = -f_config[k + 1], -f_zeta[k + 1]
            force_end[k] = M[k + 1] @ end[k]
            force_end[k, :, q_next] += force_config[1, k]
            if k > 0:
                q, z = columns(0, k - 1), columns(1, k - 1)
                motion[k, :, q], motion[k, :, z] = rates[k, :, :size], rates[k, :, size: 2 * size]
                velocity[k, :, z] = eye
                begin[k, :, q], begin[k, :, z] = -f_config[k], -f_zeta[k]
                force_begin[k, :, q] = force_config[0, k]
            force_begin[k] += M[k] @ begin[k]
            for i, block in enumerate(blocks):
                speed[k, i, z_next][block] = 2.0 * zeta[k + 1, block]
            tip[k, q_next] = y_config[k + 1, 4]
        terminal[columns(0, N - 1)] = 2.0 * (P @ xi)[:size] @ y_config[-1]
        terminal[columns(1, N - 1)] = 2.0 * (P @ xi)[size:]
        terminal[-1] = -2.0 * (ocp.terminal.radius + slack)
        return values, J

    def _forces(self, config: np.ndarray, inputs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns M (N+1, ...) and ∂(M ū)/∂𝔮 (2, N, ...) at both ends of the intervals."""
        moved = config[:, None, :] + 1j * COMPLEX_STEP * np.eye(config.shape[1])
        M = self.ocp.model.mass_matrix(self.ocp.model.kinematics(moved))
        rates = np.moveaxis(M.imag / COMPLEX_STEP, 1, -1)
        return M[:, 0].real, np.einsum(
            "ekrcj,ekc->ekrj", np.stack([rates[:-1], rates[1:]]), inputs)

    def _add_simple_bounds(self, prog: MathematicalProgram, x: np.ndarray) -> None:
        limits, N, size = self.ocp.limits, self.ocp.horizon, self.ocp.model.size
        config = x[: N * size].reshape(N, size)
        for k in range(N):
            prog.AddBoundingBoxConstraint(limits.q_lower, limits.q_upper, config[k, 6:])
            prog.AddBoundingBoxConstraint(-limits.roll, limits.roll, config[k, 3])
            prog.AddBoundingBoxConstraint(-limits.pitch, limits.pitch, config[k, 4])
        prog.AddBoundingBoxConstraint(0.0, np.inf, x[-1])


def _differentiable(function: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]) -> Callable:
    """Returns `function` (value and Jacobian of an array) as Drake's solvers call it."""
    def evaluate(x: np.ndarray):
        if x.dtype != object:
            value = function(x)[0]
            return value if len(value) > 1 else value[0]
        value, jacobian = function(ExtractValue(x).ravel())
        gradient = jacobian @ ExtractGradient(x)
        out = np.array([AutoDiffXd(v, row) for v, row in zip(value, gradient, strict=True)])
        return out if len(out) > 1 else out[0]
    return evaluate
