"""The comparison's problems solved with CasADi, as its users do.

All controllers solve the same multiple-shooting problem, ordered (x_0, u_0, x_1, u_1, ..., x_N),
from the shifted solution of the step before (multipliers unshifted: shifting them saves no
iterations). They differ in three things:

* derivatives: CasADi's of the plain model, with the exact Hessian; or, as an expert would, RK4
  Jacobians chained by hand and a Gauss-Newton Hessian that keeps the curvature of the
  norm limits;
* compiled or not: derivatives by CasADi's virtual machine, or as C code by gcc;
* solver: IPOPT, or SQP whose quadratic programs HPIPM solves; to convergence or one iteration.

Converged means a KKT residual of 10⁻⁶ (each solver's own measure). The norm limits are
‖·‖² ≤ 2.
"""

import subprocess
import tempfile
from dataclasses import dataclass

import casadi as ca
import casadi_model as model
import numpy as np
from problems import (
    CHI_DES,
    CHI_EQ,
    HORIZON,
    JOINT_LOWER,
    JOINT_UPPER,
    PITCH_LIMIT,
    SPEED_LIMIT,
    SPEEDS,
    STEP,
    U_EQ,
    Problem,
)

TOLERANCE = 1e-6
SMOOTHING = 1e-4
"""s of |v| ≈ √(v² + s) in the drag, as specified."""

IPOPT = {"ipopt.tol": TOLERANCE, "ipopt.print_level": 0, "ipopt.sb": "yes", "print_time": False}
HPIPM = {"hpipm": {"mode": "speed"}, "inf": 1e4, "error_on_fail": False, "print_time": False}
"""The fastest mode with multipliers; with `inf` at its default of 10⁸ HPIPM does not converge."""
SQP = {"qpsol": "hpipm", "qpsol_options": HPIPM, "tol_pr": TOLERANCE, "tol_du": TOLERANCE,
       "print_header": False, "print_iteration": False, "print_status": False,
       "print_time": False}


@dataclass(frozen=True)
class Transcription:
    """The nonlinear program of a problem: minimise f(w) within bounds of w and g(w)."""

    w: ca.MX
    f: ca.MX
    g: ca.MX
    hessian: ca.MX
    """Gauss-Newton Hessian, with the curvature of the norm limits."""
    multipliers: ca.MX
    """Multipliers of g, in `hessian`."""
    lbx: np.ndarray
    ubx: np.ndarray
    lbg: np.ndarray
    ubg: np.ndarray


class ShootingController:
    """A controller by a CasADi solver of the problem's `Transcription`."""

    def __init__(self, name: str, problem: Problem, plugin: str, options: dict, expert: bool,
                 compiled: bool):
        self.name = name
        self.status = False
        self._nx = len(problem.start)
        self._next = expert_step(problem) if expert else plain_step(problem)
        self._nlp = transcribe(problem, self._next)
        self._solver = make_solver(self._nlp, plugin, options, expert)
        if compiled:
            self._solver, self._next = compile_solver(self._solver, self._next, plugin, options)
        self.reset()

    def reset(self) -> None:
        """Forgets the warm start."""
        self._w: np.ndarray | None = None
        self._multipliers = np.zeros(self._nlp.g.numel())

    def step(self, x: np.ndarray) -> np.ndarray:
        """Returns u (10,) at the measured state x."""
        if self._w is None:
            self._w = np.append(np.tile(np.append(x, np.zeros(10)), HORIZON), x)
        lbx, ubx = self._nlp.lbx.copy(), self._nlp.ubx.copy()
        lbx[: self._nx] = ubx[: self._nx] = x
        w = self._solve(lbx, ubx)
        self._w = self._shift(w)
        return w[self._nx: self._nx + 10]

    def _solve(self, lbx: np.ndarray, ubx: np.ndarray) -> np.ndarray:
        solution = self._solver(x0=self._w, lam_g0=self._multipliers, lbx=lbx, ubx=ubx,
                                lbg=self._nlp.lbg, ubg=self._nlp.ubg)
        self.status = self._solver.stats()["success"]
        self._multipliers = solution["lam_g"].full().ravel()
        return solution["x"].full().ravel()

    def _shift(self, w: np.ndarray) -> np.ndarray:
        last_input, last_state = w[-self._nx - 10: -self._nx], w[-self._nx:]
        beyond = self._next(last_state, last_input).full().ravel()
        return np.concatenate([w[self._nx + 10:], last_input, beyond])


class OneIterationController(ShootingController):
    """One quadratic program per step, with a full step: a real-time iteration.

    Only the first step after a reset is solved to convergence, because one iteration
    improves the warm start only.
    """

    def __init__(self, name: str, problem: Problem):
        super().__init__(name, problem, "sqpmethod", SQP, expert=True, compiled=True)
        self._derivatives = self._solver.get_function("nlp_jac_fg")
        self._hessian = self._solver.get_function("nlp_hess_l")
        self._qp = ca.conic("qp", "hpipm", {"h": self._hessian.sparsity_out(0),
                                            "a": self._derivatives.sparsity_out(3)}, HPIPM)

    def reset(self) -> None:
        """Forgets the warm start."""
        super().reset()
        self._warm = False

    def _solve(self, lbx: np.ndarray, ubx: np.ndarray) -> np.ndarray:
        if not self._warm:
            self._warm = True
            return super()._solve(lbx, ubx)
        _, gradient, g, jacobian = self._derivatives(self._w, [])
        g = g.full().ravel()
        solution = self._qp(
            h=self._hessian(self._w, [], 1.0, self._multipliers), g=gradient, a=jacobian,
            lbx=lbx - self._w, ubx=ubx - self._w, lba=self._nlp.lbg - g, uba=self._nlp.ubg - g)
        self.status = self._qp.stats()["success"]
        self._multipliers = solution["lam_a"].full().ravel()
        return self._w + solution["x"].full().ravel()


def make_controllers(problem: Problem) -> list[ShootingController]:
    """Returns CasADi's side of the comparison; compiling takes seconds."""
    return [
        ShootingController("CasADi + IPOPT as first written", problem, "ipopt", IPOPT,
                           expert=False, compiled=False),
        ShootingController("CasADi + IPOPT, Gauss-Newton, compiled", problem, "ipopt", IPOPT,
                           expert=True, compiled=True),
        ShootingController("CasADi SQP + HPIPM", problem, "sqpmethod", SQP,
                           expert=True, compiled=False),
        ShootingController("CasADi SQP + HPIPM, compiled", problem, "sqpmethod", SQP,
                           expert=True, compiled=True),
        OneIterationController("CasADi SQP + HPIPM, compiled, one iteration", problem),
    ]


def plain_step(problem: Problem) -> ca.Function:
    """Returns x, u ↦ next x, one RK4 step."""
    x, u, rate = _rate(problem)
    return ca.Function("step", [x, u], [model.runge_kutta(ca.Function("rate", [x, u], [rate]),
                                                          x, u, STEP)])


def expert_step(problem: Problem) -> ca.Function:
    """Returns `plain_step` with Jacobians chained by hand through the four stages."""
    x, u, rate = _rate(problem)
    config, zeta = x[:10], x[10:]
    by_x = ca.vertcat(ca.jacobian(model.configuration_rate(config, zeta), x),
                      model.drift_jacobian(config, zeta, CHI_EQ, SMOOTHING))
    rates = ca.Function("rates", [x, u], [rate, by_x, ca.jacobian(rate, u)])
    plain = ca.Function("rate", [x, u], [rate])
    X, U = ca.MX.sym("x", *x.shape), ca.MX.sym("u", *u.shape)
    jacobian = ca.Function(
        "jac_step", [X, U, ca.MX.sym("out_next", *x.shape)],
        model.runge_kutta_jacobian(rates, X, U, STEP),
        ["x", "u", "out_next"], ["jac_next_x", "jac_next_u"])
    return ca.Function("step", [X, U], [model.runge_kutta(plain, X, U, STEP)],
                       ["x", "u"], ["next"],
                       {"custom_jacobian": jacobian, "jac_penalty": 0, "never_inline": True})


def _rate(problem: Problem) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Returns the symbols x, u and ẋ."""
    x, u = ca.SX.sym("x", len(problem.start)), ca.SX.sym("u", 10)
    config, zeta = x[:10], x[10:]
    return x, u, ca.vertcat(model.configuration_rate(config, zeta),
                            model.drift(config, zeta, CHI_EQ, SMOOTHING) + u)


def transcribe(problem: Problem, step: ca.Function) -> Transcription:
    """Returns the problem with x_0, ..., x_N and u_0, ..., u_{N−1} as unknowns."""
    nx = len(problem.start)
    running, terminal = _stage(problem, last=False), _stage(problem, last=True)
    lower, upper = np.full(nx, -np.inf), np.full(nx, np.inf)
    lower[4], upper[4] = -PITCH_LIMIT, PITCH_LIMIT
    lower[6:10], upper[6:10] = JOINT_LOWER, JOINT_UPPER
    input_bound = np.full(10, problem.input_limit)

    x = [ca.MX.sym(f"x{k}", nx) for k in range(HORIZON + 1)]
    u = [ca.MX.sym(f"u{k}", 10) for k in range(HORIZON)]
    f, g, hessians, multipliers, lbg, ubg = 0.0, [], [], [], [], []
    for k in range(HORIZON + 1):
        stage, curvature = running if k < HORIZON else terminal
        arguments = (x[k], u[k]) if k < HORIZON else (x[k],)
        if k < HORIZON:
            g.append(step(x[k], u[k]) - x[k + 1])
            multipliers.append(ca.MX.sym(f"gap{k}", nx))
            lbg.append(np.zeros(nx))
            ubg.append(np.zeros(nx))
        cost, speeds = stage(*arguments)
        f += cost
        g.append(speeds)
        multipliers.append(ca.MX.sym(f"limit{k}", speeds.numel()))
        hessians.append(curvature(*arguments, multipliers[-1]))
        free = k == 0  # x_0 is given
        lbg.append(np.full(speeds.numel(), -np.inf))
        ubg.append(np.full(speeds.numel(), np.inf if free else SPEED_LIMIT**2))
    free = np.full(nx, np.inf)
    return Transcription(
        w=ca.vertcat(*(item for pair in zip(x, u, strict=False) for item in pair), x[-1]),
        f=f, g=ca.vertcat(*g), hessian=ca.diagcat(*hessians), multipliers=ca.vertcat(*multipliers),
        lbx=np.concatenate([-free, *[-input_bound, lower] * HORIZON]),
        ubx=np.concatenate([free, *[input_bound, upper] * HORIZON]),
        lbg=np.concatenate(lbg), ubg=np.concatenate(ubg))


def _stage(problem: Problem, last: bool) -> tuple[ca.Function, ca.Function]:
    """Returns cost and squared norms of the velocities of one stage, and its Hessian."""
    x, u = ca.SX.sym("x", len(problem.start)), ca.SX.sym("u", 10)
    e = model.task_pose(x[:10]) - CHI_DES
    if last:
        z, zeta = [x], x[10:]
        residual = ca.vertcat(np.sqrt(problem.task_weight) * e,
                              np.sqrt(problem.terminal_velocity_weight) * zeta)
    else:
        z, zeta = [x, u], x[10:]
        residual = np.sqrt(STEP) * ca.vertcat(np.sqrt(problem.task_weight) * e,
                                              np.sqrt(problem.velocity_weight) * zeta,
                                              np.sqrt(problem.input_weight) * (u - U_EQ))
    speeds = ca.vertcat(*(ca.sumsqr(zeta[part]) for part in SPEEDS if zeta.numel()))
    multipliers = ca.SX.sym("multipliers", speeds.numel())
    by_z = ca.jacobian(residual, ca.vertcat(*z))
    curvature, _ = ca.hessian(ca.dot(multipliers, speeds), ca.vertcat(*z))
    return (ca.Function("stage", z, [ca.sumsqr(residual), speeds]),
            ca.Function("curvature", [*z, multipliers], [2 * by_z.T @ by_z + curvature]))


def make_solver(nlp: Transcription, plugin: str, options: dict, expert: bool) -> ca.Function:
    """Returns a CasADi solver, with `nlp.hessian` for an expert and else the exact Hessian."""
    if expert:
        weight = ca.MX.sym("lam_f")
        H, name = weight * nlp.hessian, "hess_gamma_x_x"
        if plugin == "ipopt":
            H, name = ca.triu(H), f"triu_{name}"
        options = {**options, "hess_lag": ca.Function(
            "nlp_hess_l", [nlp.w, ca.MX.sym("p", 0, 0), weight, nlp.multipliers], [H],
            ["x", "p", "lam_f", "lam_g"], [name])}
    return ca.nlpsol("solver", plugin, {"x": nlp.w, "f": nlp.f, "g": nlp.g}, options)


def compile_solver(solver: ca.Function, step: ca.Function, plugin: str,
                   options: dict) -> tuple[ca.Function, ca.Function]:
    """Returns solver and step with everything they evaluate, derivatives too, compiled by gcc."""
    code = ca.CodeGenerator("nlp")
    for function in (step, solver.oracle(), *map(solver.get_function, solver.get_function())):
        code.add(function)
    with tempfile.TemporaryDirectory() as folder:
        code.generate(f"{folder}/")
        library = f"{folder}/nlp.so"
        subprocess.run(["gcc", "-O3", "-march=native", "-fno-math-errno", "-shared", "-fPIC",
                        f"{folder}/nlp.c", "-o", library, "-lm"], check=True)
        return ca.nlpsol("solver", plugin, library, options), ca.external("step", library)
