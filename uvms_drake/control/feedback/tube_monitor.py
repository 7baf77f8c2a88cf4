"""Monitor of the deviation of the real from the nominal motion against the tube, at run time.

Two bounds are compared with. The *set-wise* one exists before anything moves: it contains the
largest ‖J_x‖ of the constraint set, and the limits are tightened by it. The *trajectory-wise* one
has ‖J_x(𝔮(t))‖ along the run: the law's own bound, see `Resolved.run_bound`. It is never above the
other one while the robot is in the constraint set; their distance is due to J_x.
"""

import math
from collections.abc import Mapping
from itertools import compress
from typing import NamedTuple

import numpy as np
from pydrake.common.value import Value
from pydrake.systems import framework

from uvms_drake.common.alarm import warn
from uvms_drake.common.errors import require
from uvms_drake.common.schema import check_values
from uvms_drake.common.wiring import WiredSystem, cached, output_of
from uvms_drake.control.laws.law import FIELDS, AncillaryLaw, Pair, pair_of
from uvms_drake.model.signals.sensor_actuator import SAFETY
from uvms_drake.model.uvms_model import UvmsModel

ALARMS = ("set", "trajectory", "disturbance")
"""Monitored bounds: the set-wise one, the one along the run, and ‖Ŵ⁻¹d‖₂ ≤ d̃."""

SAID = ("left the tube (set-wise)", "left the bound along the run", "disturbance above its bound")
"""Warning for each of `ALARMS` when it is exceeded."""

TUBE_REPORT = (
    *(f"{alarm}_exits" for alarm in ALARMS), *(f"{alarm}_first_exit" for alarm in ALARMS),
    *(f"worst_{bound}_{field}" for bound in ALARMS[:2] for field in FIELDS), "worst_disturbance")
"""Entries about the samples so far: number of exits, time of the first one [s] (inf: none), largest
ratios of deviation and bound, and largest ‖Ŵ⁻¹d‖₂/d̃."""

FLOOR = 1e-9
"""Deviation that counts as rounding where a bound is zero."""


class _Samples(NamedTuple):
    """Discrete state of a `TubeMonitor`: flags, and the parts of its report."""

    outside: np.ndarray
    """Flags: 1 for each of `ALARMS` that was exceeded at the last sample, else 0 (3,)."""
    exits: np.ndarray
    """Number of exits of each (3,)."""
    first: np.ndarray
    """Time of the first exit of each (3,) [s]."""
    worst: np.ndarray
    """Largest ratios of deviation and bound, and ‖Ŵ⁻¹d‖₂/d̃ (13,)."""

    @staticmethod
    def of(state: np.ndarray) -> "_Samples":
        """Returns the parts of a state (22,)."""
        n = len(ALARMS)
        return _Samples(state[:n], state[n: 2 * n], state[2 * n: 3 * n], state[3 * n:])


def beyond(norms: np.ndarray | float, bounds: np.ndarray | float, slack: float, floor: float
           ) -> np.ndarray | bool:
    """Returns whether each norm is above (1 + slack) bound + floor, of any shape."""
    return norms > (1.0 + slack) * bounds + floor


class TubeMonitor(WiredSystem):
    """Monitor of the deviation from the nominal motion; it counts exits from the tube.

    It warns of each exit on the logger `uvms_drake`, see `uvms_drake.common.alarm`.

    .. pydrake_system::

        name: TubeMonitor
        input_ports:
        - state
        - nominal_state
        - disturbance (optional)
        - pair (optional)
        - safety (optional)
        output_ports:
        - deviation
        - bound
        - ratio
        - report
        - alarm
        - e_y
        - r

    - `state`: (𝔮, ζ) (2(6+n)), in the paper's order.
    - `nominal_state`: (𝔮̄, ζ̄) (2(6+n)), of `NominalMpc`.
    - `disturbance`: simulated d, of the size of Ŵ, compared with d̃; unknown if unconnected.
    - `pair`: `Pair` of these two states; computed here if unconnected.
    - `safety` (5): of a `Supervisor`; after a trip, whose retreat has no tube, nothing is counted.
    - `deviation` (6): `FIELDS`.
    - `bound` (6): trajectory-wise bounds of `FIELDS`; inf where there is none.
    - `ratio` (12): `deviation` over the set-wise, then over the trajectory-wise bounds.
    - `report`: `TUBE_REPORT` at the last sample.
    - `alarm` (3): 1 for each of `ALARMS` that was exceeded at the last sample, 0 for the others.
    - `e_y` (6+n), `r` (6+n): 𝔢_y and 𝔯, for an adversarial disturbance.

    The continuous state is that of the law's bound along the run, see `AncillaryLaw.run_bound`:
    from zero, as the tube starts.
    The discrete state is one flag for each of `ALARMS`, whether it was outside at the last
    sample, and the report. There is no feedthrough from `disturbance` to any output. The instant at
    which a simulation ends is not a sample.

    Args:
        model: The controller's model.
        law: The law and its gains.
        d_bound: d̃, bound of ‖Ŵ⁻¹d‖₂.
        radii: Set-wise bounds by the names of `FIELDS`; others are not checked.
        weights: Diagonal of Ŵ, one for each component of the disturbance, at most 1; 1 for a ball
            of 6 + n.
        along_run: Whether the law's bound along the run is monitored; it holds for d alone.
        period: Period of the samples [s]; zero for one at the beginning of each step of the
            simulation, which does not change the steps.
        begin: Start of the monitoring [s], when observers have settled.
        slack: An exit is a deviation above (1 + slack) bound + floor. A disturbance of constant
            direction takes ‖𝔯‖ to R exactly, so the integrator's error decides which is larger. It
            is of the order of the integrator in the step: with `runge_kutta3` on a robot that meets
            a wall, 0.7 % of R at 0.02 s and 0.01 % at 0.005 s, and 0.001 % of E_b.
        floor: See `slack`; error of the integrator where the bound is zero. Ratios are to the
            larger one of bound and floor.
    """

    def __init__(self, model: UvmsModel, law: AncillaryLaw, d_bound: float,
                 radii: Mapping[str, float], *, weights: np.ndarray | float = 1.0,
                 along_run: bool = True, period: float = 0.01,
                 begin: float = 0.0, slack: float = 1e-6, floor: float = FLOOR):
        super().__init__()
        check_values(law)
        require(0.0 <= d_bound < np.inf, "d_bound", d_bound, "zero or positive")
        require(0.0 <= period < np.inf, "period", period, "zero or positive")
        require(0.0 <= begin < np.inf, "begin", begin, "zero or positive")
        require(0.0 <= slack < np.inf, "slack", slack, "zero or positive")
        require(set(radii) <= set(FIELDS), "radii", list(radii), f"among {', '.join(FIELDS)}")
        require(0.0 < floor < np.inf, "floor", floor, "positive")
        # The bounds: set-wise by `radii`, along the run by the law.
        self._model, self._law, self._d_bound = model, law, d_bound
        self._begin, self._slack, self._floor = begin, slack, floor
        self._radii = np.array([radii.get(field, np.inf) for field in FIELDS])
        require(not np.any(self._radii < 0.0), "radii", self._radii, "zero or positive")
        self._weights = np.full(model.size, weights) if np.ndim(weights) == 0 else (
            np.asarray(weights, dtype=float))
        self._along = None
        if along_run:
            self._along = law.run_bound(d_bound, self._weights)
        self._declare_ports(len(self._weights))
        # The samples, which a simulation takes at a period or at its own steps.
        never = np.full(len(ALARMS), np.inf)
        none = np.zeros(len(ALARMS))
        self.DeclareDiscreteState(np.concatenate(
            _Samples(none, none, never, np.zeros(2 * len(FIELDS) + 1))))
        if period > 0.0:
            self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)
        else:
            self.DeclarePerStepDiscreteUpdateEvent(self._update)
        if self._along is None:
            return
        self.DeclareContinuousState(framework.BasicVector(np.zeros(self._along.size)))

    def _declare_ports(self, disturbance_size: int) -> None:
        size = self._model.size
        self._state_port = self.DeclareVectorInputPort("state", 2 * size)
        self._nominal_port = self.DeclareVectorInputPort("nominal_state", 2 * size)
        self._disturbance_port = self.DeclareVectorInputPort("disturbance", disturbance_size)
        self._pair_port = self.DeclareAbstractInputPort("pair", Value(object()))
        self._safety_port = self.DeclareVectorInputPort("safety", len(SAFETY))
        self._pair = cached(self, "the two motions", self._pair_now, {
            self.input_port_ticket(port.get_index())
            for port in (self._state_port, self._nominal_port, self._pair_port)})
        self._deviation = cached(
            self, "deviation of the real from the nominal motion",
            lambda c: self._law.deviation(self._pair.Eval(c)), {self._pair.ticket()})
        now = {self._deviation.ticket()}
        bound = now | {self._pair.ticket(), self.xc_ticket()}
        for name, width, calc, prerequisites in (
            ("deviation", len(FIELDS), lambda c: self._deviation.Eval(c).norms, now),
            ("bound", len(FIELDS), self._bounds, bound),
            ("ratio", 2 * len(FIELDS), self._ratios, bound),
            ("report", len(TUBE_REPORT),
             lambda c: np.concatenate(self._samples(c)[1:]), {self.xd_ticket()}),
            ("alarm", len(ALARMS), lambda c: self._samples(c).outside, {self.xd_ticket()}),
            ("e_y", size, lambda c: self._deviation.Eval(c).e_y, now),
            ("r", size, lambda c: self._deviation.Eval(c).r, now),
        ):
            output_of(self, name, width, calc, prerequisites)

    def _pair_now(self, context: framework.Context) -> Pair:
        if self._pair_port.HasValue(context):
            return self._pair_port.Eval(context)
        return pair_of(self._model, self._state_port.Eval(context),
                       self._nominal_port.Eval(context))

    def DoCalcTimeDerivatives(  # noqa: D102  Drake's name and meaning
            self, context: framework.Context, derivatives: framework.ContinuousState) -> None:
        if self._along is None:
            return
        x = context.get_continuous_state_vector().CopyToVector()
        derivatives.SetFromVector(self._along.rate(x, self._pair.Eval(context)))

    def _bounds(self, context: framework.Context) -> np.ndarray:
        """Returns the trajectory-wise bounds of `FIELDS`."""
        if self._along is None:
            return np.full(len(FIELDS), np.inf)
        x = context.get_continuous_state_vector().CopyToVector()
        return self._along.bounds(x, self._pair.Eval(context))

    def _ratios(self, context: framework.Context) -> np.ndarray:
        bounds = np.concatenate([self._radii, self._bounds(context)])
        return np.tile(self._deviation.Eval(context).norms, 2) / np.maximum(bounds, self._floor)

    @staticmethod
    def _samples(context: framework.Context) -> _Samples:
        return _Samples.of(context.get_discrete_state_vector().value())

    def _update(self, context: framework.Context, discrete_state: framework.DiscreteValues
                ) -> framework.EventStatus:
        old = self._samples(context)
        # Bounds that are exceeded now; before `begin` deviations do not count.
        retreats = (self._safety_port.HasValue(context)
                    and self._safety_port.Eval(context)[0] > 0.0)
        counts = context.get_time() >= self._begin and not retreats
        norms = self._deviation.Eval(context).norms if counts else np.zeros(len(FIELDS))
        bounds = np.array([self._radii, self.GetOutputPort("bound").Eval(context)])
        set_wise, along = np.any(beyond(norms, bounds, self._slack, self._floor), axis=1)
        d = 0.0
        if self._disturbance_port.HasValue(context) and not retreats:
            relative = self._disturbance_port.Eval(context) / self._weights
            d = math.sqrt(relative @ relative)
        is_outside = np.array([set_wise, along, beyond(d, self._d_bound, self._slack, FLOOR)])
        # Alarms for those that have just been exceeded.
        exits, first = old.exits, old.first
        if (left := is_outside & (old.outside == 0.0)).any():
            for text in compress(SAID, left):
                warn(context.get_time(), text)
            exits = exits + left
            first = np.where(left, np.minimum(first, context.get_time()), first)
        worst = old.worst.copy()
        np.maximum(worst[:-1], (norms / np.maximum(bounds, self._floor)).ravel(), out=worst[:-1])
        worst[-1] = max(worst[-1], d / max(self._d_bound, FLOOR))
        discrete_state.set_value(np.concatenate([is_outside, exits, first, worst]))
        return framework.EventStatus.Succeeded()
