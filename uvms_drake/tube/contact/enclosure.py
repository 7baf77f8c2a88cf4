"""Enclosures: matrices within a radius of a midpoint, entry by entry; those of the arm over boxes.

Arithmetic of midpoints and radii (Rump, *Fast and parallel interval arithmetic*, BIT 39, 1999):
a result contains every result of any members of the operands. Rounding is left to the caller, see
`covering`.

The links' Jacobians and M's second derivatives over boxes of joints: for columns of any matrix T in
place of ζ, ζ = T z, and in axes of link k, Xₖ taking twists from link to link, sₖ the screw of
joint k in axes of the link before, tₖ its row of T,

    Jₖ = Xₖ(qₖ)(Jₖ₋₁ + sₖ tₖ),    ∂Jₖ/∂qᵢ = −cᵢ × Bᵢ,    ∂²Jₖ/∂qᵢ∂qⱼ = −cᵢ × ∂Jₖ/∂qⱼ,  j ≤ i,

Bᵢ = Xₖ…Xᵢ Jᵢ₋₁, cᵢ = Xₖ…Xᵢ sᵢ. Where T makes M the unit matrix at a box's centre, radii stay small.
Pairs (i, j), j ≤ i, are in the order of `np.tril_indices`. Proof:
tube/contact/theory.md#enclosures-of-link-jacobians-and-inertia.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from uvms_drake.model.frames.spatial import cross, motion_matrix, skew
from uvms_drake.model.uvms_model import UvmsModel, beyond_columns


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


class Link(NamedTuple):
    """A link beyond k joints, over m boxes of them; in its own axes."""

    J: Enclosure
    """Jacobian JₖT (m, 6, 6+n)."""
    turns: Enclosure
    """Matrices −cᵢ× of these joints (m, k, 6, 6)."""
    first: Enclosure
    """First derivatives of JₖT by them (m, k, 6, 6+n)."""


def links_in_boxes(model: UvmsModel, centre: np.ndarray, half: np.ndarray, T: np.ndarray
                   ) -> tuple[Enclosure, list[Link]]:
    """Returns J_E (m, 6, 6+n) in columns of ζ, and all links but the vehicle in those of T.

    Args:
        model: Any serial arm.
        centre: Joints in the middle of the boxes (m, n) [rad, m].
        half: Half-widths of the boxes (m, n) [rad, m].
        T: Columns in place of ζ (m, 6+n, 6+n).
    """
    count, size = len(centre), model.size
    vehicle = _carry(exactly(np.tile(model.links.X_BV, (count, 1, 1))))
    J_E, J = vehicle, vehicle @ T[:, :6]
    carried = exactly(np.zeros((count, 6, 0)))  # Bᵢ, side by side.
    links = []
    for k in range(model.num_joints):
        # The columns of J_E are the vehicle's and the screws cᵢ.
        screw = exactly(np.tile(_screw(model, k)[:, None], (count, 1, 1)))
        moved = _carry(_step(model, k, centre, half)) @ concatenated(
            J_E, screw, carried, J, axis=-1)
        J_E, carried = moved[..., :7 + k], moved[..., 7 + k:]
        J = carried[..., -size:] + J_E[..., -1:] @ T[:, 6 + k, None]
        turns = _turns(J_E)
        links.append(Link(J, turns, turns @ carried.reshape(count, 6, k + 1, size).swapaxes(1, 2)))
    return J_E, links


def second_of_tip(J_E: Enclosure) -> Enclosure:
    """Returns ∂²J_E/∂qᵢ∂qⱼ (m, n(n+1)/2, 6, 6+n) of J_E (m, 6, 6+n)."""
    n = J_E.mid.shape[-1] - 6
    beyond = beyond_columns(n)[:, None]
    turns = _turns(J_E)
    first = turns @ Enclosure(J_E.mid[:, None] * beyond, J_E.rad[:, None] * beyond)
    i, j = np.tril_indices(n)
    return turns[:, i] @ first[:, j]


def second_of_links(links: list[Link]) -> list[Enclosure]:
    """Returns ∂²JₖT/∂qᵢ∂qⱼ (m, n−i, 6, i+1, 6+n) by joint i, of links beyond it and all j ≤ i."""
    count, n, _, size = links[-1].first.mid.shape
    out = []
    for i in range(n):
        turns = concatenated(*(link.turns[:, i, None] for link in links[i:]), axis=1)
        out.append((turns @ _first(links, i)).reshape(count, n - i, 6, i + 1, size))
    return out


def second_of_inertia(model: UvmsModel, links: list[Link], second: list[Enclosure]) -> Enclosure:
    """Returns ∂²TᵀMT/∂qᵢ∂qⱼ (m, n(n+1)/2, 6+n, 6+n), TᵀMT = Σ JₖᵀIₖJₖ of all links, and motors.

    Args:
        model: Any serial arm.
        links: The links.
        second: Their second derivatives.
    """
    # All links, one above the other: Jᵢⱼᵀ I J + Jⱼᵀ I Jᵢ, and the transposes.
    count, n, _, size = links[-1].first.mid.shape
    inertia = model.links.inertia[1:]
    I_J = inertia @ concatenated(*(link.J[:, None] for link in links), axis=1)
    out = []
    for i, two in enumerate(second):
        one = _first(links, i)
        I_J_i = inertia[i:] @ one[..., -size:]
        half = (two.reshape(count, 6 * (n - i), -1).T @ I_J[:, i:].reshape(count, -1, size)
                + one.reshape(count, 6 * (n - i), -1).T @ I_J_i.reshape(count, -1, size))
        out.append(half.reshape(count, i + 1, size, size))
    halves = concatenated(*out, axis=1)
    return halves + halves.T


def _first(links: list[Link], i: int) -> Enclosure:
    """Returns ∂JₖT/∂qⱼ of all links beyond joint i (m, n−i, 6, (i+1)(6+n)), j ≤ i side by side."""
    count, _, _, size = links[-1].first.mid.shape
    each = (link.first[:, :i + 1].swapaxes(1, 2)[:, None] for link in links[i:])
    return concatenated(*each, axis=1).reshape(count, len(links) - i, 6, (i + 1) * size)


def _turns(J_E: Enclosure) -> Enclosure:
    """Returns −cᵢ× (m, k, 6, 6) of the screws in the columns of J_E (m, 6, 6+k)."""
    across = carrying(J_E[..., 6:].T)
    return Enclosure(-across.mid, across.rad)


def _step(model: UvmsModel, j: int, centre: np.ndarray, half: np.ndarray) -> Enclosure:
    """Returns the pose (m, 4, 4) of link j + 1 in the link before."""
    fixed, by_sin, by_cos, by_length = model.links.step[:, j]
    middle, reach = centre[:, j, None, None], half[:, j, None, None]
    if model.slides[j]:
        return Enclosure(fixed + middle * by_length, reach * np.abs(by_length))
    sine, cosine = sine_and_cosine(middle, reach)
    return Enclosure(fixed + sine.mid * by_sin + cosine.mid * by_cos,
                     sine.rad * np.abs(by_sin) + cosine.rad * np.abs(by_cos))


def _screw(model: UvmsModel, j: int) -> np.ndarray:
    """Returns the screw (6,) of joint j in axes of the link before."""
    axis, point = model.links.joint_axis[j, :3].T
    return np.concatenate([axis, np.zeros(3)] if model.slides[j] else [cross(point, axis), axis])


def _carry(pose: Enclosure) -> Enclosure:
    """Returns X = [Rᵀ −RᵀS(p); 0 Rᵀ], which takes twists to axes of a frame of a pose (R, p)."""
    R_T, p = pose[:, :3, :3].T, pose[:, :3, 3]
    none, lever = exactly(np.zeros_like(R_T.mid)), R_T @ crossing(p)
    minus = Enclosure(-lever.mid, lever.rad)
    return concatenated(concatenated(R_T, minus, axis=-1), concatenated(none, R_T, axis=-1),
                        axis=-2)
