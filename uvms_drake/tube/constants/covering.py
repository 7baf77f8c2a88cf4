"""Proven upper bounds of ‖J_x Ŵ‖ and of its parts over a `ConstraintSet`, by branch and bound.

The largest bound over a covering by boxes is a bound over the set at every stage, so that a small
budget gives a larger bound, never a wrong one; "proven" is up to rounding. With J_x = [J; 0 I],
D = diag(0, Ŵ_q²) and any λ₀ above its entries, ‖J_x Ŵ‖ ≤ max(√λ₀, ‖J Ŵ(I − D/λ₀)^(−½)‖). Proofs:
tube/constants/theory.md#branch-and-bound,
tube/constants/theory.md#extended-jacobian-by-the-jacobian.
"""

from typing import NamedTuple

import numpy as np

from uvms_drake.common.errors import InvalidParameter, require
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.tube.constants.boxes import JacobianBoxes
from uvms_drake.tube.constants.constants import Constant, estimate_constants
from uvms_drake.tube.search.constraint_set import ConstraintSet

BATCH = 128
"""Number of boxes halved at a time."""
MOST_WORK = 16_000_000
"""Vertices of boxes times rows of a block, of which norms are taken for one constant: a box of one
more joint has twice the vertices. An arm of four joints is below it at 40 000 boxes."""
ROUNDING = 1e-9
"""Relative allowance for rounding: a few thousand operations of relative error 1e-16."""
PROVABLE = {"J_position_max": "position", "J_attitude_max": "attitude", "J_max": "task",
            "Jx_max": "task"}
"""Constants that can be proven, with their blocks of rows of J."""


class Covering(NamedTuple):
    """Result of branch and bound."""

    upper: float
    """Bound of the norm over the set."""
    reached: float
    """Largest norm found at a state of the set."""
    boxes: int
    """Number of boxes that were evaluated."""


def prove_constants(model: ContactModel, constraint_set: ConstraintSet,
                    names: tuple[str, ...] = ("J_position_max", "J_attitude_max", "Jx_max"), *,
                    rel_gap: float = 0.03, max_boxes: int = 40_000, samples: int = 1000,
                    seed: int = 0, weights: np.ndarray | float = 1.0) -> dict[str, Constant]:
    """Returns proven constants by name; the same for the same arguments.

    `J_position_max` bounds ‖J_pos‖, hence also ‖nᵀJ_pos‖ for every unit vector n in Σ_I, such as
    the normal of a plane; `J_attitude_max` the Euler-rate rows of J; `J_max` and `Jx_max` all of J
    and J_x. With weights they bound ‖J_pos Ŵ‖ and so on.

    Args:
        model: Any serial arm.
        constraint_set: The set; velocities, yaw and contact make no difference.
        names: Names of the constants, keys of `PROVABLE`.
        rel_gap: Largest relative gap between the bound and a value that is reached.
        max_boxes: Budget of each constant, for arms of many joints less, see `MOST_WORK`;
            `value / sampled_value` tells whether it was enough.
        samples: Number of samples for the first value that is reached.
        seed: Seed of these samples.
        weights: Diagonal of Ŵ (6+n,), positive; 1 for J_x itself.

    Raises:
        InvalidParameter: The set is empty, or an argument has no meaning.
    """
    require(0.0 < rel_gap < np.inf, "rel_gap", rel_gap, "positive")
    require(max_boxes >= 1, "max_boxes", max_boxes, "a positive integer")
    for name in names:
        require(name in PROVABLE, "names", name, f"one of {', '.join(PROVABLE)}")
    estimates = estimate_constants(
        model, constraint_set, names, samples=samples, safety_factor=1.0, seed=seed,
        weights=weights)
    proven = {}
    for name, estimate in estimates.items():
        scale = weights * np.ones(model.size)
        if name == "Jx_max":  # λ₀ is the largest that was seen; above D, as no column of J is zero.
            scale[6:] /= np.sqrt(1.0 - (scale[6:] / estimate.sampled_value) ** 2)
        boxes = JacobianBoxes(model, constraint_set, PROVABLE[name], scale)
        affordable = min(max_boxes, MOST_WORK // boxes.work)
        covering = cover(boxes, estimate.sampled_value, rel_gap, affordable)
        proven[name] = Constant(
            name=name, value=covering.upper, how="proven", samples=covering.boxes,
            worst=estimate.worst, safety_factor=1.0, sampled_value=estimate.sampled_value)
    return proven


def cover(boxes: JacobianBoxes, reached: float, rel_gap: float, max_boxes: int) -> Covering:
    """Returns the bound by branch and bound.

    Args:
        boxes: Bounds over boxes.
        reached: A norm that is reached at a state of the set; zero if none is known.
        rel_gap: Stops when the bound is at most (1 + rel_gap) times a norm that is reached.
        max_boxes: Stops when so many boxes have been evaluated.

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
        if largest <= (1.0 + rel_gap) * reached or count >= max_boxes:
            return Covering(largest * (1.0 + ROUNDING), reached, count)
        # Of the boxes with the largest bounds, halve those above the gap along their worst side.
        order = np.argsort(-upper, kind="stable")
        halved, others = order[:BATCH], order[BATCH:]
        halved = halved[upper[halved] > (1.0 + rel_gap) * reached]
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
