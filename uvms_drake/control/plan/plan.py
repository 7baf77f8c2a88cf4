"""Nominal trajectory ξ̄(t): piecewise constant accelerations ζ̄̇, and the motion that follows.

Between its knots a plan is evaluated, not held: 𝔮̄ is one step of a fourth-order Runge–Kutta method
from the last knot, whose error is below 1e-7 rad at the speeds of an underwater vehicle and
h = 0.2 s (it grows with h⁵).
"""

import math
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from uvms_drake.model.frames.euler import Numbers, rate_matrix, rotated, rotation_matrix
from uvms_drake.model.frames.spatial import cross, times
from uvms_drake.model.uvms_model import configuration_rate

KNOT_TOLERANCE = 1e-9
"""Time after a knot, as a fraction of an interval, that counts as the knot: rounding of k h."""


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


def advance_one(config: np.ndarray, zeta: np.ndarray, zeta_dot: np.ndarray, duration: float
                ) -> np.ndarray:
    """Returns `advance` of one configuration (6+n,), by plain numbers and so three times as fast.

    The joints are linear: one step is exact.
    """
    start, rate = zeta[:6].tolist(), zeta_dot[:6].tolist()
    speeds = [[v + step * a for v, a in zip(start, rate, strict=True)]
              for step in (0.0, 0.5 * duration, 0.5 * duration, duration)]
    rpy, stages = _turn(tuple(config[3:6].tolist()), [speed[3:] for speed in speeds], duration)
    linear = [rotated(at, speed[:3]) for at, speed in zip(stages, speeds, strict=True)]
    out: np.ndarray = config + duration * (zeta + 0.5 * duration * zeta_dot)
    out[:3] = [p + duration / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
               for p, k1, k2, k3, k4 in zip(config[:3].tolist(), *linear, strict=True)]
    out[3:6] = rpy
    return out


def advance_derivatives(config: np.ndarray, zeta: np.ndarray, zeta_dot: np.ndarray, duration: float
                        ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns the derivatives (K, 6+n, 6+n) of `advance` (K, 6+n) by 𝔮, ζ and ζ̇.

    By the chain rule through the stages 𝔮_i = 𝔮 + c_i k_{i−1}, ζ_i = ζ + c_i ζ̇, k_i = Γ(𝔮_i) ζ_i.
    Only the attitude enters nonlinearly; the joints are linear.
    """
    K, size, c = len(config), config.shape[-1], duration * np.array([0.0, 0.5, 0.5, 1.0])
    offsets = c[:, None, None]
    speed = zeta[:, :6] + offsets * zeta_dot[:, :6]  # (4, K, 6)
    # Attitudes of the stages, and Γ and the rates' derivatives by the attitude there.
    rpy = np.array([_turn((roll, pitch, yaw), turning, duration)[1] for (roll, pitch, yaw), turning
                    in zip(config[:, 3:6].tolist(), speed[..., 3:].swapaxes(0, 1).tolist(),
                           strict=True)]).swapaxes(0, 1)
    R, T = rotation_matrix(rpy), rate_matrix(rpy)
    linear_o, angular_o = _rate_gradients(rpy, R, speed)
    # Derivatives of the attitudes and of their rates by attitude, ν₂ and ν̇₂ (9).
    attitude, step = np.zeros((4, K, 3, 9)), np.zeros((4, K, 3, 9))
    attitude[..., range(3), range(3)] = 1.0
    step[..., 3:6], step[..., 6:] = T, offsets[..., None] * T
    for i in range(4):
        if i:
            attitude[i] += c[i] * step[i - 1]
        step[i] += angular_o[i] @ attitude[i]
    # Sums over the stages.
    weights = duration / 6.0 * np.array([1.0, 2.0, 2.0, 1.0])
    by_linear, by_angular = _weighted(weights, linear_o @ attitude), _weighted(weights, step)
    by_config, by_zeta = np.empty((K, size, size)), np.empty((K, size, size))
    by_config[...], by_zeta[...] = np.eye(size), duration * np.eye(size)
    by_zeta_dot = 0.5 * duration * by_zeta
    by_config[:, :3, 3:6] = by_linear[..., :3]
    by_config[:, 3:6, 3:6] += by_angular[..., :3]
    for out, columns, parts in ((by_zeta, slice(3, 6), weights),
                                (by_zeta_dot, slice(6, 9), weights * c)):
        out[:, :3, :3] = _weighted(parts, R)
        out[:, :3, 3:6], out[:, 3:6, 3:6] = by_linear[..., columns], by_angular[..., columns]
    return by_config, by_zeta, by_zeta_dot


def _weighted(weights: np.ndarray, stages: np.ndarray) -> np.ndarray:
    """Returns the weighted sum (...) over four stages (4, ...)."""
    return (weights @ stages.reshape(4, -1)).reshape(stages.shape[1:])


def _rate_gradients(rpy: np.ndarray, R: np.ndarray, nu: np.ndarray
                    ) -> tuple[np.ndarray, np.ndarray]:
    """Returns the derivatives (..., 3, 3) of R(𝔬) ν₁ and of T(𝔬) ν₂ by 𝔬, real.

    Args:
        rpy: 𝔬 (..., 3) [rad].
        R: R(𝔬) (..., 3, 3).
        nu: (ν₁, ν₂) (..., 6) [m/s, rad/s].
    """
    sin, cos = np.sin(rpy), np.cos(rpy)
    sf, sp, cf, ct, cp = sin[..., 0], sin[..., 2], cos[..., 0], cos[..., 1], cos[..., 2]
    tan = sin[..., 1] / ct
    # A turn about x of the vehicle, the turned y and z moves R ν₁ across that axis.
    axes = np.zeros((*rpy.shape, 3))
    axes[..., 0, :] = R[..., 0]
    axes[..., 1, 0], axes[..., 1, 1], axes[..., 2, 2] = -sp, cp, 1.0
    linear = np.swapaxes(cross(axes, times(R, nu[..., :3])[..., None, :]), -1, -2)
    q, r = nu[..., 4], nu[..., 5]
    across, along = sf * q + cf * r, cf * q - sf * r
    angular = np.zeros((*rpy.shape, 3))
    angular[..., 0, 0], angular[..., 1, 0], angular[..., 2, 0] = tan * along, -across, along / ct
    angular[..., 0, 1], angular[..., 2, 1] = across / ct**2, across * tan / ct
    return linear, angular


def roll_out(config: np.ndarray, zeta: np.ndarray, zeta_dot: np.ndarray, time_step: float
             ) -> np.ndarray:
    """Returns 𝔮 (N+1, 6+n) at the knots, as `advance` interval after interval gives it.

    Only the attitude has to go step by step; the position is a sum once it is known.

    Args:
        config: 𝔮 at the first knot (6+n,).
        zeta: ζ at the beginning of every interval (N, 6+n).
        zeta_dot: ζ̇ on every interval (N, 6+n).
        time_step: h [s].
    """
    offsets = np.array([0.0, 0.5, 0.5, 1.0])[:, None] * time_step
    speeds = zeta[:, None, :] + offsets * zeta_dot[:, None, :]  # (N, 4, 6+n) at the four stages
    rpy = tuple(config[3:6].tolist())
    knots, stages = [rpy], []
    for turning in speeds[..., 3:6].tolist():
        rpy, visited = _turn(rpy, turning, time_step)
        knots.append(rpy)
        stages.append(visited)
    out = np.empty((len(zeta) + 1, len(config)))
    out[:, 3:6] = knots
    weights = np.array([1.0, 2.0, 2.0, 1.0]) * time_step / 6.0
    linear = (rotation_matrix(np.array(stages)) @ speeds[..., :3, None])[..., 0]
    out[0] = config
    out[1:, :3] = config[:3] + np.cumsum(weights @ linear, axis=0)
    out[1:, 6:] = config[6:] + np.cumsum(weights @ speeds[..., 6:], axis=0)
    return out


def _turn(rpy: Numbers, turning: list[list[float]], h: float) -> tuple[Numbers, list[Numbers]]:
    """Returns the Euler angles after one RK4 step, and those at its four stages.

    Plain numbers, because three of them are too few for NumPy. `turning` is ν₂ (4, 3) [rad/s].
    """
    roll, pitch, yaw = rpy
    half, sixth = 0.5 * h, h / 6.0
    a1, b1, c1 = _rates(roll, pitch, turning[0])
    second = roll + half * a1, pitch + half * b1, yaw + half * c1
    a2, b2, c2 = _rates(second[0], second[1], turning[1])
    third = roll + half * a2, pitch + half * b2, yaw + half * c2
    a3, b3, c3 = _rates(third[0], third[1], turning[2])
    last = roll + h * a3, pitch + h * b3, yaw + h * c3
    a4, b4, c4 = _rates(last[0], last[1], turning[3])
    end = (roll + sixth * (a1 + 2.0 * (a2 + a3) + a4), pitch + sixth * (b1 + 2.0 * (b2 + b3) + b4),
           yaw + sixth * (c1 + 2.0 * (c2 + c3) + c4))
    return end, [rpy, second, third, last]


def _rates(roll: float, pitch: float, turning: list[float]) -> Numbers:
    """Returns the rates of the Euler angles at ν₂ [rad/s]."""
    p, q, r = turning
    sin, cos = math.sin(roll), math.cos(roll)
    yaw_rate = (sin * q + cos * r) / math.cos(pitch)
    return p + yaw_rate * math.sin(pitch), cos * q - sin * r, yaw_rate


@dataclass(frozen=True)
class Plan:
    """Nominal trajectory over N intervals of length h: ζ̄ is continuous and linear on each."""

    start_time: float
    """Instant t_k of the first knot [s]."""
    time_step: float
    """Length h of an interval [s]."""
    config: np.ndarray
    """Configurations 𝔮̄ at the knots (N+1, 6+n)."""
    zeta: np.ndarray
    """ζ̄ at the knots (N+1, 6+n)."""
    zeta_dot: np.ndarray
    """ζ̄̇ on the intervals (N, 6+n)."""

    @staticmethod
    def from_accelerations(start_time: float, time_step: float, config: np.ndarray,
                           zeta: np.ndarray, zeta_dot: np.ndarray) -> "Plan":
        """Returns the plan that starts at (𝔮, ζ) (6+n,) and has the accelerations (N, 6+n)."""
        zetas = np.concatenate([zeta[None], zeta + time_step * np.cumsum(zeta_dot, axis=0)])
        configs = roll_out(config, zetas[:-1], zeta_dot, time_step)
        return Plan(start_time, time_step, configs, zetas, zeta_dot)

    @property
    def decision(self) -> np.ndarray:
        """Accelerations ζ̄̇."""
        return self.zeta_dot

    @property
    def start(self) -> np.ndarray:
        """First state (𝔮̄, ζ̄) (2(6+n),)."""
        return np.concatenate([self.config[0], self.zeta[0]])

    def redone(self, start: np.ndarray, decision: np.ndarray) -> "Plan":
        """Returns the plan from another (𝔮, ζ) or with other accelerations."""
        config, zeta = np.split(start, 2)
        return Plan.from_accelerations(
            self.start_time, self.time_step, config, zeta, decision)

    def at(self, time: float, since: float | None = None
           ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Returns 𝔮̄, ζ̄ and ζ̄̇ (6+n,) within the horizon.

        A knot belongs to the interval that ends there: an integrator's last stage falls on the
        knot, and sees the interval that it integrates over. Only `since` belongs to the one that
        begins there, in which an integrator's first stage is.

        Args:
            time: [s].
            since: Knot [s] from which on the plan is followed; by default its first.
        """
        index, duration = self._interval(time, since)
        zeta, zeta_dot = self.zeta[index], self.zeta_dot[index]
        return (advance_one(self.config[index], zeta, zeta_dot, duration),
                zeta + duration * zeta_dot, zeta_dot)

    def shifted(self, last_decision: np.ndarray) -> Self:
        """Returns the plan one interval later, with this ζ̄̇ (6+n,) at its end."""
        last = advance_one(self.config[-1], self.zeta[-1], last_decision, self.time_step)
        return replace(
            self, start_time=self.start_time + self.time_step,
            config=np.concatenate([self.config[1:], last[None]]),
            zeta=np.concatenate([self.zeta[1:], self.zeta[-1:] + self.time_step * last_decision]),
            zeta_dot=np.concatenate([self.zeta_dot[1:], last_decision[None]]))

    def after(self, knot: int) -> Self:
        """Returns the part of the plan after one of its knots."""
        return replace(
            self, start_time=self.start_time + knot * self.time_step, config=self.config[knot:],
            zeta=self.zeta[knot:], zeta_dot=self.zeta_dot[knot:])

    def preceded(self, other: "Plan", intervals: int) -> Self:
        """Returns the plan with the first intervals of another one, which end where it begins."""
        first = slice(intervals)
        return replace(
            self, start_time=other.start_time,
            config=np.concatenate([other.config[first], self.config]),
            zeta=np.concatenate([other.zeta[first], self.zeta]),
            zeta_dot=np.concatenate([other.zeta_dot[first], self.zeta_dot]))

    def _interval(self, time: float, since: float | None) -> tuple[int, float]:
        """Returns the interval that contains `time`, as of `at`, and the time since its begin."""
        elapsed = time - self.start_time
        intervals = len(self.config) - 1
        last = intervals * self.time_step
        tolerance = KNOT_TOLERANCE * self.time_step
        if not -tolerance <= elapsed <= last + tolerance:
            raise ValueError(f"the plan is for {self.start_time:g} s and {last:g} s from then on, "
                             f"not for {time:g} s")
        index = math.ceil(elapsed / self.time_step - KNOT_TOLERANCE) - 1
        first = 0 if since is None else round((since - self.start_time) / self.time_step)
        index = min(max(index, first), intervals - 1)
        return index, elapsed - index * self.time_step


@dataclass(frozen=True)
class TrackingPlan(Plan):
    """Plan about the artificial reference y_des + E a."""

    a: np.ndarray
    """Translation of the reference in Σ_I [m] and, if it may turn, its yaw [rad] (3,) or (4,)."""

    @property
    def decision(self) -> np.ndarray:
        """Decisions (N+1, 6+n): first (a, 0), then ζ̄̇."""
        out = np.zeros_like(self.zeta)
        out[0, : len(self.a)], out[1:] = self.a, self.zeta_dot
        return out

    def redone(self, start: np.ndarray, decision: np.ndarray) -> "TrackingPlan":
        """Returns the plan from another (𝔮, ζ) or with another decision."""
        a = decision[0, : len(self.a)]
        return TrackingPlan(**vars(super().redone(start, decision[1:])), a=a)


# Between the knots --------------------------------------------------------------------------------
#
# Depth x and speed v are along n. The tip's acceleration along n is taken for constant in each
# interval h; with j = sup|x⃛| the depth is off by at most (2/81) h³j, see `off_parabola`. Proofs,
# assumptions and motion across n: control/plan/theory.md#depth-between-two-knots and
# control/plan/theory.md#distance-to-stop-in.


def between_knots(depth: np.ndarray, speed: np.ndarray, step: float) -> np.ndarray:
    """Returns x_k + v_k h/2, a depth that bounds the interval after knot k together with its ends.

    It is the middle one of the Bézier control points x_k, x_k + v_k h/2 and x_{k+1} of a motion
    with constant acceleration: if all three are at most x_safe, so is x in between. It is linear in
    the plan. With the knots alone a plan that turns back exceeds x_safe by up to ah²/8.
    """
    return depth + 0.5 * step * speed


def off_parabola(jerk: float, step: float) -> float:
    """Returns (2/81) h³j [m], the largest distance of n·𝔭 from a parabola between two knots.

    Args:
        jerk: j, bound of |d³(n·𝔭)/dt³| [m/s³].
        step: h [s].
    """
    return 2.0 / 81.0 * step**3 * jerk


def stopping_distance(force_max: float, noise: float, stiffness: float, margin: float,
                  retreat: float = 0.0) -> float:
    """Returns the distance L [m] that the planned tip may advance after a reading without touch.

        L = (F_max − 2ν/(1 − c₊⟨−v⟩))/κ₊ − 2E.

    Below zero there is no approach: the tube is thicker than the compliance of the wall allows.
    Proof: control/plan/theory.md#distance-to-stop-in.

    Args:
        force_max: F_max [N].
        noise: ν [N].
        stiffness: κ₊ [N/m].
        margin: E, of the planned tip [m].
        retreat: c₊ times a bound of ⟨−v⟩ of the real tip [1], which the tube allows in addition to
            the planned velocity. From 1 on a reading bounds nothing, and L = −∞.
    """
    if retreat >= 1.0:
        return -math.inf
    return (force_max - 2.0 * noise / (1.0 - retreat)) / stiffness - 2.0 * margin
