"""The terminal set F = {‖ξ‖_P ≤ ε}: the largest ε for which it does what the stability proof needs.

The nominal state at the knots obeys the nonlinear map of `ocp`, exactly. Under the terminal
controller ζ̄̇ = gain · ξ and with V = ‖ξ‖²_P, ℓ = h(‖ξ‖²_Q + ‖ū − ū_eq‖²_R), needed for ξ in F are

    V(ξ⁺) − V(ξ) ≤ −ℓ(ξ)        so that the optimal cost falls from sample to sample, and
    all nominal limits          so that a plan that ends in F can be continued in F.

The first makes F invariant, so limits on the state are asked for in F, those on ū at both ends of
the interval that starts at ξ. What is linear or conic in ξ has a closed form (`linear_radius`). The
rest is checked on the nonlinear map: at samples on the boundary and inside, among them the support
points of every limit, and at local minima of the margins that a nonlinear program finds from the
worst samples; as ξ → 0, by an eigenvalue of the linearisation. It is a search for a counterexample
that finds none, not a proof.
"""

from dataclasses import dataclass, replace

import numpy as np
from pydrake.autodiffutils import AutoDiffXd, ExtractGradient, ExtractValue
from pydrake.solvers import MathematicalProgram, SnoptSolver

from uvms_drake.control.dynamic_ocp import DynamicOcp
from uvms_drake.control.plan import advance
from uvms_drake.model.uvms_model import COMPLEX_STEP

DECREASE, AT_REST = "decrease", "decrease at rest"
INNERMOST = 0.05
"""Smallest ‖ξ‖_P/ε looked at; below, the linearisation stands for the map."""
STARTS = 3
"""The decrease is refined from so many samples, each limit from one."""
NEAR = 0.3
"""A limit is refined if less than this fraction of it is left at the worst sample."""
SMALLEST = 1e-3
"""A terminal set smaller than this fraction of the linear bound is none."""


@dataclass(frozen=True)
class TerminalCheck:
    """What was found about one terminal set."""

    radius: float
    """ε."""
    margins: dict[str, float]
    """Worst margin of each condition, negative where it is broken. Of the decrease it is
    (V − V⁺)/ℓ − 1, in F and at rest, as ξ → 0; of a limit, the fraction of it that is left."""
    worst: dict[str, np.ndarray]
    """ξ (2(6+n),) at which a margin was found; conditions in closed form have none."""
    samples: int
    """States at which the nonlinear map was evaluated."""
    refinements: int
    """Local minima searched for from the worst of them."""

    @property
    def failures(self) -> tuple[str, ...]:
        """Names of the conditions that are broken, the worst first."""
        return tuple(name for name, margin in sorted(self.margins.items(), key=lambda item: item[1])
                     if not margin >= 0.0)

    @property
    def holds(self) -> bool:
        """True if every condition is met wherever it was looked at."""
        return not self.failures

    @property
    def limiting(self) -> str:
        """Name of the condition with the smallest margin."""
        return min(self.margins, key=lambda name: self.margins[name])


class TerminalLoop:
    """The nominal system about its equilibrium, under a terminal controller, valued by a P."""

    def __init__(self, ocp: DynamicOcp, P: np.ndarray | None = None,
                 gain: np.ndarray | None = None):
        self.ocp = ocp
        self.P = ocp.terminal.P if P is None else P
        size = self.size = ocp.model.size
        step = 1j * COMPLEX_STEP * np.eye(2 * size)
        by_xi = self.move(step, np.zeros((2 * size, size)))
        by_zeta_dot = self.move(np.zeros((size, 2 * size)), step[:size, :size])
        A, C = (item.imag.T / COMPLEX_STEP for item in by_xi)
        B, D = (item.imag.T / COMPLEX_STEP for item in by_zeta_dot)
        if gain is None:
            gain = ocp.terminal.gain if P is None else _greedy(A, B, C[:size], ocp, P)
        self.gain = gain
        self.closed = A + B @ gain
        """Linearised ξ⁺ = closed · ξ."""
        self.rows = C + D @ gain
        """Linearised limited values, see `move`: rows · ξ."""
        limits = ocp.limits
        inputs = [("u", limits.u)] + ([] if limits.tau is None else [("tau", limits.tau)])
        rows = [(f"{key}[{i}] {end}", bound) for key, bounds in inputs for end in ("begin", "end")
                for i, bound in enumerate(bounds)]
        rows += [("roll", limits.roll), ("pitch", limits.pitch)]
        self.names = (DECREASE, *(name for name, _ in rows))
        """Conditions on the nonlinear map, in the order of `margins`."""
        self.bounds = np.array([bound for _, bound in rows])

    def move(self, xi: np.ndarray, zeta_dot: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns ξ⁺ (..., 2(6+n)) after one interval from ξ with ζ̄̇ (..., 6+n), and limited values.

        Those are ū at both ends of the interval, M(𝔮̄)ū if forces are limited, roll and pitch.
        """
        ocp, model, h = self.ocp, self.ocp.model, self.ocp.time_step
        zeta = xi[..., self.size:]
        config = model.configuration(ocp.y_des + xi[..., : self.size])
        end, zeta_end = advance(config, zeta, zeta_dot, h), zeta + h * zeta_dot
        error = model.task_pose(end) - ocp.y_des
        error[..., 3:6] -= 2.0 * np.pi * np.round(error[..., 3:6].real / (2.0 * np.pi))
        values = [zeta_dot - model.drift(config, zeta), zeta_dot - model.drift(end, zeta_end)]
        if ocp.limits.tau is not None:
            values += [(model.mass_matrix(model.kinematics(at)) @ u[..., None])[..., 0]
                       for at, u in zip((config, end), values, strict=True)]
        return (np.concatenate([error, zeta_end], axis=-1),
                np.concatenate([*values, config[..., 3:5]], axis=-1))

    def margins(self, xi: np.ndarray) -> np.ndarray:
        """Returns the margins (..., number of names) of the conditions at ξ (..., 2(6+n)) ≠ 0."""
        ocp = self.ocp
        after, values = self.move(xi, xi @ self.gain.T)
        w = values[..., : self.size] - ocp.u_eq
        stage = ocp.time_step * (_square(xi, ocp.Q) + _square(w, ocp.R))
        decrease = (_square(xi, self.P) - _square(after, self.P)) / stage - 1.0
        left = 1.0 - np.where(values.real < 0.0, -values, values) / self.bounds
        return np.concatenate([decrease[..., None], left], axis=-1)

    def margin_at_rest(self) -> float:
        """Returns the smallest (V − V⁺)/ℓ − 1 as ξ → 0, a generalised eigenvalue."""
        ocp, K = self.ocp, self.rows[: self.size]
        fall = self.P - self.closed.T @ self.P @ self.closed
        root = np.linalg.inv(np.linalg.cholesky(ocp.time_step * (ocp.Q + K.T @ ocp.R @ K)))
        return float(np.linalg.eigvalsh(root @ fall @ root.T)[0]) - 1.0


def boundary_samples(P: np.ndarray, count: int, rng: np.random.Generator,
                     rows: np.ndarray | None = None) -> np.ndarray:
    """Returns states (m, size) with ‖ξ‖_P = 1.

    `count` of them are uniform in the metric P; with them come both ends of the principal axes and
    both support points ±P⁻¹a/‖a‖_{P⁻¹} of each of the linear functions aᵀξ in `rows` (r, size).
    """
    axes = np.linalg.eigh(P).eigenvectors.T
    ends = axes if rows is None else np.concatenate([axes, np.linalg.solve(P, rows.T).T])
    scatter = rng.normal(size=(count, len(P))) @ np.linalg.inv(np.linalg.cholesky(P))
    states = np.concatenate([scatter, ends, -ends])
    return states / np.sqrt(_square(states, P))[:, None]


def linear_radius(ocp: DynamicOcp, P: np.ndarray | None = None) -> float:
    """Returns the largest ε within the limits of joints, tip pitch and speeds; negative for none.

    The largest aᵀξ in F is ε‖a‖_{P⁻¹}, the largest norm of a block ε √λ_max of its block of P⁻¹.
    """
    return min(room / reach for room, reach, _ in _linear_limits(ocp, P).values())


def _linear_limits(ocp: DynamicOcp, P: np.ndarray | None) -> dict[str, tuple[float, float, float]]:
    """Returns of each limit the room at the equilibrium, what ε = 1 takes of it, and its size."""
    limits, y, size = ocp.limits, ocp.y_des, ocp.model.size
    inverse = np.linalg.inv(ocp.terminal.P if P is None else P)
    reach = np.sqrt(np.diag(inverse))
    out = {"tip_pitch": (limits.tip_pitch - abs(y[4]), reach[4], limits.tip_pitch)}
    room = np.minimum(limits.q_upper - y[6:], y[6:] - limits.q_lower)
    for i in range(size - 6):
        out[f"q[{i}]"] = (room[i], reach[6 + i], 0.5 * (limits.q_upper[i] - limits.q_lower[i]))
    for name, block in (("nu1", slice(size, size + 3)), ("nu2", slice(size + 3, size + 6)),
                        ("qdot", slice(size + 6, 2 * size))):
        limit = getattr(limits, name)
        out[name] = (limit, float(np.sqrt(np.linalg.eigvalsh(inverse[block, block])[-1])), limit)
    return out


def check_terminal(ocp: DynamicOcp, radius: float, samples: int = 4000, seed: int = 0
                   ) -> TerminalCheck:
    """Returns whether ‖ξ‖_P ≤ `radius` is a terminal set of `ocp`, with its own P and controller.

    Args:
        ocp: The problem.
        radius: ε.
        samples: Number of random states; half on the boundary, half on shells inside.
        seed: Of the samples.
    """
    loop = TerminalLoop(ocp)
    return _check(loop, radius, _unit_states(loop, samples, seed))


def largest_radius(ocp: DynamicOcp, samples: int = 2000, seed: int = 0, tolerance: float = 0.01
                   ) -> tuple[float, TerminalCheck]:
    """Returns the largest ε that passes the check, by bisection, and what was found there.

    The direction in which a radius fails is looked at again at every other radius. If not even a
    small set passes, ε is zero, and the check is that of the small set.

    Args:
        ocp: The problem.
        samples: Number of random states per radius.
        seed: Of the samples.
        tolerance: Relative, of ε.
    """
    loop = TerminalLoop(ocp)
    states = _unit_states(loop, samples, seed)
    radius = upper = linear_radius(ocp)
    lower = SMALLEST * (upper if upper > 0.0 else 1.0)
    best = _check(loop, lower, states)
    if not best.holds:
        return 0.0, best
    while upper - lower > tolerance * upper:
        check = _check(loop, radius, states)
        if check.holds:
            lower, best = radius, check
        else:
            upper = radius
            failed = [check.worst[name] / radius for name in check.failures if name in check.worst]
            states = np.concatenate([states, np.reshape(failed, (-1, len(loop.P)))])
        radius = 0.5 * (lower + upper)
    return lower, best


def check_penalty(ocp: DynamicOcp, P: np.ndarray, gain: np.ndarray | None = None,
                  radius: float | None = None, samples: int = 4000, seed: int = 0) -> TerminalCheck:
    """Returns whether V = ‖ξ‖²_P decreases as it must, for a P that comes from elsewhere.

    Without a `gain` the controller is the one that minimises V⁺ + ℓ of the linearisation at every
    ξ. If even that has a negative margin at rest, there are ξ for which no ζ̄̇ is good enough: no
    controller whatsoever makes P a terminal penalty.

    Args:
        ocp: The problem.
        P: Penalty (2(6+n), 2(6+n)), positive definite.
        gain: Of the terminal controller ζ̄̇ = gain · ξ.
        radius: ε; the largest within the linear limits if none is given.
        samples: Number of random states.
        seed: Of the samples.
    """
    loop, radius = TerminalLoop(ocp, P, gain), radius or linear_radius(ocp, P)
    check = _check(loop, radius, _unit_states(loop, samples, seed))
    margins = {name: check.margins[name] for name in (DECREASE, AT_REST)}
    return replace(check, margins=margins, worst={DECREASE: check.worst[DECREASE]})


def _greedy(A: np.ndarray, B: np.ndarray, C: np.ndarray, ocp: DynamicOcp, P: np.ndarray
            ) -> np.ndarray:
    """Returns the gain of the ζ̄̇ that minimises ‖Aξ + Bζ̄̇‖²_P + h‖Cξ + ζ̄̇‖²_R."""
    weight = ocp.time_step * ocp.R
    return -np.linalg.solve(weight + B.T @ P @ B, weight @ C + B.T @ P @ A)


def _unit_states(loop: TerminalLoop, samples: int, seed: int) -> np.ndarray:
    """Returns states (m, 2(6+n)) with ‖ξ‖_P ≤ 1: boundary, support points, and shells inside."""
    rng, half = np.random.default_rng(seed), samples // 2
    boundary = boundary_samples(loop.P, half, rng, loop.rows)
    inside = boundary_samples(loop.P, samples - half, rng)
    shells = np.linspace(INNERMOST, 1.0, len(inside), endpoint=False)
    return np.concatenate([boundary, rng.permutation(shells)[:, None] * inside])


def _check(loop: TerminalLoop, radius: float, states: np.ndarray) -> TerminalCheck:
    """Returns the check of ε = `radius` from states (m, 2(6+n)) with ‖ξ‖_P ≤ 1."""
    xi = radius * states
    found = loop.margins(xi)
    rank = np.argsort(found, axis=0)
    worst = {name: xi[rank[0, j]] for j, name in enumerate(loop.names)}
    margins = {name: float(found[rank[0, j], j]) for j, name in enumerate(loop.names)}
    margins[AT_REST] = loop.margin_at_rest()
    for name, (room, reach, size) in _linear_limits(loop.ocp, loop.P).items():
        margins[name] = float((room - radius * reach) / size)
    refinements = 0
    if all(margin >= 0.0 for margin in margins.values()):  # else it is decided already
        for j, name in enumerate(loop.names):
            starts = STARTS if name == DECREASE else int(margins[name] <= NEAR)
            for start in xi[rank[:starts, j]]:
                refinements += 1
                state, margin = _refine(loop, radius, j, start)
                if margin < margins[name]:
                    worst[name], margins[name] = state, margin
    return TerminalCheck(radius, margins, worst, len(states), refinements)


def _refine(loop: TerminalLoop, radius: float, column: int, start: np.ndarray
            ) -> tuple[np.ndarray, float]:
    """Returns a ξ in F with a locally smallest margin of condition `column`, and the margin."""
    root = radius * np.linalg.inv(np.linalg.cholesky(loop.P)).T  # ξ = root · s, ‖s‖ ≤ 1

    def margin(x: np.ndarray):  # with its gradient, if Drake's solvers ask for it
        s = ExtractValue(x).ravel() if x.dtype == object else x
        values = loop.margins((s + 1j * COMPLEX_STEP * np.eye(len(s))) @ root.T)[:, column]
        if x.dtype != object:
            return values[0].real
        return AutoDiffXd(values[0].real, values.imag / COMPLEX_STEP @ ExtractGradient(x))

    prog = MathematicalProgram()
    s = prog.NewContinuousVariables(len(start), "s")
    prog.AddCost(margin, vars=s)
    prog.AddQuadraticConstraint(2.0 * np.eye(len(s)), np.zeros(len(s)), INNERMOST**2, 1.0, s)
    found = SnoptSolver().Solve(prog, np.linalg.solve(root, start), None).GetSolution(s)
    state = root @ found / max(1.0, float(np.linalg.norm(found)))
    return state, float(loop.margins(state)[column])


def _square(x: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Returns xᵀ · weight · x (...)."""
    return np.sum((x @ weight) * x, axis=-1)
