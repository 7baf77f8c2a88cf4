"""Largest terminal set F = {‖ξ‖_P ≤ ε} that the stability proof allows.

Under the terminal controller, with V = ‖ξ‖²_P, F needs V(ξ⁺) − V(ξ) ≤ −ℓ(ξ) and all nominal limits:
see control/theory.md#terminal-set. Conditions that are linear or conic in ξ have a closed form
(`linear_radius`). The others are checked on the nonlinear map: at samples on the boundary and
inside, among them the support points of every limit, and at local minima of the margins that a
nonlinear program finds from the worst samples; as ξ → 0, by an eigenvalue of the linearisation. It
is a search for a counterexample that finds none, not a proof.
"""

from dataclasses import dataclass

import numpy as np
from pydrake.solvers import MathematicalProgram, SnoptSolver

from uvms_drake.common.differentiable import differentiable
from uvms_drake.common.errors import require
from uvms_drake.control.ocp.ocp import Ocp
from uvms_drake.control.plan.points import Points
from uvms_drake.model.frames.euler import COMPLEX_STEP

DECREASE, AT_REST = "decrease", "decrease at rest"
INNERMOST = 0.05
"""Smallest ‖ξ‖_P/ε of the samples; below, the linearisation stands for the map."""
STARTS = 3
"""Samples from which the decrease is refined; each limit is refined from one."""
NEAR = 0.3
"""Fraction of a limit below which the margin of the worst sample is refined."""
SMALLEST = 1e-3
"""Smallest radius over the linear bound; a smaller terminal set is none."""


@dataclass(frozen=True)
class TerminalCheck:
    """The result of the check of one terminal set."""

    radius: float
    """Radius ε of the set."""
    margins: dict[str, float]
    """Worst margin of each condition, negative where it is broken: (V − V⁺)/ℓ − 1 of the decrease,
    in F and at rest, as ξ → 0; the available fraction of a limit."""
    worst: dict[str, np.ndarray]
    """States ξ (2(6+n),) at which the margins were found; conditions in closed form have none."""
    samples: int
    """States at which the nonlinear map was evaluated."""
    refinements: int
    """Number of local minima searched for from the worst of them."""

    @property
    def failures(self) -> tuple[str, ...]:
        """Names of the conditions that are broken, the worst first."""
        return tuple(name for name, margin in sorted(self.margins.items(), key=lambda item: item[1])
                     if not margin >= 0.0)

    @property
    def holds(self) -> bool:
        """True if every condition is met wherever it was evaluated."""
        return not self.failures

    @property
    def limiting(self) -> str:
        """Name of the condition with the smallest margin."""
        return min(self.margins, key=lambda name: self.margins[name])

    def nearest(self, P: np.ndarray) -> float:
        """Returns the smallest ‖ξ‖_P of the states that break a condition; inf without any."""
        return min((float(np.sqrt(_square(self.worst[name], P))) for name in self.failures
                    if name in self.worst), default=np.inf)


class TerminalLoop:
    """The nominal system about its equilibrium, under a terminal controller, valued by a P.

    Args:
        ocp: The problem.
    """

    closed: np.ndarray
    """Matrix of the linearised loop: ξ⁺ = closed · ξ."""
    input_rows: np.ndarray
    """Matrix of the linearised input: ū − ū_eq = input_rows · ξ."""
    rows: np.ndarray
    """Matrices of the linearised limited values: rows · ξ."""
    names: tuple[str, ...]
    """Names of the conditions on the nonlinear map, in the order of `margins`."""

    def __init__(self, ocp: Ocp):
        self.ocp, size = ocp, ocp.state_size
        self.P, self.gain = ocp.terminal.P, ocp.terminal.gain
        least = float(np.linalg.eigvalsh(self.P)[0])
        require(least > 0.0, "smallest eigenvalue of P", least, "positive: F is unbounded else")
        self.inverse = np.linalg.inv(self.P)
        limits = ocp.lasting_limits.values()
        self.closed_forms = {limit.name: form for limit in limits
                             if (form := limit.closed_form(ocp.model.size)) is not None}
        self.inputs = [limit for limit in limits if limit.about == "input"]
        self.sampled = [limit for limit in limits
                        if limit.about != "input" and limit.name not in self.closed_forms]
        self.names = (DECREASE, *(f"{part}, {end} of a step" for limit in self.inputs
                                  for end in ("begin", "end") for part in limit.labels),
                      *(part for limit in self.sampled for part in limit.labels), *ocp.reach_names)
        # Limit, whether at the end of an interval, and component of the columns that have one.
        self._columns = [
            *((limit, at_end, i) for limit in self.inputs for at_end in (False, True)
              for i in range(len(limit.labels))),
            *((limit, False, i) for limit in self.sampled for i in range(len(limit.labels)))]
        step = 1j * COMPLEX_STEP * np.eye(size + ocp.model.size)
        after, w, begin, end = ocp.move(step[:, :size], step[:, size:])
        moved = (item.imag.T / COMPLEX_STEP for item in (after, w, np.concatenate(
            [self._limited("values", begin, end), ocp.reached(begin)[0]], axis=-1)))
        (A, B), (C, D), (E, F) = (np.split(item, [size], axis=1) for item in moved)
        self.closed, self.input_rows, self.rows = (
            by_xi + by_decision @ self.gain for by_xi, by_decision in ((A, B), (C, D), (E, F)))

    def _limited(self, method: str, begin: Points, end: Points) -> np.ndarray:
        """Returns `values` or `used` of the limits that have no closed form (..., their number)."""
        return np.concatenate([
            np.empty((*begin.config.shape[:-1], 0)),
            *(getattr(limit, method)(at) for limit in self.inputs for at in (begin, end)),
            *(getattr(limit, method)(begin) for limit in self.sampled)], axis=-1)

    def margins(self, xi: np.ndarray) -> np.ndarray:
        """Returns the margins (..., number of names) of the conditions at ξ (..., size) ≠ 0."""
        after, w, begin, end = self.ocp.move(xi, xi @ self.gain.T)
        worst = np.concatenate([
            self._decrease(xi, after, w)[..., None], 1.0 - self._limited("used", begin, end),
            self._near(xi, begin)], axis=-1)
        return worst

    def margin(self, xi: np.ndarray, column: int) -> np.ndarray:
        """Returns one column (...) of `margins`; no other limit is evaluated."""
        after, w, begin, end = self.ocp.move(xi, xi @ self.gain.T)
        worst: np.ndarray
        if column == 0:
            worst = self._decrease(xi, after, w)
        elif column <= len(self._columns):
            limit, at_end, i = self._columns[column - 1]
            worst = 1.0 - limit.used(end if at_end else begin)[..., i]
        else:
            worst = self._near(xi, begin)[..., column - 1 - len(self._columns)]
        return worst

    def _decrease(self, xi: np.ndarray, after: np.ndarray, w: np.ndarray) -> np.ndarray:
        """Returns (V − V⁺)/ℓ − 1 (...) of a step from ξ to ξ⁺ = `after` with the input w."""
        ocp = self.ocp
        stage = ocp.time_step * (_square(xi, ocp.Q) + _square(w, ocp.R))
        fall: np.ndarray = _square(xi, self.P) - _square(after, self.P)
        return fall / stage - 1.0

    def _near(self, xi: np.ndarray, begin: Points) -> np.ndarray:
        """Returns the margins of `Ocp.reached`."""
        reached, per = self.ocp.reached(begin)
        near: np.ndarray = 1.0 - reached / (per * np.sqrt(_square(xi, self.P))[..., None])
        return near

    def margin_at_rest(self) -> float:
        """Returns the smallest (V − V⁺)/ℓ − 1 as ξ → 0, a generalised eigenvalue."""
        ocp, K = self.ocp, self.input_rows
        fall = self.P - self.closed.T @ self.P @ self.closed
        root = np.linalg.inv(np.linalg.cholesky(ocp.time_step * (ocp.Q + K.T @ ocp.R @ K)))
        return float(np.linalg.eigvalsh(root @ fall @ root.T)[0]) - 1.0

    def closed_form_limits(self) -> dict[str, tuple[float, float, float]]:
        """Returns, by limit, its distance at the equilibrium, its change for ε = 1, and its size.

        The largest aᵀξ in F is ε‖a‖_{P⁻¹}, the largest ‖Aξ‖ is ε √λ_max(A P⁻¹ Aᵀ). Of
        the static force it takes the largest change; a spring's force may rise by less.
        """
        model, y = self.ocp.model, self.ocp.y_des
        equilibrium = Points(model, model.configuration(y), y, np.zeros(model.size))
        out = {}
        for name, forms in self.closed_forms.items():
            limit = self.ocp.limits[name]
            values = limit.values(equilibrium)
            distances = np.minimum(limit.upper - values, values - limit.lower)
            for part, form, free, half in zip(
                    limit.labels, forms, distances, limit.half, strict=True):
                out[part] = (free, self._reach(form.through(self.ocp.state_rows())), half)
        return out

    def _reach(self, A: np.ndarray) -> float:
        """Returns the largest ‖Aξ‖₂ where ‖ξ‖_P ≤ 1; zero if A has no rows, as without an arm."""
        squares = np.linalg.eigvalsh(A @ self.inverse @ A.T)
        return float(np.sqrt(np.max(squares, initial=0.0)))


def boundary_samples(P: np.ndarray, count: int, rng: np.random.Generator,
                     rows: np.ndarray | None = None) -> np.ndarray:
    """Returns states (m, size) with ‖ξ‖_P = 1.

    `count` of them are uniform in the metric P; with them come both ends of the principal axes and
    both support points ±P⁻¹a/‖a‖_{P⁻¹} of each of the linear functions aᵀξ in `rows` (r, size).
    """
    axes = np.linalg.eigh(P).eigenvectors.T
    if rows is not None:  # A value that is largest at the task has no direction there.
        rows = rows[np.any(rows != 0.0, axis=1)]
    ends = axes if rows is None else np.concatenate([axes, np.linalg.solve(P, rows.T).T])
    scatter = rng.normal(size=(count, len(P))) @ np.linalg.inv(np.linalg.cholesky(P))
    states = np.concatenate([scatter, ends, -ends])
    return states / np.sqrt(_square(states, P))[:, None]


def linear_radius(loop: TerminalLoop) -> float:
    """Returns the largest ε within the limits that have a closed form; negative for none."""
    return min(free / reach for free, reach, _ in loop.closed_form_limits().values()
               if reach > 0.0)


def largest_radius(ocp: Ocp, samples: int = 2000, seed: int = 0, tolerance: float = 0.01
                   ) -> tuple[float, TerminalCheck]:
    """Returns the largest ε that passes the check, by bisection, and its check.

    Samples decide the bisection, and local minima are searched for at the largest radius that they
    pass: a state that breaks a condition is in every larger set. Where one is found there, each
    radius below is searched likewise. No set with a state that is known to break a condition
    passes. If not even a small set passes, ε is zero, and the check is that of the small set.

    Args:
        ocp: The problem.
        samples: Number of random states per radius.
        seed: Seed of the samples.
        tolerance: Relative tolerance of ε.
    """
    loop = TerminalLoop(ocp)
    states, upper = unit_states(loop, samples, seed), linear_radius(loop)
    small = check_radius(loop, SMALLEST * (upper if upper > 0.0 else 1.0), states)
    if not small.holds:
        return 0.0, small
    best = _bisected(loop, states, small, upper, tolerance, search=False)
    if best is not small:
        check = check_radius(loop, best.radius, states)
        if not check.holds:  # Samples do not show all: below, every radius is searched.
            failed = [check.worst[name] / check.radius for name in check.failures]
            states = np.concatenate([states, failed])
            check = _bisected(loop, states, small, check.radius, tolerance, search=True)
        best = check
    return best.radius, best


def _bisected(loop: TerminalLoop, states: np.ndarray, passed: TerminalCheck, upper: float,
              tolerance: float, *, search: bool) -> TerminalCheck:
    """Returns the check of the largest ε up to `upper` that passes, from one that does.

    The other arguments are those of `check_radius` and `largest_radius`.
    """
    radius, nearest = upper, np.inf
    while upper - passed.radius > tolerance * upper:
        check = check_radius(loop, radius, states, search=search)
        if radius < nearest and check.holds:
            passed = check
        else:
            upper, nearest = radius, min(nearest, check.nearest(loop.P))
        radius = 0.5 * (passed.radius + upper)
    return passed


def unit_states(loop: TerminalLoop, samples: int, seed: int) -> np.ndarray:
    """Returns states (m, 2(6+n)) with ‖ξ‖_P ≤ 1: boundary, support points, and shells inside."""
    rng, half = np.random.default_rng(seed), samples // 2
    boundary = boundary_samples(loop.P, half, rng, loop.rows)
    inside = boundary_samples(loop.P, samples - half, rng)
    shells = np.linspace(INNERMOST, 1.0, len(inside), endpoint=False)
    return np.concatenate([boundary, rng.permutation(shells)[:, None] * inside])


def check_radius(loop: TerminalLoop, radius: float, states: np.ndarray, *, search: bool = True
                 ) -> TerminalCheck:
    """Returns the check of ε = `radius` from states (m, 2(6+n)) with ‖ξ‖_P ≤ 1.

    Args:
        loop: The loop.
        radius: ε.
        states: The states.
        search: Whether local minima are searched for, too, from the worst of the states.
    """
    xi = radius * states
    found = loop.margins(xi)
    rank = np.argsort(found, axis=0)
    worst = {name: xi[rank[0, j]] for j, name in enumerate(loop.names)}
    margins = {name: float(found[rank[0, j], j]) for j, name in enumerate(loop.names)}
    margins[AT_REST] = loop.margin_at_rest()
    for name, (free, reach, size) in loop.closed_form_limits().items():
        margins[name] = float((free - radius * reach) / size)
    refinements = 0
    if search and all(margin >= 0.0 for margin in margins.values()):  # Else it is decided already.
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

    def margin(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        values = loop.margin((x + 1j * COMPLEX_STEP * np.eye(len(x))) @ root.T, column)
        return values[:1].real, values.imag[None] / COMPLEX_STEP

    cost = differentiable(margin)
    prog = MathematicalProgram()
    s = prog.NewContinuousVariables(len(start), "s")
    prog.AddCost(lambda x: cost(x)[0], vars=s)
    prog.AddQuadraticConstraint(2.0 * np.eye(len(s)), np.zeros(len(s)), INNERMOST**2, 1.0, s)
    found = SnoptSolver().Solve(prog, np.linalg.solve(root, start), None).GetSolution(s)
    state = root @ found / max(1.0, float(np.linalg.norm(found)))
    return state, float(loop.margin(state, column))


def _square(x: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Returns xᵀ · weight · x (...)."""
    return np.sum((x @ weight) * x, axis=-1)
