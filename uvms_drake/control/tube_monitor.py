"""Watches the deviation of the real from the nominal motion against the tube, while it happens.

Two bounds are watched. The *set-wise* one is a number that exists before anything moves: it has the
largest ‖J_x‖ of the constraint set in it and is what the limits are tightened by. The
*trajectory-wise* one takes ‖J_x(𝔮(t))‖ as it comes; under the law `resolved` it is the solution of

    Ṙ = −k R + d̃,    Ė_b = −σ E_b + ‖J_b(𝔮(t))‖₂ R,    Ẇ = −(σ − μ(t)) W + R    from zero,

b a block of rows of J_x, μ the largest eigenvalue of the symmetric part of −J_x⁻¹J̇_x. By the proofs
in `tube.tubes`, ‖𝔯‖ ≤ R, ‖𝔢_b‖ ≤ E_b and ‖J_x⁻¹𝔢_y‖ ≤ W. It is never above the other one
while the robot is in the constraint set, and says how much of the distance is due to J_x.
"""

import math
from collections.abc import Mapping
from itertools import compress
from typing import NamedTuple, Self

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import (
    BasicVector,
    DiagramBuilder,
    EventStatus,
    LeafSystem,
    OutputPort,
    ValueProducer,
)

from uvms_drake.common.alarm import warn
from uvms_drake.common.errors import require
from uvms_drake.control.ancillary import AncillaryConfig, Resolved, motion, task_error
from uvms_drake.model.uvms_model import UvmsModel

FIELDS = ("task", "position", "orientation", "joints", "z", "r")
"""2-norms: of what the law feeds back (𝔢_y of `resolved`, 𝔢 of `transpose`), of its rows 𝔢_p [m],
𝔢_o [rad], 𝔢_q [rad], of 𝔷 = ζ − ζ̄ and of 𝔯 [m/s, rad/s]."""

ALARMS = ("set", "trajectory", "disturbance")
"""What can be left: the set-wise bound, the trajectory-wise bound, and ‖d‖₂ ≤ d̃."""

SAID = ("left the tube (set-wise)", "left the bound along the run", "disturbance above its bound")
"""What is said of each of `ALARMS` when it is left."""

REPORT_FIELDS = (
    *(f"{alarm}_exits" for alarm in ALARMS), *(f"{alarm}_first_exit" for alarm in ALARMS),
    *(f"worst_{bound}_{field}" for bound in ALARMS[:2] for field in FIELDS), "worst_disturbance")
"""Number of exits, time of the first one [s] (inf: none so far), largest ratios of deviation and
bound, and largest ‖d‖₂/d̃, over the samples so far."""

FLOOR = 1e-9
"""Rounding, where a bound is zero."""


class Deviation(NamedTuple):
    """The real motion relative to the nominal one, at an instant."""

    norms: np.ndarray
    """(6,) `FIELDS`."""
    e_y: np.ndarray
    """𝔢_y (6+n,)."""
    r: np.ndarray
    """𝔯 (6+n,)."""
    gains: np.ndarray
    """Of `resolved`, (5,) ‖J_x‖, its blocks' for position, orientation and joints, and 1."""
    mu: float
    """μ of `resolved` [1/s]."""
    z_gain: float
    """j of ‖𝔷‖ ≤ ‖𝔯‖ + j‖J_x⁻¹𝔢_y‖ + c (`resolved`): σ; of ‖𝔷‖ ≤ ‖𝔯‖ + j‖𝔢‖ (`transpose`):
    σ‖J(𝔮̄)‖."""
    z_offset: float
    """c of `resolved`: ‖J_x(𝔮)⁻¹(J_x(𝔮̄) − J_x(𝔮))ζ̄‖."""


def deviation(model: UvmsModel, config: AncillaryConfig, state: np.ndarray,
              nominal_state: np.ndarray) -> Deviation:
    """Returns the errors in which the law `config` has its tube.

    For `resolved`, 𝔯 = ζ − J_x(𝔮)⁻¹[J_x(𝔮̄)ζ̄ − σ𝔢_y]; for `transpose`, 𝔯 = 𝔷 + σJ(𝔮̄)ᵀ𝔢, or with
    `joints` 𝔷 + σJ_x(𝔮̄)ᵀ𝔢_y.

    Args:
        model: The controller's model.
        config: The law and its gains.
        state: (𝔮, ζ) measured (2(6+n),).
        nominal_state: (𝔮̄, ζ̄) (2(6+n),).
    """
    now = motion(model, state, nominal_state)
    (zeta, zeta_nominal), (J, J_nominal) = now.zeta, now.J_x
    e_y = task_error(*now.y)
    z = zeta - zeta_nominal
    if isinstance(config, Resolved):
        offset = now.inverse @ (J_nominal @ zeta_nominal) - zeta_nominal  # ζ_ref − ζ̄ at 𝔢_y = 0
        r, task = z - offset + config.sigma * now.inverse @ e_y, e_y
        turning = -now.inverse @ now.J_x_dot[0]
        gains, mu = _gains_and_growth(J, 0.5 * (turning + turning.T))
        z_gain, z_offset = config.sigma, _norm2(offset)
    else:
        rows = slice(None) if config.joints else slice(0, 6)
        J_fed, task = J_nominal[rows], e_y[rows]
        r = z + config.sigma * J_fed.T @ task
        gains, mu, z_offset = np.zeros(0), 0.0, 0.0
        z_gain = config.sigma * float(np.linalg.norm(J_fed, 2))
    norms = np.array([_norm2(x) for x in (task, e_y[:3], e_y[3:6], e_y[6:], z, r)])
    return Deviation(norms, e_y, r, gains, mu, z_gain, z_offset)


def _gains_and_growth(J_x: np.ndarray, turning: np.ndarray) -> tuple[np.ndarray, float]:
    """Returns `Deviation.gains` and `Deviation.mu`; `turning` is symmetric.

    ‖J‖² is the largest eigenvalue of J Jᵀ. The rows of the joints are unit vectors.
    """
    squares = J_x @ J_x.T
    whole, mu = np.linalg.eigvalsh(np.array([squares, turning]))[:, -1]
    blocks = np.linalg.eigvalsh(np.array([squares[:3, :3], squares[3:6, 3:6]]))[:, -1]
    return np.array([*np.sqrt([whole, *blocks]), 1.0, 1.0]), float(mu)


def beyond(norms: np.ndarray, bounds: np.ndarray | float, slack: float, floor: float
           ) -> np.ndarray:
    """Returns whether each norm is above (1 + slack) bound + floor, of any shape."""
    return norms > (1.0 + slack) * bounds + floor


def _norm2(x: np.ndarray) -> float:
    return math.sqrt(x @ x)


class TubeMonitor(LeafSystem):
    """Compares real and nominal motion with the tube at every sample; counts what leaves it.

    It warns of each exit on the logger `uvms_drake`, see `uvms_drake.common.alarm`.

    .. pydrake_system::

        name: TubeMonitor
        input_ports:
        - state
        - nominal_state
        - disturbance (optional)
        output_ports:
        - deviation
        - bound
        - ratio
        - report
        - alarm
        - e_y
        - r

    - `state`: (𝔮, ζ) measured (2(6+n)), in the paper's order.
    - `nominal_state`: (𝔮̄, ζ̄) (2(6+n)), from `NominalMpc`; continuous also where it plans anew.
    - `disturbance`: the simulated d (6+n), so that ‖d‖₂ > d̃ is noticed; unconnected means unknown.
    - `deviation` (6): `FIELDS`.
    - `bound` (6): the trajectory-wise bounds of `FIELDS`; inf where there is none.
    - `ratio` (12): `deviation` over the set-wise, then over the trajectory-wise bounds.
    - `report`: `REPORT_FIELDS`, as of the last sample.
    - `alarm` (3): 1 for each of `ALARMS` that was left at the last sample, 0 for the others.
    - `e_y` (6+n), `r` (6+n): 𝔢_y and 𝔯, for a disturbance that is aimed at them.

    The continuous state is R, the E_b of task, position, orientation and joints, and W
    (`resolved`), or the E and R of the comparison system (`transpose`); from zero, as the tube
    starts. The discrete state is one flag for each of `ALARMS`, whether it was outside at the last
    sample, and the report. There is no feedthrough from `disturbance` to any output. The instant at
    which a simulation ends is not a sample.

    ‖𝔷‖ is compared with R + σW + c or R + jE, where c and j (see `Deviation`) are known along the
    run.

    Args:
        model: The controller's model.
        config: The law and its gains.
        d_bound: d̃, bound of ‖d‖₂.
        radii: Set-wise bounds by the names of `FIELDS`; what is missing is not checked.
        comparison: A (2, 2) of (Ė, Ṙ) = A (E, R) + (0, d̃), for the law `transpose`; `resolved` does
            not read it. None: no trajectory-wise bound, because the constants allow for none.
        period: Of the samples [s]; zero for one at the beginning of each step of the simulation,
            which leaves the steps as they are.
        slack: An exit is a deviation above (1 + slack) bound + floor. A disturbance of constant
            direction takes ‖𝔯‖ to R exactly, so the integrator's error decides which is larger. It
            is of the order of the integrator in the step: with `runge_kutta3` on a robot that meets
            a wall, 0.7 % of R at 0.02 s and 0.01 % at 0.005 s, and 0.001 % of E_b.
        floor: See `slack`; a ratio is that to the bound or to the floor, whichever is larger. What
            the integrator leaves of the exact cascade where the bound is zero.
    """

    def __init__(self, model: UvmsModel, config: AncillaryConfig, d_bound: float,
                 radii: Mapping[str, float], *, comparison: np.ndarray | None = None,
                 period: float = 0.01, slack: float = 1e-6, floor: float = FLOOR):
        super().__init__()
        require(0.0 <= d_bound < np.inf, "d_bound", d_bound, "zero or positive")
        require(0.0 <= period < np.inf, "period", period, "zero or positive")
        require(0.0 <= slack < np.inf, "slack", slack, "zero or positive")
        require(set(radii) <= set(FIELDS), "radii", list(radii), f"among {', '.join(FIELDS)}")
        require(0.0 < floor < np.inf, "floor", floor, "positive")
        self._model, self._law, self._d_bound = model, config, d_bound
        self._slack, self._floor = slack, floor
        self._radii = np.array([radii.get(field, np.inf) for field in FIELDS])
        require(not np.any(self._radii < 0.0), "radii", self._radii, "zero or positive")
        self._comparison = comparison
        self._declare_bounds()
        self._declare_ports()
        first = np.zeros(len(ALARMS) + len(REPORT_FIELDS))
        first[2 * len(ALARMS): 3 * len(ALARMS)] = np.inf
        self.DeclareDiscreteState(first)
        if period > 0.0:
            self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)
        else:
            self.DeclarePerStepDiscreteUpdateEvent(self._update)

    def _declare_bounds(self) -> None:
        """Declares the continuous state, from which the trajectory-wise bounds follow."""
        if isinstance(self._law, Resolved):
            self.DeclareContinuousState(6)
        elif self._comparison is not None:
            stable = np.shape(self._comparison) == (2, 2) and np.max(
                np.linalg.eigvals(self._comparison).real) < 0.0
            require(bool(stable), "comparison", self._comparison, "a stable 2×2 matrix")
            self.DeclareContinuousState(2)

    def _disturbance_size(self) -> int:
        return self._model.size

    def _declare_ports(self) -> None:
        size = self._model.size
        self._state_port = self.DeclareVectorInputPort("state", 2 * size)
        self._nominal_port = self.DeclareVectorInputPort("nominal_state", 2 * size)
        self._disturbance_port = self.DeclareVectorInputPort(
            "disturbance", self._disturbance_size())
        self._deviation = self.DeclareCacheEntry(
            description="deviation of the real from the nominal state",
            value_producer=ValueProducer(
                allocate=lambda: AbstractValue.Make(()), calc=self._calc_deviation),
            prerequisites_of_calc={self.input_port_ticket(port.get_index())
                                   for port in (self._state_port, self._nominal_port)})
        now = {self._deviation.ticket()}
        bound = now | {self.xc_ticket()}
        for name, width, calc, prerequisites in (
            ("deviation", len(FIELDS), lambda c: self._deviation.Eval(c).norms, now),
            ("bound", len(FIELDS), self._bounds, bound),
            ("ratio", 2 * len(FIELDS), self._ratios, bound),
            ("report", len(REPORT_FIELDS),
             lambda c: c.get_discrete_state_vector().value()[len(ALARMS):], {self.xd_ticket()}),
            ("alarm", len(ALARMS),
             lambda c: c.get_discrete_state_vector().value()[: len(ALARMS)], {self.xd_ticket()}),
            ("e_y", size, lambda c: self._deviation.Eval(c).e_y, now),
            ("r", size, lambda c: self._deviation.Eval(c).r, now),
        ):
            self.DeclareVectorOutputPort(
                name, BasicVector(width),
                lambda context, output, calc=calc: output.SetFromVector(calc(context)),
                prerequisites)

    def _calc_deviation(self, context, value):
        value.set_value(deviation(self._model, self._law, self._state_port.Eval(context),
                                  self._nominal_port.Eval(context)))

    def DoCalcTimeDerivatives(self, context, derivatives):  # noqa: D102  Drake's name and meaning
        x = context.get_continuous_state_vector().CopyToVector()
        if isinstance(self._law, Resolved):
            now = self._deviation.Eval(context)
            x_dot = -self._law.sigma * x
            x_dot[0] = self._d_bound - self._law.k * x[0]
            x_dot[1:] += now.gains * x[0]
            x_dot[-1] += now.mu * x[-1]
            derivatives.SetFromVector(x_dot)
        elif len(x):
            derivatives.SetFromVector(self._comparison @ x + np.array([0.0, self._d_bound]))

    def _bounds(self, context) -> np.ndarray:
        """Returns the trajectory-wise bounds of `FIELDS`."""
        x = context.get_continuous_state_vector().CopyToVector()
        if isinstance(self._law, Resolved):
            R, blocks, inside = x[0], x[1:5], x[5]
        elif len(x):
            inside, R = x
            blocks = np.array([inside, inside, inside, np.inf])
        else:
            return np.full(len(FIELDS), np.inf)
        now = self._deviation.Eval(context)
        return np.array([*blocks, R + now.z_gain * inside + now.z_offset, R])

    def _ratios(self, context) -> np.ndarray:
        norms = self._deviation.Eval(context).norms
        bounds = np.concatenate([self._radii, self._bounds(context)])
        return np.tile(norms, 2) / np.maximum(bounds, self._floor)

    def _update(self, context, discrete_state):
        old = context.get_discrete_state_vector().value()
        outside, exits, first, worst = np.split(old, [3, 6, 9])
        norms = np.tile(self._deviation.Eval(context).norms, 2)
        bounds = np.concatenate([self._radii, self._bounds(context)])
        left_parts = beyond(norms, bounds, self._slack, self._floor)
        d = 0.0
        if self._disturbance_port.HasValue(context):
            d = float(np.linalg.norm(self._disturbance_port.Eval(context)))
        is_outside = np.array([np.any(left_parts[:6]), np.any(left_parts[6:]),
                               beyond(d, self._d_bound, self._slack, FLOOR)])
        left = is_outside & (outside == 0.0)
        for text in compress(SAID, left):
            warn(context.get_time(), text)
        ratios = np.append(norms / np.maximum(bounds, self._floor),
                           d / max(self._d_bound, FLOOR))
        discrete_state.set_value(np.concatenate([
            is_outside, exits + left, np.where(left, np.minimum(first, context.get_time()), first),
            np.maximum(worst, ratios)]))
        return EventStatus.Succeeded()

    @classmethod
    def AddToBuilder(cls, builder: DiagramBuilder, model: UvmsModel, config: AncillaryConfig,
                     bound: float, radii: Mapping[str, float], *, state: OutputPort,
                     nominal_state: OutputPort, disturbance: OutputPort | None = None,
                     name: str = "tube_monitor", **options) -> Self:
        """Adds the monitor and connects it; `options` are those of the constructor."""
        monitor = cls(model, config, bound, radii, **options)
        builder.AddNamedSystem(name, monitor)
        builder.Connect(state, monitor.GetInputPort("state"))
        builder.Connect(nominal_state, monitor.GetInputPort("nominal_state"))
        if disturbance is not None:
            builder.Connect(disturbance, monitor.GetInputPort("disturbance"))
        return monitor
