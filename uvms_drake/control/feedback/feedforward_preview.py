"""Feedforward preview: the plan's forces, commanded in advance by the delay of the actuators.

A law adds to its command

    τ̄(t + ℓ) − τ̄(t),    τ̄ = M ζ̄̇ + b + Jᵀ𝔉 along the plan,                                     (P)

with ℓ the sum of the dead times, half the periods of the holds, and the time constants of the lags,
`CommandPath.preview`. The remaining error is of second order, (e^{sT} − 1 − Ts)/(Ts + 1) behind a
lag T, and no average of the plan's forces has a smaller one. The reaction of an unknown wall is
predicted with its estimated stiffness and inclination, n·𝐅 + κ̂(n + 𝔱)·Δ𝔭̄, not below zero; before
the first touch none is. A new plan keeps the commands that were issued, see `planner`; beyond
the end of a plan its last forces are used. Derivation:
control/feedback/theory.md#feedforward-preview.
"""

from typing import NamedTuple

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder, LeafSystem

from uvms_drake.common.wiring import WiredSystem, outputs, wire
from uvms_drake.control.contact.contact_estimator import ContactEstimator
from uvms_drake.control.feedback.ancillary import AncillaryFeedback
from uvms_drake.control.laws.law import AncillaryLaw
from uvms_drake.control.plan.plan import Plan
from uvms_drake.model.signals.command_path import CommandPath
from uvms_drake.model.uvms_model import UvmsModel

CONTACT_PORTS = {"touched": 1, "reading": 4, "stiffness_used": 1, "tilt": 3, "force_lost": 1}
"""Ports of a `ContactEstimator` that the preview reads, and their sizes."""


class SurfaceReaction(NamedTuple):
    """Estimated reaction of an unknown wall."""

    direction: np.ndarray
    """Unit vector n (3,)."""
    force: float
    """Force n·𝐅 [N]."""
    gradient: np.ndarray
    """Gradient κ̂(n + 𝔱) of the force (3,) [N/m]."""


def previewed_forces(
    model: UvmsModel, plan: Plan, time: float, preview: tuple[float, float],
    now: tuple[np.ndarray, ...], pressed: SurfaceReaction | None = None,
) -> np.ndarray:
    """Returns τ̄(t + ℓ) − τ̄(t) (6+n,) of (P) [N, N m].

    Args:
        model: The controller's model.
        plan: The plan.
        time: t [s].
        preview: Times ℓ of the vehicle and of the joints [s], see `CommandPath.preview`.
        now: 𝔮̄, ζ̄ and ζ̄̇ (6+n,) at t.
        pressed: Reaction of a wall that the model does not know; None if none is touched.
    """
    end = plan.start_time + (len(plan.config) - 1) * plan.time_step
    later = (plan.at(min(time + delay, end)) if delay > 0.0 else now for delay in preview)
    config, zeta, zeta_dot = (np.array(item) for item in zip(now, *later, strict=True))
    kinematics = model.kinematics(config)
    tau = model.inverse_dynamics(kinematics, zeta, zeta_dot)
    if pressed is not None:
        deeper = (kinematics.chi[:, :3] - kinematics.chi[0, :3]) @ pressed.gradient
        along = np.maximum(pressed.force + deeper, 0.0)
        tau = tau + along[:, None] * (pressed.direction @ kinematics.J_chi[:, :3])
    change: np.ndarray = np.append(tau[1, :6], tau[2, 6:]) - tau[0]
    return change


class FeedforwardPreview(WiredSystem):
    """Change of the plan's forces over the delay of the actuators.

    .. pydrake_system::

        name: FeedforwardPreview
        input_ports:
        - plan
        - nominal_state
        - nominal_acceleration
        - touched (optional, with a direction)
        - reading (optional, with a direction)
        - stiffness_used (optional, with a direction)
        - tilt (optional, with a direction)
        - force_lost (optional, with a direction)
        output_ports:
        - preview

    - `plan`: current `Plan` (abstract).
    - `nominal_state`, `nominal_acceleration`: (𝔮̄, ζ̄) (2(6+n)) and ζ̄̇ (6+n) of now.
    - `touched` (1), `reading` (4), `stiffness_used` (1), `tilt` (3), `force_lost` (1): those of a
      `ContactEstimator`. While the force is lost no reaction is predicted.
    - `preview`: see `previewed_forces` (6+n) [N, N m].

    It has no state.

    Args:
        model: The controller's model.
        command_path: Path of the commands in the controller's model.
        direction: n of unknown walls (3,); None if the surface is in the model.
    """

    def __init__(self, model: UvmsModel, command_path: CommandPath,
                 direction: np.ndarray | None = None):
        super().__init__()
        self._model, self._preview, self._direction = model, command_path.preview, direction
        self._plan_port = self.DeclareAbstractInputPort("plan", Value(object()))
        self._state_port = self.DeclareVectorInputPort("nominal_state", 2 * model.size)
        self._acceleration_port = self.DeclareVectorInputPort("nominal_acceleration", model.size)
        if direction is not None:
            self._contact_ports = {name: self.DeclareVectorInputPort(name, size)
                                for name, size in CONTACT_PORTS.items()}
        self.DeclareVectorOutputPort("preview", model.size, self._calc)

    def _pressed(self, context: Context) -> SurfaceReaction | None:
        if self._direction is None:
            return None
        touched, lost = (self._contact_ports[name].Eval(context)[0]
                         for name in ("touched", "force_lost"))
        if lost or not touched:
            return None
        reading, stiffness, tilt = (
            self._contact_ports[name].Eval(context) for name in (
                "reading", "stiffness_used", "tilt"))
        return SurfaceReaction(
            self._direction, float(reading[3]), stiffness * (self._direction + tilt))

    def _calc(self, context: Context, output: BasicVector) -> None:
        state, size = self._state_port.Eval(context), self._model.size
        now = state[:size], state[size:], self._acceleration_port.Eval(context)
        output.SetFromVector(previewed_forces(
            self._model, self._plan_port.Eval(context), context.get_time(), self._preview, now,
            self._pressed(context)))


def add_feedforward_preview(
    builder: DiagramBuilder, model: UvmsModel, law: AncillaryLaw, feedback: AncillaryFeedback,
    command_path: CommandPath, *, nominal: LeafSystem,
    estimator: ContactEstimator | None = None, direction: np.ndarray | None = None,
) -> FeedforwardPreview | None:
    """Adds the preview and connects it; None for a law without one, or without any delay.

    Args:
        builder: Builder of the Diagram.
        model: The controller's model.
        law: The law; it needs `takes_wrench`.
        feedback: The law as a system.
        command_path: Path of the commands in the controller's model.
        nominal: A `NominalMpc`.
        estimator: Contact state of a wall that the model does not know, if there is one.
        direction: n of such walls (3,).
    """
    if not law.takes_wrench or not any(command_path.preview):
        return None
    preview = FeedforwardPreview.AddToBuilder(
        builder, model, command_path, direction, name="previewed_forces",
        plan=nominal.GetOutputPort("plan"))
    wire(builder, preview, outputs(nominal))
    if estimator is not None:
        wire(builder, preview, outputs(estimator))
    builder.Connect(preview.get_output_port(), feedback.GetInputPort("preview"))
    return preview
