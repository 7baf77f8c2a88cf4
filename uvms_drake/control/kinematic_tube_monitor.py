"""`TubeMonitor` for the kinematic model χ̇ = J(𝔮)ζ + w, ‖w‖₂ ≤ w̃, whose input is ζ.

The law leaves an error that shrinks on its own and is driven by w: D⁺‖𝔢‖ ≤ −a‖𝔢‖ + b. The
trajectory-wise bound is the solution of Ė = −aE + b from the first deviation; see `resolved_rate`
and `transpose_rate`. The set-wise bounds come from the caller, see `kinematic_tubes`.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from pydrake.systems.framework import (
    BasicVector,
    EventStatus,
)

from uvms_drake.common.errors import require
from uvms_drake.control.ancillary import AncillaryConfig, Resolved
from uvms_drake.control.tube_monitor import FLOOR, TubeMonitor
from uvms_drake.model.uvms_model import UvmsModel

NOT_STARTED = -1.0
"""E before the first sample."""


class ErrorRate(NamedTuple):
    """Of D⁺‖𝔢‖ ≤ −a‖𝔢‖ + b."""

    decay: float
    """a [1/s]."""
    drive: float
    """b [m/s, rad/s]."""


def resolved_rate(sigma: float, w_bound: float) -> ErrorRate:
    """Returns the rate of 𝔢_y, or of any of its rows, under the law `resolved`.

    𝔢̇_y = −σ𝔢_y + (w, 0) exactly; a constant w takes ‖𝔢_y‖ to its bound. The rows of the joints are
    not driven: for them, w̃ is zero.
    """
    return ErrorRate(sigma, w_bound)


def transpose_rate(sigma: float, J: np.ndarray, J_nominal: np.ndarray, zeta: np.ndarray,
                   w_bound: float) -> ErrorRate:
    """Returns the rate of 𝔢 = χ − χ̄ under the law `transpose`.

    With ζ = ζ̄ − σJ(𝔮̄)ᵀ𝔢, 𝔢̇ = J(𝔮)ζ − J(𝔮̄)ζ̄ + w = −σJ(𝔮̄)J(𝔮̄)ᵀ𝔢 + (J(𝔮) − J(𝔮̄))ζ + w. The middle
    term is taken as it comes: no constant bounds it by ‖𝔢‖, since the arm's self-motion, on which
    the law does not act, is in it. Nothing is said about the joints; with J_x and 𝔢_y in place of J
    and 𝔢, it is.

    Args:
        sigma: σ [1/s].
        J: J(𝔮) (6, 6+n).
        J_nominal: J(𝔮̄) (6, 6+n).
        zeta: The real ζ (6+n,).
        w_bound: w̃, bound of ‖w‖₂.
    """
    smallest = float(np.linalg.eigvalsh(J_nominal @ J_nominal.T)[0])
    return ErrorRate(
        sigma * smallest, float(np.linalg.norm((J - J_nominal) @ zeta)) + w_bound)


class KinematicTubeMonitor(TubeMonitor):
    """Compares real and nominal motion with the tube at every sample; counts what leaves it.

    .. pydrake_system::

        name: KinematicTubeMonitor
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
        - e

    - `state`: (𝔮, ζ) (2(6+n)), in the paper's order, ζ as it is commanded.
    - `nominal_state`: (𝔮̄, ζ̄) (2(6+n)); 𝔮̄ is continuous, ζ̄ may jump where it is planned anew.
    - `disturbance`: the simulated w (6), so that ‖w‖₂ > w̃ is noticed; unconnected means unknown.
    - `deviation` (6), `bound` (6), `ratio` (12), `report`, `alarm` (3), `e_y` (6+n), `r` (6+n): see
      `TubeMonitor`. 𝔯 is zero where ζ is what the law commands, and zero is its trajectory-wise
      bound; where it is above, the bounds of the others have no ground.
    - `e` (6): 𝔢 = χ − χ̄, for a `TaskAdversary`.

    The continuous state is E of task, position, orientation and joints (`resolved`) or of 𝔢
    (`transpose`), `NOT_STARTED` before the first sample and the deviation at the first one. The
    discrete state is that of `TubeMonitor`. There is no feedthrough from `disturbance` to any
    output. The instant at which a simulation ends is not a sample.

    ‖𝔷‖ is compared with σ‖J_x(𝔮)⁻¹‖E + ‖J_x(𝔮)⁻¹(J_x(𝔮̄) − J_x(𝔮))ζ̄‖ or σ‖J(𝔮̄)‖E, along the run.

    Args:
        model: The controller's model.
        config: The law and its σ; k has no meaning here.
        w_bound: w̃, bound of ‖w‖₂.
        radii: Set-wise bounds by the names of `FIELDS`; what is missing is not checked.
        period: Of the samples [s]; zero for one at the beginning of each step of the simulation.
        slack: An exit is a deviation above (1 + slack) bound + floor; see `TubeMonitor`.
        floor: See `slack`.
    """

    def __init__(self, model: UvmsModel, config: AncillaryConfig, w_bound: float,
                 radii: Mapping[str, float], *, period: float = 0.01, slack: float = 1e-6,
                 floor: float = FLOOR):
        require(0.0 <= w_bound < np.inf, "w_bound", w_bound, "zero or positive")
        require(bool(0.0 < config.sigma < np.inf), "sigma", config.sigma, "positive")
        super().__init__(
            model, config, w_bound, radii, period=period, slack=slack, floor=floor)
        self.DeclareVectorOutputPort(
            "e", 6,
            lambda context, output: output.SetFromVector(self._deviation.Eval(context).e_y[:6]),
            {self._deviation.ticket()})
        # An unrestricted update comes before the discrete update of the same instant.
        if period > 0.0:
            self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._start)
        else:
            self.DeclarePerStepUnrestrictedUpdateEvent(self._start)

    def _declare_bounds(self) -> None:
        self._bounded = 4 if isinstance(self._law, Resolved) else 1
        self.DeclareContinuousState(BasicVector(np.full(self._bounded, NOT_STARTED)))

    def _disturbance_size(self) -> int:
        return 6

    def _start(self, context, state):
        if self._has_started(context):
            return EventStatus.DidNothing()
        state.get_mutable_continuous_state().get_mutable_vector().SetFromVector(
            self._deviation.Eval(context).norms[: self._bounded])
        return EventStatus.Succeeded()

    @staticmethod
    def _has_started(context) -> bool:
        return context.get_continuous_state_vector()[0] != NOT_STARTED

    def DoCalcTimeDerivatives(self, context, derivatives):  # noqa: D102  Drake's name and meaning
        if not self._has_started(context):
            derivatives.SetFromVector(np.zeros(self._bounded))
            return
        E = context.get_continuous_state_vector().CopyToVector()
        sigma, w_bound = self._law.sigma, self._d_bound
        if isinstance(self._law, Resolved):
            driven, joints = resolved_rate(sigma, w_bound), resolved_rate(sigma, 0.0)
            decay = driven.decay
            drive = np.array([*[driven.drive] * 3, joints.drive])
        else:
            q, zeta = np.split(self._state_port.Eval(context), 2)
            q_nominal = self._nominal_port.Eval(context)[: self._model.size]
            rows = slice(None) if self._law.joints else slice(0, 6)
            J, J_nominal = self._model.task_jacobian(np.array([q, q_nominal]))[:, rows]
            decay, drive = transpose_rate(sigma, J, J_nominal, zeta, w_bound)
        derivatives.SetFromVector(drive - decay * E)

    def _bounds(self, context) -> np.ndarray:
        """Returns the trajectory-wise bounds of `FIELDS`."""
        now = self._deviation.Eval(context)
        E = now.norms[: self._bounded]
        if self._has_started(context):
            E = context.get_continuous_state_vector().CopyToVector()
        if isinstance(self._law, Resolved):
            config = self._state_port.Eval(context)[: self._model.size]
            smallest = np.linalg.svd(self._model.task_jacobian(config), compute_uv=False)[-1]
            return np.array([*E, self._law.sigma / smallest * E[0] + now.z_offset, 0.0])
        joints = E[0] if self._law.joints else np.inf
        return np.array([*np.repeat(E, 3), joints, now.z_gain * E[0], 0.0])
