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
from uvms_drake.control.convex.regulator import Regulator, motion, row_gradients
from uvms_drake.control.convex.staged_program import StagedProgram
from uvms_drake.control.convex.working_set import KEPT, WorkingSet

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
) -> tuple[LeastNorm, WorkingSet] | None:
    """Returns the least-norm r that keeps all limits, and the limits that were added.

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
    return None if found is None else (found, search.kept)


class _Rows(NamedTuple):
    """Rows G r ≤ b."""

    G: np.ndarray
    """Rows (m, size of r)."""
    b: np.ndarray
    """Bounds (m,)."""
    soft: np.ndarray
    """Whether v relaxes a row (m,)."""


class _Cone:
    """Norm limit ‖c + A r‖ ≤ bound of one stage, or the terminal set.

    Args:
        at: Positions of A's rows among those of all cones.
        c: Vector c.
        value: Vector in the plan, whose direction is the first d.
        bound: Bound of a norm limit.
    """

    def __init__(self, at: slice, c: np.ndarray, value: np.ndarray, bound: float = np.inf):
        self.at, self.c, self.bound = at, c, bound
        self.d = value / max(np.linalg.norm(value), SMALLEST)
        """Direction d of v."""
        self.mu = 0.0
        """Curvature μ, the multiplier over ‖v‖."""

    def turn(self, change: np.ndarray, price: float) -> bool:
        """Takes over d and μ for A r and a multiplier; returns whether this changes the program."""
        v, before = self.c + change, self.mu
        size = max(float(np.linalg.norm(v)), SMALLEST)
        turned = np.linalg.norm(v / size - self.d)
        self.d, self.mu = v / size, price / size
        # The gradient of (1) was off by the change of μ times P v, of length ‖v‖ `turned`.
        return bool(turned * max(self.mu, abs(self.mu - before)) > TURNED * self.mu)


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
        # Rows of the terminal set: those of v, then of its radii.
        end = z[-1, :nx]
        self._radius = terminal.radius_bounds(end)
        p, q = len(terminal.T) if len(self._radius.size) else 0, len(self._radius.size)
        C = np.zeros((p + q, z.shape[1]))
        C[:p, :nx], C[p:, :nx] = terminal.T[:p], self._radius.rows
        self._A = row_gradients(program, regulator, np.full(p + q, len(z) - 1), C)
        self._end = _Cone(slice(p), (terminal.value + terminal.T @ end)[:p], terminal.value[:p])
        self._norms: list[_Cone] = []
        # Whether the plan is to end in the tip, and whether it may still be tried.
        self._tip = terminal.radius_bound is not None and bool(
            np.linalg.norm(terminal.value) <= AT_THE_TIP)
        self._untried = terminal.radius_bound is not None and not self._tip
        # Limits G r ≤ b of unit length, and the products of all rows.
        self._G, self._b, self._scale = np.zeros((0, size)), np.zeros(0), np.zeros(0)
        self._soft = np.zeros(0, dtype=bool)
        self._AA, self._GA, self._GG = self._A @ self._A.T, np.zeros((0, p + q)), np.zeros((0, 0))
        self._active = NO_ROWS, NO_ROWS

    def run(self) -> LeastNorm | None:
        """Returns the solution, or None if there is none of this form."""
        program, regulator = self._program, self._regulator
        new: WorkingSet | None = self.kept
        for _ in range(ROUNDS):
            found = self._solution() if self._added(new) else None
            if found is None:
                return None
            r, changed, slack_price, excess_price = found
            # The multipliers decide whether a slack or an excess would be cheaper; here too early,
            # perhaps, but the conic solver finds that out.
            if excess_price > program.excess_penalty or slack_price > program.slack_penalty:
                return None
            if changed:  # Other limits are asked once the cones have settled.
                new = None
                continue
            best = motion(program, regulator, r)
            broken = WorkingSet.broken(program, best, 0.0)
            new = broken.without(self.kept)
            self.kept = self.kept | new
            if not (new.any() or broken.any()):
                return LeastNorm(r, 0.0, 0.0, excess_price)
        return None

    def _added(self, new: WorkingSet | None) -> bool:
        """Adds limits; returns whether those that r does not change are kept."""
        if new is None:
            return True
        program, regulator, z = self._program, self._regulator, self._z
        for limit, stages in zip(program.norms, new.norms, strict=True):
            for k in np.flatnonzero(stages):
                count = len(self._A)
                self._norms.append(_Cone(slice(count, count + len(limit.C)),
                                         limit.value[k] + limit.C @ z[k], limit.value[k],
                                         limit.bound[k]))
                self._A = np.concatenate([self._A, row_gradients(
                    program, regulator, np.full(len(limit.C), k), limit.C)])
        if len(self._A) > len(self._AA):
            self._AA, self._GA = self._A @ self._A.T, self._G @ self._A.T
        rows = _linear_rows(program, regulator, z, new)
        size = np.linalg.norm(rows.G, axis=1)
        moves = size > 0.0
        if np.any(rows.b[~moves] < -KEPT):
            return False
        if np.any(moves):
            scale = 1.0 / size[moves]
            G = rows.G[moves] * scale[:, None]
            mixed = self._G @ G.T
            self._GG = np.block([[self._GG, mixed], [mixed.T, G @ G.T]])
            self._GA = np.concatenate([self._GA, G @ self._A.T])
            self._G = np.concatenate([self._G, G])
            self._b = np.append(self._b, rows.b[moves] * scale)
            self._scale = np.append(self._scale, scale)
            self._soft = np.append(self._soft, rows.soft[moves])
        return True

    def _rows(self) -> tuple[np.ndarray, np.ndarray]:
        """Returns the cones' rows as combinations D of A's, and their bounds at r = 0.

        At the tip they are v = 0, 0 ≤ τ; else dᵀv ≤ τ, 0 ≤ τ. Those of the norms follow.
        """
        p, q = len(self._end.c), len(self._radius.size)
        first = p if self._tip else q
        D, b = np.zeros((first + q + len(self._norms), len(self._A))), []
        if self._tip:
            D[:p, :p], b = np.eye(p), [-self._end.c]
        else:
            D[:q, :p], D[:q, p: p + q] = self._end.d, -np.eye(q)
            b = [self._radius.size - self._end.d @ self._end.c]
        D[first: first + q, p: p + q] = -np.eye(q)
        for i, cone in enumerate(self._norms, start=first + q):
            D[i, cone.at] = cone.d
        return D, np.concatenate(
            [*b, self._radius.size, [cone.bound - cone.d @ cone.c for cone in self._norms]])

    def _curvature(self) -> tuple[np.ndarray, np.ndarray]:
        """Returns N and N c of the cones."""
        Q, c = np.zeros(self._AA.shape), np.zeros(len(self._A))
        for cone in (self._end, *self._norms):
            if cone.mu > 0.0:
                Q[cone.at, cone.at] = cone.mu * (np.eye(len(cone.c)) - np.outer(cone.d, cone.d))
                c[cone.at] = cone.c
        used = np.flatnonzero(np.diag(Q))
        square = np.ix_(used, used)
        N, Q = np.zeros_like(Q), Q[square]
        N[square] = np.linalg.solve(np.eye(len(used)) + Q @ self._AA[square], Q)
        return N, N @ c

    def _solution(self) -> tuple[np.ndarray, bool, float, float] | None:
        """Returns r (N, nw) of (1), whether it changes (1), and the multipliers of s and v."""
        D, b = self._rows()
        by_A = np.concatenate([D @ self._AA, self._GA])
        cones = len(D)
        M = np.empty((len(by_A), len(by_A)))
        M[:cones, :cones], M[cones:, cones:] = by_A[:cones] @ D.T, self._GG
        M[cones:, :cones] = self._GA @ D.T
        M[:cones, cones:] = M[cones:, :cones].T
        N, shift = self._curvature()
        M -= by_A @ N @ by_A.T
        b = np.concatenate([b, self._b]) + by_A @ shift
        # Rows of unit length, but for those that nothing changes.
        length = np.sqrt(np.maximum(np.diag(M), 0.0))
        still = length < SMALLEST
        if np.any(b[still] < -KEPT):
            return None
        length[still] = 1.0
        scale = np.concatenate([np.ones(cones), self._scale])
        equalities = len(self._end.c) if self._tip else 0
        guess = np.concatenate([self._active[0], self._active[1] + cones])
        found = multipliers(M / length / length[:, None], b / length, equalities,
                            BROKEN * scale / length, guess)
        if found is None:
            return None
        rows = found.active
        self._active = rows[rows < cones], rows[rows >= cones] - cones
        value = found.value / length
        by_cones = N @ (value @ by_A) - value[:cones] @ D - shift
        r = by_cones @ self._A - value[cones:] @ self._G
        excess = value[cones:] * self._scale
        return (r.reshape(self._regulator.k.shape), *self._turned(r, value[:cones]),
                float(np.sum(excess[self._soft])))

    def _turned(self, r: np.ndarray, value: np.ndarray) -> tuple[bool, float]:
        """Takes over the cones' directions and multipliers for the next step.

        Args:
            r: Solution of (1).
            value: Multipliers of the cones' rows.

        Returns:
            Whether (1) changes, and the multiplier of s.
        """
        p, q, end = len(self._end.c), len(self._radius.size), self._end
        first = p if self._tip else q
        price, kept = float(np.sum(value[first: first + q])), value[:first]
        changed = False
        if self._tip:
            # Where the tip is no optimum, its multipliers have the direction of the end.
            size = float(np.linalg.norm(kept))
            if size > (1.0 + DUAL) * price + DUAL:
                radius = float(np.min(self._radius.size + self._A[p: p + q] @ r))
                end.d, end.mu = kept / size, size / max(radius, SMALLEST)
                self._switch(tip=False)
                changed = True
        else:
            own = float(np.sum(kept))
            changed = end.turn(self._A[end.at] @ r, own)
            if price > 0.0 and self._untried:  # A radius of zero has a multiplier.
                self._switch(tip=True)
                changed = True
            price += own
        for cone, multiplier in zip(self._norms, value[first + q:], strict=True):
            changed |= cone.turn(self._A[cone.at] @ r, float(multiplier))
        return changed, price

    def _switch(self, *, tip: bool) -> None:
        """Changes to or from a plan that ends in the tip."""
        self._tip, self._untried = tip, False
        self._active = NO_ROWS, self._active[1]
        if tip:
            self._end.mu = 0.0


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
    return _Rows(row_gradients(program, regulator, stage, C),
                 sign * (bound - linear.value[stage, row]) - now, linear.soft[row])
