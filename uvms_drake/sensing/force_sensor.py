"""Sensor of the contact force, and the bound of its error."""

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from pydrake.systems.framework import DiagramBuilder, OutputPort

from uvms_drake.common.keyed_random import generator_of
from uvms_drake.model.signals import sensor_actuator
from uvms_drake.model.uvms import STANDARD_GRAVITY
from uvms_drake.model.uvms_model import UvmsModel
from uvms_drake.sensing import wrist_sensor
from uvms_drake.sensing.force_fault_detector import repeat_probability
from uvms_drake.sensing.measurements import tip_pose


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


def error_bound(sensor: wrist_sensor.WristSettings, time: float, rate: np.ndarray,
                turning: float = 0.0) -> ForceError:
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
    """
    largest_noise = sensor.noise_multiple * np.asarray(sensor.noise, dtype=float)
    weight = sensor.tool.largest_hold(STANDARD_GRAVITY)
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


def readable_force(sensor: wrist_sensor.WristSettings, time: float) -> float:
    """Returns the largest norm of a force at the tip [N] that the range never cuts up to a time.

    That is the least end of the range of a force or of a torque over the lever of the mounting,
    less the other terms of a raw value: bias, drift, noise, rounding and the tool's weight.

    Args:
        sensor: The sensor.
        time: t [s].
    """
    other = (sensor.noise_multiple * np.asarray(sensor.noise, dtype=float)
             + 0.5 * np.asarray(sensor.resolution, dtype=float)
             + np.asarray(sensor.bias, dtype=float) + time * np.asarray(sensor.drift, dtype=float)
             + sensor.tool.largest_hold(STANDARD_GRAVITY))
    lever = np.linalg.norm(np.linalg.inv(
        wrist_sensor.transfer(np.asarray(sensor.mounting, dtype=float)))[:, :3], axis=1)
    free = np.asarray(sensor.range, dtype=float) - other
    return max(float(np.min(free / np.maximum(lever, 1e-9))), 0.0)


def in_tip_axes(sensor: wrist_sensor.WristSettings, bound: np.ndarray) -> np.ndarray:
    """Returns the bound (6,) of A(𝔬)ᵀ(𝔉_s − 𝔉), in Σ_E, for a bound (6,) of F̂ − F_S."""
    return np.abs(wrist_sensor.transfer(np.asarray(sensor.mounting, dtype=float))) @ bound


@dataclass
class ForceSensor(wrist_sensor.WristSettings, sensor_actuator.Sensor):
    """A wrist sensor of the contact force, which the law takes instead of the surface's.

    Logged are `force_raw`, F̂ in its own axes, and `force_measured`, 𝔉_s. Rate, noise and range
    are those of the wrist sensor in the Girona 1000's own scenario for Stonefish (CIRS,
    `girona1000_vectorial.scn`); the others are unpublished, and assumed: the lag is that of a
    low-pass of 8 Hz (one of 5 Hz is in use), and a bias of newtons is why such a sensor "must be
    tared" (Reach Bravo). The scenario for Stonefish has no resolution; this one is the data sheet's
    of an ATI Mini45 (SI-145-5), 1/16 N and 1/752 N m, and about that of 16 bits over this range.
    """


    def assumption(self) -> str:
        """Returns the assumption that it breaks."""
        return "the proofs know the contact force by the surface's law"

    def reading(self, time: float, turning: float) -> sensor_actuator.ForceReading:
        """Returns its properties up to a time; see `error_bound`."""
        parts = error_bound(self, time, np.zeros(6), turning)
        # The mean of the tare: its noise, and as much of the resolution as a reading has, for
        # samples with less noise than that are all rounded alike.
        count = self.tare_samples
        rounding = 0.5 * np.asarray(self.resolution, dtype=float) * bool(count)
        constant, likely = parts.bias + rounding, parts.bias
        if count:
            deviations = max(3.0, self.noise_multiple) / max(self.noise_multiple, 1e-9)
            likely = rounding + min(deviations / np.sqrt(count), 1.0) * parts.bias
        repeated = repeat_probability(self.least_noise * np.asarray(self.noise, dtype=float),
                                      self.noise_multiple, self.resolution)
        return sensor_actuator.ForceReading(
            in_tip_axes(self, parts.total), self.lag, 1.0 / self.rate, self.tare, repeated,
            readable_force(self, time), in_tip_axes(self, constant),
            in_tip_axes(self, likely))

    def imperfection(self, seed: int) -> wrist_sensor.Imperfection:
        """Returns the errors of the copy of a seed; b and s are uniform within their bounds."""
        b, s = generator_of(seed, (wrist_sensor.STREAM, 0)).uniform(-1.0, 1.0, (2, 6))
        return wrist_sensor.Imperfection(b * self.bias, s * self.drift, partial(
            wrist_sensor.cut_noise, np.asarray(self.noise, dtype=float), self.noise_multiple, seed))

    def add_to(self, builder: DiagramBuilder, model: UvmsModel, port: OutputPort,
               signals: sensor_actuator.Signals, seed: int) -> OutputPort:
        """Adds a `WristSensor`, which takes its measured attitude from `port`; see `Part`."""
        sensor = wrist_sensor.WristSensor.AddToBuilder(
            builder, model, self, self.imperfection(seed), force=signals["force"],
            chi=signals["chi"], measured_chi=tip_pose(builder, model, port, signals),
            payload=signals.get(sensor_actuator.PAYLOAD),
            payload_at_rest=signals.get(sensor_actuator.PAYLOAD_AT_REST))
        signals[sensor_actuator.MEASURED_FORCE] = sensor.GetOutputPort("force_measured")
        signals["force_raw"] = sensor.GetOutputPort("reading")
        return port
