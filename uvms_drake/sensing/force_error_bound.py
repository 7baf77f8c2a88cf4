"""Error bound of a `ForceSensor` by source; see `sensing/theory.md`."""

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
    """By the noise of the sample."""
    bias: np.ndarray
    """By the bias, or by what the tare leaves of it."""
    drift: np.ndarray
    """By the drift since the tare."""
    tool: np.ndarray
    """By a wrong model of the tool, and by the lag of its weight during the tare."""
    lag: np.ndarray
    """By the lag."""
    hold: np.ndarray
    """By the age of the sample."""

    @property
    def total(self) -> np.ndarray:
        """Bound of F̂ − F_S (6,) [N, N m]."""
        total: np.ndarray = np.sum(self, axis=0)
        return total


def error_bound(sensor: "ForceSensor", time: float, rate: np.ndarray, turning: float = 0.0,
                gravity: float = 9.81) -> ForceError:
    """Returns the bound of F̂ − F_S at a time after the tare.

    Bound. Let |Ḟ_S| ≤ ρ in every component, the sensor turn by no more than ω, its range not be
    reached, its measured attitude be true, and nothing be touched during the tare, if there is one.
    Then at all times up to t, with N samples of the tare, σ̄ = mσ the largest noise, Λ the largest
    weight of the tool and ε its relative error,

        |F̂ − F_S| ≤ σ̄ + β + s̄ (t − (N−1)h/2) + (2|ε|Λ + TωΛ) + T(ρ + ωΛ) + hρ,   β = σ̄,

    and without a tare (N = 0) ≤ σ̄ + b̄ + s̄ t + |ε|Λ + T(ρ + ωΛ) + hρ.

    Proof. Let u = F_S + L, |u̇| ≤ ρ + ωΛ, since L turns with gravity. e = x − u has Tė = −e − Tu̇
    from e(0) = 0, so |e| ≤ T(ρ + ωΛ). For tₖ ≤ t < tₖ₊₁ and means over the tare

        F̂ₖ − F_S(t) = νₖ − mean ν + s(tₖ − mean tⱼ) + eₖ − mean e + (L − L̂)ₖ − mean(L − L̂)
                      + F_S(tₖ) − F_S(t),

    where b has gone, |mean ν| ≤ σ̄, mean tⱼ = (N−1)h/2, |mean e| ≤ TωΛ, as F_S is zero then,
    |L − L̂| ≤ |ε|Λ and the last difference is at most hρ. Without a tare the means are zero and b
    stays. ∎ All of it is attained in the limit at once, but for the tool, by noise and drift of one
    sign, the opposite noise during the tare, and a force that falls or rises steadily.

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
        bias=largest_noise if count else np.asarray(sensor.bias, dtype=float),
        drift=drift * (time - max(count - 1, 0) * period / 2.0),
        tool=2.0 * wrong + lag * weight_rate if count else wrong,
        lag=lag * (rate + weight_rate),
        hold=period * rate)


def readable_force(sensor: "ForceSensor", time: float, gravity: float = 9.81) -> float:
    """Returns the largest norm of a force [N] that the range never cuts up to a time [s].

    That is the least end of the range along the axes of the sensor, less all else that is in a raw
    value: bias, drift, noise, and what hangs beyond it.

    Args:
        sensor: The sensor.
        time: t [s].
        gravity: ‖g‖ [m/s²].
    """
    beside = (sensor.noise_multiple * np.asarray(sensor.noise, dtype=float)
              + np.asarray(sensor.bias, dtype=float) + time * np.asarray(sensor.drift, dtype=float)
              + sensor.tool.largest_hold(gravity))
    return max(float(np.min((np.asarray(sensor.range, dtype=float) - beside)[:3])), 0.0)


def in_tip_axes(sensor: "ForceSensor", bound: np.ndarray) -> np.ndarray:
    """Returns the bound (6,) of A(𝔬)ᵀ(𝔉_s − 𝔉), in Σ_E, for a bound (6,) of F̂ − F_S."""
    return np.abs(transfer(np.asarray(sensor.mounting, dtype=float))) @ bound
