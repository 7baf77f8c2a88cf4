"""How far to go towards a wall that may be anywhere, and what a plan does between its knots.

*Assumption.* The tip's acceleration along n is constant in each interval h. A plan has constant ζ̄̇
instead; the tip's turns with the robot. With j = sup|x⃛| over the interval, x is at most (2/81) h³j
off the parabola by x_k, v_k and x_{k+1}: the remainder x⃛ t²(h − t)/6 of Hermite's interpolation, at
t = 2h/3. And x_{k+1} is at most h³j/12 off x_k + h(v_k + v_{k+1})/2, the trapezoidal rule's. Who
does not know them to be small adds them to the margin E, the latter once for each interval.

*A touch between two samples needs no plan of its own.* The plan that is followed keeps x ≤ x_safe
with the front of its instant, to the end of its horizon and beyond, and a front never shrinks: from
the touch on φ ≤ F_max as before it, and the next sample has a solution (`tracking_ocp`). A plan at
the instant could only go on sooner, by less than h, and none has to be slower than its front makes
it: one of duration T that ends at the front, L away, goes at about 2L/T.

*Across n.* Depth x and speed v are along n. If the wall is tilted, α > 0, a motion m uses up
⟨m⟩ = n·m + α‖P_t m‖ of the room: what is said here holds if the tip does not move across n on its
approach, or if v is a bound of ⟨v̄⟩ of the planned velocity and the way is counted by it.
"""

import math

import numpy as np


def between_knots(depth: np.ndarray, speed: np.ndarray, step: float) -> np.ndarray:
    """Returns x_k + v_k h/2, a depth that bounds the interval after knot k together with its ends.

    With constant acceleration (see the module) x is a parabola over the interval, inside of the
    hull of its control points x_k, x_k + v_k h/2 and x_{k+1} (Bézier). If all three are at most
    x_safe, all of it is: a row of the plan, linear. With the knots alone a plan that turns round
    between two of them gets up to ah²/8 beyond: 1 mm at 0.2 m/s² and 0.2 s.
    """
    return depth + 0.5 * step * speed


def off_parabola(jerk: float, step: float) -> float:
    """Returns (2/81) h³j [m], how far n·𝔭 is off a parabola between two knots; see the module.

    Args:
        jerk: j, bound of |d³(n·𝔭)/dt³| [m/s³].
        step: h [s].
    """
    return 2.0 / 81.0 * step**3 * jerk


def stopping_distance(force_max: float, noise: float, stiffness: float, margin: float,
                  retreat: float = 0.0) -> float:
    """Returns L [m], how far the planned tip may still go from where nothing has been felt yet.

    A reading is up to ν off. Below the threshold of a touch, which is ν, it bounds the force by 2ν,
    not by ν. A real tip that swings back in the tube, however steadily the planned one goes ahead,
    hides c₊⟨−v⟩ of the static force: φ⁺ ≤ 2ν/(1 − c₊⟨−v⟩). So the front of the last reading
    before the touch is (F_max − φ⁺)/κ₊ ahead of the real tip. The planned one may be E ahead of the
    real one, and is kept E behind the front:

        L = (F_max − 2ν/(1 − c₊⟨−v⟩))/κ₊ − 2E.

    Below zero there is no approach at all: the tube is thicker than what the wall forgives.

    Args:
        force_max: F_max [N].
        noise: ν [N].
        stiffness: κ₊ [N/m].
        margin: E, of the planned tip [m].
        retreat: c₊ times a bound of ⟨−v⟩ of the real tip [1]: what the tube leaves it of speed
            beside the planned one. From 1 on a reading says nothing, and L = −∞.
    """
    if retreat >= 1.0:
        return -math.inf
    return (force_max - 2.0 * noise / (1.0 - retreat)) / stiffness - 2.0 * margin
