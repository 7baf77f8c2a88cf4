"""Error budget of the rows of `tip first` under thrusters with delay: no proof, a budget.

For blocks b of rows with the G, h and A of `row_loop`, f̄ = Aτ̄ of the plan, commanded ℓ ahead, φ
the remaining feedforward of the robot, w the feedback, ā the mean age, |·|∘ norms of blocks:

    δ'_b = (G e^{sℓ} − 1)f̄ + (G − 1)φ + c,
    |c| ≤ |ȦA⁻¹|∘ (ā(|φ| + |w| + |contact|) + (ā + ℓ)|f̄|).                                   (1)

Errors make feedforward, and feedforward makes errors: `least_bounds` finds the least fixed point.
Derivation, and omissions:
tube/actuation/theory.md#error-budget-under-thrusters.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from uvms_drake.tube.actuation.thruster_feedforward import (
    TIP_ROWS,
    VEHICLE_ROWS,
    ThrusterFeedforward,
)
from uvms_drake.tube.loops.actuator_path import Actuators
from uvms_drake.tube.loops.row_loop import ACCELERATION, RATE, RowLoop, W

PLAN, OFF_PLAN, WRENCH, TURNING, CONTACT, ARM = (
    "delayed plan", "delayed feedforward off the plan", "thrusters off the plan",
    "rotation within the delay", "delayed contact", "delayed arm")
"""Sources of the rows' errors by delayed actuators."""


class Errors(NamedTuple):
    """Bounds of errors of the rows, in the order of `ThrusterFeedforward.by_error`."""

    x: np.ndarray
    """Bounds of x and ẋ (10,)."""
    rate: np.ndarray
    """Bounds of ẋ and ẍ (10,)."""
    w: np.ndarray
    """Bounds of the feedback, by block of rows (4,)."""
    w_rate: np.ndarray
    """Bounds of its rate (4,)."""


class ThrusterBudget:
    """Bounds of the rows' errors by source.

    Args:
        actuators: Delays of the actuators.
        vehicle: The loop of the vehicle's rows, without observer.
        tip: The loop of the tip's.
        feedforward: Suprema of the feedforward of the rows.
        force: Bounds of the contact's force, of its rate but for a ripple, and of that [N, N/s].
    """

    def __init__(self, actuators: Actuators, vehicle: RowLoop, tip: RowLoop,
                 feedforward: ThrusterFeedforward, force: tuple[float, float, float]):
        size, rate, ripple = force
        self._actuators, self._f = actuators, feedforward
        self._pressed = feedforward.by_force * size
        paths, loops = (actuators.vehicle, actuators.joints), (vehicle, tip)
        self._age, self._hold, self._preview = _of_blocks(
            [[path.age, path.period, path.preview] for path in paths]).T
        # Gains to e, ė, w and ë, the last of which is the feedback behind G and a direct effect.
        self._gains = {name: _of_blocks([
            [*loop.gains[name], loop.gains[name].command + direct(path)]
            for loop, path in zip(loops, paths, strict=True)])
                       for name, direct in (
                           ("disturbance", lambda path: 1.0),
                           ("feed_forward", lambda path: 2.0 * (path.age > path.period)),
                           ("planned", lambda path: 2.0 * (path.age > path.period)),
                           ("planned_rate", lambda path: path.age + path.preview),
                           ("free_feed_forward", lambda path: 2.0),
                           ("feed_forward_rate", lambda path: path.age))}
        k, sigma = _of_blocks([[loop.k, loop.sigma] for loop in loops]).T
        # Gains by the integral of a δ: g∗Δ̇ = ġ∗Δ, and ė has Δ itself besides.
        by_rate = self._gains["disturbance"][:, RATE]
        faster = 1.0 + self._gains["disturbance"][:, W]
        self._by_integral = np.stack(
            [by_rate, faster, (k + sigma) * faster + k * sigma * by_rate], axis=1)
        # The contact, where the joints have another delay than the vehicle.
        missed = 0.0
        if actuators.vehicle != actuators.joints:
            missed = min(rate * (self._age[VEHICLE_ROWS] - self._age[TIP_ROWS]) + 2.0 * ripple,
                         2.0 * size)
        self._contact = self._by(
            "disturbance", missed * feedforward.by_force * np.array([1.0, 1.0, 0.0, 0.0]))

    def _by(self, name: str, sizes: np.ndarray) -> np.ndarray:
        """Returns e, ė, w and ë (4, 4) by a source of sizes (4,)."""
        out: np.ndarray = self._gains[name] * sizes[:, None]
        return out

    def _off_plan(self, errors: Errors) -> np.ndarray:
        """Returns |φ| + |w| and the effect of the contact (4,)."""
        out: np.ndarray = self._f.by_error @ errors.x + errors.w + self._pressed
        return out

    def parts(self, errors: Errors) -> dict[str, np.ndarray]:
        """Returns the bounds of e, ė, w and ë by source (4, 4)."""
        f, joints = self._f, self._actuators.joints
        # φ̇, the thrusters' deviation from the plan, and c of (1).
        off = self._off_plan(errors)
        rate = f.by_error @ errors.rate + f.by_error_rate @ errors.x
        wrench = 2.0 * f.by_wrench @ (f.plan + off)
        c = self._age * (f.turning @ (off + wrench)) + (self._age + self._preview) * (
            f.turning @ f.plan)
        by_wrench = arm = np.zeros((4, 4))
        if joints.age > 0.0:
            by_wrench, arm = self._by_wrench(wrench), self._by_arm(errors, rate, wrench, c)
        return {PLAN: self._plan(), OFF_PLAN: self._by("feed_forward_rate", rate),
                WRENCH: by_wrench, TURNING: self._by("disturbance", c), CONTACT: self._contact,
                ARM: arm}

    def _by_wrench(self, wrench: np.ndarray) -> np.ndarray:
        """Returns the bounds (4, 4) by a wrench off the plan, which varies behind the lag."""
        f, lag = self._f, self._actuators.vehicle.lag
        out = self._by("free_feed_forward", wrench)
        if lag > 0.0:
            out = np.minimum(out, self._by("feed_forward_rate", wrench / lag))
        jump, jump_rate, smooth_rate = (
            f.by_wrench @ each for each in (f.jump, f.jump_rate, f.smooth_rate))
        return out + (
            self._by("feed_forward", jump) + self._by("disturbance", self._hold * jump_rate)
            + self._by("feed_forward_rate", smooth_rate))

    def _by_arm(self, errors: Errors, rate: np.ndarray, wrench: np.ndarray, c: np.ndarray
                ) -> np.ndarray:
        """Returns the bounds (4, 4) by the delay of the arm, on the vehicle."""
        f, joints, lag = self._f, self._actuators.joints, self._actuators.vehicle.lag
        varies = 1.0 / lag if lag > 0.0 else np.inf
        jump = joints.age * f.by_tip @ f.jump
        out = self._by("disturbance", f.by_tip @ (
            2.0 * joints.period * f.jump_rate + c + (joints.age + joints.preview) * f.smooth_rate
            + joints.age * (rate + errors.w_rate) + min(1.0, varies * joints.age) * wrench))
        out[:, :ACCELERATION] += self._by_integral * jump[:, None]
        out[:, ACCELERATION] += self._by_integral[:, W] * jump + 2.0 * f.by_tip @ f.jump
        return out

    def _plan(self) -> np.ndarray:
        """Returns the bounds (4, 4) by a plan whose forces are commanded ahead."""
        f = self._f
        hold = self._hold * np.where(self._preview > 0.0, 2.0, 1.0)
        out: np.ndarray = np.minimum(
            self._by("planned", f.plan) + self._by("disturbance", hold * f.plan_rate),
            self._by("planned", f.jump) + self._by("disturbance", hold * f.jump_rate)
            + self._by("planned_rate", f.smooth_rate))
        return out

    def extra_input(self, errors: Errors, joints: float, qdot: float) -> np.ndarray:
        """Returns the addition to u and τ (2(6+n),).

        The joints take the wrench as it is. And the input of a force of the plan is another one at
        the real posture, and at the present one.

        Args:
            errors: The errors of the rows.
            joints: Bound of ‖q − q̄‖ [rad].
            qdot: Bound of a plan's ‖q̄̇‖ [rad/s].
        """
        f, preview = self._f, float(np.max(self._preview))
        off = self._off_plan(errors)
        delayed = 2.0 * (f.plan + off) + self._age * (f.turning @ (off + f.plan))
        out: np.ndarray = self._actuators.thrusters * (delayed[:TIP_ROWS] @ f.joints)
        if preview > 0.0:
            out[: len(out) // 2] += f.by_posture * (2.0 * joints + preview * qdot)
        return out


def _of_blocks(of_loops: list[list[float]]) -> np.ndarray:
    """Returns the numbers of both loops (2, c) for their blocks of rows (4, c)."""
    return np.repeat(np.array(of_loops, dtype=float), 2, axis=0)


def least_bounds(sums: Callable[[np.ndarray], np.ndarray], shape: tuple[int, ...]
                 ) -> tuple[np.ndarray, float]:
    """Returns the least z ≥ 0 with z = sums(z), inf if there is none, and the spectral radius.

    Args:
        sums: An affine function of arrays of this shape, with coefficients ≥ 0.
        shape: Shape of z.
    """
    size = int(np.prod(shape))
    start = sums(np.zeros(shape)).ravel()
    back = np.column_stack([sums(unit.reshape(shape)).ravel() - start for unit in np.eye(size)])
    radius = float(np.max(np.abs(np.linalg.eigvals(back))))
    if not radius < 1.0:
        return np.full(shape, np.inf), radius
    return np.linalg.solve(np.eye(size) - back, start).reshape(shape), radius
