"""Bounds of norms of matrices over boxes of joints, from their expansions about the centres.

A norm of A(q) is at most its largest value at the corners ε, A(c) + Σ εᵢhᵢ∂ᵢA(c), plus
½ΣΣ hᵢhⱼ‖A″ᵢⱼ‖, A″ᵢⱼ in the enclosure of ∂ᵢ∂ⱼA over the box. Proof:
tube/contact/theory.md#operator-norms-over-boxes-of-joints.
"""

from itertools import product
from typing import NamedTuple

import numpy as np

from uvms_drake.tube.contact.enclosure import Enclosure
from uvms_drake.tube.contact.gain_expansions import Expansion, pair_of
from uvms_drake.tube.contact.sensor_gains import norm

ROUNDING = 1e-9
"""Relative allowance for rounding."""


class Bounds(NamedTuple):
    """Bounds of norms over m boxes, in the order of the columns of `norms_over_joints`."""

    value: np.ndarray
    """Values at the centres, with n the tip's x-axis (m, c)."""
    upper: np.ndarray
    """Bounds of all values in the boxes (m, c)."""
    share: np.ndarray
    """Approximate part of each coordinate in the bounds (m, n, c); the largest is worth cutting."""


Sides = tuple[np.ndarray | None, np.ndarray | None]
"""Vectors (d, 3) on the left and on the right of A, or none."""
NEITHER: Sides = (None, None)


class Columns:
    """Bounds of norms, one after the other; see `Bounds`.

    Args:
        half: Half of the boxes' widths (m, n) [rad].
        claims: Values of the columns up to which a bound needs not be close.
    """

    def __init__(self, half: np.ndarray, claims: np.ndarray):
        self._half, self._claims = half, claims
        self._signs = np.array(list(product((-1.0, 1.0), repeat=half.shape[1])))
        self._found: list[Bounds] = []

    def add(self, A: Expansion, sides: Sides = NEITHER) -> None:
        """Adds ‖A‖, ‖nᵀA‖, ‖A n‖ or |nᵀA n|.

        A box is evaluated at its corners only where the sum of norms is above the claim.
        """
        most = longest(sides)
        bend, slope = self._bend(A) * most, frobenius(A.first) * most
        here = norms(A.value, sides)
        rest = 0.5 * np.sum(self._half * bend, axis=1)
        upper = np.max(here, axis=-1) + np.sum(self._half * slope, axis=1) + rest
        close = ~(upper * (1.0 + ROUNDING) <= self._claims[len(self._found)])
        corners = A.value[close, None] + np.einsum(
            "vi,mi,mirc->mvrc", self._signs, self._half[close], A.first[close])
        upper[close] = np.max(norms(corners, sides), axis=(1, 2), initial=0.0) + rest[close]
        self._found.append(Bounds(here[..., 0], upper, self._half * (slope + bend)))

    def add_slope(self, A: Expansion, sides: Sides = NEITHER) -> None:
        """Adds (Σ‖∂ᵢA‖²)^½ or (Σ‖nᵀ∂ᵢA‖²)^½."""
        bend, here = self._bend(A) * longest(sides), norms(A.first, sides)
        self._add(here[..., :1], here + bend[..., None], self._half * bend)

    def add_enclosed(self, at: Enclosure, box: Enclosure) -> None:
        """Adds (Σ‖Aᵢ‖²)^½ of Aᵢ (m, n, r, c) at the centres and in the boxes."""
        radius = frobenius(box.rad)
        self._add(norms(at.mid, NEITHER), norms(box.mid, NEITHER) + radius[..., None],
                  self._half * radius)

    def _add(self, value: np.ndarray, upper: np.ndarray, share: np.ndarray) -> None:
        value, upper = (np.max(np.linalg.norm(each, axis=1), axis=-1) for each in (value, upper))
        self._found.append(Bounds(value, upper, share))

    def _bend(self, A: Expansion) -> np.ndarray:
        """Returns Σⱼ hⱼ‖A″ᵢⱼ‖ (m, n), the largest change of ∂ᵢA."""
        each = frobenius(A.second)[:, pair_of(self._half.shape[1])]
        out: np.ndarray = np.sum(self._half[:, None] * each, axis=2)
        return out

    def all(self) -> Bounds:
        """Returns the bounds; infinite where nothing is known."""
        value, upper, share = (
            np.stack(each, axis=-1) for each in zip(*self._found, strict=True))
        return Bounds(value, np.where(np.isnan(upper), np.inf, upper), share)


def norms(A: np.ndarray, sides: Sides) -> np.ndarray:
    """Returns the norms (..., k) of matrices (..., r, c), times all vectors on either side.

    The first is that with the first vectors, the tip's x-axis.
    """
    left, right = sides
    if left is not None:
        A = left @ A
    if right is not None:
        A = A @ right.T
    if left is not None and right is not None:
        return np.abs(A).reshape(*A.shape[:-2], A.shape[-2] * A.shape[-1])
    if left is None and right is None:
        return norm(A)[..., None]
    out: np.ndarray = np.linalg.norm(A, axis=-2 if left is None else -1)
    return out


def longest(sides: Sides) -> float:
    """Returns the product of the largest norms on either side."""
    return float(np.prod([np.max(np.linalg.norm(side, axis=1)) for side in sides
                          if side is not None]))


def frobenius(A: np.ndarray) -> np.ndarray:
    """Returns Frobenius norms (...), which are not below the spectral ones, of (..., r, c)."""
    out: np.ndarray = np.sqrt(np.sum(np.square(A), axis=(-2, -1)))
    return out
