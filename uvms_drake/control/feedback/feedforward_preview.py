"""The plan's forces, asked for as much earlier as the actuators give them later.

A force that is commanded now acts later: behind a dead time, a hold, a lag. A feedback cannot do
without the time, but a plan is known in advance. So a law adds to its command

    τ̄(t + ℓ) − τ̄(t),    τ̄ = M ζ̄̇ + b + Jᵀ𝔉 along the plan,                                     (P)

and commands the plan's forces of the time at which they act. ℓ is the sum of the dead times, half
the periods of the holds, and the time constants of the lags; see `ActuationDelay`.

*What is left.* Let G be what a dead time D and a lag T make of a command. With ℓ = D + T the plan's
forces come as G e^{sℓ}τ̄, and

    G e^{sℓ} − 1 = (e^{sT} − 1 − Ts)/(Ts + 1),    e^{sT} − 1 − Ts = s²∫₀ᵀ (T − u) e^{su} du,

in place of G − 1 = −Ts/(Ts + 1) without it: a term of second order in s, zero for every plan whose
forces grow linearly. `tube.loops.row_loop` has what a row makes of it. If the lag is T + ΔT and
not T, −ΔT s/(Ts + 1) comes to it, ΔT/T of the term without (P).

*Why not τ̄ + Tτ̄˙*, which is the inverse of the lag? It leaves nothing where τ̄ is smooth. A plan has
constant accelerations between its knots, though, and its forces jump there: the inverse asks for
impulses, which no thruster gives, and without them jumps come as late as ever. Of all averages
∫p(θ)τ̄(t + θ)dθ of what is to come, p ≥ 0, with nothing left of first order, (P) leaves least of
second: ∫θ²p/2 − T(∫θp) + T² with ∫θp = T is smallest where p is a pulse at T, by Jensen. And it
asks for nothing but forces of the plan: what keeps the plan's within limits keeps these.

*A wall that is felt* is in 𝔉 by what was felt of it last: where the plan goes deeper by Δ𝔭̄ until
t + ℓ, the force along n is n·𝐅 + κ̂(n + 𝔱)·Δ𝔭̄ then, and not less than zero, with the slope κ̂ and the
inclination 𝔱 that are learned (`contact.slope`). For a wall that was not touched yet nothing is
asked for. This is a prediction: on a wall of slope κ it is off by (κ̂ − κ) n·Δ𝔭̄, and without it by
−κ n·Δ𝔭̄. κ̂ is the most that is believed, κ₊ at the first touch: that helps where the force rises
fastest, on stiff walls, and costs on walls of less than κ̂/2, whose force rises slowly. The pitch
of a BlueROV2 told of κ₊ = 500 N/m swings by 22 instead of 47 mrad on 500 N/m, and by 22 instead of
12 on 90 N/m, where nothing is near its limit; with the mean of what is believed by 27 and 12.

*A new plan* keeps what was asked for, see `commitment`: what it changed within ℓ of its start would
come as late as without (P). The largest such change would be the first plan, where before there was
none: a jump J that comes late leaves the velocity off by JT, and with (P) nothing that is late
later on makes up for it. Beyond the end of a plan its last forces are meant.
"""

from typing import NamedTuple

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder, LeafSystem

from uvms_drake.control.contact.contact_estimator import ContactEstimator
from uvms_drake.control.feedback.ancillary import AncillaryFeedback
from uvms_drake.control.laws.law import AncillaryLaw
from uvms_drake.control.plan.plan import DynamicPlan
from uvms_drake.model.sensor_actuator import ActuationDelay
from uvms_drake.model.uvms_model import UvmsModel

CONTACT_PORTS = {"touched": 1, "reading": 4, "slope": 1, "tilt": 3, "force_lost": 1}
"""Ports of an `ContactEstimator` that say what was felt, and their sizes."""


class SurfaceReaction(NamedTuple):
    """The wall as it is felt."""

    direction: np.ndarray
    """n (3,)."""
    force: float
    """n·𝐅 [N]."""
    gradient: np.ndarray
    """κ̂(n + 𝔱) (3,) [N/m]."""


def previewed_forces(model: UvmsModel, plan: DynamicPlan, time: float, actuation_delay: ActuationDelay,
                 now: tuple[np.ndarray, ...], pressed: SurfaceReaction | None = None) -> np.ndarray:
    """Returns τ̄(t + ℓ) − τ̄(t) (6+n,) of (P) [N, N m].

    Args:
        model: The controller's.
        plan: The plan.
        time: t [s].
        actuation_delay: ℓ of the vehicle and of the joints.
        now: 𝔮̄, ζ̄ and ζ̄̇ (6+n,) at t.
        pressed: A wall that the model does not know; None if none is touched.
    """
    end = plan.start_time + (len(plan.config) - 1) * plan.time_step
    later = (plan.at(min(time + delay, end)) if delay > 0.0 else now for delay in actuation_delay)
    config, zeta, zeta_dot = (np.array(item) for item in zip(now, *later, strict=True))
    kinematics = model.kinematics(config)
    tau = model.inverse_dynamics(kinematics, zeta, zeta_dot)
    if pressed is not None:
        deeper = (kinematics.chi[:, :3] - kinematics.chi[0, :3]) @ pressed.gradient
        along = np.maximum(pressed.force + deeper, 0.0)
        tau = tau + along[:, None] * (pressed.direction @ kinematics.J_chi[:, :3])
    preview: np.ndarray = np.append(tau[1, :6], tau[2, 6:]) - tau[0]
    return preview


class FeedforwardPreview(LeafSystem):
    """What a command has more, or less, of the plan's forces because they act later.

    .. pydrake_system::

        name: FeedforwardPreview
        input_ports:
        - plan
        - nominal_state
        - nominal_acceleration
        - touched (optional, with a direction)
        - reading (optional, with a direction)
        - slope (optional, with a direction)
        - tilt (optional, with a direction)
        - force_lost (optional, with a direction)
        output_ports:
        - ahead

    - `plan`: the current `DynamicPlan` (abstract).
    - `nominal_state`, `nominal_acceleration`: (𝔮̄, ζ̄) (2(6+n)) and ζ̄̇ (6+n) of now.
    - `touched` (1), `reading` (4), `slope` (1), `tilt` (3), `force_lost` (1): of an
      `ContactEstimator`. While the force is lost nothing is known of the wall.
    - `preview`: see `previewed_forces` (6+n) [N, N m].

    It has no state.

    Args:
        model: The controller's.
        actuation_delay: Of the vehicle and of the joints, as the controller believes.
        direction: n of walls that are felt (3,); None if the model knows what is pressed.
    """

    def __init__(self, model: UvmsModel, actuation_delay: ActuationDelay, direction: np.ndarray | None = None):
        super().__init__()
        self._model, self._delay, self._direction = model, actuation_delay, direction
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
        reading, slope, tilt = (
            self._contact_ports[name].Eval(context) for name in ("reading", "slope", "tilt"))
        return SurfaceReaction(self._direction, float(reading[3]), slope * (self._direction + tilt))

    def _calc(self, context: Context, output: BasicVector) -> None:
        state = self._state_port.Eval(context)
        now = (*np.split(state, 2), self._acceleration_port.Eval(context))
        output.SetFromVector(previewed_forces(
            self._model, self._plan_port.Eval(context), context.get_time(), self._delay, now,
            self._pressed(context)))


def add_feedforward_preview(builder: DiagramBuilder, model: UvmsModel, law: AncillaryLaw,
                     feedback: AncillaryFeedback, actuation_delay: ActuationDelay, *, nominal: LeafSystem,
                     estimator: ContactEstimator | None = None, direction: np.ndarray | None = None,
                     name: str = "previewed_forces") -> FeedforwardPreview | None:
    """Adds what a law asks for ahead and connects it, or returns None where nothing is late.

    Args:
        builder: Where to add it.
        model: The controller's.
        law: The law; nothing is added if it does not know of actuators, see `takes_wrench`.
        feedback: The law as a system.
        actuation_delay: Of the vehicle and of the joints, as the controller believes.
        nominal: A `NominalMpc`.
        estimator: What was felt of a wall that the model does not know, if there is one.
        direction: n of such walls (3,).
        name: Name of the system.
    """
    if not law.takes_wrench or not any(actuation_delay):
        return None
    preview = builder.AddNamedSystem(name, FeedforwardPreview(model, actuation_delay, direction))
    for port in ("plan", "nominal_state", "nominal_acceleration"):
        builder.Connect(nominal.GetOutputPort(port), preview.GetInputPort(port))
    if estimator is not None:
        for port in CONTACT_PORTS:
            builder.Connect(estimator.GetOutputPort(port), preview.GetInputPort(port))
    builder.Connect(preview.get_output_port(), feedback.GetInputPort("preview"))
    return preview
