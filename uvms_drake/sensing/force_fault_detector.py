"""Detector of frozen and saturated readings of a force sensor.

A sensor with noise never repeats itself: m equal values of a component in a row, in Σ_I or in the
axes of the tip, are no readings, nor is a force whose norm is at the declared end of the range.
Until then readings pass that are at least the least force of the last mT, as the safe region asks
of a window W = mT. Proof, and faults that it cannot detect:
sensing/theory.md#detection-of-a-frozen-force.
"""

import math
from typing import NamedTuple

import numpy as np
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiagramBuilder,
    DiscreteValues,
    EventStatus,
    LeafSystem,
    OutputPort,
)

from uvms_drake.common.errors import require
from uvms_drake.common.wiring import added
from uvms_drake.model.frames.euler import rotation_matrix
from uvms_drake.model.uvms_model import UvmsModel

SAME = 1e-9
"""Largest difference of two equal forces, by the rounding of a rotation there and back [N]."""


class RepeatCount(NamedTuple):
    """State of the detector."""

    last: np.ndarray
    """The last force, in Σ_I (3) and in the axes of the tip (3) [N]; NaN before there is one."""
    times: np.ndarray
    """Number of times in a row that each of them has been read (6,)."""


def counted(before: RepeatCount, force: np.ndarray) -> RepeatCount:
    """Returns the state after a sample of a force (6,) [N]; a gap leaves it."""
    if not np.all(np.isfinite(force)):
        return before
    same = np.abs(force - before.last) <= SAME
    return RepeatCount(force, np.where(same, before.times + 1.0, 1.0))


class ForceFaultDetector(LeafSystem):
    """Passes the measured force on while it is valid, and else NaN; see the module.

    .. pydrake_system::

        name: ForceFaultDetector
        input_ports:
        - state
        - force_measured
        output_ports:
        - force_valid

    - `state`: (𝔮, ζ) (2(6+n)) measured, for the attitude of the tip.
    - `force_measured`, `force_valid`: 𝔉_s (6), force in Σ_I [N, N m].

    The discrete state is that of `RepeatCount` (12), and the number of samples (1).

    Args:
        model: The controller's model.
        period: T, between two samples [s].
        repeats: m; 0: no detection, as a sensor without noise needs.
        tare: Time after its first sample at which detection begins [s]: a sensor that is tared may
            read zero all the time.
        largest: Norm of a force at the end of the range [N].
    """

    def __init__(self, model: UvmsModel, period: float, *, repeats: int = 3, tare: float = 0.0,
                 largest: float = np.inf):
        super().__init__()
        require(0.0 < period < np.inf, "period", period, "positive")
        require(repeats == 0 or repeats >= 2, "repeats", repeats, "0, or 2 or more")
        self._model, self._repeats, self._largest = model, repeats, largest
        self._passed = math.ceil(tare / period - 1e-6)
        self._state_port = self.DeclareVectorInputPort("state", 2 * model.size)
        self._port = self.DeclareVectorInputPort("force_measured", 6)
        self.DeclareDiscreteState(np.append(np.full(6, np.nan), np.zeros(6)))
        self.DeclareDiscreteState(1)
        if repeats:
            self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._look)
        self.DeclareVectorOutputPort("force_valid", 6, self._calc, {
            self.xd_ticket(), self._port.ticket()})

    @staticmethod
    def _remembered(context: Context) -> RepeatCount:
        state = context.get_discrete_state(0).value()
        return RepeatCount(state[:6], state[6:])

    def _look(self, context: Context, state: DiscreteValues) -> EventStatus:
        turns = context.get_discrete_state(1).value()
        state.set_value(1, turns + 1.0)
        if turns[0] < self._passed:
            return EventStatus.Succeeded()
        config, force = self._state_port.Eval(context)[: self._model.size], self._port.Eval(context)
        if not (np.all(np.isfinite(config)) and np.all(np.isfinite(force))):
            return EventStatus.Succeeded()
        attitude = self._model.task_pose(config)[3:6]
        R_WE = self._model.R_WT @ rotation_matrix(attitude)
        both = np.concatenate([force[:3], force[:3] @ R_WE])
        state.set_value(0, np.concatenate(counted(self._remembered(context), both)))
        return EventStatus.Succeeded()

    def _calc(self, context: Context, output: BasicVector) -> None:
        force = self._port.Eval(context)
        stuck = self._repeats and max(self._remembered(context).times) >= self._repeats
        none = stuck or not math.hypot(*force[:3]) < self._largest
        output.SetFromVector(np.full(6, np.nan) if none else force)

    @staticmethod
    def AddToBuilder(builder: DiagramBuilder, model: UvmsModel, period: float, *,
                     repeats: int = 3, tare: float = 0.0, largest: float = np.inf,
                     state: OutputPort, force_measured: OutputPort | None = None,
                     name: str = "force_fault_detector") -> "ForceFaultDetector":
        """Adds the detector; the caller connects `force_measured` if it is None."""
        watch = ForceFaultDetector(model, period, repeats=repeats, tare=tare, largest=largest)
        return added(builder, name, watch, state=state, force_measured=force_measured)
