"""Disturbance observer of the outputs of a law, from their measured rates and the applied forces.

An output obeys ÿ = ÿ_pred + δ, ÿ_pred = Gτ + c with G = J_y M⁻¹, of the model and the applied
forces. At the ticks of a period h

    δ̂ₖ = δ̂ₖ₋₁ + (1 − e^{−λh}) (mₖ − δ̂ₖ₋₁),   mₖ = [Δẏ − Ḡ Δ∫τ]/h − c̄,                            (O)

Δ over the period, a bar the mean of both ends: δ − δ̂ = s/(s + λ) δ for a short h, and |δ̂| ≤ sup|δ|.
Nothing winds up: the error of the output is not integrated, τ is the applied force, and a tick
whose state is missing, or equal to the last one to the bit (a frozen measurement), is left out.
Derivation: control/feedback/theory.md#disturbance-observer.
"""

from typing import NamedTuple

import numpy as np
from pydrake.common.value import Value
from pydrake.systems import framework

from uvms_drake.common.finite import is_finite
from uvms_drake.common.wiring import WiredSystem, output_of
from uvms_drake.control.feedback.ancillary import AncillaryFeedback
from uvms_drake.control.laws.law import AncillaryLaw, Observed, Pair
from uvms_drake.model.signals.sensor_actuator import MEASURED_FORCE, VEHICLE_WRENCH
from uvms_drake.model.uvms_model import UvmsModel


def estimate(before: np.ndarray, mean: np.ndarray, rates: np.ndarray, period: float) -> np.ndarray:
    """Returns δ̂ₖ (...) of (O) from δ̂ₖ₋₁ and mₖ (...), with λ (...) [1/s] and h [s]."""
    out: np.ndarray = before - np.expm1(-rates * period) * (mean - before)
    return out


class Prediction(NamedTuple):
    """Outputs' motion by the model: ÿ_pred = Gτ + c."""

    rate: np.ndarray
    """ẏ (6+n,)."""
    c: np.ndarray
    """c (6+n,)."""
    G: np.ndarray
    """G (6+n, 6+n)."""


def prediction(model: UvmsModel, observed: Observed, now: Pair) -> Prediction:
    """Returns the motion of the outputs at a measured state and force, `now.contact`."""
    out, measured, zeta = observed.outputs(now), now.kinematics.at(0), now.zeta[0]
    b = model.inverse_dynamics(measured, zeta, np.zeros_like(zeta), now.contact)
    G = np.linalg.solve(model.mass_matrix(measured), out.J[0].T).T
    return Prediction(out.rate[0], out.bias[0] - G @ b, G)


class RowObserver(WiredSystem):
    """Observer of the disturbance of a law's outputs.

    .. pydrake_system::

        name: RowObserver
        input_ports:
        - state
        - pair
        - tau
        - applied (optional)
        - vehicle_wrench (optional)
        - force_measured (optional)
        output_ports:
        - estimate

    - `state`: (𝔮, ζ) measured (2(6+n)).
    - `pair`: `Pair` of it and the nominal motion.
    - `tau`: command τ (6+n) [N, N m], as it is sent.
    - `applied`: τ behind known actuators (6+n), if there are any.
    - `vehicle_wrench`: its first six of the thrusters, see `VEHICLE_WRENCH`.
    - `force_measured`: 𝔉_s (6), in place of the force by the model's surface.
    - `estimate`: δ̂ (6+n) [m/s², rad/s²]; no feedthrough.

    The continuous state is ∫τ (6+n). The discrete state is δ̂ (6+n), from zero; of the last tick
    with a new measurement ẏ, ∫τ, c (6+n each) and the rows of G, NaN after a missing one, and the
    measured state (2(6+n)); and the number of ticks since it (1).

    Args:
        model: The controller's model.
        observed: The outputs and their rates λ.
    """

    def __init__(self, model: UvmsModel, observed: Observed):
        super().__init__()
        self._model, self._observed = model, observed
        size = model.size
        self._state_port = self.DeclareVectorInputPort("state", 2 * size)
        self._pair_port = self.DeclareAbstractInputPort("pair", Value(object()))
        self._tau_port = self.DeclareVectorInputPort("tau", size)
        self._applied_port = self.DeclareVectorInputPort("applied", size)
        self._wrench_port = self.DeclareVectorInputPort(VEHICLE_WRENCH, 6)
        self._force_port = self.DeclareVectorInputPort(MEASURED_FORCE, 6)
        self.DeclareContinuousState(size)
        self.DeclareDiscreteState(np.zeros(size))
        self.DeclareDiscreteState(np.full((3 + size) * size, np.nan))
        self.DeclareDiscreteState(np.full(2 * size, np.nan))
        self.DeclareDiscreteState(np.ones(1))
        self.DeclarePeriodicDiscreteUpdateEvent(observed.period, 0.0, self._update)
        output_of(self, "estimate", size, lambda c: c.get_discrete_state(0).value(),
                  {self.xd_ticket()})

    def _motion(self, context: framework.Context) -> np.ndarray:
        """Returns ẏ, ∫τ, c and the rows of G now."""
        now: Pair = self._pair_port.Eval(context)
        if self._force_port.HasValue(context) and is_finite(self._force_port.Eval(context)):
            now = now.given(contact=self._force_port.Eval(context))
        rate, c, G = prediction(self._model, self._observed, now)
        return np.concatenate([
            rate, context.get_continuous_state_vector().CopyToVector(), c, G.ravel()])

    def _applied(self, context: framework.Context) -> np.ndarray:
        known = self._applied_port if self._applied_port.HasValue(context) else self._tau_port
        tau = known.Eval(context).copy()
        if self._wrench_port.HasValue(context):
            tau[:6] = self._wrench_port.Eval(context)
        return tau

    def DoCalcTimeDerivatives(  # noqa: D102  Drake's name and meaning
            self, context: framework.Context, derivatives: framework.ContinuousState) -> None:
        derivatives.SetFromVector(self._applied(context))

    def _update(self, context: framework.Context, state: framework.DiscreteValues) -> None:
        measured = self._state_port.Eval(context)
        known, before, last, ticks = (context.get_discrete_state(i).value() for i in range(4))
        if not is_finite(measured):
            state.set_value(1, np.full_like(before, np.nan))
            return
        if np.array_equal(measured, last):
            state.set_value(3, ticks + 1.0)
            return
        motion = self._motion(context)
        if np.isfinite(before).all():
            since, size = float(ticks[0]) * self._observed.period, self._model.size
            rate_change, impulse = (motion - before)[: 2 * size].reshape(2, size)
            c, *G = (0.5 * (motion + before))[2 * size:].reshape(-1, size)
            mean = (rate_change - np.array(G) @ impulse) / since - c
            state.set_value(0, estimate(known, mean, self._observed.rates, since))
        state.set_value(1, motion)
        state.set_value(2, measured)
        state.set_value(3, np.ones(1))


def add_observer(builder: framework.DiagramBuilder, model: UvmsModel, law: AncillaryLaw,
                 feedback: AncillaryFeedback, *, state: framework.OutputPort) -> RowObserver | None:
    """Adds the observer of a law and connects it with the feedback; None if it has none.

    Args:
        builder: Builder of the Diagram.
        model: The controller's model.
        law: The law.
        feedback: The law as a system; its inputs from outside are left to the caller.
        state: Gives (𝔮, ζ) as it is measured.
    """
    observed = law.observed(model)
    if observed is None:
        return None
    observer = RowObserver.AddToBuilder(
        builder, model, observed, name="observer", state=state, pair=feedback.GetOutputPort("pair"),
        tau=feedback.GetOutputPort("tau"))
    builder.Connect(observer.get_output_port(), feedback.GetInputPort("estimate"))
    return observer


def export_inputs(builder: framework.DiagramBuilder, feedback: AncillaryFeedback,
                  observer: RowObserver | None) -> None:
    """Exports the inputs of feedback and observer for measured and applied forces."""
    for name in (MEASURED_FORCE, VEHICLE_WRENCH):
        port = builder.ExportInput(feedback.GetInputPort(name), name)
        if observer is not None:
            builder.ConnectInput(port, observer.GetInputPort(name))
    if observer is not None:
        builder.ExportInput(observer.GetInputPort("applied"), "applied")
