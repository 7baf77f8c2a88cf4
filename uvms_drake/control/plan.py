"""The nominal trajectory ξ̄(t): a piecewise constant acceleration and what follows from it.

Between its knots the plan is evaluated, not held: ζ̄ is linear in time and 𝔮̄ is one step of a
fourth-order Runge–Kutta method from the last knot, whose error is below 1e-7 rad at the speeds of
an underwater vehicle and h = 0.2 s.
"""

import math
from dataclasses import dataclass

import numpy as np

from uvms_drake.model.uvms_model import configuration_rate

KNOT_TOLERANCE = 1e-9
"""A time so close after a knot, as a fraction of an interval, is the knot: rounding of k h."""


def advance(config: np.ndarray, zeta: np.ndarray, zeta_dot: np.ndarray,
            duration: float | np.ndarray) -> np.ndarray:
    """Returns 𝔮 (..., 6+n) after `duration` [s] of constant ζ̇ from (𝔮, ζ), by one RK4 step."""
    half = 0.5 * duration
    middle, last = zeta + half * zeta_dot, zeta + duration * zeta_dot
    k1 = configuration_rate(config, zeta)
    k2 = configuration_rate(config + half * k1, middle)
    k3 = configuration_rate(config + half * k2, middle)
    k4 = configuration_rate(config + duration * k3, last)
    return config + duration / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)


@dataclass(frozen=True)
class Plan:
    """A nominal trajectory over N intervals of length h."""

    start_time: float
    """t_k [s]."""
    time_step: float
    """h [s]."""
    config: np.ndarray
    """𝔮̄ at the knots (N+1, 6+n)."""
    zeta: np.ndarray
    """ζ̄ at the knots (N+1, 6+n)."""
    zeta_dot: np.ndarray
    """ζ̄̇ on the intervals (N, 6+n)."""

    @staticmethod
    def from_accelerations(start_time: float, time_step: float, config: np.ndarray,
                           zeta: np.ndarray, zeta_dot: np.ndarray) -> "Plan":
        """Returns the plan that starts at (𝔮, ζ) (6+n,) and has the accelerations (N, 6+n)."""
        configs = [config]
        zetas = np.concatenate([zeta[None], zeta + time_step * np.cumsum(zeta_dot, axis=0)])
        for velocity, acceleration in zip(zetas[:-1], zeta_dot, strict=True):
            configs.append(advance(configs[-1], velocity, acceleration, time_step))
        return Plan(start_time, time_step, np.array(configs), zetas, zeta_dot)

    def at(self, time: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Returns 𝔮̄, ζ̄ and ζ̄̇ (6+n,) at `time` [s], within the plan's horizon.

        ζ̄̇ at a knot is that of the interval that ends there: an integrator's last stage falls on
        the knot, and sees the interval that it integrates over.
        """
        elapsed = time - self.start_time
        last = len(self.zeta_dot) * self.time_step
        tolerance = KNOT_TOLERANCE * self.time_step
        if not -tolerance <= elapsed <= last + tolerance:
            raise ValueError(f"the plan is for {self.start_time:g} s and {last:g} s from then on, "
                             f"not for {time:g} s")
        index = math.ceil(elapsed / self.time_step - KNOT_TOLERANCE) - 1
        index = min(max(index, 0), len(self.zeta_dot) - 1)
        duration = elapsed - index * self.time_step
        zeta, zeta_dot = self.zeta[index], self.zeta_dot[index]
        return (advance(self.config[index], zeta, zeta_dot, duration),
                zeta + duration * zeta_dot, zeta_dot)

    def shifted(self, last_zeta_dot: np.ndarray) -> "Plan":
        """Returns the plan one interval later, continued by the acceleration `last_zeta_dot`."""
        last = advance(self.config[-1], self.zeta[-1], last_zeta_dot, self.time_step)
        return Plan(
            self.start_time + self.time_step, self.time_step,
            np.concatenate([self.config[1:], last[None]]),
            np.concatenate([self.zeta[1:], self.zeta[-1:] + self.time_step * last_zeta_dot]),
            np.concatenate([self.zeta_dot[1:], last_zeta_dot[None]]))
