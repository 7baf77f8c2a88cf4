"""Simulated presses on many one-dimensional walls at once, with a planner of three lines.

The planned tip has a constant acceleration in each interval h; each plan moves as fast as it can
and stops at the target or at the safe depth, whichever comes first. The real tip is off by e(t).
"""

from dataclasses import dataclass

import numpy as np

from uvms_drake.control.contact.press_target import target_depth
from uvms_drake.control.contact.safe_region import apex, dominates, safe_depth
from uvms_drake.control.contact.stiffness_estimate import (
    NO_ESTIMATE,
    StiffnessEstimate,
    stiffness_used,
    surface_depth,
    with_reading,
)
from uvms_drake.model.surface.surface_class import SurfaceClass

STEP, ACCELERATION, CRUISE = 0.2, 0.2, 0.3
"""h [s], a [m/s²], and the largest speed [m/s]."""
FORCE_MAX, NOISE, MEMORY = 45.0, 0.5, 10.0
"""F_max, ν and the slope's memory [N]."""
SLACK = 1.05
"""Largest final error over ν + κ₊E, above 1 as the slope may be estimated too low."""
PERIOD = 0.02
"""Period of the sensor, and of the simulation [s]."""
ALONG = np.array([1.0, 0.0, 0.0])


@dataclass
class Walls:
    """Walls at `place` [m]: slope `soft` to the depth `knee` and `stiff` from there on, damped."""

    place: np.ndarray
    soft: np.ndarray
    stiff: np.ndarray
    knee: np.ndarray
    damping: np.ndarray

    def static(self, x):
        deep = x - self.place
        return (self.soft * np.clip(deep, 0.0, self.knee)
                + self.stiff * np.maximum(deep - self.knee, 0.0))


def random_walls_in_line(stiffness, count, rng, furthest, dissipation=2.5):
    """Half of them straight, half of two slopes; each at 0.1 to 1 times the largest."""
    share = rng.uniform(0.1, 1.0, (2, count))
    share[1] = np.where(np.arange(count) % 2, share[1], share[0])
    soft, stiff = stiffness * share
    return Walls(rng.uniform(0.02, furthest, count), soft, stiff,
                 rng.uniform(3.0, 20.0, count) / soft, rng.uniform(0.0, dissipation, count))


def stop(speed):
    """Returns the stopping distance from a speed at a knot: v²/(2a), interpolated between ah."""
    quanta = np.arange(12) * ACCELERATION * STEP
    return np.interp(speed, quanta, quanta**2 / (2.0 * ACCELERATION))


def end(x, v, w):
    """Returns the end of a plan with the speeds v and w at its first knots that then stops."""
    return x + 0.5 * STEP * (v + w) + np.sign(w) * stop(np.abs(w))


def next_speed(x, v, bound, cap):
    """Returns the largest next speed from which a plan ends at the bound, by bisection."""
    change = ACCELERATION * STEP
    low, high = v - change, np.clip(cap, v - change, v + change)
    least = low
    for _ in range(40):
        middle = 0.5 * (low + high)
        fits = end(x, v, middle) <= bound
        low, high = np.where(fits, middle, low), np.where(fits, high, middle)
    return np.where(end(x, v, high) <= bound, high, np.maximum(low, least))


def pressed(stiffness, walls, desired, error, noise, *, duration, margin):
    """Returns the metrics of a press, one entry for each wall.

    Args:
        stiffness: κ₊ [N/m].
        walls: The walls.
        desired: F_des [N].
        error: Function of the time and of whether the wall was touched yet: e and its rate.
        noise: Function of the time: error of the reading [N].
        duration: Of the simulation [s].
        margin: E [m].
    """
    surface = SurfaceClass(ALONG, stiffness, dissipation=2.5)
    count = len(walls.place)
    x, v, a, begun = np.zeros((4, count))
    tip = np.full((count, 3), np.nan)
    belief = StiffnessEstimate(*(
        np.broadcast_to(part, (count, *part.shape)) for part in NO_ESTIMATE))
    first, late, largest = np.full(count, np.nan), np.zeros(count), np.zeros(count)
    slack, was_touched = np.full(count, np.inf), np.zeros(count, dtype=bool)
    for time in PERIOD * np.arange(round(duration / PERIOD)):
        # The world.
        t = time - begun
        x_now, v_now = x + v * t + 0.5 * a * t**2, v + a * t
        e, e_rate = error(time, ~np.isnan(first))
        real, rate = x_now + e, v_now + e_rate
        static = walls.static(real)
        force = static * np.maximum(1.0 + walls.damping * rate, 0.0) + noise(time)
        # The contact estimator.
        at, moving = real[:, None, None] * ALONG, rate[:, None, None] * ALONG
        new = apex(surface, at, moving, force[:, None] * ALONG, FORCE_MAX, NOISE)
        tip = np.where(dominates(surface, new, tip, np.zeros((2, 2)))[:, None], new, tip)
        safe = safe_depth(surface, tip, at[:, 0], margin)
        touched = np.abs(force) > NOISE
        belief = with_reading(
            belief, surface, at[:, 0], force, touched, NOISE, MEMORY, PERIOD)
        kappa = stiffness_used(belief, surface)
        target = target_depth(desired, np.array([real, force]), touched, kappa,
                              surface_depth(belief, surface, at[:, 0]), safe)
        # The plan: at its own instants, and when a wall is touched.
        again = (t >= STEP - 1e-9) | (touched & ~was_touched) | (time == 0.0)
        first = np.where(touched & np.isnan(first), time, first)
        was_touched = touched
        w = next_speed(x_now, v_now, np.minimum(target, safe), CRUISE)
        left = safe - end(x_now, v_now, w)
        slack = np.where(again & (w > 0.0), np.minimum(slack, left), slack)
        x, v = np.where(again, x_now, x), np.where(again, v_now, v)
        a, begun = np.where(again, (w - v_now) / STEP, a), np.where(again, time, begun)
        # The metrics.
        largest = np.maximum(largest, static)
        off = np.abs(static - desired) > SLACK * (NOISE + stiffness * margin)
        late = np.where(off, time, late)
    return {"share": largest / FORCE_MAX, "slack": slack, "first": first, "settled": late - first,
            "stiffness_used": kappa}


def random_errors(margin, count, rng):
    """Errors within ± E: sines, and sines cut off hard; of 2 to 20 s."""
    rate, phase = rng.uniform(0.3, 3.0, count), rng.uniform(0.0, 2.0 * np.pi, count)
    gain = np.where(rng.random(count) < 0.3, 3.0, 1.0)

    def error(time, touched):
        wave = gain * np.sin(rate * time + phase)
        slope = np.where(np.abs(wave) < 1.0, gain * rate * np.cos(rate * time + phase), 0.0)
        return margin * np.clip(wave, -1.0, 1.0), margin * slope

    return error
