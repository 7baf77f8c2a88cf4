"""Detector of frozen, saturated and missing readings of a force sensor.

Noise moves every reading, and the resolution rounds it: whatever the force, a component repeats the
last reading with a probability of at most that of the most probable interval of the noise of the
length of the resolution, and all six with at most the product.

A sensor whose noise exceeds its resolution does not repeat all six components of its reading for
long: m equal readings in a row, in Σ_I or in the axes of the tip, are none, nor is a force whose
norm is at the declared end of the range. Until then readings pass that are at least the least force
of the last mT, as the safe region asks of a window W = mT. Proof, probability, and faults that it
cannot detect: sensing/theory.md#detection-of-a-frozen-force.
"""

import math
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from pydrake.systems.framework import Context, DiscreteValues

from uvms_drake.common.errors import require
from uvms_drake.common.finite import is_finite
from uvms_drake.common.wiring import WiredSystem, output_of
from uvms_drake.model.end_effector import force_in_tip
from uvms_drake.model.frames.spatial import block_diagonal
from uvms_drake.model.uvms_model import UvmsModel

CHANCE = 1e-9
"""Largest probability, per reading, that a working sensor makes the run of a frozen one."""
SAME = 1e-9
"""Largest difference of two equal forces, by the rounding of a rotation there and back [N, N m]."""


class ForceStatus(IntEnum):
    """Status of a reading."""

    VALID = 0
    FROZEN = 1
    """All components repeat, for longer than noise and resolution allow."""
    SATURATED = 2
    """The force is at the end of the declared range."""
    MISSING = 3
    """It is not finite."""


class RepeatCount(NamedTuple):
    """State of the detector."""

    last: np.ndarray
    """The last wrench, in Σ_I and in the axes of the tip (2, 6) [N, N m]; NaN before there is
    one."""
    times: np.ndarray
    """Number of times in a row that each of them has been read (2,)."""


def counted(before: RepeatCount, wrench: np.ndarray) -> RepeatCount:
    """Returns the state after a sample of a wrench (2, 6) [N, N m]; a gap leaves it."""
    if not np.isfinite(wrench).all():
        return before
    same = (np.abs(wrench - before.last) <= SAME).all(axis=-1)
    return RepeatCount(wrench, np.where(same, before.times + 1.0, 1.0))


def status(force: np.ndarray, times: np.ndarray, repeats: int, largest: float) -> ForceStatus:
    """Returns the status of a reading.

    Args:
        force: 𝔉_s (6,) [N, N m].
        times: Numbers of equal readings in a row (2,), see `RepeatCount`.
        repeats: m, of a frozen sensor; 0: none is detected.
        largest: Norm of a force at the end of the range [N].
    """
    if not is_finite(force):
        return ForceStatus.MISSING
    if not math.hypot(*force[:3].tolist()) < largest:
        return ForceStatus.SATURATED
    return ForceStatus.FROZEN if 0 < repeats <= max(times.tolist()) else ForceStatus.VALID


def repeat_probability(sigma: np.ndarray, multiple: float, resolution: np.ndarray) -> float:
    """Returns a bound p of the probability that a reading repeats the last one in all components.

    With noise νᵢ, Gaussian and cut to ± mσᵢ, and Φ the normal distribution, p = ∏ pᵢ,

        pᵢ = max(P(|νᵢ| ≤ rᵢ/2), P(νᵢ ≥ mσᵢ − rᵢ)) = max(erf(rᵢ/(2√2 σᵢ)), Φ(rᵢ/σᵢ − m)),

    and 1 for rᵢ ≥ 2mσᵢ. It is 1 for a sensor without noise.

    Args:
        sigma: σ (6,) [N, N m].
        multiple: m.
        resolution: r (6,) [N, N m].
    """
    p = 1.0
    for s, r in zip(np.asarray(sigma, dtype=float), np.asarray(resolution, dtype=float),
                    strict=True):
        if s > 0.0 and r < 2.0 * multiple * s:
            middle = math.erf(r / (2.0 * math.sqrt(2.0) * s))
            end = 0.5 * math.erfc((multiple - r / s) / math.sqrt(2.0))
            p *= max(middle, end)
    return p


def chance_of_run(repeated: float, run: int) -> float:
    """Returns the bound 2p^(N − 1) of the probability that a reading ends a run of N equal ones.

    Twice, since they are compared in two frames.
    """
    return float(2.0 * repeated ** (run - 1))


def run_of_frozen(repeated: float) -> int:
    """Returns N, the least number of equal readings in a row whose `chance_of_run` is `CHANCE`.

    0 if there is none: then a frozen sensor cannot be told from a working one.

    Args:
        repeated: p, see `repeat_probability`.
    """
    if repeated >= 1.0:
        return 0
    ratio = math.log(0.5 * CHANCE) / math.log(max(repeated, 0.5 * CHANCE))
    return 1 + math.ceil(ratio - 1e-12)


class ForceFaultDetector(WiredSystem):
    """Passes the measured force on while it is valid, and else NaN; see the module.

    .. pydrake_system::

        name: ForceFaultDetector
        input_ports:
        - state
        - force_measured
        output_ports:
        - force_valid
        - force_status

    - `state`: (𝔮, ζ) (2(6+n)) measured, for the attitude of the tip.
    - `force_measured`, `force_valid`: 𝔉_s (6), force in Σ_I and torque conjugate to Euler rates [N,
      N m].
    - `force_status`: a `ForceStatus` (1).

    The discrete state is that of `RepeatCount` (14), and the number of samples (1).

    Args:
        model: The controller's model.
        period: T, between two samples [s].
        repeats: m; 0: no detection, of a sensor that is as quiet as a frozen one.
        tare: Time with a state after which detection begins [s]: a sensor that is tared may read
            zero all the time.
        largest: Norm of a force at the end of the range [N].
    """

    def __init__(self, model: UvmsModel, period: float, *, repeats: int = 3, tare: float = 0.0,
                 largest: float = np.inf):
        super().__init__()
        require(0.0 < period < np.inf, "period", period, "positive")
        require(repeats == 0 or repeats >= 2, "repeats", repeats, "0, or 2 or more")
        self._model, self._repeats, self._largest = model, repeats, largest
        self._from_task = block_diagonal(model.R_WT, np.eye(3))
        self._passed = math.ceil(tare / period - 1e-6)
        self._state_port = self.DeclareVectorInputPort("state", 2 * model.size)
        self._port = self.DeclareVectorInputPort("force_measured", 6)
        self.DeclareDiscreteState(np.append(np.full(12, np.nan), np.zeros(2)))
        self.DeclareDiscreteState(1)
        if repeats:
            self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._look)
        known = {self.xd_ticket(), self._port.ticket()}
        output_of(self, "force_valid", 6, self._valid, known)
        output_of(self, "force_status", 1,
                  lambda c: [float(self._status(c, self._port.Eval(c)))], known)

    @staticmethod
    def _remembered(context: Context) -> RepeatCount:
        state = context.get_discrete_state(0).value()
        return RepeatCount(state[:12].reshape(2, 6), state[12:])

    def _look(self, context: Context, state: DiscreteValues) -> None:
        config, force = self._state_port.Eval(context)[: self._model.size], self._port.Eval(context)
        if not is_finite(config):  # Nor does the sensor take a sample for its tare.
            return
        turns = context.get_discrete_state(1).value()
        state.set_value(1, turns + 1.0)
        if turns[0] < self._passed or not is_finite(force):
            return
        # A frozen reading is constant in its own axes, and moves with the attitude in others.
        in_tip = force_in_tip(self._model.task_pose(config)[:6], force @ self._from_task)
        last, times = counted(self._remembered(context), np.array([force, in_tip]))
        state.set_value(0, np.concatenate([last.ravel(), times]))

    def _status(self, context: Context, force: np.ndarray) -> ForceStatus:
        return status(force, self._remembered(context).times, self._repeats, self._largest)

    def _valid(self, context: Context) -> np.ndarray:
        force = self._port.Eval(context)
        return force if self._status(context, force) is ForceStatus.VALID else np.full(6, np.nan)
