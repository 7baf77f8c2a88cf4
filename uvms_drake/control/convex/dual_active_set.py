"""Least-norm vector of a polyhedron, by the dual active-set method of Goldfarb and Idnani (1983).

    min ½‖r‖²  s.t.  E r = e,  G r ≤ b

The method passes through points of least norm for some of the rows, at first for the equalities
alone. It adds one row at a time, the one with the largest violation, and removes rows whose
multipliers reach zero meanwhile: the norm grows in every step, so no active set recurs, and the
number of steps is about that of the rows active at the end. Rows may be added then, and the method
continues from there.

With rows of unit length, M their Gram matrix and λ the multipliers, r = −Σ λ_i g_i: all of it is
computed in M, of the size of the number of rows, whatever the length of r.

Reference: D. Goldfarb and A. Idnani, A numerically stable dual method for solving strictly convex
quadratic programs, Mathematical Programming 27, 1983.
"""

import numpy as np

BROKEN = 1e-8
"""Excess of a row, in its own unit, that counts as none."""
DEPENDENT = 1e-11
"""Least square of the part of a unit row that is independent of the active ones."""
STEPS = 3
"""Largest number of steps a row."""
ROUNDING = 1e-9
"""Part of the largest multiplier by which one may be negative."""


class DualActiveSet:
    """Polyhedron and its least-norm vector for the active rows.

    Args:
        E: Independent rows (k, n).
        e: Their values (k,).
    """

    def __init__(self, E: np.ndarray, e: np.ndarray):
        self._equalities = len(e)
        self._G, self._b = np.zeros((0, E.shape[1])), np.zeros(0)
        self._size, self._M = np.zeros(0), np.zeros((0, 0))
        self._active = np.arange(len(e))
        self.add(E, e)

    def add(self, G: np.ndarray, b: np.ndarray) -> None:
        """Adds rows, none of which is zero: G r ≤ b."""
        size = np.linalg.norm(G, axis=1)
        G = G / size[:, None]
        mixed = self._G @ G.T
        self._M = np.block([[self._M, mixed], [mixed.T, G @ G.T]])
        self._G, self._b = np.concatenate([self._G, G]), np.append(self._b, b / size)
        self._size = np.append(self._size, size)

    def least_norm(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Returns r (n,) and the multipliers of all rows, the equalities first; or None.

        None if there is no such vector, if it is not found in `STEPS` a row, or if rows are so
        nearly dependent that rounding spoils the result; that proves nothing. A vector that is
        returned keeps all rows, the active ones to the same tolerance, with multipliers of the
        right sign.
        """
        M, first, active = self._M, self._equalities, self._active
        if not np.isfinite(M).all() or np.isnan(self._b).any():
            return None
        tolerance, left = BROKEN / self._size, STEPS * len(self._b)
        while True:
            # Inverse anew, as updates accumulate errors; one step of iterative refinement.
            gram = M[np.ix_(active, active)]
            try:
                inverse = np.linalg.inv(gram)
            except np.linalg.LinAlgError:
                return None
            multiplier = -inverse @ self._b[active]
            multiplier -= inverse @ (gram @ multiplier + self._b[active])
            excess = -M[:, active] @ multiplier - self._b
            missed = np.abs(excess[active])
            excess[active] = -np.inf
            # The end, unless rounding has spoiled active rows or signs of multipliers.
            if np.all(excess <= tolerance):
                if np.any(missed > tolerance[active]) or np.any(
                        multiplier[first:] < -ROUNDING * np.max(np.abs(multiplier), initial=0.0)):
                    return None
                break
            while np.any(excess > tolerance):
                row, own = int(np.argmax(excess - tolerance)), 0.0
                # The row's own multiplier grows until the row is kept (a whole step) or another
                # multiplier reaches zero; that one's row is removed from the active set.
                while True:
                    if left == 0:
                        return None
                    left -= 1
                    by = M[active, row]
                    change = inverse @ by
                    rate = 1.0 - by @ change
                    falls = np.flatnonzero(change[first:] > 0.0) + first
                    lasts = multiplier[falls] / change[falls]
                    whole = excess[row] / rate if rate > DEPENDENT else np.inf
                    step = min(whole, np.min(lasts, initial=np.inf))
                    if step == np.inf:
                        return None
                    multiplier, own = multiplier - step * change, own + step
                    excess -= step * (M[:, row] - M[:, active] @ change)
                    if step == whole:
                        break
                    out = falls[np.argmin(lasts)]
                    excess[active[out]] = 0.0
                    stay = np.arange(len(active)) != out
                    by_out = inverse[out, stay]
                    inverse = inverse[np.ix_(stay, stay)] - np.outer(
                        by_out, by_out / inverse[out, out])
                    active, multiplier = active[stay], multiplier[stay]
                # The row becomes active.
                corner = np.append(change, -1.0)
                inverse = _bordered(inverse, corner, rate)
                active, multiplier = np.append(active, row), np.append(multiplier, own)
                excess[row] = -np.inf
        self._active = active
        all_multipliers = np.zeros(len(self._b))
        all_multipliers[active] = multiplier / self._size[active]
        return -(multiplier @ self._G[active]), all_multipliers


def _bordered(inverse: np.ndarray, corner: np.ndarray, rate: float) -> np.ndarray:
    """Returns the inverse with one row more, by (change, −1) and the row's independent part."""
    out = np.outer(corner, corner / rate)
    out[:-1, :-1] += inverse
    return out
