"""How fast to approach a wall that may be anywhere: as fast as the plan's own grid can stop.

*Assumption.* The tip's acceleration along n is constant in each interval h. A plan has constant ζ̄̇
instead; the tip's turns with the robot. With j = sup|x⃛| over the interval, x is at most (2/81) h³j
off the parabola by x_k, v_k and x_{k+1}: the remainder x⃛ t²(h − t)/6 of Hermite's interpolation, at
t = 2h/3. And x_{k+1} is at most h³j/12 off x_k + h(v_k + v_{k+1})/2, the trapezoidal rule's. Who
does not know them to be small adds them to the margin E, the latter once for each interval.

*A touch between two samples needs no plan of its own.* The plan that is followed keeps x ≤ x_safe
with the front of its instant, to the end of its horizon and beyond, and a front never shrinks: from
the touch on φ ≤ F_max as before it, and the next sample has a solution (`tracking_ocp`). A plan at
the instant could only go on sooner, by less than h, and come faster: with the same front it stops
from `approach_speed(L, h, a, T_r)`, and not from `approach_speed(L, h, a, T_r + h)`. Either is
beyond what plans make of the room: one of duration T that ends at the front goes at about 2L/T. On
the Girona's main wall, with L = 31 mm, T = 3 s, h = 0.2 s, a = 0.17 m/s² and T_r = 0.14 s, that is
21 mm/s; the others are 80 and 59 mm/s.

*Across n.* Depth x and speed v are along n. If the wall is tilted, α > 0, a motion m uses up
⟨m⟩ = n·m + α‖P_t m‖ of the room: what is said here holds if the tip does not move across n on its
approach, or if v is a bound of ⟨v̄⟩ of the planned velocity and the way is counted by it.
"""

import math

import numpy as np


def stopping_distance(speed: float, step: float, deceleration: float) -> float:
    """Returns D(v), the shortest way from speed v at a knot to rest at one, never back [m].

    The acceleration is constant in each interval h and at most a. Then D is piecewise linear, and
    equal to v²/(2a) at the multiples of ah: with v = (m + ρ)ah, 0 ≤ ρ < 1,

        D = ah² (m²/2 + (m + ½)ρ).

    *Proof.* The way is h Σ (v_k + v_{k+1})/2, v_0 = v, v_k ≥ 0. Every v_k ≥ (v − k ah)₊, and full
    braking with the remainder in the last interval has equality in all of them at once, so no other
    way is shorter. Its sum is h (v/2 + Σ_{k=1}^{m} (v − k ah)) = ah² ((m + ρ)/2 + mρ + m²/2 − m/2).

    Args:
        speed: v ≥ 0 [m/s].
        step: h [s].
        deceleration: a [m/s²].
    """
    quantum = deceleration * step
    m = math.floor(speed / quantum)
    rest = speed / quantum - m
    return quantum * step * (0.5 * m * m + (m + 0.5) * rest)


def between_knots(depth: np.ndarray, speed: np.ndarray, step: float) -> np.ndarray:
    """Returns x_k + v_k h/2, a depth that bounds the interval after knot k together with its ends.

    With constant acceleration (see the module) x is a parabola over the interval, inside of the
    hull of its control points x_k, x_k + v_k h/2 and x_{k+1} (Bézier). If all three are at most
    x_safe, all of it is: a row of the plan, linear. With the knots alone a plan that turns round
    between two of them gets up to ah²/8 beyond: 1 mm at 0.2 m/s² and 0.2 s. It costs the approach
    nothing, for `D` ends with x_k + v_k h/2 in its last interval: a plan that goes back later stops
    no shorter by this row.
    """
    return depth + 0.5 * step * speed


def off_parabola(jerk: float, step: float) -> float:
    """Returns (2/81) h³j [m], how far n·𝔭 is off a parabola between two knots; see the module.

    Args:
        jerk: j, bound of |d³(n·𝔭)/dt³| [m/s³].
        step: h [s].
    """
    return 2.0 / 81.0 * step**3 * jerk


def stopping_room(force_max: float, noise: float, stiffness: float, margin: float,
                  touch: float | None = None, retreat: float = 0.0) -> float:
    """Returns L [m], how far the planned tip may still go from where nothing has been felt yet.

    A reading is up to ν off. Below the threshold F_t ≥ ν of a touch it bounds the force by F_t + ν,
    not by ν. A real tip that swings back in the tube, however steadily the planned one goes ahead,
    hides c₊⟨−v⟩ of the static force: φ⁺ ≤ (F_t + ν)/(1 − c₊⟨−v⟩). So the front of the last reading
    before the touch is (F_max − φ⁺)/κ₊ ahead of the real tip. The planned one may be E ahead of the
    real one, and is kept E behind the front:

        L = (F_max − (F_t + ν)/(1 − c₊⟨−v⟩))/κ₊ − 2E,    F_t = ν at least.

    Below zero there is no approach at all: the tube is thicker than what the wall forgives.

    Args:
        force_max: F_max [N].
        noise: ν [N].
        stiffness: κ₊ [N/m].
        margin: E, of the planned tip [m].
        touch: F_t [N]; ν if None.
        retreat: c₊ times a bound of ⟨−v⟩ of the real tip [1]: what the tube leaves it of speed
            beside the planned one. From 1 on a reading says nothing, and L = −∞.
    """
    if retreat >= 1.0:
        return -math.inf
    felt = noise if touch is None else touch
    return (force_max - (felt + noise) / (1.0 - retreat)) / stiffness - 2.0 * margin


def approach_speed(room: float, step: float, deceleration: float, reaction: float) -> float:
    """Returns v_app [m/s], the largest v with D(v) + v T_r ≤ L; zero for L ≤ 0.

    From the instant of the last reading without a touch to the first instant of a plan that knows
    of the touch, T_r, the planned tip goes v T_r at most; then D(v), at whose end it is at rest. So
    the new plan has a solution, and until then nothing is beyond the front: φ ≤ F_max all the time.
    T_r is the sensor's period and its W (see `front`), the time that a plan takes, and the wait for
    the next plan, if a touch does not start one. With the *front alone*, x ≤ x_safe from the start
    and plans on their own clock, a steady speed v has a solution at each plan iff one more interval
    at v and D(v) fit in: `approach_speed(L, h, a, T_r + h)`.

    D(v) + v T_r is increasing and linear between multiples of ah: m is the last of them that fits.

    Args:
        room: L, see `stopping_room` [m].
        step: h [s].
        deceleration: a [m/s²], one that a plan has along n wherever it is, whatever else limits it.
        reaction: T_r [s].
    """
    if room <= 0.0:
        return 0.0
    quantum = deceleration * step
    wait = reaction / step
    units = room / (quantum * step)  # m²/2 + m wait ≤ units
    m = math.floor(2.0 * units / (wait + math.hypot(wait, math.sqrt(2.0 * units))))
    rest = (units - 0.5 * m * m - m * wait) / (m + 0.5 + wait)
    return quantum * (m + rest)
