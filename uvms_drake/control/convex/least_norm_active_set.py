"""Least-norm r under active limits of a staged program, by active sets: without a conic solver.

Linear limits are rows of a polyhedron (`dual_active_set`). A cone ‖v(r)‖ ≤ τ(r), v = c + A r, is a
norm limit, whose τ is constant, or the terminal set, with τ the least of several affine ones. With
the direction d of v it has the row dᵀv ≤ τ, and with the row's multiplier λ its curvature. A step
of Newton's method solves, for μ = λ/‖v‖ of each cone,

    min ½‖r‖² + ½ Σ μ‖P v(r)‖²,  P = 1 − ddᵀ,  s.t. the rows                                     (1)

and gives the next λ and d. This norm differs from ‖r‖ in the span of A's rows alone: with Q the
matrices μP the Gram matrix becomes GGᵀ − GAᵀ N AGᵀ, N = (1 + Q AAᵀ)⁻¹Q, of the size of all v.
At the boundary of an unexplored region a plan ends in the tip of the terminal set, v = 0.

Where a slack or an excess would be cheaper, the conic solver is used (`least_norm`), likewise where
this search does not end. Conditions and proofs: control/convex/theory.md#newton-step-on-cones,
control/convex/theory.md#end-in-the-tip-of-the-terminal-set,
control/convex/theory.md#without-slack-and-excess.
"""

from typing import NamedTuple

import numpy as np

from uvms_drake.control.convex.dual_active_set import BROKEN, NO_ROWS, multipliers
from uvms_drake.control.convex.least_norm_conic import LeastNorm
from uvms_drake.control.convex.regulator import Regulator
from uvms_drake.control.convex.staged_program import KEPT, ActiveLimits, StagedProgram, WorkingSet

ROUNDS = 25
"""Largest number of times that limits are added or directions of cones are changed."""
DUAL = 1e-6
"""Relative and absolute rounding of ‖κ‖ that is accepted."""
AT_THE_TIP = 1e-3
"""‖value‖ of a plan, over that at the edge of an ordinary terminal set, up to which the next plan
is expected to end at the tip too."""
TURNED = 1e-4
"""Sine of the angle by which d of an active cone may turn in the last step; the error that remains
is of the order of its square."""
SMALLEST = 1e-12
"""Norm below which a vector has no direction."""


def least_norm_active_set(
    program: StagedProgram, regulator: Regulator, z: np.ndarray, kept: WorkingSet,
) -> tuple[LeastNorm, WorkingSet, ActiveLimits] | None:
    """Returns the least-norm r that keeps all limits, the limits added, and the active ones.

    Args:
        program: The program.
        regulator: Its regulator.
        z: The motion for r = 0 (N+1, nx+nw).
        kept: First working set.

    Returns:
        None if the method does not apply or fails; that proves nothing.
    """
    search = _Search(program, regulator, z, kept)
    found = search.run()
    return None if found is None else (found, search.kept, search.active())


class _Rows(NamedTuple):
    """Rows G r ≤ b."""

    G: np.ndarray
    """Rows (m, size of r)."""
    b: np.ndarray
    """Bounds (m,)."""
    stage: np.ndarray
    """Stage of each row (m,)."""
    row: np.ndarray
    """Its row among the linear limits of the stage (m,)."""
    above: np.ndarray
    """Whether its bound is the upper one (m,)."""

    def of(self, which: np.ndarray) -> "_Rows":
        """Returns some of the rows."""
        return _Rows(*(each[which] for each in self))

    def and_more(self, other: "_Rows") -> "_Rows":
        """Returns these rows and others."""
        return _Rows(*map(np.concatenate, zip(self, other, strict=True)))


class _Cones:
    """Norm limits ‖c + A r‖ ≤ bound of one stage each, or the terminal set, in one array each.

    Args:
        c: Vectors c, one below the other (size of all).
        d: Vectors in the plan, whose directions are the first d, likewise.
        sizes: Sizes of the vectors (k,).
        mu: Curvatures μ, the multipliers over ‖v‖ (k,); zero at first.
    """

    def __init__(self, c: np.ndarray, d: np.ndarray, sizes: np.ndarray, mu: np.ndarray):
        self.c, self.sizes, self.mu = c, sizes, mu
        self.which = np.repeat(np.arange(len(sizes)), sizes)
        """Cone of each entry."""
        self._starts = np.cumsum(sizes) - sizes
        self.d = d / self._norms(d)[self.which]

    def sums(self, entries: np.ndarray) -> np.ndarray:
        """Returns the sum over each vector (k,)."""
        return np.add.reduceat(entries, self._starts) if len(self.sizes) else np.zeros(0)

    def _norms(self, vectors: np.ndarray) -> np.ndarray:
        return np.maximum(np.sqrt(self.sums(vectors * vectors)), SMALLEST)

    def and_more(self, c: np.ndarray, d: np.ndarray, sizes: np.ndarray) -> "_Cones":
        """Returns these cones and others."""
        return _Cones(np.concatenate([self.c, c]), np.concatenate([self.d, d]),
                      np.concatenate([self.sizes, sizes]),
                      np.concatenate([self.mu, np.zeros(len(sizes))]))

    def turn(self, change: np.ndarray, prices: np.ndarray) -> bool:
        """Takes over d and μ for A r and multipliers (k,); returns whether this changes (1)."""
        v, d, mu = self.c + change, self.d, self.mu
        size = self._norms(v)
        self.d, self.mu = v / size[self.which], prices / size
        turned = np.sqrt(self.sums((self.d - d) ** 2))
        # The gradient of (1) was off by the change of μ times P v, of length ‖v‖ `turned`.
        return bool((turned * np.maximum(self.mu, np.abs(self.mu - mu)) > TURNED * self.mu).any())


class _Search:
    """Search for the least-norm r with all limits; `kept` are those that it contains.

    Args:
        program: The program.
        regulator: Its regulator.
        z: The motion for r = 0.
        kept: First working set.
    """

    def __init__(self, program: StagedProgram, regulator: Regulator, z: np.ndarray,
                 kept: WorkingSet):
        self.kept = kept
        self._program, self._regulator, self._z = program, regulator, z
        size, nx, terminal = regulator.k.size, program.A.shape[-1], program.terminal
        # Rows of the terminal set: those of its radii, then of v, of which there is one or none.
        end = z[-1, :nx]
        self._radius = terminal.radius_bounds(end)
        q = len(self._radius.size)
        self._p = p = len(terminal.T) if q else 0
        self._ends = min(p, 1)
        C = np.zeros((q + p, z.shape[1]))
        C[:q, :nx], C[q:, :nx] = self._radius.rows, terminal.T[:p]
        self._A = regulator.row_gradients(np.full(q + p, len(z) - 1), C)
        self._cones = _Cones((terminal.value + terminal.T @ end)[:p], terminal.value[:p],
                             np.full(self._ends, p), np.zeros(self._ends))
        self._norm_bounds, self._norm_at = np.zeros(0), (NO_ROWS, NO_ROWS)
        # Whether the plan is to end in the tip, and whether it may still be tried.
        self._tip = terminal.radius_bound is not None and bool(
            np.linalg.norm(terminal.value) <= AT_THE_TIP)
        self._untried = terminal.radius_bound is not None and not self._tip
        # Limits G r ≤ b of unit length, and the products of all rows.
        self._linear = _Rows(np.zeros((0, size)), np.zeros(0), NO_ROWS, NO_ROWS,
                             np.zeros(0, dtype=bool))
        self._scale = np.zeros(0)
        self._AA, self._GA, self._GG = self._A @ self._A.T, np.zeros((0, q + p)), np.zeros((0, 0))
        self._active = NO_ROWS, NO_ROWS

    def run(self) -> LeastNorm | None:
        """Returns the solution, or None if there is none of this form."""
        program, regulator = self._program, self._regulator
        if not self._added(self.kept):
            return None
        if program.similar is not None:
            self._active = self._active_in(program.similar)
        for _ in range(ROUNDS):
            found = self._solution()
            if found is None:
                return None
            r, changed, slack_price, excess_price = found
            # The multipliers decide whether a slack or an excess would be cheaper; here too early,
            # perhaps, but the conic solver finds that out.
            if excess_price > program.excess_penalty or slack_price > program.slack_penalty:
                return None
            if changed:  # Other limits are asked once the cones have settled.
                continue
            best = self._z + regulator.moved(r)
            broken = WorkingSet.broken(program, best, 0.0)
            new = broken.without(self.kept)
            self.kept = self.kept | new
            if not broken.any():
                return LeastNorm(r, 0.0, 0.0, excess_price)
            if not self._added(new):
                return None
        return None

    def _added(self, new: WorkingSet) -> bool:
        """Adds limits; returns whether those that r does not change are kept."""
        program, regulator, z = self._program, self._regulator, self._z
        if new.norms.any():
            self._add_norms(new.norms)
        rows = _linear_rows(program, regulator, z, new)
        size = np.sqrt(np.einsum("ij,ij->i", rows.G, rows.G))
        moves = size > 0.0
        if (rows.b[~moves] < -KEPT).any():
            return False
        if moves.any():
            scale = 1.0 / size[moves]
            G = rows.G[moves] * scale[:, None]
            # The products with the new rows, below and beside those of the old ones.
            old = len(self._linear.G)
            products = np.empty((old + len(G),) * 2)
            self._linear = self._linear.and_more(
                rows.of(moves)._replace(G=G, b=rows.b[moves] * scale))
            products[:old, :old], products[old:] = self._GG, G @ self._linear.G.T
            products[:old, old:] = products[old:, :old].T
            self._GG = products
            self._GA = np.concatenate([self._GA, G @ self._A.T])
            self._scale = np.concatenate([self._scale, scale])
        return True

    def _add_norms(self, new: np.ndarray) -> None:
        """Adds norm limits at the stages of a mask (number of norm limits, N+1)."""
        z, norms = self._z, self._program.norms
        at = [np.flatnonzero(stages) for stages in new]
        counts = [len(limit.C) for limit in norms]
        self._cones = self._cones.and_more(
            np.concatenate([(limit.value[k] + z[k] @ limit.C.T).ravel()
                            for limit, k in zip(norms, at, strict=True)]),
            np.concatenate([limit.value[k].ravel() for limit, k in zip(norms, at, strict=True)]),
            np.repeat(counts, [len(k) for k in at]))
        self._norm_bounds = np.concatenate(
            [self._norm_bounds, *(limit.bound[k] for limit, k in zip(norms, at, strict=True))])
        self._A = np.concatenate([self._A, self._regulator.row_gradients(
            np.concatenate([np.repeat(k, count) for k, count in zip(at, counts, strict=True)]),
            np.concatenate([np.tile(limit.C, (len(k), 1))
                            for limit, k in zip(norms, at, strict=True)]))])
        self._AA, self._GA = self._A @ self._A.T, self._linear.G @ self._A.T
        self._norm_at = (
            np.concatenate([self._norm_at[0], np.repeat(np.arange(len(at)), [len(k) for k in at])]),
            np.concatenate([self._norm_at[1], *at]))

    def _active_in(self, limits: ActiveLimits) -> tuple[np.ndarray, np.ndarray]:
        """Returns the cones' rows and the linear rows that are active according to limits."""
        rows = self._linear
        linear = np.where(rows.above, limits.upper[rows.stage, rows.row],
                          limits.lower[rows.stage, rows.row])
        return (self._first_norm + np.flatnonzero(limits.norms[self._norm_at]),
                np.flatnonzero(linear))

    @property
    def _first_norm(self) -> int:
        """Number of the rows of the terminal set."""
        return (self._p if self._tip else len(self._radius.size)) + len(self._radius.size)

    def active(self) -> ActiveLimits:
        """Returns the active limits of the last solution of (1)."""
        out = ActiveLimits(*map(np.zeros_like, (
            self.kept.upper, self.kept.lower, self.kept.norms)))
        cones, linear = self._active
        rows = self._linear.of(linear)
        out.upper[rows.stage[rows.above], rows.row[rows.above]] = True
        out.lower[rows.stage[~rows.above], rows.row[~rows.above]] = True
        norms = cones[cones >= self._first_norm] - self._first_norm
        out.norms[self._norm_at[0][norms], self._norm_at[1][norms]] = True
        return out

    def _rows(self) -> tuple[np.ndarray, np.ndarray]:
        """Returns the cones' rows as combinations D of A's, and their bounds at r = 0.

        At the tip they are v = 0, 0 ≤ τ; else dᵀv ≤ τ, 0 ≤ τ. Those of the norms follow.
        """
        cones, p, q = self._cones, self._p, len(self._radius.size)
        first = self._first_norm
        D = np.zeros((first + len(self._norm_bounds), len(self._A)))
        if self._tip:
            D[:p, q: q + p], b = np.eye(p), -cones.c[:p]
        else:
            D[:q, :q], D[:q, q: q + p] = -np.eye(q), cones.d[:p]
            b = self._radius.size - cones.d[:p] @ cones.c[:p]
        D[first - q: first, :q] = -np.eye(q)
        D[first - self._ends + cones.which[p:], np.arange(q + p, len(self._A))] = cones.d[p:]
        along = cones.sums(cones.d * cones.c)[self._ends:]
        return D, np.concatenate([b, self._radius.size, self._norm_bounds - along])

    def _curvature(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Returns the rows of A that have a curvature, and N and N c of these."""
        cones = self._cones
        mu = cones.mu[cones.which]
        used = np.flatnonzero(mu > 0.0)
        rows = used + len(self._radius.size)
        if not len(used):
            return rows, np.zeros((0, 0)), np.zeros(0)
        mu, d, cone = mu[used], cones.d[used], cones.which[used]
        Q = np.diag(mu) - (cone[:, None] == cone) * ((mu * d)[:, None] * d)
        N = np.linalg.solve(np.eye(len(used)) + Q @ self._AA[rows[:, None], rows], Q)
        return rows, N, N @ cones.c[used]

    def _solution(self) -> tuple[np.ndarray, bool, float, float] | None:
        """Returns r (N, nw) of (1), whether it changes (1), and the multipliers of s and v."""
        D, b = self._rows()
        cones, by_A = len(D), np.concatenate([D @ self._AA, self._GA])
        M = np.empty((len(by_A), len(by_A)))
        M[:, :cones], M[cones:, cones:] = by_A @ D.T, self._GG
        M[:cones, cones:] = M[cones:, :cones].T
        used, N, shift = self._curvature()
        curved = by_A[:, used]
        b = np.concatenate([b, self._linear.b])
        if len(used):
            M -= curved @ N @ curved.T
            b += curved @ shift
        # Rows of unit length, but for those that nothing changes.
        length = np.sqrt(np.maximum(M.diagonal(), 0.0))
        still = length < SMALLEST
        if (b[still] < -KEPT).any():
            return None
        length[still] = 1.0
        scale = np.concatenate([np.ones(cones), self._scale])
        equalities = self._p if self._tip else 0
        guess = np.concatenate([self._active[0], self._active[1] + cones])
        found = multipliers(M / length / length[:, None], b / length, equalities,
                            BROKEN * scale / length, guess)
        if found is None:
            return None
        rows = found.active
        self._active = rows[rows < cones], rows[rows >= cones] - cones
        value = found.value / length
        by_cones = -(value[:cones] @ D)
        by_cones[used] += N @ (value @ curved) - shift
        r = by_cones @ self._A - value[cones:] @ self._linear.G
        excess, soft = value[cones:] * self._scale, self._program.linear.soft
        return (r.reshape(self._regulator.k.shape), *self._turned(r, value[:cones]),
                float(np.sum(excess[soft[self._linear.row]])))

    def _turned(self, r: np.ndarray, value: np.ndarray) -> tuple[bool, float]:
        """Takes over the cones' directions and multipliers for the next step.

        Args:
            r: Solution of (1).
            value: Multipliers of the cones' rows.

        Returns:
            Whether (1) changes, and the multiplier of s.
        """
        cones, p, q = self._cones, self._p, len(self._radius.size)
        first = self._first_norm
        price, kept = float(np.sum(value[first - q: first])), value[: first - q]
        change = self._A @ r
        own = 0.0 if self._tip else float(np.sum(kept))
        changed = cones.turn(change[q:], np.append(np.full(self._ends, own), value[first:]))
        if self._tip:
            # Where the tip is no optimum, its multipliers have the direction of the end.
            size = float(np.linalg.norm(kept))
            if size > (1.0 + DUAL) * price + DUAL:
                radius = float(np.min(self._radius.size + change[:q]))
                self._switch(tip=False)
                cones.d[:p], cones.mu[0] = kept / size, size / max(radius, SMALLEST)
                changed = True
        elif price > 0.0 and self._untried:  # A radius of zero has a multiplier.
            self._switch(tip=True)
            changed = True
        return changed, price + own

    def _switch(self, *, tip: bool) -> None:
        """Changes to or from a plan that ends in the tip."""
        self._tip, self._untried = tip, False
        self._active = NO_ROWS, self._active[1]
        self._cones.mu[: self._ends] = 0.0


def _linear_rows(program: StagedProgram, regulator: Regulator, z: np.ndarray, which: WorkingSet
                 ) -> _Rows:
    """Returns ± (value + C z) ≤ ± bound of the linear limits."""
    linear = program.linear
    (above, upper), (below, lower) = np.nonzero(which.upper), np.nonzero(which.lower)
    stage, row = np.concatenate([above, below]), np.concatenate([upper, lower])
    sign = np.repeat([1.0, -1.0], [len(above), len(below)])
    bound = np.concatenate([linear.upper[above, upper], linear.lower[below, lower]])
    C = sign[:, None] * linear.C[stage, row]
    now = np.sum(C * z[stage], axis=1)
    return _Rows(regulator.row_gradients(stage, C),
                 sign * (bound - linear.value[stage, row]) - now, stage, row, sign > 0.0)
