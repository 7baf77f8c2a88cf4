"""Error budget of the rows of `tip first` under thrusters with delay: no proof, a budget.

By (3) there, for blocks b of rows with the G, h and A of `thruster_feedforward`; f̄ = Aτ̄ of the plan, asked
for ℓ ahead, φ what the robot carries besides, w the feedback, ∘ marks norms of blocks:

    δ'_b = (G e^{sℓ} − 1)f̄ + (G − 1)φ + c,
    |c| ≤ |ȦA⁻¹|∘ (ā(|φ| + |w| + |contact|) + (ā + ℓ)|f̄|),                                       (1)

since [(AG − GA)τ](t) = ∫[A(t) − A(s)]A(s)⁻¹(Aτ)(s) over ages of ā in the mean, at most.

*f̄ jumps at the knots of a plan*, which are ticks, and varies in between: its level goes by the gain
of `planned`, and what it varies in a period by that of a δ; or so does the part with ζ̄̇, which
jumps, and the rest by its rate. A contact's force is late as well: where the joints have the
reading G_sF̂, the vehicle has G_vF̂.

*A plan that is made anew* keeps what was asked for ahead (`control.plan.commitment`): f̄ is the
one that is followed, and no source of its own.

*φ* is what errors x make of h, by its derivatives, and nothing is late of what stands still: what
counts is its rate, |φ̇| ≤ |∂φ/∂x|∘|ẋ| + |d/dt ∂φ/∂x|∘|x|. ẍ is at most the feedback and what pushes.
The tip's carries what the thrusters give off the plan, too: |Aτ_v| varies behind a lag T at no more
than 2(|f̄| + |φ| + |w| + |contact|)/T, and Aτ̄_v, which is not known to the joints' hold, like f̄.

*The arm is late, too.* The vehicle's h counts with v_s, and the tip does v_s + r, where r is the δ'
of the tip without what pushes it: at most ā(|φ̇| + |ẇ|) and c, with the part of f̄. What jumps is
late by ā at most, which has a bounded integral: it counts ā|f̄| by the kernel's derivative,
g∗Δ̇ = ġ∗Δ.

*A budget, and not a proof yet*: it says what eats the tube, and where there are thrusters the
certificate is void by their assumption (a clock alone has a proof, `held_rows`, and so has a lag of
the wrench on all axes of which no plan is told, `lagged_rows`). Not counted are

- a wrench that thrusters cut at their limits, if `limits.thrusters` are not declared;
- (G_v − 1)A M_vq J_sq⁻¹w_s: what the tip feeds back is late on the vehicle, too;
- (G e^{sℓ} − 1)(A − Ā)τ̄, for f̄ here has A and the posture of the plan, and what jumps of φ with it;
- (G − 1) of a steady contact force whose map to the rows moves with the posture;
- in ARM the thrusters' part of the plan and, with an observer, its jumps in ẇ.

In (1) [A(t) − A(s)]A(s)⁻¹ is taken to first order in the age; and g∗Δ̇ = ġ∗Δ is that of a kernel
that does not change with time, which behind a hold is so to (k + σ)h.

Errors make loads, and loads make errors: the smallest numbers that bound each other. They exist if
what comes back is less than what was put in, and bound all of that, since it is causal.
What an observer is told, that is all of δ', it does not see: these are gains without it.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from uvms_drake.tube.actuation.thruster_feedforward import ThrusterFeedforward
from uvms_drake.tube.loops.actuator_path import Actuators
from uvms_drake.tube.loops.row_loop import RowLoop

PLAN, LOADS, WRENCH, TURNING, CONTACT, ARM = (
    "the plan, late", "loads off the plan, late", "the thrusters, off the plan",
    "what turns meanwhile", "the contact, late", "the arm, late")
"""Sources of the rows' errors by actuators that are late."""


class Errors(NamedTuple):
    """Bounds of errors of the rows, as `ThrusterFeedforward.by_error` has them."""

    x: np.ndarray
    """Of x and ẋ (10,)."""
    rate: np.ndarray
    """Of ẋ and ẍ (10,)."""
    w: np.ndarray
    """Of the feedback, by block of rows (4,)."""
    w_rate: np.ndarray
    """Of its rate (4,)."""


class ThrusterBudget:
    """The bounds by source.

    Args:
        actuators: How late they are.
        vehicle: The loop of the vehicle's rows, without observer.
        tip: The loop of the tip's.
        loads: Suprema of what the rows carry.
        force: Bounds of the contact's force, of its rate but for a ripple, and of that [N, N/s].
    """

    def __init__(self, actuators: Actuators, vehicle: RowLoop, tip: RowLoop, loads: ThrusterFeedforward,
                 force: tuple[float, float, float]):
        size, rate, ripple = force
        self._actuators, self._loads = actuators, loads
        self._pressed = loads.by_force * size
        paths, loops = (actuators.vehicle, actuators.joints), (vehicle, tip)
        self._age, self._hold, self._ahead = _of_blocks(
            [[path.age, path.period, path.ahead] for path in paths]).T
        # Of e, ė, w and ë, which is the feedback behind G and what pushes.
        self._gains = {name: _of_blocks([[*loop.gains[name], loop.gains[name].command + most(path)]
                                         for loop, path in zip(loops, paths, strict=True)])
                       for name, most in (
                           ("disturbance", lambda path: 1.0),
                           ("feed_forward", lambda path: 2.0 * (path.age > path.period)),
                           ("planned", lambda path: 2.0 * (path.age > path.period)),
                           ("planned_rate", lambda path: path.age + path.ahead),
                           ("free_feed_forward", lambda path: 2.0),
                           ("feed_forward_rate", lambda path: path.age))}
        k, sigma = _of_blocks([[loop.k, loop.sigma] for loop in loops]).T
        # By the integral of a δ: g∗Δ̇ = ġ∗Δ, and ė has Δ itself besides.
        by_rate = self._gains["disturbance"][:, 1]
        faster = 1.0 + self._gains["disturbance"][:, 2]
        self._by_integral = np.stack(
            [by_rate, faster, (k + sigma) * faster + k * sigma * by_rate], axis=1)
        missed = 0.0
        if actuators.vehicle != actuators.joints:
            missed = min(rate * (self._age[0] - self._age[2]) + 2.0 * ripple, 2.0 * size)
        self._contact = self._by(
            "disturbance", missed * loads.by_force * np.array([1.0, 1.0, 0.0, 0.0]))

    def _by(self, name: str, sizes: np.ndarray) -> np.ndarray:
        """Returns e, ė, w and ë (4, 4) by a source of sizes (4,)."""
        out: np.ndarray = self._gains[name] * sizes[:, None]
        return out

    def _off(self, errors: Errors) -> np.ndarray:
        """Returns |φ| + |w| and what the contact makes (4,)."""
        out: np.ndarray = self._loads.by_error @ errors.x + errors.w + self._pressed
        return out

    def parts(self, errors: Errors) -> dict[str, np.ndarray]:
        """Returns the bounds of e, ė, w and ë by source (4, 4)."""
        loads, joints, lag = self._loads, self._actuators.joints, self._actuators.vehicle.lag
        off = self._off(errors)
        rate = loads.by_error @ errors.rate + loads.by_error_rate @ errors.x
        wrench = 2.0 * loads.by_wrench @ (loads.plan + off)
        c = self._age * (loads.turning @ (off + wrench)) + (self._age + self._ahead) * (
            loads.turning @ loads.plan)
        varies = 1.0 / lag if lag > 0.0 else np.inf
        by_wrench = arm = np.zeros((4, 4))
        if joints.age > 0.0:
            by_wrench = self._by("free_feed_forward", wrench)
            if lag > 0.0:
                by_wrench = np.minimum(by_wrench, self._by("feed_forward_rate", wrench / lag))
            by_wrench = by_wrench + self._held(*(loads.by_wrench @ each for each in (
                loads.jump, loads.jump_rate, loads.smooth_rate)))
            late = joints.age * loads.by_tip @ loads.jump
            arm = self._by("disturbance", loads.by_tip @ (
                2.0 * joints.period * loads.jump_rate + c
                + (joints.age + joints.ahead) * loads.smooth_rate
                + joints.age * (rate + errors.w_rate) + min(1.0, varies * joints.age) * wrench))
            arm[:, :3] += self._by_integral * late[:, None]
            arm[:, 3] += self._by_integral[:, 2] * late + 2.0 * loads.by_tip @ loads.jump
        return {PLAN: self._plan(), LOADS: self._by("feed_forward_rate", rate), WRENCH: by_wrench,
                TURNING: self._by("disturbance", c), CONTACT: self._contact, ARM: arm}

    def _held(self, jump: np.ndarray, jump_rate: np.ndarray, smooth_rate: np.ndarray
              ) -> np.ndarray:
        """Returns the bounds (4, 4) by what jumps at ticks, varies in between, or is smooth."""
        return (self._by("feed_forward", jump) + self._by("disturbance", self._hold * jump_rate)
                + self._by("feed_forward_rate", smooth_rate))

    def _plan(self) -> np.ndarray:
        """Returns the bounds (4, 4) by a plan whose forces are asked for ahead."""
        loads = self._loads
        twice = self._hold * np.where(self._ahead > 0.0, 2.0, 1.0)
        out: np.ndarray = np.minimum(
            self._by("planned", loads.plan) + self._by("disturbance", twice * loads.plan_rate),
            self._by("planned", loads.jump) + self._by("disturbance", twice * loads.jump_rate)
            + self._by("planned_rate", loads.smooth_rate))
        return out

    def beside(self, errors: Errors, joints: float, qdot: float) -> np.ndarray:
        """Returns what comes to u and τ (2(6+n),).

        The joints take the wrench as it is. And the input of a force of the plan is another one at
        the real posture, and at that of now.

        Args:
            errors: The errors of the rows.
            joints: Bound of ‖q − q̄‖ [rad].
            qdot: Of a plan's ‖q̄̇‖ [rad/s].
        """
        loads, ahead = self._loads, float(np.max(self._ahead))
        off = self._off(errors)
        late = 2.0 * (loads.plan + off) + self._age * (loads.turning @ (off + loads.plan))
        out: np.ndarray = self._actuators.thrusters * (late[:2] @ loads.joints)
        if ahead > 0.0:
            out[: len(out) // 2] += loads.by_posture * (2.0 * joints + ahead * qdot)
        return out


def _of_blocks(of_loops: list[list[float]]) -> np.ndarray:
    """Returns numbers of the vehicle's loop and the tip's (2, c) for their blocks (4, c)."""
    return np.repeat(np.array(of_loops, dtype=float), 2, axis=0)


def least_bounds(sums: Callable[[np.ndarray], np.ndarray], shape: tuple[int, ...]
                 ) -> tuple[np.ndarray, float]:
    """Returns the z ≥ 0 with z = sums(z), and what comes back of it: inf and ≥ 1 if there is none.

    Args:
        sums: An affine function of arrays of this shape, with coefficients ≥ 0.
        shape: Of z.
    """
    size = int(np.prod(shape))
    start = sums(np.zeros(shape)).ravel()
    back = np.column_stack([sums(unit.reshape(shape)).ravel() - start for unit in np.eye(size)])
    share = float(np.max(np.abs(np.linalg.eigvals(back))))
    if not share < 1.0:
        return np.full(shape, np.inf), share
    return np.linalg.solve(np.eye(size) - back, start).reshape(shape), share
