"""Least-norm vector of a polyhedron, by its multipliers: exchanges of many rows, then of one.

    min ½‖r‖²  s.t.  G r = b in the first rows, G r ≤ b in the others

With M = G Gᵀ and λ the multipliers, r = −Gᵀλ: all of it is computed in M, of the size of the number
of rows, whatever the length of r. Any other norm of r changes M alone.

At first all violated rows become active and all with a negative multiplier leave, at once: a
semismooth Newton step (Hintermüller, Ito and Kunisch 2002), a few of which are enough as a rule,
fewer from the rows of a similar problem. Nothing ensures that they end, so after some of them the
dual active-set method of Goldfarb and Idnani (1983) takes over. It passes through points of least
norm for some of the rows, at first for none. It adds one row at a time, the one
with the largest violation, and removes rows whose multipliers reach zero meanwhile: the norm grows
in every step, so no active set recurs.
"""

from typing import NamedTuple

import numpy as np

BROKEN = 1e-8
"""Excess of a row, in its own unit, that counts as none."""
DEPENDENT = 1e-11
"""Least square of the part of a unit row that is independent of the active ones."""
EXCHANGES = 12
"""Largest number of exchanges of many rows."""
ALIKE = 0.3
"""Cosine of the angle of two rows above which only one of them becomes active in an exchange."""
EARLIER = 1e-7
"""Part of a violation that makes the earlier one of two equal rows active."""
STEPS = 3
"""Largest number of steps a row with one row at a time."""
ROUNDING = 1e-9
"""Part of the largest multiplier by which one may be negative."""


class Multipliers(NamedTuple):
    """Multipliers of a least-norm vector."""

    value: np.ndarray
    """Multipliers λ of all rows (m,)."""
    active: np.ndarray
    """Indices of the active rows but for the equalities."""


NO_ROWS = np.zeros(0, dtype=int)


def multipliers(M: np.ndarray, b: np.ndarray, equalities: int, tolerance: np.ndarray,
                active: np.ndarray = NO_ROWS) -> Multipliers | None:
    """Returns the multipliers of the least-norm vector, or None.

    None if there is no such vector, if it is not found in `STEPS` a row, or if rows are so nearly
    dependent that rounding spoils the result; that proves nothing. A vector that is returned keeps
    all rows, the active ones to the same tolerance, with multipliers of the right sign.

    Args:
        M: Gram matrix G Gᵀ (m, m) of rows of about unit length.
        b: Values (m,).
        equalities: Number of equalities, which come first.
        tolerance: Excess of a row that counts as none (m,).
        active: Guess of the active rows but for the equalities.
    """
    if not np.isfinite(M).all() or np.isnan(b).any():
        return None
    if not equalities:
        found = _Rows(M, b, tolerance).multipliers(active)
        return None if found is None else Multipliers(found[0], found[1])
    # The part of the other rows that is independent of the equalities.
    first, rest = slice(equalities), slice(equalities, None)
    try:
        inverse = np.linalg.inv(M[first, first])
    except np.linalg.LinAlgError:
        return None
    by = M[rest, first] @ inverse
    own, values = M[rest, rest] - by @ M[first, rest], b[rest] - by @ b[first]
    square = np.diag(own)
    free = np.flatnonzero(square > DEPENDENT)
    if np.any(np.delete(values + tolerance[rest], free) < 0.0):
        return None
    scale = 1.0 / np.sqrt(square[free])
    place = np.full(len(values), -1)
    place[free] = np.arange(len(free))
    guess = place[active - equalities]
    found = _Rows(own[np.ix_(free, free)] * scale * scale[:, None], values[free] * scale,
                  tolerance[rest][free] * scale).multipliers(guess[guess >= 0])
    if found is None:
        return None
    value = np.zeros(len(b))
    value[equalities + free] = found[0] * scale
    value[first] = -inverse @ (b[first] + M[first, rest] @ value[rest])
    missed = np.abs(M[first] @ value + b[first])
    return (Multipliers(value, equalities + free[found[1]])
            if np.all(missed <= tolerance[first]) else None)


class _Rows(NamedTuple):
    """Rows G r ≤ b of unit length."""

    M: np.ndarray
    b: np.ndarray
    tolerance: np.ndarray

    def multipliers(self, active: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """Returns the multipliers and the active rows, or None; `active` is a guess."""
        return self._by_exchanges(active) or self._by_steps()

    def _at(self, active: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        """Returns the multipliers of active rows (k,), the excess of all (m,), and their inverse.

        The excess of the active rows is that of rounding.
        """
        columns, b = self.M[:, active], self.b[active]
        gram = columns[active]
        try:  # With one step of iterative refinement.
            inverse = np.linalg.inv(gram)
        except np.linalg.LinAlgError:
            return None
        multiplier = -(inverse @ b)
        multiplier -= inverse @ (gram @ multiplier + b)
        return multiplier, -(columns @ multiplier) - self.b, inverse

    def _result(self, active: np.ndarray, multiplier: np.ndarray, excess: np.ndarray
                ) -> tuple[np.ndarray, np.ndarray] | None:
        """Returns the multipliers of all rows if active rows are kept and signs are right."""
        least = -ROUNDING * np.max(np.abs(multiplier), initial=0.0)
        if np.any(np.abs(excess[active]) > self.tolerance[active]) or np.any(multiplier < least):
            return None
        value = np.zeros(len(self.b))
        value[active] = multiplier
        return value, active

    def _by_exchanges(self, active: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """Returns the multipliers by exchanges of many rows, or None if they do not end soon."""
        for _ in range(EXCHANGES):
            found = self._at(active)
            if found is None:
                return None
            multiplier, excess, _ = found
            over = excess > self.tolerance
            over[active] = False
            broken = np.flatnonzero(over)
            if not len(broken):
                result = self._result(active, multiplier, excess)
                if result is not None:
                    return result
            elif len(broken) > 1:
                # Of rows of about one direction the most violated one keeps the others, too.
                violation = excess[broken] * (1.0 - EARLIER * broken)
                alike = self.M[broken[:, None], broken] > ALIKE
                broken = broken[violation >= np.max(alike * violation, axis=1)]
            active = np.concatenate([active[multiplier > 0.0], broken])
        return None

    def _by_steps(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Returns the multipliers by the method of Goldfarb and Idnani."""
        M, left, active = self.M, STEPS * len(self.b), NO_ROWS
        earlier = 1.0 - EARLIER * np.arange(len(self.b))
        while True:
            # Inverse anew, as updates accumulate errors.
            found = self._at(active)
            if found is None:
                return None
            multiplier, missed, inverse = found
            excess = missed.copy()
            excess[active] = -np.inf
            if np.all(excess <= self.tolerance):
                return self._result(active, multiplier, missed)
            while np.any(excess > self.tolerance):
                row, own = int(np.argmax((excess - self.tolerance) * earlier)), 0.0
                # The row's own multiplier grows until the row is kept (a whole step) or another
                # multiplier reaches zero; that one's row is removed from the active set.
                while True:
                    if left == 0:
                        return None
                    left -= 1
                    by = M[active, row]
                    change = inverse @ by
                    rate = M[row, row] - by @ change
                    falls = np.flatnonzero(change > 0.0)
                    lasts = multiplier[falls] / change[falls]
                    whole = excess[row] / rate if rate > DEPENDENT else np.inf
                    step = min(whole, np.min(lasts, initial=np.inf))
                    if step == np.inf:
                        return None
                    multiplier, own = multiplier - step * change, own + step
                    turned = np.zeros(len(excess))
                    turned[active], turned[row] = change, -1.0
                    excess += step * (M @ turned)
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
                inverse = _bordered(inverse, np.append(change, -1.0), rate)
                active, multiplier = np.append(active, row), np.append(multiplier, own)
                excess[row] = -np.inf


def _bordered(inverse: np.ndarray, corner: np.ndarray, rate: float) -> np.ndarray:
    """Returns the inverse with one row more, by (change, −1) and the row's independent part."""
    out = np.outer(corner, corner / rate)
    out[:-1, :-1] += inverse
    return out
