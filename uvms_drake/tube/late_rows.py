"""What late actuators make of the rows of `tip first`: the sources of `tube.row_loop`, bounded.

By (1) there, for blocks b of rows with the G, h and A of `late_loads`; f = f̄ + φ of the plan and of
what the robot carries beside it, w the feedback, ∘ marks norms of blocks:

    δ'_b = (G − 1)f̄ + (G − 1)φ + c,    |c| ≤ ā |ȦA⁻¹|∘ (|f̄| + |φ| + |w| + |contact|),            (1)

since [(AG − GA)τ_c](t) = ∫[A(t) − A(s)]A(s)⁻¹(Aτ_c)(s) over ages of ā in the mean, at most.

*f̄ jumps at the knots of a plan*, which are ticks, and varies in between: its level goes by the gain
of `feed_forward`, and what it varies in a period by that of a δ; or so does the part with ζ̄̇, which
jumps, and the rest by its rate. A contact's force is late as well:
where the joints have the reading G_sF̂, the vehicle has G_vF̂.

*φ* is what errors x make of h, by its derivatives, and nothing is late of what stands still: what
counts is its rate, |φ̇| ≤ |∂h/∂x|∘|ẋ| + |d/dt ∂h/∂x|∘|x|. ẍ is at most the feedback and what pushes.
The tip's carries what the thrusters give off
the plan, too: |A(τ_v − τ̄_v)| ≤ 2|f̄| + |φ| + |w|, which behind a lag T varies at no more than
2(|f̄| + |φ| + |w| + |contact|)/T.

*The arm is late, too.* The vehicle's h counts with v_s, and the tip does v_s + r, where r is the
(G − 1)v_s + (G − 1)h + c of the tip: at most ā(|φ̇| + |ẇ|) and c, with the part of f̄. What jumps is
late by the dead time t_d, which has a bounded integral, −∫f̄ over the last t_d: it counts t_d|f̄| by
the kernel's derivative, g∗Δ̇ = ġ∗Δ.

Errors make loads, and loads make errors: the smallest numbers that bound each other. They exist if
what comes back is less than what was put in, and bound the real ones, since all of that is causal.
What an observer is told, that is all of δ', it does not see: these are gains without it.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from uvms_drake.tube.actuators import Actuators
from uvms_drake.tube.late_loads import LateLoads
from uvms_drake.tube.row_loop import RowLoop

PLAN, LOADS, WRENCH, TURNING, CONTACT, ARM = (
    "the plan, late", "loads off the plan, late", "the thrusters, off the plan",
    "what turns meanwhile", "the contact, late", "the arm, late")
SOURCES = (PLAN, LOADS, WRENCH, TURNING, CONTACT, ARM)
"""Sources of the rows' errors by actuators that are late."""


class Errors(NamedTuple):
    """Bounds of errors of the rows, as `LateLoads.by_error` has them."""

    x: np.ndarray
    """Of x and ẋ (10,)."""
    rate: np.ndarray
    """Of ẋ and ẍ (10,)."""
    w: np.ndarray
    """Of the feedback, by block of rows (4,)."""
    w_rate: np.ndarray
    """Of its rate (4,)."""


class LateRows:
    """The bounds by source.

    Args:
        actuators: How late they are.
        vehicle: The loop of the vehicle's rows, without observer.
        tip: The loop of the tip's.
        loads: Suprema of what the rows carry.
        force: Bounds of the contact's force, of its rate but for a ripple, and of that [N, N/s].
    """

    def __init__(self, actuators: Actuators, vehicle: RowLoop, tip: RowLoop, loads: LateLoads,
                 force: tuple[float, float, float]):
        size, rate, ripple = force
        self._actuators, self._loads = actuators, loads
        self._pressed = loads.by_force * size
        paths, loops = (actuators.vehicle, actuators.joints), (vehicle, tip)
        self._age, self._hold = _of_blocks([[path.age, path.period] for path in paths]).T
        # Of e, ė, w and ë, which is the feedback behind G and what pushes.
        self._gains = {name: _of_blocks([[*loop.gains[name], loop.gains[name].command + most(path)]
                                         for loop, path in zip(loops, paths, strict=True)])
                       for name, most in (
                           ("disturbance", lambda path: 1.0),
                           ("feed_forward", lambda path: 2.0 * (path.age > path.period)),
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

    def _given(self, errors: Errors) -> np.ndarray:
        """Returns |f| + |w| and what the contact makes (4,)."""
        out: np.ndarray = (self._loads.plan + self._loads.by_error @ errors.x + errors.w
                           + self._pressed)
        return out

    def parts(self, errors: Errors) -> dict[str, np.ndarray]:
        """Returns the bounds of e, ė, w and ë by source (4, 4)."""
        loads, path, lag = self._loads, self._actuators.joints, self._actuators.vehicle.lag
        given = self._given(errors)
        plan = np.minimum(
            self._by("feed_forward", loads.plan)
            + self._by("disturbance", self._hold * loads.plan_rate),
            self._by("feed_forward", loads.jump)
            + self._by("disturbance", self._hold * loads.jump_rate)
            + self._by("feed_forward_rate", loads.smooth_rate))
        rate = loads.by_error @ errors.rate + loads.by_error_rate @ errors.x
        wrench = 2.0 * loads.by_wrench @ given
        varies = 1.0 / lag if lag > 0.0 else np.inf
        by_wrench = np.minimum(self._by("free_feed_forward", wrench), self._by(
            "feed_forward_rate", wrench * varies)) if path.age > 0.0 else np.zeros((4, 4))
        c = self._age * (loads.turning @ (given + wrench))
        arm = np.zeros((4, 4))
        if path.age > 0.0:
            off = (path.period * loads.jump_rate + c
                   + path.age * (loads.smooth_rate + rate + errors.w_rate)
                   + min(1.0, varies * path.age) * wrench)
            late = path.dead_time * loads.by_tip @ loads.jump
            arm = self._by("disturbance", loads.by_tip @ off)
            arm[:, :3] += self._by_integral * late[:, None]
            arm[:, 3] += self._by_integral[:, 2] * late + 2.0 * loads.by_tip @ loads.jump
        return {PLAN: plan, LOADS: self._by("feed_forward_rate", rate), WRENCH: by_wrench,
                TURNING: self._by("disturbance", c), CONTACT: self._contact, ARM: arm}

    def wrench_late(self, errors: Errors) -> np.ndarray:
        """Returns what this makes of u and τ (2(6+n),): the joints take the wrench as it is."""
        if not self._actuators.thrusters:
            return np.zeros(self._loads.joints.shape[1])
        given = self._given(errors)
        off = 2.0 * given + self._age * (self._loads.turning @ given)
        out: np.ndarray = off[:2] @ self._loads.joints
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
