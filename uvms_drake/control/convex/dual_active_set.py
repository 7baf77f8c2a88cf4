"""The shortest vector in a polyhedron, by the dual active-set method of Goldfarb and Idnani (1983).

    min ½‖r‖²  s.t.  E r = e,  G r ≤ b

The method goes through points that are the shortest for some of the rows, at first for the
equalities alone. It puts in one row at a time, the one that is broken by most, and takes out what
has to give way for that: each point is longer than the last, so none comes twice, and the end is
reached after about as many steps as rows are tight there. Rows may be added at the end, and the
method goes on from there.

With rows of unit length, M their Gram matrix and λ the multipliers, r = −Σ λ_i g_i: all of it is
done in M, which is as large as there are rows, whatever the length of r.

Reference: D. Goldfarb and A. Idnani, A numerically stable dual method for solving strictly convex
quadratic programs, Mathematical Programming 27, 1983.
"""

import numpy as np

BROKEN = 1e-8
"""Excess of a row, in its own unit, that does not count."""
DEPENDENT = 1e-11
"""Square of the part of a unit row that is not in those that are held; less counts as none."""
STEPS = 3
"""Largest number of steps a row."""
ROUNDING = 1e-9
"""Part of the largest multiplier by which one may be negative."""


class DualActiveSet:
    """A polyhedron and the shortest vector in it for some of its rows.

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

        There is none if there is no such vector, if it is not found in `STEPS` a row, or if rows
        are so nearly dependent that what is found is no optimum for rounding. So none proves
        nothing; a vector that is returned keeps all rows, those that are held to the same
        tolerance, with multipliers of the right sign.
        """
        M, first, active = self._M, self._equalities, self._active
        if not np.isfinite(M).all() or np.isnan(self._b).any():
            return None
        tolerance, left = BROKEN / self._size, STEPS * len(self._b)
        while True:
            # Made anew, for what is updated gathers errors, and once more for what is left.
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
            if np.all(excess <= tolerance):
                if np.any(missed > tolerance[active]) or np.any(
                        multiplier[first:] < -ROUNDING * np.max(np.abs(multiplier), initial=0.0)):
                    return None
                break
            while np.any(excess > tolerance):
                row, own_multiplier = int(np.argmax(excess - tolerance)), 0.0
                # What the multipliers and the rows become with that of this row, as long as none of
                # the others is used up, and no longer than until it is kept.
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
                    multiplier, own_multiplier = multiplier - step * change, own_multiplier + step
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
                corner = np.append(change, -1.0)
                inverse = _bordered(inverse, corner, rate)
                active, multiplier, excess[row] = np.append(active, row), np.append(multiplier, own_multiplier), -np.inf
        self._active = active
        all_multipliers = np.zeros(len(self._b))
        all_multipliers[active] = multiplier / self._size[active]
        return -(multiplier @ self._G[active]), all_multipliers


def _bordered(inverse: np.ndarray, corner: np.ndarray, rate: float) -> np.ndarray:
    """Returns the inverse with one row more, by the vector (change, −1) and the rest of the row."""
    out = np.outer(corner, corner / rate)
    out[:-1, :-1] += inverse
    return out
