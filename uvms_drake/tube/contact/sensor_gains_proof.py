"""Proof of claims on the suprema of `sensor_gains`, by branch and bound over boxes of joints.

For A(q), c the centre of a box of half-widths h and δ = q − c in it, a norm of A is at most its
largest value at the corners ε, A(c) + Σ εᵢhᵢ∂ᵢA(c), plus ½ΣΣ hᵢhⱼ‖A″ᵢⱼ‖, A″ᵢⱼ in the enclosure of
∂ᵢ∂ⱼA over the box. A claim is proven where all boxes of a covering have such a bound that is no
larger; others are halved. n, within an angle of the tip's x-axis, is in the convex hull of vectors.
"Proven" is up to rounding: the arithmetic is floating-point, and `ROUNDING` is added for it. Proof:
tube/contact/theory.md#operator-norms-over-boxes-of-joints.
"""

from itertools import product
from typing import NamedTuple

import numpy as np

from uvms_drake.model.uvms_model import UvmsModel
from uvms_drake.tube.contact.enclosure import Enclosure, concatenated, crossing, exactly, inverse
from uvms_drake.tube.contact.joint_enclosures import Expansion, inertia_of, link_jacobians
from uvms_drake.tube.contact.sensor_gains import ALONE, Suprema, norm, norms_over_joints, suprema_of
from uvms_drake.tube.search.constraint_set import ConstraintSet
from uvms_drake.tube.search.estimate import Check, Estimate, largest_of
from uvms_drake.tube.search.joint_search import second_over_joints, supremum_over_joints
from uvms_drake.tube.search.search_memo import active_memo

SLOPES_OF_J, SLOPES_OF_A = 1.3, 3.0
"""Additional factors of the claims of (Σ‖∂ᵢJ‖²)^½ and (Σ‖∂ᵢA‖²)^½: they count little, and smaller
ones need far more boxes."""
BATCH = 64
"""Number of boxes evaluated at a time."""
MOST_WORK = 6_000_000
"""Boxes times 4ⁿ, after which claims remain unproven."""
POLYGON = 12
"""Corners of the polygon about the circle of w."""
ROUNDING = 1e-9
"""Relative allowance for rounding."""
PROVABLE = ALONE + 4 * 6
"""Number of the columns of `norms_over_joints` to prove: all but those of single rows of ζ̇."""


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
    largest: float
    """Largest value at a box's centre, over its claim: more than 1 refutes it."""


def claimed_suprema(model: UvmsModel, declared: ConstraintSet, tool_angle: float, *,
                    safety_factor: float, seed: int = 0) -> Claimed:
    """Returns the values found, times a factor, as claims that are proven or not.

    With an active memo no proof is needed, and none is tried.

    Args:
        model: The controller's.
        declared: The set of the suprema.
        tool_angle: Largest angle of n and the tip's x-axis [rad].
        safety_factor: The factor.
        seed: Seed of the searches.
    """
    sizes, box = norms_over_joints(model, declared, tool_angle)
    claims = safety_factor * supremum_over_joints(sizes, *box, seed)
    claims[[2, 4]] *= SLOPES_OF_J
    claims[ALONE + 3::4] *= SLOPES_OF_A
    joints = declared.q_lower, declared.q_upper
    proof = Proof(False, 0, 0.0) if active_memo() is not None else proof_of(
        model, *joints, tool_angle, claims[:PROVABLE], MOST_WORK)
    first = PROVABLE if proof.proven else 0

    def check() -> tuple[Estimate, ...]:
        second = second_over_joints(sizes, *box, seed)
        if not proof.proven:  # The values of an attempt count, too.
            second = np.maximum(second, proof.largest * claims)
        return (largest_of("norms of M⁻¹J_Eᵀ", claims[first:], second[first:]),)

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
        return Proof(False, 0, 0.0)
    # The whole range of the joints is the first box.
    directions = corners_of_cone(tool_angle)
    todo = [(0.5 * (lower + upper), 0.5 * (upper - lower))]
    boxes, largest, most = 0, 0.0, most_work // 4 ** len(lower)
    while todo and boxes < most:
        taken, todo = todo[-BATCH:], todo[:-BATCH]
        centre, half = (np.array(each) for each in zip(*taken, strict=True))
        boxes += len(taken)
        found = bounds(model, centre, half, directions)
        largest = max(largest, float(np.max(_over_claim(found.value, claims))))
        if largest > 1.0:
            break
        # Boxes above a claim are halved along the coordinate that counts most.
        over = _over_claim(found.upper, claims) * (1.0 + ROUNDING) > 1.0
        for i in np.flatnonzero(np.any(over, axis=1)):
            worth = np.max(_over_claim(found.share[i], claims)[:, over[i]], axis=1)
            which = np.argmax(worth if np.all(np.isfinite(worth)) else half[i])
            shift = np.zeros_like(worth)
            shift[which] = 0.5 * half[i, which]
            todo += [(centre[i] - shift, half[i] - shift), (centre[i] + shift, half[i] - shift)]
    return Proof(not todo and largest <= 1.0, boxes, largest)


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


class Bounds(NamedTuple):
    """Bounds of norms over m boxes, in the order of the columns of `norms_over_joints`."""

    value: np.ndarray
    """Values at the centres, with n the tip's x-axis (m, c)."""
    upper: np.ndarray
    """Bounds of all values in the boxes (m, c)."""
    share: np.ndarray
    """Approximate part of each coordinate in the bounds (m, n, c); the largest is worth halving."""


def bounds(model: UvmsModel, centre: np.ndarray, half: np.ndarray, directions: np.ndarray
           ) -> Bounds:
    """Returns bounds over boxes; see the module.

    Args:
        model: The controller's.
        centre: Centres of the boxes (m, n) [rad].
        half: Half of their widths (m, n) [rad].
        directions: Vectors (d, 3) in whose convex hull n is.
    """
    size = model.size
    J_E, in_vehicle = _tip(model, centre, half)
    A = _gains(model, centre, half)
    columns = _Columns(half)
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
    return columns.bounds()


def _tip(model: UvmsModel, centre: np.ndarray, half: np.ndarray
         ) -> tuple[Expansion, tuple[Enclosure, Enclosure]]:
    """Returns J_E about the centres, and ∂ᵢJ_v in axes of the vehicle there and in the boxes."""
    def in_vehicle(J: Enclosure) -> Enclosure:
        """By joint i the tip is moved by lᵢ, its lever's end, and the levers of joints j turn.

        [0, −S(lᵢ), a_min × l_max] with a, l of the axes, of the two of i and j.
        """
        n = J.mid.shape[-1] - 6
        levers, axes = J[:, :3, 6:].T, J[:, 3:, 6:].T
        turned = crossing(axes)[:, :, None] @ levers[:, None, ..., None]
        i, j = np.indices((n, n))
        joints = turned[..., 0][:, np.minimum(i, j), np.maximum(i, j)].swapaxes(2, 3)
        vehicle = crossing(levers)
        return concatenated(exactly(np.zeros_like(vehicle.mid)), vehicle, joints, axis=-1)

    unit = np.tile(np.eye(model.size), (len(centre), 1, 1))
    here, box = ([*link_jacobians(model, centre, each, unit)][-1]
                 for each in (np.zeros_like(half), half))
    return here._replace(second=box.second), (in_vehicle(here.value), in_vehicle(box.value))


def _gains(model: UvmsModel, centre: np.ndarray, half: np.ndarray) -> Expansion:
    """Returns S over G (m, 6+6+n, 6) about the centres."""
    T = _unit(model, centre)
    points, boxes = ([*link_jacobians(model, centre, each, T)]
                     for each in (np.zeros_like(half), half))
    here, second = inertia_of(model, points, T), inertia_of(model, boxes, T).second
    first = here.first.widened(_moved(half[:, None], second))
    M = Expansion(here.value.widened(_moved(half, first)), first, second)
    at, over = _over(points[-1], here, T), _over(boxes[-1], M, T)
    return at._replace(second=over.second)


def _over(J: Expansion, M: Expansion, T: np.ndarray) -> Expansion:
    """Returns S over G, of JT and TᵀMT."""
    M_inverse = inverse(M.value)
    G = M_inverse @ J.value.T
    one, two = G[:, None], G[:, None, None]
    G_by = M_inverse[:, None] @ (J.first.T - M.first @ one)
    M_G, J_G = (each.first[:, :, None] @ G_by[:, None] for each in (M, J))
    G_two = M_inverse[:, None, None] @ (
        J.second.T - M.second @ two - M_G - M_G.swapaxes(1, 2))
    S_by = J.first @ one
    S_two = J.second @ two + J_G + J_G.swapaxes(1, 2) + J.value[:, None, None] @ G_two
    rows = exactly(T)
    return Expansion(
        concatenated(J.value @ G, rows @ G, axis=-2),
        concatenated(S_by + S_by.T - one.T @ M.first @ one, rows[:, None] @ G_by, axis=-2),
        concatenated(S_two, rows[:, None, None] @ G_two, axis=-2))


def _unit(model: UvmsModel, q: np.ndarray) -> np.ndarray:
    """Returns T (m, 6+n, 6+n) with TᵀMT = I at joint angles (m, n)."""
    config = np.concatenate([np.zeros((len(q), 6)), q], axis=1)
    root = np.linalg.cholesky(model.mass_matrix(model.kinematics(config)))
    out: np.ndarray = np.linalg.inv(root).swapaxes(-1, -2)
    return out


def _moved(half: np.ndarray, by: Enclosure) -> np.ndarray:
    """Returns the largest change by derivatives (..., n, r, c) within h (..., n)."""
    out: np.ndarray = np.sum(half[..., None, None] * by.largest, axis=-3)
    return out


Sides = tuple[np.ndarray | None, np.ndarray | None]
"""Vectors (d, 3) on the left and on the right of A, or none."""
NEITHER: Sides = (None, None)


class _Columns:
    """Bounds of norms, one after the other; see `Bounds`."""

    def __init__(self, half: np.ndarray):
        self._half = half
        self._corners = half[:, None] * np.array(list(product((-1.0, 1.0), repeat=half.shape[1])))
        self._found: list[Bounds] = []

    def add(self, A: Expansion, sides: Sides = NEITHER) -> None:
        """Adds ‖A‖, ‖nᵀA‖, ‖A n‖ or |nᵀA n|."""
        corners = A.value.mid[:, None] + np.einsum("mvi,mirc->mvrc", self._corners, A.first.mid)
        bend = self._bend(A) * longest(sides)
        self._found.append(Bounds(
            np.max(norms(A.value.mid, first(sides)), axis=-1),
            np.max(norms(corners, sides), axis=(1, 2)) + 0.5 * np.sum(
                self._half * bend, axis=1),
            self._half * (frobenius(A.first.mid) * longest(sides) + bend)))

    def add_slope(self, A: Expansion, sides: Sides = NEITHER) -> None:
        """Adds (Σ‖∂ᵢA‖²)^½ or (Σ‖nᵀ∂ᵢA‖²)^½."""
        bend = self._bend(A) * longest(sides)
        self._add(norms(A.first.mid, first(sides)),
                  norms(A.first.mid, sides) + bend[..., None], self._half * bend)

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
        out: np.ndarray = np.sum(self._half[:, None] * frobenius(A.second.largest), axis=2)
        return out

    def bounds(self) -> Bounds:
        """Returns the bounds; infinite where nothing is known."""
        value, upper, share = (
            np.stack(each, axis=-1) for each in zip(*self._found, strict=True))
        return Bounds(value, np.where(np.isnan(upper), np.inf, upper), share)


def norms(A: np.ndarray, sides: Sides) -> np.ndarray:
    """Returns the norms (..., k) of matrices (..., r, c), times all vectors on either side."""
    left, right = sides
    if left is not None:
        A = left @ A
    if right is not None:
        A = A @ right.T
    if left is not None and right is not None:
        return np.abs(A).reshape(*A.shape[:-2], -1)
    if left is None and right is None:
        return norm(A)[..., None]
    out: np.ndarray = np.linalg.norm(A, axis=-2 if left is None else -1)
    return out


def first(sides: Sides) -> Sides:
    """Returns the first vector on either side, the tip's x-axis."""
    left, right = (None if side is None else side[:1] for side in sides)
    return left, right


def longest(sides: Sides) -> float:
    """Returns the product of the largest norms on either side."""
    return float(np.prod([np.max(np.linalg.norm(side, axis=1)) for side in sides
                          if side is not None]))


def frobenius(A: np.ndarray) -> np.ndarray:
    """Returns Frobenius norms (...), which are not below the spectral ones, of (..., r, c)."""
    out: np.ndarray = np.sqrt(np.sum(np.square(A), axis=(-2, -1)))
    return out
