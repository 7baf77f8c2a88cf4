"""Detections of a run outside of its class, each a number over its threshold; above 1 it trips.

A threshold follows from the declared data, see `station.supervision.thresholds_of`. All of it is
measured on board: state, force, commands, plans, estimates; nothing is known of the truth.
"""

from typing import NamedTuple

import numpy as np

from uvms_drake.model.surface.surface_class import SurfaceClass

CAUSES = {
    "force": "the force is above the declared one",
    "slope": "the wall is stiffer than declared",
    "tip": "the end-effector is off its plan",
    "joints": "the joints are off their plan",
    "vehicle": "the vehicle is off its plan",
    "fix": "position and velocity are without a fix",
    "drift": "the water or a thruster drives the vehicle away",
    "raised": "the law failed",
    "cut": "the commands are beyond the limits of thrusters and joints",
    "plan": "there is no new plan",
    "force_lost": "the force is not measured",
}
"""Causes by name, each with its sentence; a cause is logged as its index, from 1."""
SLACK = 1.1
"""Largest slope of the force over κ₊ that is none: the estimate of the depth is off, too."""
WINDOW = 1.0
"""Time for which readings are compared, and after which a touch is over [s]."""
ROWS = 50
"""Number of readings that are kept, over `WINDOW`."""


class Thresholds(NamedTuple):
    """Thresholds, and the numbers of the class that detections compare with."""

    force: float
    """Largest force along n [N]."""
    slope: float
    """Largest excess of a force over that of the stiffest wall [N]."""
    walls: SurfaceClass
    """Walls of the class: κ₊, n and the angle of their normals."""
    touch: float
    """Force that is a touch [N]."""
    depth_error: float
    """Error of the measured depth [m]."""
    off: np.ndarray
    """Deviations from the plan: tip [m], joints [rad], vehicle [m] (3,)."""
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


def force_excess(readings: np.ndarray, tip: np.ndarray, force: float, limits: Thresholds) -> float:
    """Returns the largest excess of a force over that of the stiffest wall since a reading [N].

    max over readings (𝔭₀, F₀) with ⟨𝔭 − 𝔭₀⟩ ≥ −error of F − F₀ − 1.1 κ₊ ⟨𝔭 − 𝔭₀⟩₊, see
    `SurfaceClass.advance`: the static force of a wall of the class grows by no more, however its
    normal is tilted. Friction that turns and dissipation are left to the 1.1 and the threshold.
    Zero without a touch.

    Args:
        readings: Time [s], position 𝔭₀ [m], force F₀ [N] of earlier readings (k, 5).
        tip: 𝔭 (3,) [m].
        force: F [N].
        limits: Walls of the class, the force of a touch and the error of the depth.
    """
    if not force > limits.touch or not len(readings):
        return 0.0
    growth = limits.walls.advance(tip - readings[:, 1:4])
    excess = force - readings[:, 4] - SLACK * limits.walls.stiffness * np.maximum(growth, 0.0)
    return float(np.max(excess[growth >= -limits.depth_error], initial=0.0))


def ratios(seen: Seen, readings: np.ndarray, limits: Thresholds) -> np.ndarray:
    """Returns each quantity of `CAUSES` over its threshold (11,).

    Args:
        seen: Measurements now; those that are missing count by their age.
        readings: As of `force_excess`.
        limits: The thresholds.
    """
    follows = seen.time >= limits.begin
    off = np.nan_to_num(seen.off) / limits.off if follows else np.zeros(3)
    drift = np.nan_to_num(seen.drift)
    force = np.inf if seen.saturated else np.nan_to_num(seen.force)
    return np.array([
        force / limits.force,
        force_excess(readings, seen.tip, seen.force, limits) / limits.slope,
        *off,
        seen.fix_age / limits.fix,
        max(np.linalg.norm(each) / limit
            for each, limit in zip(np.split(drift, 2), limits.drift, strict=True)),
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
