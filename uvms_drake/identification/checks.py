"""Checks of a log before it is used: each finds a fault, in a line, or nothing."""

from collections.abc import Callable

import numpy as np

from uvms_drake.identification.log import Log, gravity_in_body
from uvms_drake.model.frames.euler import inverse_rate_matrix
from uvms_drake.model.frames.spatial import times
from uvms_drake.model.uvms import STANDARD_GRAVITY

LARGEST_ANGLE, LARGEST_RATE = 4.0 * np.pi, 10.0
"""Sizes beyond which angles [rad] and rates [rad/s] are taken to be in another unit."""
MOVING = 0.01
"""Smallest rms rate that shows the sense of an axis [rad/s]."""
AGREEMENT = (0.7, 1.4)
"""Range of the slope of the attitude's rate over the gyro."""
TILT, FIELD = np.deg2rad(15.0), (0.8, 1.2)
"""Largest angle between gravity and accelerometer [rad], and range of their ratio."""
KNOWN = 0.5
"""Smallest fraction of samples that are known."""
CUT = 0.1
"""Fraction of samples at exactly its largest size from which on a wrench is saturated."""
LAGS, LATEST = 2.0, 0.5
"""Largest shift of a clock that is looked for, and largest one that is allowed [s]."""
ALIKE = 0.5
"""Smallest correlation by which the shift of a clock is known."""
BETTER = 0.05
"""Smallest gain of correlation by a shift."""


def complaint(log: Log) -> str | None:
    """Returns the first fault of a log in one line, or None."""
    checks: tuple[Callable[[Log], str | None], ...] = (
        _units, _gaps, _excitation, _gyro, _gravity, _saturation)
    return next((found for check in checks if (found := check(log))), None)


def _units(log: Log) -> str | None:
    for name, values, largest, unit in (
            ("joints", log.q, LARGEST_ANGLE, "rad"), ("attitude", log.state[:, :2], np.pi, "rad"),
            ("angular_velocity", log.state[:, 6:], LARGEST_RATE, "rad/s")):
        size = float(np.max(np.abs(np.nan_to_num(values)), initial=0.0))
        if size > largest:
            return (f"{name} has {size:.3g} {unit}, and must be within {largest:.3g}: is it in "
                    "degrees?")
    return None


def _gaps(log: Log) -> str | None:
    share = float(np.mean(log.known)) if len(log.known) else 0.0
    if np.mean(log.touching, dtype=float) > KNOWN:
        return "contact: a force acts on it, of which no parameter of the water is known"
    return None if share >= KNOWN else (
        f"gaps: joints, attitude and wrench are known in {share:.0%} of its samples, and must be "
        f"in {KNOWN:.0%}")


def _excitation(log: Log) -> str | None:
    known = log.known
    sizes = [np.ptp(log.state[known, :2], axis=0), np.ptp(log.q[known], axis=0)]
    still = np.max(np.concatenate(sizes), initial=0.0) < MOVING
    return "no excitation: neither arm nor vehicle moves" if still else None


def _gyro(log: Log) -> str | None:
    rpy = np.column_stack([log.state[:, :2], np.zeros(len(log.time))])
    seen = times(inverse_rate_matrix(rpy), log.attitude_rate)
    for axis, name in enumerate(("roll", "pitch", "yaw")):
        gyro, attitude = log.state[:, 6 + axis], seen[:, axis]
        known = np.isfinite(gyro) & np.isfinite(attitude)
        g, a = gyro[known], attitude[known]
        if known.any() and np.sqrt(np.mean(g**2)) > MOVING:
            slope = float(g @ a / (g @ g))
            if not AGREEMENT[0] <= slope <= AGREEMENT[1]:
                return (f"the attitude contradicts the gyro: it turns in {name} by {slope:.2g} of "
                        "it, so a frame, a sense or a unit is not as declared")
    return None


def _gravity(log: Log) -> str | None:
    known = np.all(np.isfinite(log.specific_force), axis=1) & np.isfinite(log.state[:, 0])
    if not known.any():
        return None
    down = gravity_in_body(log.state[known]) / STANDARD_GRAVITY
    along = -np.sum(log.specific_force[known] * down, axis=1)
    size = float(np.mean(np.linalg.norm(log.specific_force[known], axis=1)))
    tilt = float(np.arccos(np.clip(np.mean(along) / max(size, 1e-9), -1.0, 1.0)))
    if tilt < TILT and FIELD[0] < size / STANDARD_GRAVITY < FIELD[1]:
        return None
    return (f"the accelerometer has {size:.3g} m/s2, {np.rad2deg(tilt):.0f} degrees off up by the "
            "attitude, so a frame or a unit is not as declared")


def _saturation(log: Log) -> str | None:
    for axis, wrench in enumerate(log.wrench[log.known].T):
        size = np.max(np.abs(wrench), initial=0.0)
        if np.ptp(wrench) > 0.0 and np.mean(np.abs(wrench) > (1.0 - 1e-6) * size) > CUT:
            return (f"saturation: component {axis + 1} of the wrench is at its largest size in "
                    f"more than {CUT:.0%} of the samples")
    return None


def clock_shift(measured: np.ndarray, predicted: np.ndarray, step: float) -> float | None:
    """Returns the time by which a log's attitude is late to its prediction [s]; None if unknown.

    It is where the correlation of both is largest; zero if that is not much larger than without
    a shift, as where the model's period differs.

    Args:
        measured: Roll and pitch at the samples (T, 2) [rad]; nan where unknown.
        predicted: The same by the model.
        step: Time between samples [s].
    """
    lags = np.arange(-round(LAGS / step), round(LAGS / step) + 1)
    m, p = (x - np.nanmean(x, axis=0) for x in (measured, predicted))
    found = np.full(len(lags), -1.0)
    for i, lag in enumerate(lags.tolist()):
        after, before = m[max(lag, 0): len(m) + min(lag, 0)], p[max(-lag, 0): len(p) - max(lag, 0)]
        both = np.all(np.isfinite(after) & np.isfinite(before), axis=1)
        a, b = after[both].ravel(), before[both].ravel()
        if len(a) > 0.5 * m.size / 2 and (size := np.linalg.norm(a) * np.linalg.norm(b)) > 0.0:
            found[i] = a @ b / size
    best, none = int(np.argmax(found)), len(lags) // 2
    if found[best] <= ALIKE:
        return None
    return float(lags[best] * step) if found[best] > found[none] + BETTER else 0.0
