"""Enclosures: matrices within a radius of a midpoint, entry by entry.

Arithmetic of midpoints and radii (Rump, *Fast and parallel interval arithmetic*, BIT 39, 1999):
a result contains every result of any members of the operands. Rounding is left to the caller, see
`covering`.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from uvms_drake.model.frames.spatial import motion_matrix, skew


@dataclass(frozen=True)
class Enclosure:
    """All matrices A with |A − mid| ≤ rad, entry by entry; a stack of any leading shape."""

    mid: np.ndarray
    """Midpoints (..., r, c)."""
    rad: np.ndarray
    """Radii (..., r, c), not negative; infinite, or not a number, where nothing is known."""
    __array_ufunc__ = None  # A matrix times an enclosure is `__rmatmul__`.

    def __add__(self, other: "Enclosure") -> "Enclosure":
        return Enclosure(self.mid + other.mid, self.rad + other.rad)

    def __sub__(self, other: "Enclosure") -> "Enclosure":
        return Enclosure(self.mid - other.mid, self.rad + other.rad)

    def __matmul__(self, other: "Enclosure | np.ndarray") -> "Enclosure":
        with np.errstate(invalid="ignore", over="ignore"):  # Zero times infinity.
            if isinstance(other, np.ndarray):
                return Enclosure(self.mid @ other, self.rad @ np.abs(other))
            rad = np.abs(self.mid) @ other.rad + self.rad @ other.largest
        return Enclosure(self.mid @ other.mid, rad)

    def __rmatmul__(self, other: np.ndarray) -> "Enclosure":
        with np.errstate(invalid="ignore", over="ignore"):
            return Enclosure(other @ self.mid, np.abs(other) @ self.rad)

    def __getitem__(self, index: Any) -> "Enclosure":
        return Enclosure(self.mid[index], self.rad[index])

    @property
    def T(self) -> "Enclosure":
        """The transposes."""
        return self.swapaxes(-1, -2)

    @property
    def largest(self) -> np.ndarray:
        """The largest |A|, entry by entry."""
        return np.abs(self.mid) + self.rad

    def swapaxes(self, first: int, second: int) -> "Enclosure":
        """Returns the stack with two of its axes interchanged."""
        return Enclosure(self.mid.swapaxes(first, second), self.rad.swapaxes(first, second))

    def reshape(self, *shape: int) -> "Enclosure":
        """Returns the stack in another shape."""
        return Enclosure(self.mid.reshape(shape), self.rad.reshape(shape))


def exactly(A: np.ndarray) -> Enclosure:
    """Returns the enclosure of one matrix."""
    return Enclosure(A, np.zeros_like(A))


def crossing(a: Enclosure) -> Enclosure:
    """Returns S(a) (..., 3, 3) of vectors a (..., 3), S(a) b = a × b."""
    return Enclosure(skew(a.mid), np.abs(skew(a.rad)))


def carrying(V: Enclosure) -> Enclosure:
    """Returns V× (..., 6, 6) of motion vectors V (..., 6), see `motion_matrix`."""
    return Enclosure(motion_matrix(V.mid), np.abs(motion_matrix(V.rad)))


def concatenated(*parts: Enclosure, axis: int) -> Enclosure:
    """Returns enclosures one after the other along an axis."""
    return Enclosure(np.concatenate([part.mid for part in parts], axis=axis),
                     np.concatenate([part.rad for part in parts], axis=axis))


def sine_and_cosine(centre: np.ndarray, half: np.ndarray) -> tuple[Enclosure, Enclosure]:
    """Returns sin and cos of all angles within `half` of `centre`, of any shape [rad]."""
    sine, cosine = np.sin(centre), np.cos(centre)
    wide = half > 0.5 * np.pi
    least = np.where(wide, -1.0, np.cos(half))  # Of cos δ, at most 1.
    reach = np.where(wide, 1.0, np.sin(half))  # Of |sin δ|.
    middle, spread = 0.5 * (1.0 + least), 0.5 * (1.0 - least)
    return (Enclosure(sine * middle, np.abs(sine) * spread + np.abs(cosine) * reach),
            Enclosure(cosine * middle, np.abs(cosine) * spread + np.abs(sine) * reach))


def inverse(A: Enclosure) -> Enclosure:
    """Returns the inverses of square matrices; of unknown radius where one may be singular.

    With R the inverse of the midpoint and Z = |R|A_r, |A⁻¹ − R| ≤ Z(I − Z)⁻¹|R| if Z's spectral
    radius is below 1. Proof: tube/contact/theory.md#inverse-of-an-interval-matrix.
    """
    R = np.linalg.inv(A.mid)
    Z = np.abs(R) @ A.rad
    known = np.all(np.isfinite(Z), axis=(-2, -1), keepdims=True)
    Z = np.where(known, Z, 0.0)
    known &= np.max(np.abs(np.linalg.eigvals(Z)), axis=-1)[..., None, None] < 1.0
    Z = np.where(known, Z, 0.0)
    series = np.linalg.inv(np.eye(Z.shape[-1]) - Z)
    known &= np.all(series >= 0.0, axis=(-2, -1), keepdims=True)
    return Enclosure(R, np.where(known, Z @ series @ np.abs(R), np.inf))
