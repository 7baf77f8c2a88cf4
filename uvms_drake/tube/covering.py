"""Proven upper bounds of ‖J_x Ŵ‖ and of its parts over a `ConstraintSet`, by branch and bound.

The largest bound over a covering by boxes is a bound over the set at every stage, so that a small
budget gives a larger bound, never a wrong one; "proven" is up to rounding. With J_x = [J; 0 I],
D = diag(0, Ŵ_q²) and any λ₀ above its entries, ‖J_x Ŵ‖ ≤ max(√λ₀, ‖J Ŵ(I − D/λ₀)^(−½)‖). Proofs:
tube/theory.md#branch-and-bound, tube/theory.md#extended-jacobian-by-the-jacobian.

Over a box: E' is the frame of the end-effector before its roll, aᵢ the joint axes, p the tip,
cᵢ = ∂p/∂qᵢ in the vehicle's frame B. Up to rotations of rows and of columns, with t = tan θ,

    J ~ [ I  −S(p)  c₁ … c_n ]              A(θ) = [ 1  0  t ]
        [ 0  A(θ)C [I  a₁ … a_n] ]                 [ 0  1  0 ]
                                                   [ 0  0  √(1+t²) ],  C = R_E'B.

The coordinates are (q₁ … q_n, −φ, θ). The vehicle's roll and pitch are half-spaces g_k ≤ 0 of the
direction of "down" in E'. For any μ ≥ 0 a feasible state has ‖K‖ ≤ ‖K‖ − Σ μ_k g_k, whose bound has
its maximum at a vertex of the box: tube/theory.md#jacobian-norms-over-boxes.
"""

from itertools import product
from typing import NamedTuple

import numpy as np

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.frames.euler import rotation_matrix
from uvms_drake.model.frames.spatial import cross, skew, times
from uvms_drake.tube.constants import Constant, estimate_constants
from uvms_drake.tube.contact.sensor_gains import norm
from uvms_drake.tube.search.constraint_set import ConstraintSet

SAME_AXIS = 1e-9
"""Distance below which a last joint's axis is the tool's [1, m]."""
ALLOWANCE = 1e-12
"""Allowance of the half-spaces: g is computed to about 1e-15."""
LARGEST_MULTIPLIER = 1e3
"""Largest multiplier μ_k, for which rounding in Σ μ_k g_k is below the allowance of `covering`."""
SWEEPS = 2
"""Sweeps of coordinate descent for the multipliers."""
BATCH = 128
"""Number of boxes halved at a time."""
GAP = 0.03
"""Largest relative gap between a bound and a value that is reached."""
SAMPLES = 1000
"""Number of samples for the first value that is reached."""
MOST_BOXES, MOST_WORK = 40_000, 16_000_000
"""Boxes of a constant; vertices of boxes times rows of a block, of which norms are taken: one of
a joint more has twice the vertices. An arm of four joints is below it at 40 000 boxes."""
ROUNDING = 1e-9
"""Relative allowance for rounding: a few thousand operations of relative error 1e-16."""
PROVABLE = {"J_position_max": "position", "J_attitude_max": "attitude", "J_max": "task",
            "Jx_max": "task"}
"""Constants that can be proven, with their blocks of rows of J."""
BLOCKS = ("position", "attitude", "task")
"""Blocks of rows of J: the tip's velocity, its Euler rates, all."""


class BoxBounds(NamedTuple):
    """Bounds of the norm over m boxes."""

    upper: np.ndarray
    """Bound of the norm at the feasible states of the box (m,), −∞ if there are none."""
    reached: np.ndarray
    """Norm at a feasible state (m,), −∞ if the box's centre has none."""
    score: np.ndarray
    """Contribution of each coordinate to the bound (m, n+2); the largest is worth halving."""


class _Constraints(NamedTuple):
    """g_k about the centres of m boxes, at both ends in θ."""

    value: np.ndarray
    """g at the centre (2, m, k)."""
    slope: np.ndarray
    """Derivatives of g at the centre (2, m, k, n+1)."""
    remainder: np.ndarray
    """Bound of the nonlinear part of g (2, m, k)."""


class JacobianBoxes:
    """Bounds of the norm of one block of rows of J Ŵ over boxes of (q, −φ, θ).

    Args:
        model: Any serial arm.
        constraint_set: Set of the configurations.
        block: One of `BLOCKS`.
        weights: Diagonal of Ŵ (6+n,), positive; 1 for J itself.
    """

    def __init__(self, model: ContactModel, constraint_set: ConstraintSet, block: str,
                 weights: np.ndarray | float = 1.0):
        self._model = model
        self._block = block
        self._weights = weights * np.ones(model.size)
        # The columns of ν₂ are turned into E' where that is allowed.
        self._turned = block == "attitude" and np.ptp(self._weights[3:6]) == 0.0

        # Half-spaces of "down", widened by the tilt of the task's frame.
        roll, pitch = constraint_set.roll, constraint_set.pitch
        self._normals = np.array([
            [1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0],
            [0.0, np.cos(roll), -np.sin(roll)], [0.0, -np.cos(roll), -np.sin(roll)]])
        tilt = float(np.arccos(np.clip(model.R_WT[2, 2], -1.0, 1.0)))
        self._offsets = np.sin(np.minimum(
            np.array([pitch, pitch, 0.0, 0.0, 0.0]) + tilt, 0.5 * np.pi)) + ALLOWANCE

        # The box of all coordinates; those that make no difference are constant.
        turn, lean = (0.0, 0.0) if block == "position" else (np.pi, constraint_set.tip_pitch)
        self.lower = np.concatenate([constraint_set.q_lower, [-turn, -lean]])
        self.upper = np.concatenate([constraint_set.q_upper, [turn, lean]])
        self._turns = np.append(~model.slides, True).astype(float)
        if block == "attitude":  # A joint that slides makes no difference.
            self._keep_still(np.flatnonzero(model.slides))
        if self._last_joint_turns_the_tool():
            self._keep_still(np.array([model.num_joints - 1]))
        self._free = np.nonzero(self.upper[:-1] > self.lower[:-1])[0]
        self._vertices = np.array(list(product([-1.0, 1.0], repeat=len(self._free))))

    @property
    def work(self) -> int:
        """Number of norms of matrices for a box, times their rows."""
        return len(self._vertices) * (6 if self._block == "task" else 3)

    def _keep_still(self, joints: np.ndarray) -> None:
        middle = 0.5 * (self.lower[joints] + self.upper[joints])
        self.lower[joints] = self.upper[joints] = middle

    def _last_joint_turns_the_tool(self) -> bool:
        if self._model.num_joints == 0:
            return False
        axes, columns, _, _ = self._geometry(0.5 * (self.lower + self.upper)[None])
        about_tool = np.linalg.norm(cross(axes[0, -2], axes[0, -1])) < SAME_AXIS
        return bool(np.linalg.norm(columns[0, -2]) < SAME_AXIS
                    and (about_tool or self._block == "position"))

    def bounds(self, centre: np.ndarray, half: np.ndarray) -> BoxBounds:
        """Returns the bounds over m boxes centre ± half (m, n+2)."""
        # K and g at the centres, at both ends in θ, with their derivatives.
        geometry = self._geometry(centre)
        rows = self._position_rows(*geometry[:3]), self._attitude_rows(geometry[0], geometry[3])
        second = self._second_derivatives(geometry[1], half[:, :-1])
        ends = np.stack([centre[:, -1] - half[:, -1], centre[:, -1] + half[:, -1]])
        K = np.stack([self._rows(*rows, theta) for theta in ends]) * self._weights
        g = self._constraints(geometry[0], geometry[3], ends, half[:, :-1])
        chord = (np.tan(ends[1]) - np.tan(ends[0])) ** 2 / 8.0
        mu, gradient = _multipliers(K, g, half[:, :-1], chord)

        # The bound for these multipliers; no bound is needed where some g_k > 0 all over the box.
        upper = np.max(self._vertex_maximum(K, g, mu, half) + 0.5 * np.sqrt(
            second[0] + second[1] / (1.0 - np.sin(np.abs(ends)))), axis=0)
        upper += np.sum(mu, axis=1) * chord
        lowest = g.value - g.remainder - np.einsum("emki,mi->emk", np.abs(g.slope), half[:, :-1])
        upper[np.any(np.min(lowest, axis=0) > chord[:, None], axis=1)] = -np.inf
        # The norm that is reached, if the centre is feasible at one end in θ.
        feasible = np.all(g.value <= 0.0, axis=-1)
        reached = np.max(np.where(feasible, norm(K[:, :, 0]), -np.inf), axis=0)
        return BoxBounds(upper, reached, self._score(K, mu, gradient, half, chord))

    def _geometry(self, centre: np.ndarray) -> tuple[np.ndarray, ...]:
        """Returns axes w and columns c (m, n+1, 3), tip p (m, 3) and C (m, 3, 3) at the centres."""
        n = self._model.num_joints
        config = np.zeros((len(centre), 6 + n))
        config[:, 6:] = centre[:, :n]
        kinematics = self._model.kinematics(config)
        R_BE, p = kinematics.R_BL[:, -1], kinematics.p_BL[:, -1]
        columns = np.zeros((len(centre), n + 1, 3))
        turning = kinematics.screw[..., 3:]
        columns[:, :n] = kinematics.screw[..., :3] + cross(turning, p[:, None])
        axes = np.concatenate([turning, R_BE[:, None, :, 0]], axis=1)
        roll = np.zeros((len(centre), 3))
        roll[:, 0] = -centre[:, n]
        C = rotation_matrix(roll) @ np.swapaxes(R_BE, -1, -2)
        return axes, columns, p, C

    def _position_rows(self, axes: np.ndarray, columns: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Returns [I −S(p) c] and its n+1 derivatives, ∂ᵢcⱼ = w_min × c_max, (m, n+2, 3, 6+n)."""
        n = self._model.num_joints
        P = np.zeros((len(p), n + 2, 3, 6 + n))
        P[:, 0, :, :3] = np.eye(3)
        P[:, 0, :, 3:6] = -skew(p)
        P[:, 0, :, 6:] = np.swapaxes(columns[:, :n], -1, -2)
        P[:, 1:, :, 3:6] = -skew(columns)
        for i in range(n + 1):
            for j in range(n):
                P[:, 1 + i, :, 6 + j] = cross(axes[:, min(i, j)], columns[:, max(i, j)])
        return P

    def _attitude_rows(self, axes: np.ndarray, C: np.ndarray) -> np.ndarray:
        """Returns C[0 I a] and its n+1 derivatives (m, n+2, 3, 6+n); [0 I Ca] if ν₂ is turned.

        ∂ᵢC = −C S(wᵢ); ∂ᵢ(C aⱼ) = −C(wᵢ × aⱼ) for i > j, else 0: the joint turns both alike.
        """
        n = self._model.num_joints
        Q = np.zeros((len(C), n + 2, 3, 6 + n))
        Q[:, 0, :, 6:] = np.swapaxes(axes[:, :n], -1, -2)
        for i in range(n + 1):
            Q[:, 1 + i, :, 6: 6 + i] = np.swapaxes(cross(axes[:, :i], axes[:, i, None]), -1, -2)
        if not self._turned:
            Q[:, 0, :, 3:6] = np.eye(3)
            Q[:, 1:, :, 3:6] = -skew(axes)
        Q = C[:, None] @ Q
        if self._turned:
            Q[:, 0, :, 3:6] = np.eye(3)
        return Q

    def _rows(self, P: np.ndarray, Q: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """Returns the block of J and its derivatives (m, n+2, rows, 6+n) at θ (m,)."""
        if self._block == "position":
            return P
        A = np.tile(np.eye(3), (len(theta), 1, 1, 1))
        A[:, 0, 0, 2], A[:, 0, 2, 2] = np.tan(theta), 1.0 / np.cos(theta)
        if self._block == "attitude":
            return A @ Q
        return np.concatenate([P, A @ Q], axis=-2)

    def _second_derivatives(self, columns: np.ndarray,
                            h: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns bounds (m,) of ‖K″‖² of the position rows, and of the attitude rows by ‖A‖²."""
        n, turns = self._model.num_joints, self._turns
        r = np.linalg.norm(columns, axis=-1)
        for i in range(n - 1, -1, -1):
            r[:, i] += turns[i] * np.sum(h[:, i + 1:] * r[:, i + 1:], axis=1)
        outer = np.maximum.outer(np.arange(n + 1), np.arange(n + 1))
        by_joint = np.maximum(outer[..., None], np.arange(n))
        inner = np.minimum.outer(np.arange(n + 1), np.arange(n + 1))
        p2 = np.einsum("mi,mk,mik->m", h, h, turns[inner] * r[:, outer])
        c2 = np.einsum("mi,mk,mikj->mj", h, h, r[:, by_joint])
        vehicle, joints = np.max(self._weights[3:6]) ** 2, self._weights[6:] ** 2
        position = vehicle * p2**2 + np.sum(joints * c2**2, axis=1)
        beyond = np.cumsum((h * turns)[:, ::-1], axis=1)[:, ::-1]  # Σ_{i≥j} hᵢ
        attitude = np.sum(joints * turns[:-1] * beyond[:, 1:] ** 4, axis=1)
        if not self._turned:
            attitude += vehicle * beyond[:, 0] ** 4
        return position * (self._block != "attitude"), attitude * (self._block != "position")

    def _constraints(self, axes: np.ndarray, C: np.ndarray, ends: np.ndarray,
                     h: np.ndarray) -> _Constraints:
        """Returns g_k, its derivatives and the bound of the remainder at θ (2, m)."""
        coordinates = h.shape[1]
        if self._block == "position":
            none = np.zeros((*ends.shape, 0))
            return _Constraints(none, np.zeros((*ends.shape, 0, coordinates)), none)
        down = -np.sin(ends)[..., None] * C[:, 0] + np.cos(ends)[..., None] * C[:, 2]
        turned = cross(axes, down[..., None, :])  # ∂ᵢd; ∂ᵢ∂ⱼd = w_min × (w_max × d)
        turned_T = np.swapaxes(turned, -1, -2)
        moments = cross(self._normals[:, None], axes[:, None])  # N_k·(wᵢ × v) = (N_k × wᵢ)·v
        bends = np.abs(moments @ turned_T[:, :, None])  # [i, j] counts for i ≤ j
        pairs = np.triu(2.0 * np.ones((coordinates, coordinates)), 1) + np.eye(coordinates)
        remainder = 0.5 * np.einsum("mi,emkij,mj->emk", h, bends * pairs, h)
        return _Constraints(down @ self._normals.T - self._offsets, self._normals @ turned_T,
                            remainder + (h @ self._turns)[:, None] ** 3 / 6.0)

    def _vertex_maximum(self, K: np.ndarray, g: _Constraints, mu: np.ndarray,
                        half: np.ndarray) -> np.ndarray:
        """Returns the largest ‖K + Σδᵢ∂ᵢK‖ − Σμ_k(g_k + Σδᵢ∂ᵢg_k − R) over |δᵢ| = hᵢ (2, m)."""
        step = half[:, None, self._free] * self._vertices
        rows, columns = K.shape[3:]
        along = K[:, :, 1 + self._free].reshape(*K.shape[:2], len(self._free), rows * columns)
        moved = (step @ along).reshape(*K.shape[:2], len(self._vertices), rows, columns)
        value = norm(K[:, :, :1] + moved)
        slope = np.einsum("mk,emki->emi", mu, g.slope)[..., self._free]
        value -= times(step, slope)
        return np.max(value, axis=-1) + np.sum(mu * (g.remainder - g.value), axis=-1)

    def _score(self, K: np.ndarray, mu: np.ndarray, gradient: np.ndarray, half: np.ndarray,
               chord: np.ndarray) -> np.ndarray:
        """Returns the approximate contribution of each coordinate's width to the bound (m, n+2).

        The order of halving makes a proof shorter or longer, never wrong; the weights are tuned.
        """
        h, price = half[:, :-1], np.sum(mu, axis=1)
        bend = 0.5 * np.linalg.norm(K[0, :, 1:], axis=(-2, -1)) + 0.5 * price[:, None]
        if self._block != "position":
            bend += 0.5  # For a direction that only the constraints know.
        joints = h * (np.max(np.abs(gradient), axis=0) + np.sum(h, axis=1)[:, None] * bend)
        pitch = 4.0 * price * chord + half[:, -1]
        return np.concatenate([joints, pitch[:, None]], axis=1)


def _multipliers(K: np.ndarray, g: _Constraints, h: np.ndarray,
                 chord: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns μ (m, k), and the remaining gradient of ‖K‖ − Σ μ_k g_k (2, m, n+1).

    Coordinate descent on the first-order bound, the larger one over the two ends in θ of
    ‖K‖ + Σ hᵢ|∂ᵢ‖K‖ − Σ μ_k∂ᵢg_k| + Σ μ_k(R − g_k + chord). It is convex and piecewise linear
    in each μ_k: tried are the zeros of the absolute values and where the ends (nearly) meet.
    """
    U, sigma, Vh = np.linalg.svd(K[:, :, 0], full_matrices=False)
    left = np.einsum("emr,emirc,emc->emi", U[..., 0], K[:, :, 1:], Vh[..., 0, :])
    price = g.remainder - g.value + chord[:, None]
    base = sigma[..., 0]
    mu = np.zeros_like(g.value[0])
    for k in list(range(mu.shape[1])) * SWEEPS:
        slope, cost = g.slope[:, :, k], price[..., k]
        left = left + mu[:, k, None] * slope
        base = base - mu[:, k] * cost
        tried = np.concatenate([
            np.zeros((len(mu), 1)), *_ratio(left, slope),
            _ratio(base[0] - base[1], cost[1] - cost[0])[:, None]], axis=1)
        tried = np.clip(tried, 0.0, LARGEST_MULTIPLIER)
        bound = base[..., None] + tried * cost[..., None] + np.einsum(
            "mi,emji->emj", h, np.abs(left[:, :, None] - tried[..., None] * slope[:, :, None]))
        best = np.argmin(np.max(bound, axis=0), axis=1)[:, None]
        mu[:, k] = np.take_along_axis(tried, best, axis=1)[:, 0]
        left = left - mu[:, k, None] * slope
        base = base + mu[:, k] * cost
    return mu, left


def _ratio(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Returns a / b, zero where b is (nearly) zero."""
    usable = np.abs(b) > 1e-9
    return np.where(usable, a / np.where(usable, b, 1.0), 0.0)


class Covering(NamedTuple):
    """Result of branch and bound."""

    upper: float
    """Bound of the norm over the set."""
    reached: float
    """Largest norm found at a state of the set."""
    boxes: int
    """Number of boxes that were evaluated."""


def prove_constants(model: ContactModel, constraint_set: ConstraintSet, names: tuple[str, ...], *,
                    seed: int = 0, weights: np.ndarray | float = 1.0) -> dict[str, Constant]:
    """Returns proven constants by name; the same for the same arguments.

    `J_position_max` bounds ‖J_pos‖, hence also ‖nᵀJ_pos‖ for every unit vector n in Σ_I, such as
    the normal of a plane; `J_attitude_max` the Euler-rate rows of J; `J_max` and `Jx_max` all of J
    and J_x. With weights they bound ‖J_pos Ŵ‖ and so on. `value / sampled_value` tells whether the
    budget was enough.

    Args:
        model: Any serial arm.
        constraint_set: The set; velocities, yaw and contact make no difference.
        names: Names of the constants, keys of `PROVABLE`.
        seed: Seed of the search for a first value that is reached.
        weights: Diagonal of Ŵ (6+n,), positive; 1 for J_x itself.

    Raises:
        InvalidParameter: The set is empty.
    """
    estimates = estimate_constants(
        model, constraint_set, names, samples=SAMPLES, safety_factor=1.0, seed=seed,
        weights=weights)
    proven = {}
    for name, estimate in estimates.items():
        scale = weights * np.ones(model.size)
        if name == "Jx_max":  # λ₀ is the largest that was seen; above D, as no column of J is zero.
            scale[6:] /= np.sqrt(1.0 - (scale[6:] / estimate.sampled_value) ** 2)
        boxes = JacobianBoxes(model, constraint_set, PROVABLE[name], scale)
        covering = cover(boxes, estimate.sampled_value, min(MOST_BOXES, MOST_WORK // boxes.work))
        proven[name] = Constant(
            name, covering.upper, "proven", covering.boxes, estimate.sampled_value)
    return proven


def cover(boxes: JacobianBoxes, reached: float, max_boxes: int) -> Covering:
    """Returns the bound by branch and bound.

    Args:
        boxes: Bounds over boxes.
        reached: A norm that is reached at a state of the set; zero if none is known.
        max_boxes: Stops when so many boxes have been evaluated, if not before by `GAP`.

    Raises:
        InvalidParameter: No box can have a state of the set.
    """
    centre = 0.5 * (boxes.upper + boxes.lower)[None]
    half = 0.5 * (boxes.upper - boxes.lower)[None]
    upper, seen, score = boxes.bounds(centre, half)
    reached, count = max(reached, float(np.max(seen))), 1
    while True:
        kept = upper > reached  # The others cannot have the supremum.
        centre, half, upper, score = (item[kept] for item in (centre, half, upper, score))
        if len(upper) == 0 and reached <= 0.0:
            raise InvalidParameter(
                "tip_pitch", boxes.upper[-1],
                "a pitch that the vehicle's attitude and the joints can keep")
        largest = float(np.max(upper, initial=reached))
        if largest <= (1.0 + GAP) * reached or count >= max_boxes:
            return Covering(largest * (1.0 + ROUNDING), reached, count)
        # Of the boxes with the largest bounds, halve those above the gap along their worst side.
        order = np.argsort(-upper, kind="stable")
        halved, others = order[:BATCH], order[BATCH:]
        halved = halved[upper[halved] > (1.0 + GAP) * reached]
        others = np.concatenate([order[len(halved): BATCH], others])
        row = np.arange(len(halved))
        which = np.argmax(score[halved], axis=1)
        new_half = half[halved]
        new_half[row, which] *= 0.5
        shift = np.zeros_like(new_half)
        shift[row, which] = new_half[row, which]
        new_centre = np.concatenate([centre[halved] - shift, centre[halved] + shift])
        new_half = np.concatenate([new_half, new_half])
        # The halves take their place; a box's bound holds in its halves.
        new = boxes.bounds(new_centre, new_half)
        new_upper = np.minimum(new.upper, np.tile(upper[halved], 2))
        reached, count = max(reached, float(np.max(new.reached))), count + len(new_centre)
        centre, half, upper, score = (
            np.concatenate([old[others], item]) for old, item in (
                (centre, new_centre), (half, new_half), (upper, new_upper), (score, new.score)))
