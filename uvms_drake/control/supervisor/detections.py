"""Detections of a run outside of its class, each a number over its threshold; above 1 it trips.

A threshold follows from the declared data, see `station.supervision.thresholds_of`. All of it is
measured on board: state, force, commands, plans, estimates; nothing is known of the truth.
"""

import math
from typing import NamedTuple

import numpy as np

from uvms_drake.model.surface.surface_class import SurfaceClass

FINAL = ("raised", "plan", "cut")
"""Causes after which the robot does not go on."""
OFF_PLAN = ("tip", "tool", "joints", "drift")
"""Causes that a thruster may have."""
WINDOW = 1.0
"""Time for which readings are compared, and after which a touch is over [s]."""
ROWS = 50
"""Number of readings that are kept, over `WINDOW`."""
SPACING = WINDOW / ROWS
"""Time between two of them [s]."""
MOST_DAMPING = 0.9
"""Largest c₊⟨𝔭̇⟩ that is counted with: beyond 1 a reading bounds no static force."""


class Thresholds(NamedTuple):
    """Thresholds, and the numbers of the class that detections compare with."""

    force: float
    """Largest reading of the force along n [N]."""
    error: float
    """Part of a reading's error that may change [N]."""
    constant: float
    """Part of it that does not [N]."""
    share: float
    """Share of a force that a reading of it may be off by, as the tip turns."""
    delay: float
    """Largest age of the force in a reading [s]."""
    walls: SurfaceClass
    """Walls of the class: κ₊, n, the angle of their normals, damping and friction."""
    faster: float
    """Largest ⟨𝔭̇⟩ of the tip over that of its plan at the readings around [m/s]."""
    touch: float
    """Force that is a touch [N]."""
    depth_error: float
    """Error of the measured depth [m]."""
    off: np.ndarray
    """Deviations from the plan: tip [m], its angles, joints [rad] (3,)."""
    fix: float
    """Age of the last fix [s]."""
    drift: np.ndarray
    """Disturbance of the vehicle, linear and angular (2,) [m/s², rad/s²]."""
    cut: float
    """Time for which a command is cut [s]."""
    plan: float
    """Age of the last new plan [s]."""
    lost: float
    """Time for which the force is lost [s]."""
    begin: float
    """Time from which on plans are followed [s]: until then observers settle."""


class Seen(NamedTuple):
    """Measurements at an instant."""

    time: float
    """t [s]."""
    tip: np.ndarray
    """Position of the tip (3,) [m]; NaN while there is no state."""
    advance: float
    """Larger one of ⟨±𝔭̄̇⟩ of the planned tip [m/s]."""
    force: float
    """Force along n [N]; NaN while there is none."""
    saturated: bool
    """Whether the sensor is at the end of its range."""
    off: np.ndarray
    """Deviations from the plan, as of `Thresholds` (3,)."""
    drift: np.ndarray
    """Estimated disturbance of η, (6,) [m/s², rad/s²]."""
    fix_age: float
    """Age of the last fix [s]."""
    raised: bool
    """Whether the law has raised an exception, or its command is not finite."""
    cut_time: float
    """Time for which the command has been cut [s]."""
    plan_age: float
    """Age of the last new plan [s]."""
    lost_time: float
    """Time for which the force has been lost [s]."""
    resume: bool = False
    """Whether the robot is to go on after a retreat."""


def largest_force(readings: np.ndarray, limits: Thresholds) -> float:
    """Returns the largest reading that a wall of the class allows after earlier readings [N].

    A reading is of forces up to W old, and off by e = c + η, of which c, |c| ≤ C, stays and |η| ≤ N
    may change. With ⟨m⟩ = n·m + α‖P_t m‖, see `SurfaceClass`, let w bound ⟨±𝔭̇⟩ of the tip since the
    readings, d = c₊w, a₋ ≤ n·𝐅/F_N ≤ a₊ as it is read (friction that turns on a tilted wall), G the
    largest ⟨𝔭 − 𝔭₀⟩₊ from a place of the last W before the earlier reading F₀ to one of the last W
    before now. The earlier one has a static force φ₀ ≤ (F₀ − c + N)₊/(a₋(1 − d)) in it, no later
    one exceeds φ₀ + κ₊G, and so, with r = a₊(1 + d)/(a₋(1 − d)),

        F ≤ N − C + r(F₀ + N + C) + a₊(1 + d) κ₊ G.

    G is taken of the kept places, at most h apart, and of hw. The least of this over the readings
    of the last second; inf without one.

    Args:
        readings: Time [s], position 𝔭₀ [m], force F₀ [N], planned speed [m/s] of the readings so
            far, the newest last (k, 6); F₀ is NaN for none.
        limits: Errors of a reading, walls of the class and `faster`.
    """
    times, tips, before = readings[:, 0], readings[:, 1:4], readings[:, 4]
    walls, N, C = limits.walls, limits.error, limits.constant
    known = np.isfinite(before) & (times >= times[0] + limits.delay)
    if not known.any() or walls.share <= limits.share:
        return np.inf
    # w, h, and the shares of a force that friction, tilt and damping leave and add.
    speed = float(np.max(readings[:, 5])) + limits.faster
    apart = float(np.max(np.diff(times), initial=0.0))
    damping = min(walls.dissipation * speed, MOST_DAMPING)
    least = (walls.share - limits.share) * (1.0 - damping)
    most = (walls.largest_share + limits.share) * (1.0 + damping)
    # Growth of the depth from each place to now, then from any of the W before a reading.
    back = limits.delay + apart + 1e-9
    growth = np.max(walls.advance(tips[times >= times[-1] - back][:, None] - tips), axis=0)
    ages = times[known][:, None] - times
    since = np.max(np.where((ages >= 0.0) & (ages <= back), growth, -np.inf), axis=1)
    bound = N - C + most / least * np.maximum(before[known] + N + C, 0.0) + (
        most * walls.stiffness * np.maximum(since + apart * speed, 0.0))
    return float(max(np.min(bound), N))


def ratios(seen: Seen, readings: np.ndarray, limits: Thresholds) -> np.ndarray:
    """Returns each quantity of `CAUSES` over its threshold (11,).

    Args:
        seen: Measurements now; those that are missing count by their age.
        readings: As of `largest_force`, with that of now if there is a state; of a second.
        limits: The thresholds.
    """
    follows = seen.time >= limits.begin
    off = np.nan_to_num(seen.off) / limits.off if follows else np.zeros(3)
    drift = np.nan_to_num(seen.drift)
    force = np.inf if seen.saturated else 0.0 if math.isnan(seen.force) else seen.force
    return np.array([
        force / limits.force,
        force / largest_force(readings, limits) if (
            seen.force > limits.touch and np.isfinite(seen.tip[0])) else 0.0,
        *off,
        seen.fix_age / limits.fix,
        max(np.linalg.norm(each) / limit
            for each, limit in zip((drift[:3], drift[3:]), limits.drift, strict=True)),
        np.inf if seen.raised else 0.0,
        seen.cut_time / limits.cut,
        seen.plan_age / limits.plan if follows else 0.0,
        seen.lost_time / limits.lost])


def stiffness_of_touch(depth: np.ndarray, force: np.ndarray, depth_error: float,
                       force_error: float) -> float:
    """Returns the stiffness of a wall from readings in contact, by errors in variables [N/m].

    The slope of the line through (x, F) with the least sum of squares across it, both scaled by
    their errors (Deming 1943): that of least squares in F alone is too small, as x is uncertain,
    too. NaN without readings of two depths.

    Args:
        depth: Depths along n of readings in contact (k,) [m].
        force: Their forces along n (k,) [N].
        depth_error: Error of a depth [m].
        force_error: Error of a force [N].
    """
    if len(depth) < 3:
        return np.nan
    weight = force_error / depth_error if depth_error > 0.0 else 0.0
    x, F = depth - np.mean(depth), force - np.mean(force)
    sxx, sFF, sxF = x @ x, F @ F, x @ F
    if not sxF > 0.0:
        return np.nan
    if weight == 0.0:
        return float(sxF / sxx)
    gap = sFF - weight**2 * sxx
    return float((gap + np.hypot(gap, 2.0 * weight * sxF)) / (2.0 * sxF))
