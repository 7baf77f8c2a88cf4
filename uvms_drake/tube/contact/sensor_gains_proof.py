"""Proof of claims on the suprema of `sensor_gains`, by branch and bound over boxes of joints.

A claim is proven where all boxes of a covering have a bound that is no larger; others are cut. n,
within an angle of the tip's x-axis, is in the convex hull of vectors. A norm of A(q) is at most its
largest value at the corners ε, A(c) + Σ εᵢhᵢ∂ᵢA(c), plus ½ΣΣ hᵢhⱼ‖A″ᵢⱼ‖, A″ᵢⱼ in the enclosure of
∂ᵢ∂ⱼA over the box. "Proven" is up to rounding: the arithmetic is floating-point, and `ROUNDING` is
added for it. Proof: tube/contact/theory.md#operator-norms-over-boxes-of-joints.
"""

from itertools import product
from typing import NamedTuple

import numpy as np

from uvms_drake.model.uvms_model import UvmsModel
from uvms_drake.tube.contact.enclosure import Enclosure
from uvms_drake.tube.contact.gain_expansions import Expansion, expansions, pair_of
from uvms_drake.tube.contact.sensor_gains import ALONE, Suprema, norm, norms_over_joints, suprema_of
from uvms_drake.tube.estimates import Check, Estimate, extremes_of, searched_again
from uvms_drake.tube.search.constraint_set import ConstraintSet
from uvms_drake.tube.search.joint_search import second_over_joints, supremum_over_joints

ROUNDING = 1e-9
"""Relative allowance for rounding."""
SLOPES_OF_J, SLOPES_OF_A = 1.3, 3.0
"""Additional factors of the claims of (Σ‖∂ᵢJ‖²)^½ and (Σ‖∂ᵢA‖²)^½: they count little, and smaller
ones need far more boxes."""
BATCH = 128
"""Number of boxes evaluated at a time."""
MOST_WORK = 6_000_000
"""Boxes times 4ⁿ, after which claims remain unproven."""
MOST_HALVINGS, NEAR = 3, 1.5
"""Halvings of a box at once, and excess of its pieces at or below which there are no more."""
POLYGON = 12
"""Corners of the polygon about the circle of w."""
PROVABLE = ALONE + 4 * 6
"""Number of the columns of `norms_over_joints` to prove: all but those of single rows of ζ̇."""


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


class Claimed(NamedTuple):
    """Claims for the suprema."""

    suprema: Suprema
    """Claims."""
    proven: bool
    """True if those of the tip and of blocks are proven; those of single rows never are."""
    check: Check
    """Function that returns the estimates."""


class Proof(NamedTuple):
    """Result of an attempt."""

    proven: bool
    """True if every claim is."""
    boxes: int
    """Number of boxes evaluated."""
    largest: np.ndarray
    """Largest values at boxes' centres over the claims (c,): more than 1 refutes one."""


def claimed_suprema(model: UvmsModel, declared: ConstraintSet, tool_angle: float, *,
                    safety_factor: float, seed: int = 0) -> Claimed:
    """Returns the values found, times a factor, as claims that are proven or not.

    Args:
        model: The controller's.
        declared: The set of the suprema.
        tool_angle: Largest angle of n and the tip's x-axis [rad].
        safety_factor: The factor.
        seed: Seed of the searches.
    """
    sizes, box = norms_over_joints(model, declared, tool_angle)
    claims = safety_factor * supremum_over_joints(sizes, *box, seed)
    provable = claims[:PROVABLE].copy()
    provable[[2, 4]] *= SLOPES_OF_J
    provable[ALONE + 3::4] *= SLOPES_OF_A
    joints = declared.q_lower, declared.q_upper
    proof = proof_of(model, *joints, tool_angle, provable, MOST_WORK)
    first = 0
    if proof.proven:
        first, claims[:PROVABLE] = PROVABLE, provable

    def check() -> tuple[Estimate, ...]:
        second = searched_again(claims[first:], lambda which, attempt: second_over_joints(
            lambda x: sizes(x)[:, first + which], *box, seed, attempt))
        if not proof.proven:  # The values of an attempt count, too.
            second[:PROVABLE] = np.maximum(second[:PROVABLE], proof.largest * provable)
        return extremes_of("norms of M⁻¹J_Eᵀ", claims[first:], second)

    return Claimed(suprema_of(claims), proof.proven, check)


def proof_of(model: UvmsModel, lower: np.ndarray, upper: np.ndarray, tool_angle: float,
             claims: np.ndarray, most_work: int) -> Proof:
    """Returns whether the first of the suprema of `norms_over_joints` are at most the claims.

    A robot without joints has one box without halves, and no proof.

    Args:
        model: The controller's.
        lower: Smallest joint angles (n,) [rad].
        upper: Largest joint angles (n,) [rad].
        tool_angle: Largest angle of n and the tip's x-axis, below π/2 [rad].
        claims: Claims of the first `PROVABLE` columns.
        most_work: Largest work, see `MOST_WORK`.
    """
    if len(lower) == 0:
        return Proof(False, 0, np.zeros(len(claims)))
    # The whole range of the joints is the first box.
    directions = corners_of_cone(tool_angle)
    todo = [(0.5 * (lower + upper), 0.5 * (upper - lower))]
    boxes, largest, most = 0, np.zeros(len(claims)), most_work // 4 ** len(lower)
    while todo and boxes < most:
        taken, todo = todo[-BATCH:], todo[:-BATCH]
        centre, half = (np.array(each) for each in zip(*taken, strict=True))
        boxes += len(taken)
        found = bounds(model, centre, half, directions, claims)
        largest = np.maximum(largest, np.max(_over_claim(found.value, claims), axis=0))
        if np.any(largest > 1.0):
            break
        # Boxes above a claim are cut along the coordinates that count most.
        over = _over_claim(found.upper, claims) * (1.0 + ROUNDING) > 1.0
        for i in np.flatnonzero(np.any(over, axis=1)):
            worth = np.max(_over_claim(found.share[i], claims)[:, over[i]], axis=1)
            pieces = pieces_of(half[i], 0.0)
            if np.all(np.isfinite(worth)) and np.any(worth > 0.0):
                excess = _over_claim(found.upper[i] - found.value[i], claims - found.value[i])
                pieces = pieces_of(worth, float(np.max(excess)))
            width = half[i] / pieces
            todo += [(centre[i] + width * (2.0 * np.array(at) + 1.0 - pieces), width)
                     for at in product(*map(range, pieces))]
    return Proof(not todo and bool(np.all(largest <= 1.0)), boxes, largest)


def pieces_of(worth: np.ndarray, excess: float) -> np.ndarray:
    """Returns the number of pieces of each coordinate (n,) of a box above a claim.

    The excess is quadratic in the widths, to which the parts are proportional. Without the boxes
    in between, which would be cut, too, there are about a third fewer to evaluate.

    Args:
        worth: Part of each coordinate in the bound (n,).
        excess: Bound less the value at the centre, over the claim less it.
    """
    pieces, left = np.ones(len(worth), dtype=int), worth.copy()
    for _ in range(MOST_HALVINGS):
        which = np.argmax(left)
        pieces[which] *= 2
        left[which] *= 0.5
        if excess * (np.sum(left) / np.sum(worth)) ** 2 <= NEAR:
            break
    return pieces


def _over_claim(value: np.ndarray, claims: np.ndarray) -> np.ndarray:
    """Returns values (..., c) over claims (c,); 0 where both are zero."""
    return np.divide(value, claims, out=np.where(value == 0.0, 0.0, np.inf), where=claims > 0.0)


def corners_of_cone(angle: float) -> np.ndarray:
    """Returns vectors (d, 3) in whose convex hull all n within an angle of x are."""
    about = 2.0 * np.pi * np.arange(POLYGON) / POLYGON
    w = np.stack([np.zeros(POLYGON), np.cos(about), np.sin(about)], axis=-1) / np.cos(
        np.pi / POLYGON)
    x = np.array([1.0, 0.0, 0.0])
    return np.concatenate([x[None], x + np.tan(0.5 * angle) * w,
                           np.cos(angle) * x + np.sin(angle) * w])


def bounds(model: UvmsModel, centre: np.ndarray, half: np.ndarray, directions: np.ndarray,
           claims: np.ndarray) -> Bounds:
    """Returns bounds over boxes, in the order of the columns of `norms_over_joints`.

    Args:
        model: The controller's.
        centre: Centres of the boxes (m, n) [rad].
        half: Half of their widths (m, n) [rad].
        directions: Vectors (d, 3) in whose convex hull n is, the first the tip's x-axis.
        claims: Values (c,) up to which a bound needs not be close.
    """
    size = model.size
    J_E, in_vehicle, A = expansions(model, centre, half)
    columns = Columns(half, claims)
    columns.add(J_E.part(slice(3, 6), slice(6, None)))
    columns.add(J_E.part(slice(0, 3)))
    columns.add_enclosed(*in_vehicle)
    columns.add(J_E.part(slice(3, 6)))
    columns.add_slope(J_E.part(slice(3, 6)))
    blocks = [slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 12), slice(12, 6 + size)]
    # The rows of the depth are nᵀ times those of the position.
    for rows, left in ((blocks[0], directions), *((each, None) for each in blocks)):
        force, torque = (A.part(rows, part) for part in (slice(0, 3), slice(3, 6)))
        columns.add(force, (left, None))
        columns.add(force, (left, directions))
        columns.add(torque, (left, None))
        columns.add_slope(force, (left, None))
    return columns.all()
