"""A log on one grid: the motion of the arm, the wrench on the vehicle, and its measured state."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from uvms_drake.common.errors import require
from uvms_drake.identification.local_fit import local_quadratic
from uvms_drake.model.uvms import STANDARD_GRAVITY

GRID = 0.05
"""Step of the grid [s]."""
STATE = ("roll", "pitch", "depth", "u", "v", "w", "p", "q", "r")
"""State x of a vehicle, but for its heading and horizontal position [rad, m, m/s, rad/s]."""
SIZES = {"joints": None, "attitude": 3, "angular_velocity": 3, "velocity": 3, "depth": 1,
         "wrench": 6, "specific_force": 3, "force": 3}
"""Number of components of the signals of a log; None: a joint each."""

Samples = tuple[np.ndarray, np.ndarray]
"""Times (N,) [s] and samples (N, c) of a signal."""


@dataclass(frozen=True)
class Log:
    """A log in the model's axes and units, T samples on a grid, n joints."""

    name: str
    """Name of the log."""
    time: np.ndarray
    """Times (T,) [s]."""
    q: np.ndarray
    """Joint angles (T, n) [rad, m]; nan where unknown, as is all else."""
    q_dot: np.ndarray
    """Their rates (T, n)."""
    q_ddot: np.ndarray
    """Their accelerations (T, n)."""
    wrench: np.ndarray
    """Wrench τ_v on the vehicle (T, 6) [N, N m]."""
    state: np.ndarray
    """Measured x (T, 9), see `STATE`; nan where nothing was measured."""
    rate: np.ndarray
    """ẋ (T, 9), likewise."""
    specific_force: np.ndarray
    """Accelerometer, without gravity's field (T, 3) [m/s²]."""
    attitude_rate: np.ndarray
    """Rates of roll, pitch, yaw of the measured attitude (T, 3) [rad/s]."""
    touching: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=bool))
    """Whether it touched something (T,)."""

    @property
    def known(self) -> np.ndarray:
        """Whether arm, wrench and attitude are known, and nothing was touched (T,)."""
        return (np.all(np.isfinite(self.q_ddot), axis=1) & ~self.touching
                & np.all(np.isfinite(self.wrench), axis=1)
                & np.all(np.isfinite(self.state[:, :2]), axis=1))


def on_grid(name: str, signals: Mapping[str, Samples], joints: int, contact: float = 1.0) -> Log:
    """Returns a log of signals in the model's axes and units, see `SIZES`.

    Args:
        name: Name of the log.
        signals: The signals; without `wrench` the vehicle is not driven.
        joints: Number of joints.
        contact: Largest force that is no contact [N].

    Raises:
        InvalidParameter: Attitude and joints have no time in common.
    """
    needed = ["attitude"] + ["joints"] * bool(joints)
    first = max(signals[each][0][0] for each in needed)
    last = min(signals[each][0][-1] for each in needed)
    grid = np.arange(first, last + 1e-9, GRID)
    require(len(grid) > 1, f"{name}: times of {' and '.join(needed)}", [first, last],
            "with a common span: one clock, in one unit")

    def fit(signal: str, size: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        if signal not in signals:
            return (np.full((len(grid), size), np.nan),) * 3
        return local_quadratic(*signals[signal], grid)

    q, q_dot, q_ddot = fit("joints", joints)
    times, attitude = signals["attitude"]
    known = np.isfinite(attitude).all(axis=1)  # A missing one would spoil all turns after it.
    require(bool(known.any()), f"{name}: attitude", "no numbers", "roll, pitch and yaw")
    rpy, rpy_rate, _ = local_quadratic(times[known], np.unwrap(attitude[known], axis=0), grid)
    parts = [(rpy[:, :2], rpy_rate[:, :2]), *(fit(signal, size)[:2] for signal, size in (
        ("depth", 1), ("velocity", 3), ("angular_velocity", 3)))]
    wrench = fit("wrench", 6)[0] if "wrench" in signals else np.zeros((len(grid), 6))
    touching = np.zeros(len(grid), dtype=bool)
    if "force" in signals:
        at, force = signals["force"]
        touching = np.interp(grid, at, np.linalg.norm(force, axis=1)) > contact
    return Log(name, grid, q, q_dot, q_ddot, wrench,
               np.concatenate([x for x, _ in parts], axis=1),
               np.concatenate([rate for _, rate in parts], axis=1),
               fit("specific_force", 3)[0], rpy_rate, touching)


def gravity_in_body(state: np.ndarray) -> np.ndarray:
    """Returns g_B (..., 3) [m/s²] at x (..., 9)."""
    roll, pitch = state[..., 0], state[..., 1]
    level = np.cos(pitch)
    return STANDARD_GRAVITY * np.stack(
        [-np.sin(pitch), level * np.sin(roll), level * np.cos(roll)], axis=-1)


def state_rate(state: np.ndarray, nu_dot: np.ndarray) -> np.ndarray:
    """Returns ẋ (..., 9) at x (..., 9), by ν̇ (..., 6)."""
    roll, pitch, _, u, v, w, p, q, r = np.moveaxis(state, -1, 0)
    sin, cos, level = np.sin(roll), np.cos(roll), np.cos(pitch)
    turn = sin * q + cos * r
    return np.concatenate([np.stack([
        p + np.tan(pitch) * turn, cos * q - sin * r,
        -np.sin(pitch) * u + level * (sin * v + cos * w)], axis=-1), nu_dot], axis=-1)
