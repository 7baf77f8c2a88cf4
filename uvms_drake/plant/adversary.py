"""Adversarial disturbances, with ‖Ŵ⁻¹d(t)‖₂ ≤ d̃ at all times.

State-dependent ones read the error that they drive through ports, and know the robot's geometry,
but not the controller. `make_uvms_plant` with `disturbance=None` has an input port for them.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from pydrake.systems import framework

from uvms_drake.common.constraints import Finite, NotNegative, OneOf, Positive
from uvms_drake.common.errors import require
from uvms_drake.common.wiring import WiredSystem
from uvms_drake.model.uvms_model import UvmsModel
from uvms_drake.plant.disturbance import Disturbance, unit_vector

AIM_FROM = 1e-6
"""‖Ŵ⁻¹𝔯‖, ‖ŴJ_bᵀ𝔢_b‖ or ‖𝔢‖ at which the disturbance is halfway between fixed direction and aim."""

PREVIEW_TIME = 0.2
"""Prediction time of `predictive` [s]."""
PREVIEW_ITERATIONS = 12

KINDS = ("along_r", "along_task_error", "leading", "predictive", "constant", "sinusoid",
         "bang_bang", "per_channel")
ROWS = {"all": slice(None), "position": slice(0, 3), "orientation": slice(3, 6),
        "joints": slice(6, None)}


@dataclass
class AdversarialDisturbance(Disturbance):
    """A disturbance d = d̃Ŵe of the full size, ‖e‖ = 1, or of |sin| of that for `sinusoid`.

    - `along_r`: e along Ŵ⁻¹𝔯, which keeps ‖Ŵ⁻¹𝔯‖ at the solution of Ṙ = −kR + d̃.
    - `along_task_error`: e along ŴJ_b(𝔮)ᵀ𝔢_b, b the block of `rows`: no d drives ‖𝔢_b‖ more.
    - `leading`: e along the right-singular vector of J_b(𝔮)Ŵ with the largest singular value.
    - `predictive`: the d that maximises ‖𝔢_b‖ after `PREVIEW_TIME` without feedback.
    - `constant`, `sinusoid`, `bang_bang`: e a fixed direction times 1, a sine, its sign.
    - `per_channel`: a single component, its sign as of `bang_bang`.

    Where 𝔯 or 𝔢_y vanishes, as at the start, the first two have the fixed direction. `leading` has
    the sign of a non-negative inner product with the fixed direction.
    """

    kind: Annotated[str, OneOf(*KINDS)] = "along_r"
    rows: Annotated[str, OneOf(*ROWS)] = "all"
    """Block of rows of J_x to drive."""
    direction: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """The fixed direction of e (6+n), of any length; empty means the same in all components."""
    channel: Annotated[int, NotNegative] = 0
    """Component of `per_channel`, 0 to 5+n."""
    period: Annotated[float, Positive] = 1.0
    """Period of `sinusoid`, `bang_bang` and `per_channel` [s]."""
    phase: Annotated[float, Finite] = 0.0
    """Phase of the sine at t = 0 [rad]."""

    @property
    def label(self) -> str:
        """Kind of the disturbance."""
        return self.kind

    def add_to(self, builder: framework.DiagramBuilder, model: UvmsModel, seed: int,
               signals: Mapping[str, framework.OutputPort]) -> framework.OutputPort:
        """Adds an `Adversary`; see `Disturbance`."""
        require("e_y" in signals, "kind", self.kind, "another: a function of time alone, or in a "
                "station with a tube MPC, which has the errors that aim it")
        return Adversary.AddToBuilder(
            builder, model, self, state=signals["state"], e_y=signals["e_y"],
            r=signals["r"]).get_output_port()


def toward(aim: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Returns a unit vector along `aim`, or along the unit vector `direction` where that is zero.

    It is continuous but where `aim` = −`AIM_FROM` `direction`.
    """
    vector = aim + AIM_FROM * direction
    return unit_vector(vector, len(aim)) if np.any(vector) else direction


class Adversary(WiredSystem):
    """A disturbance d with ‖Ŵ⁻¹d‖₂ ≤ d̃ that is aimed at the tube.

    .. pydrake_system::

        name: Adversary
        input_ports:
        - state (for along_task_error, leading, predictive)
        - e_y (for along_task_error, predictive)
        - r (for along_r, predictive)
        output_ports:
        - disturbance

    - `state`: (𝔮, ζ) (2(6+n)), in the paper's order.
    - `e_y`, `r` (6+n): 𝔢_y and 𝔯, of a `TubeMonitor`.
    - `disturbance` (6+n) [m/s², rad/s²]: d, in the paper's order.

    The square waves have one discrete state, their sign, which is updated when it changes: an
    integration step ends there. There is no other state.

    Args:
        model: The robot's geometry.
        settings: Kind, bound, weights and shape of the disturbance.
    """

    def __init__(self, model: UvmsModel, settings: AdversarialDisturbance):
        super().__init__()
        size = model.size
        self._weights, self._axes = settings.relative_weights(size), settings.axes(size)
        require(settings.channel < size, "channel", settings.channel, f"0 to {size - 1}")
        self._model, self._settings = model, settings
        self._direction = unit_vector(settings.direction, size)
        if settings.kind == "per_channel":
            self._direction = unit_vector(np.eye(size)[settings.channel], size)
        self._state_port = self.DeclareVectorInputPort("state", 2 * size)
        self._e_y_port = self.DeclareVectorInputPort("e_y", size)
        self._r_port = self.DeclareVectorInputPort("r", size)
        self._has_sign = settings.kind in ("bang_bang", "per_channel")
        if self._has_sign:
            self._declare_sign(settings)
        state, e_y, r = (self.input_port_ticket(port.get_index()) for port in (
            self._state_port, self._e_y_port, self._r_port))
        prerequisites = {
            "along_r": {r}, "along_task_error": {state, e_y}, "leading": {state},
            "predictive": {state, e_y, r}, "constant": {self.nothing_ticket()},
            "sinusoid": {self.time_ticket()}}
        self.DeclareVectorOutputPort(
            "disturbance", size, self._calc_disturbance,
            prerequisites.get(settings.kind, {self.xd_ticket()}))

    def _declare_sign(self, settings: AdversarialDisturbance) -> None:
        self._half = 0.5 * settings.period
        shift = settings.phase / np.pi
        self._sign_at = lambda time: 1.0 - 2.0 * (np.floor(time / self._half + shift + 1e-6) % 2.0)
        self.DeclareDiscreteState([self._sign_at(0.0)])
        self.DeclareInitializationDiscreteUpdateEvent(self._update_sign)
        self.DeclarePeriodicDiscreteUpdateEvent(
            self._half, self._half * float(-shift % 1.0), self._update_sign)

    def _update_sign(
        self, context: framework.Context, discrete_state: framework.DiscreteValues) -> None:
        discrete_state.set_value([self._sign_at(context.get_time())])

    def _calc_disturbance(self, context: framework.Context, output: framework.BasicVector) -> None:
        match self._settings.kind:
            case "along_r":
                e = toward(self._r_port.Eval(context) / self._weights, self._direction)
            case "along_task_error":
                e_b = self._e_y_port.Eval(context)[ROWS[self._settings.rows]]
                e = toward(self._jacobian(context).T @ e_b, self._direction)
            case "leading":
                leading = np.linalg.svd(self._jacobian(context))[2][0]
                sign = -1.0 if leading @ self._direction < 0.0 else 1.0
                e = unit_vector(sign * leading, self._model.size)
            case "predictive":
                e = self._predictive(context)
            case "constant":
                e = self._direction
            case "sinusoid":
                angle = 2.0 * np.pi * context.get_time() / self._settings.period
                e = self._direction * np.sin(angle + self._settings.phase)
            case _:
                e = self._direction * context.get_discrete_state_vector().value()[0]
        output.SetFromVector(self._axes * e)

    def _predictive(self, context: framework.Context) -> np.ndarray:
        """Returns e with the largest ‖𝔢_b + T J_b𝔯 + ½T² J_b d̃Ŵe‖, T = `PREVIEW_TIME`.

        The generalised power method increases it in each step, since it is convex in e.
        """
        J = self._jacobian(context)
        drift = self._e_y_port.Eval(context)[ROWS[self._settings.rows]]
        drift = drift + PREVIEW_TIME * (J @ (self._r_port.Eval(context) / self._weights))
        reach = 0.5 * PREVIEW_TIME**2 * self._settings.d_bound * J
        e = toward(J.T @ drift, self._direction)
        for _ in range(PREVIEW_ITERATIONS):
            e = toward(J.T @ (drift + reach @ e), self._direction)
        return e

    def _jacobian(self, context: framework.Context) -> np.ndarray:
        """Returns the driven rows of J_xŴ."""
        config = self._state_port.Eval(context)[: self._model.size]
        return self._model.task_jacobian(config)[ROWS[self._settings.rows]] * self._weights
