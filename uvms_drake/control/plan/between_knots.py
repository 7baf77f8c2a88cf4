"""Depth between the knots of a plan, and the distance that a plan may go towards an unknown wall.

Depth x and speed v are along n. The tip's acceleration along n is taken for constant in each
interval h; with j = sup|x⃛| the depth is off by at most (2/81) h³j, see `off_parabola`. Proofs,
assumptions and motion across n: control/plan/theory.md#depth-between-two-knots and
control/plan/theory.md#distance-to-stop-in.
"""

import math

import numpy as np


def between_knots(depth: np.ndarray, speed: np.ndarray, step: float) -> np.ndarray:
    """Returns x_k + v_k h/2, a depth that bounds the interval after knot k together with its ends.

    It is the middle one of the Bézier control points x_k, x_k + v_k h/2 and x_{k+1} of a motion
    with constant acceleration: if all three are at most x_safe, so is x in between. It is linear in
    the plan. With the knots alone a plan that turns back exceeds x_safe by up to ah²/8.
    """
    return depth + 0.5 * step * speed


def off_parabola(jerk: float, step: float) -> float:
    """Returns (2/81) h³j [m], the largest distance of n·𝔭 from a parabola between two knots.

    Args:
        jerk: j, bound of |d³(n·𝔭)/dt³| [m/s³].
        step: h [s].
    """
    return 2.0 / 81.0 * step**3 * jerk


def stopping_distance(force_max: float, noise: float, stiffness: float, margin: float,
                  retreat: float = 0.0) -> float:
    """Returns the distance L [m] that the planned tip may advance after a reading without touch.

        L = (F_max − 2ν/(1 − c₊⟨−v⟩))/κ₊ − 2E.

    Below zero there is no approach: the tube is thicker than the compliance of the wall allows.
    Proof: control/plan/theory.md#distance-to-stop-in.

    Args:
        force_max: F_max [N].
        noise: ν [N].
        stiffness: κ₊ [N/m].
        margin: E, of the planned tip [m].
        retreat: c₊ times a bound of ⟨−v⟩ of the real tip [1], which the tube allows in addition to
            the planned velocity. From 1 on a reading bounds nothing, and L = −∞.
    """
    if retreat >= 1.0:
        return -math.inf
    return (force_max - 2.0 * noise / (1.0 - retreat)) / stiffness - 2.0 * margin
