"""What is looked for in the signals of a run: limits, units, and the instant of settling."""

from collections.abc import Sequence

import numpy as np

from uvms_drake.model.surface.law import make_surface_law, static_force
from uvms_drake.station.motions import motion_of
from uvms_drake.station.record import Record

BOUND_SLACK, BOUND_FLOOR = 1e-6, 1e-9
"""Relative and absolute [m/s², rad/s²]: what rounding leaves of a disturbance of exactly d̃."""


def disturbance_above(record: Record) -> np.ndarray:
    """Returns whether the norm of all that disturbs is above d̃ (T,)."""
    bound = record.scenario.disturbance.bound
    effective = np.linalg.norm(record.effective_disturbance, axis=1)
    return effective > (1.0 + BOUND_SLACK) * bound + BOUND_FLOOR


def constraint_signals(record: Record) -> dict[str, tuple[np.ndarray, float]]:
    """Returns for each constraint g(t) ≤ limit the signal g (T,) and the limit, by name.

    The lower joint limits q_min ≤ q are the exception: there the signal must stay above. The static
    force is that of the pose, at rest, on the surface as the controller knows it: a limit of how
    far the end-effector goes into it.
    """
    limits, zeta, config = record.scenario.limits, record.zeta, record.config
    signals = {
        "nu1": (np.linalg.norm(zeta[:, :3], axis=1), limits.nu1),
        "nu2": (np.linalg.norm(zeta[:, 3:6], axis=1), limits.nu2),
        "qdot": (np.linalg.norm(zeta[:, 6:], axis=1), limits.qdot),
    }
    for i, (lower, upper) in enumerate(zip(record.joint_lower, record.joint_upper, strict=True)):
        signals[f"q{i + 1}_min"] = (config[:, 6 + i], lower)
        signals[f"q{i + 1}_max"] = (config[:, 6 + i], upper)
    signals["roll"] = (np.abs(config[:, 3]), limits.roll)
    signals["pitch"] = (np.abs(config[:, 4]), limits.pitch)
    signals["tip_pitch"] = (np.abs(record.chi[:, 4]), limits.tip_pitch)
    if limits.static_force is not None:
        surface = make_surface_law(record.scenario.surface)
        signals["static_force"] = (static_force(surface, record.chi), limits.static_force)
    names = input_names(record.num_joints)
    for key, inputs, bounds in (("u", record.u, limits.u), ("tau", record.tau, limits.tau)):
        if bounds is not None and motion_of(record.scenario).has_forces:
            for name, values, limit in zip(names, inputs.T, bounds, strict=True):
                signals[f"{key}_{name}"] = (np.abs(values), limit)
    return {name: pair for name, pair in signals.items() if np.isfinite(pair[1])}


def input_names(num_joints: int) -> list[str]:
    """Returns the names of the 6 + n accelerations."""
    return ["surge", "sway", "heave", "roll", "pitch", "yaw",
            *(f"q{i + 1}" for i in range(num_joints))]


def wrench_unit(desired: Sequence[float] | np.ndarray) -> str:
    """Returns the unit of 𝔉 and its errors by what 𝔉_des (6,) has: a force, a torque or both."""
    force, torque = np.any(desired[:3]), np.any(desired[3:])
    return "N, N m" if force and torque else "N m" if torque else "N"


def settling_index(error: np.ndarray, tolerance: float) -> int | None:
    """Returns the first sample from which on `error` (T,) stays within `tolerance`, or None."""
    outside = np.flatnonzero(error > tolerance)
    first = int(outside[-1]) + 1 if len(outside) else 0
    return first if first < len(error) else None
