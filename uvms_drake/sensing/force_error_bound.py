"""Bound of the error of a `ForceSensor`, by its sources."""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from uvms_drake.model.frames.euler import rotation_matrix
from uvms_drake.model.frames.spatial import block_diagonal, skew

if TYPE_CHECKING:
    from uvms_drake.sensing.force_sensor import ForceSensor


def transfer(mounting: np.ndarray) -> np.ndarray:
    """Returns X (6, 6) with F_E = X F_S, for a wrench and the pose (6,) of S in E [m, rad]."""
    R_ES = rotation_matrix(mounting[3:])
    X = block_diagonal(R_ES, R_ES)
    X[3:, :3] = skew(mounting[:3]) @ R_ES
    return X


class ForceError(NamedTuple):
    """Bounds of the parts of F̂ − F_S, each component (6,) [N, N m] in the sensor's axes."""

    noise: np.ndarray
    """Noise of the sample."""
    resolution: np.ndarray
    """Rounding of the sample, and of the mean of the tare."""
    bias: np.ndarray
    """Bias, or its remainder after the tare."""
    drift: np.ndarray
    """Drift since the tare."""
    tool: np.ndarray
    """Error of the tool's model, and lag of its weight during the tare."""
    lag: np.ndarray
    """Lag."""
    hold: np.ndarray
    """Age of the sample."""

    @property
    def total(self) -> np.ndarray:
        """Bound of F̂ − F_S (6,) [N, N m]."""
        total: np.ndarray = np.sum(self, axis=0)
        return total


def error_bound(sensor: "ForceSensor", time: float, rate: np.ndarray, turning: float = 0.0,
                gravity: float = 9.81) -> ForceError:
    """Returns the bound of F̂ − F_S at a time after the tare.

    With N samples of the tare, σ̄ = mσ the largest noise, r the resolution, Λ the largest weight of
    the tool and ε its relative error, (1) of sensing/theory.md#error-bound-of-the-force-sensor is,
    β = σ̄,

        |F̂ − F_S| ≤ σ̄ + r + β + s̄ (t − (N−1)h/2) + (2|ε|Λ + TωΛ) + T(ρ + ωΛ) + hρ,

    and without a tare (N = 0) ≤ σ̄ + r/2 + b̄ + s̄ t + |ε|Λ + T(ρ + ωΛ) + hρ. The range is not
    reached, the measured attitude is true, and nothing is touched during the tare.

    Args:
        sensor: The sensor.
        time: t [s].
        rate: ρ (6,), of F_S in the sensor's axes [N/s, N m/s].
        turning: ω, bound of the angular velocity of the end-effector [rad/s].
        gravity: ‖g‖ [m/s²].
    """
    largest_noise = sensor.noise_multiple * np.asarray(sensor.noise, dtype=float)
    weight = sensor.tool.largest_hold(gravity)
    weight_rate, wrong = turning * weight, abs(sensor.tool.error) * weight
    count, period = sensor.tare_samples, 1.0 / sensor.rate
    drift, lag = np.asarray(sensor.drift, dtype=float), sensor.lag
    return ForceError(
        noise=largest_noise,
        resolution=(1.0 if count else 0.5) * np.asarray(sensor.resolution, dtype=float),
        bias=largest_noise if count else np.asarray(sensor.bias, dtype=float),
        drift=drift * (time - max(count - 1, 0) * period / 2.0),
        tool=2.0 * wrong + lag * weight_rate if count else wrong,
        lag=lag * (rate + weight_rate),
        hold=period * rate)


def readable_force(sensor: "ForceSensor", time: float, gravity: float = 9.81) -> float:
    """Returns the largest norm of a force [N] that the range never cuts up to a time [s].

    That is the least end of the range along the axes of the sensor, less the other terms of a raw
    value: bias, drift, noise, rounding and the weight of the tool.

    Args:
        sensor: The sensor.
        time: t [s].
        gravity: ‖g‖ [m/s²].
    """
    other = (sensor.noise_multiple * np.asarray(sensor.noise, dtype=float)
             + 0.5 * np.asarray(sensor.resolution, dtype=float)
             + np.asarray(sensor.bias, dtype=float) + time * np.asarray(sensor.drift, dtype=float)
             + sensor.tool.largest_hold(gravity))
    return max(float(np.min((np.asarray(sensor.range, dtype=float) - other)[:3])), 0.0)


def in_tip_axes(sensor: "ForceSensor", bound: np.ndarray) -> np.ndarray:
    """Returns the bound (6,) of A(𝔬)ᵀ(𝔉_s − 𝔉), in Σ_E, for a bound (6,) of F̂ − F_S."""
    return np.abs(transfer(np.asarray(sensor.mounting, dtype=float))) @ bound
