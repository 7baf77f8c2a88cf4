"""Derived signals of a run: limits, units, and the instant of settling."""

from collections.abc import Sequence

import numpy as np

from uvms_drake.control.limits import Limit, tighten
from uvms_drake.control.plan.points import Points
from uvms_drake.model.surface.law import Surface
from uvms_drake.station.diagram import bounds_disturbance
from uvms_drake.station.problem import limits_of
from uvms_drake.station.record import Record

BOUND_SLACK, BOUND_FLOOR = 1e-6, 1e-9
"""Relative and absolute rounding [m/s², rad/s²] of a disturbance of exactly d̃."""
AROUND, HALVINGS = 0.5, 20
"""Search distance for a surface [m], and number of bisections of 5 mm of it."""
STEP = 1e-5
"""Step of the difference for the slope of a force [m]."""


def disturbance_above(record: Record) -> np.ndarray:
    """Returns whether the effective disturbance violates ‖Ŵ⁻¹d‖₂ ≤ d̃ (T,), if declared."""
    declared = record.scenario.disturbance
    if not bounds_disturbance(declared.d_bound, bool(record.certified)):
        return np.zeros(len(record.time), dtype=bool)
    effective = declared.norm(record.effective_disturbance)
    return effective > (1.0 + BOUND_SLACK) * declared.d_bound + BOUND_FLOOR


def real_limits(record: Record) -> dict[str, Limit]:
    """Returns the limits of the robot by name."""
    return limits_of(record.scenario, record.model)


def nominal_limits(record: Record) -> dict[str, Limit]:
    """Returns the tightened limits, those of the nominal MPC."""
    return tighten(real_limits(record), record.scenario.tube)


def constraint_signals(record: Record) -> dict[str, tuple[np.ndarray, float]]:
    """Returns for each constraint g(t) ≤ limit the signal g (T,) and the limit, by name.

    The lower joint limits q_min ≤ q are the exception: there the signal must stay above. The static
    force is that of the pose, at rest, on the controller's model of the surface: a limit of the
    penetration.
    """
    y = np.concatenate([record.chi, record.config[:, 6:]], axis=1)
    at = Points(record.model, record.config, y, record.zeta, record.u, record.tau)
    return {name: pair for limit in real_limits(record).values()
            for name, pair in limit.signals(at).items() if np.isfinite(pair[1])}


def constraint_units(record: Record) -> dict[str, str]:
    """Returns the units of `constraint_signals` by the same names; empty if unknown."""
    y = np.concatenate([record.chi[0], record.config[0, 6:]])
    at = Points(record.model, record.config[0], y, record.zeta[0], record.u[0], record.tau[0])
    return {name: limit.unit_of(name) for limit in real_limits(record).values()
            for name in limit.signals(at)}


def wrench_unit(desired: Sequence[float] | np.ndarray) -> str:
    """Returns the unit of 𝔉 and its errors for 𝔉_des (6,): of a force, a torque or both."""
    force, torque = np.any(desired[:3]), np.any(desired[3:])
    return "N, N m" if force and torque else "N m" if torque else "N"


def surface_depth(surface: Surface, chi: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Returns the depth n·𝔭 (T,) [m] at which the tip first touches the surface along n.

    The search is over `AROUND` on both sides of the tip; NaN if there is no surface.

    Args:
        surface: The surface.
        chi: Poses of the end-effector (T, 6) [m, rad].
        direction: Unit vector n into the surface (3,).
    """
    along, steps = np.pad(direction, (0, 3)), np.linspace(-AROUND, AROUND, 201)
    inside = np.array([surface.penetration(chi + step * along) > 0.0 for step in steps])
    first = np.argmax(inside, axis=0)
    low, high = steps[first - 1], steps[first]
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        deep = surface.penetration(chi + middle[:, None] * along) > 0.0
        low, high = np.where(deep, low, middle), np.where(deep, middle, high)
    return np.where(first > 0, chi[:, :3] @ direction + high, np.nan)


def surface_slope(surface: Surface, chi: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Returns the stiffness along n, the slope of the static force (T,) [N/m]; NaN without contact.

    Args:
        surface: The surface.
        chi: Poses of the end-effector (T, 6) [m, rad].
        direction: Unit vector n into the surface (3,).
    """
    step = STEP * np.pad(direction, (0, 3))
    rise = (surface.static_force(chi + step) - surface.static_force(chi - step)) / (2.0 * STEP)
    return np.where(surface.penetration(chi - step) > 0.0, rise, np.nan)


def settling_index(error: np.ndarray, tolerance: float) -> int | None:
    """Returns the first sample after which `error` (T,) stays within `tolerance`, or None."""
    outside = np.flatnonzero(error > tolerance)
    first = int(outside[-1]) + 1 if len(outside) else 0
    return first if first < len(error) else None
