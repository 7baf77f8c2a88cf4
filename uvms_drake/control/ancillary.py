"""The ancillary feedback: keeps the real state in a tube about the nominal one.

Errors are 𝔢_y = y − ȳ of the extended task y = (χ, q), 𝔢 of its χ part, and 𝔷 = ζ − ζ̄; Euler
angles are compared modulo 2π. Two laws:

* `resolved` (resolved acceleration on the extended task). With J_x = [J; 0 I],

      ζ_ref = J_x(𝔮)⁻¹ [J_x(𝔮̄) ζ̄ − σ 𝔢_y],   𝔯 = ζ − ζ_ref,   u = ζ̇_ref − f(𝔮, ζ) − k 𝔯,

  which leaves exactly 𝔢̇_y = −σ 𝔢_y + J_x(𝔮) 𝔯 and 𝔯̇ = −k 𝔯 + d: a cascade without f in it, so a
  stiff surface costs nothing, and ‖𝔢_y‖ ≤ J̄ d̃/(kσ), ‖𝔯‖ ≤ d̃/k for every k, σ > 0.

* `transpose`, the law of Nikou, Verginis and Dimarogonas (2018) as its proof needs it,

      u = ū − k 𝔷 − k σ J(𝔮̄)ᵀ 𝔢.

  The printed (eq:kappa_law) multiplies a (6+n)×6 matrix with a (6+n)-vector; the proof uses
  u − ū = −k 𝔯 with 𝔯 = 𝔷 + σJ(𝔮̄)ᵀ𝔢, which is this. It does not act on the arm's self-motion; with
  `joints`, J_x and 𝔢_y take the place of J and 𝔢, the proof goes through as before, and it does.

u of (eq:dynamics) is a generalised acceleration: f carries M⁻¹ inside, u stands beside it. What
goes to thrusters and joints is τ = M(𝔮) u, with the full inertia including added mass. For the law
`resolved` that is the inverse dynamics at ζ̇_ref − k𝔯, and neither f nor M is needed.

An actuator saturates, and so does the command, where it is told the robot's input limits. Inside
of what the certificate covers, and as far as the estimated radii of the input hold, the command is
within them; so there nothing is cut and the above is exact.
"""

import math
from collections.abc import Callable
from dataclasses import astuple, dataclass
from functools import cache, lru_cache
from typing import NamedTuple

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import DiagramBuilder, LeafSystem, OutputPort, ValueProducer

from uvms_drake.common.errors import require
from uvms_drake.control.limits import Limits, check_limits
from uvms_drake.model.euler import wrap_angle
from uvms_drake.model.uvms_model import Kinematics, UvmsModel


@dataclass
class Resolved:
    """Gains of the law `resolved`."""

    k: float = 20.0
    """[1/s]."""
    sigma: float = 5.0
    """σ [1/s]."""


@dataclass
class Transpose:
    """Gains of the law `transpose`."""

    k: float = 20.0
    """[1/s]."""
    sigma: float = 1.0
    """σ [1/s]."""
    joints: bool = False
    """Feeds back 𝔢_y with J_x instead of 𝔢 with J: the arm's self-motion too, which the paper's
    law leaves alone, and without which no tube protects the joints."""


AncillaryConfig = Resolved | Transpose


@dataclass(frozen=True)
class Command:
    """What a law commands; it gives one of u and τ, and the rest follows when it is asked for."""

    u: Callable[[], np.ndarray]
    """u (6+n,) [m/s² (3), rad/s² (3+n)]."""
    tau: Callable[[], np.ndarray]
    """τ = M(𝔮) u (6+n,) [N (3), N m (3+n)]."""
    M: Callable[[], np.ndarray]
    """M(𝔮) (6+n, 6+n)."""
    limited: bool = False
    """Whether a limit has cut it."""


class Motion(NamedTuple):
    """How the real and the nominal robot move at an instant; the real one is first everywhere."""

    kinematics: Kinematics
    """Of stacks (2,)."""
    zeta: np.ndarray
    """(2, 6+n) ζ, ζ̄."""
    y: np.ndarray
    """(2, 6+n) y, ȳ."""
    J_x: np.ndarray
    """(2, 6+n, 6+n) J_x(𝔮), J_x(𝔮̄)."""
    J_x_dot: np.ndarray
    """(2, 6+n, 6+n)."""
    inverse: np.ndarray
    """(6+n, 6+n) J_x(𝔮)⁻¹."""


def motion(model: UvmsModel, state: np.ndarray, nominal_state: np.ndarray) -> Motion:
    """Returns the motion of (𝔮, ζ) and (𝔮̄, ζ̄) (2(6+n),) each, whose arrays must not be changed.

    The last ones are remembered, since the law and the `TubeMonitor` ask for the same ones.
    """
    return _motion(model, *(np.asarray(each, dtype=float).tobytes()
                            for each in (state, nominal_state)))


@lru_cache(maxsize=2)
def _motion(model: UvmsModel, *states: bytes) -> Motion:
    both = np.frombuffer(b"".join(states)).reshape(2, -1)
    config, zeta = both[:, : model.size], both[:, model.size:]
    kinematics = model.kinematics(config)
    y, J_x, J_x_dot = model.task_motion(config, zeta, kinematics)
    return Motion(kinematics, zeta, y, J_x, J_x_dot, np.linalg.inv(J_x[0]))


def resolved_command(model: UvmsModel, state: np.ndarray, nominal_state: np.ndarray,
                     nominal_acceleration: np.ndarray, k: float, sigma: float) -> Command:
    """Returns what the law `resolved` commands.

    Args:
        model: The prediction model; it supplies J_x, J̇_x and the inverse dynamics.
        state: (𝔮, ζ) measured (2(6+n),).
        nominal_state: (𝔮̄, ζ̄) (2(6+n),).
        nominal_acceleration: ζ̄̇ (6+n,).
        k: Velocity gain [1/s].
        sigma: σ, task gain [1/s].
    """
    now = motion(model, state, nominal_state)
    (zeta, nominal_zeta), (J, J_nominal), (J_dot, J_dot_nominal) = now.zeta, now.J_x, now.J_x_dot
    velocity = J_nominal @ nominal_zeta
    acceleration = J_dot_nominal @ nominal_zeta + J_nominal @ nominal_acceleration
    zeta_ref = now.inverse @ (velocity - sigma * task_error(*now.y))
    error_rate = J @ zeta - velocity
    zeta_ref_dot = now.inverse @ (acceleration - sigma * error_rate - J_dot @ zeta_ref)
    measured = now.kinematics.at(0)
    tau = model.inverse_dynamics(measured, zeta, zeta_ref_dot - k * (zeta - zeta_ref))
    M = cache(lambda: model.mass_matrix(measured))
    return Command(u=lambda: np.linalg.solve(M(), tau), tau=lambda: tau, M=M)


def transpose_command(model: UvmsModel, state: np.ndarray, nominal_state: np.ndarray,
                      nominal_input: np.ndarray, k: float, sigma: float,
                      joints: bool = False) -> Command:
    """Returns what `transpose` commands; `nominal_input` is ū (6+n,), the rest as above.

    Args:
        model: The prediction model.
        state: As above.
        nominal_state: As above.
        nominal_input: ū (6+n,).
        k: Velocity gain [1/s].
        sigma: σ, task gain [1/s].
        joints: Whether 𝔢_y and J_x take the place of 𝔢 and J.
    """
    now = motion(model, state, nominal_state)
    rows = slice(None) if joints else slice(0, 6)
    error = task_error(*now.y)[rows]
    z = now.zeta[0] - now.zeta[1]
    u = nominal_input - k * z - k * sigma * now.J_x[1, rows].T @ error
    M = cache(lambda: model.mass_matrix(now.kinematics.at(0)))
    return Command(u=lambda: u, tau=lambda: M() @ u, M=M)


def limited_input(u: np.ndarray, tau: np.ndarray, M: np.ndarray, u_limit: np.ndarray,
                  tau_limit: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray, bool]:
    """Returns u and τ cut to their limits, and whether they are cut.

    First u ← clip(u, ±u_limit) and τ = M u, one component at a time, then likewise
    τ ← clip(τ, ±τ_limit) and u = M⁻¹τ. What exceeds no limit is returned as it is. τ is what is
    sent: where its own limits cut it, u follows from it and may be beyond those of u.

    Args:
        u: (6+n,) [m/s² (3), rad/s² (3+n)].
        tau: M u (6+n,) [N (3), N m (3+n)].
        M: (6+n, 6+n).
        u_limit: Of |uᵢ| (6+n,).
        tau_limit: Of |τᵢ| (6+n,); None if τ is not limited.
    """
    limited = False
    if (np.abs(u) > u_limit).any():
        u, limited = np.clip(u, -u_limit, u_limit), True
        tau = M @ u
    if tau_limit is not None and (np.abs(tau) > tau_limit).any():
        tau, limited = np.clip(tau, -tau_limit, tau_limit), True
        u = np.linalg.solve(M, tau)
    return u, tau, limited


def _cut(command: Command, u_limit: np.ndarray, tau_limit: np.ndarray | None) -> Command:
    """Returns what `limited_input` leaves of a command."""
    u, tau, limited = limited_input(command.u(), command.tau(), command.M(), u_limit, tau_limit)
    return Command(lambda: u, lambda: tau, command.M, limited)


def _input_limits(limits: Limits, num_joints: int) -> tuple[np.ndarray, np.ndarray | None]:
    """Returns the limits of |uᵢ| and |τᵢ| (6+n,), or raises."""
    check_limits(limits, num_joints)
    tau = None if limits.tau is None else np.asarray(limits.tau, dtype=float)
    return np.asarray(limits.u, dtype=float), tau


def task_error(y: np.ndarray, y_nominal: np.ndarray) -> np.ndarray:
    """Returns y − ȳ (..., 6 or 6+n) with the differences of Euler angles in [−π, π)."""
    error = y - y_nominal
    error[..., 3:6] = wrap_angle(error[..., 3:6])
    return error


def is_lost(measured: np.ndarray) -> bool:
    """Returns whether a measurement is none, because it is not finite."""
    return not math.isfinite(sum(measured))


class AncillaryFeedback(LeafSystem):
    """Turns nominal trajectory and measured state into a command, as acceleration and as force.

    .. pydrake_system::

        name: AncillaryFeedback
        input_ports:
        - state
        - nominal_state
        - nominal_acceleration
        - nominal_input
        output_ports:
        - u
        - tau
        - lost
        - limited

    - `state`: (𝔮, ζ) measured (2(6+n)), in the paper's order.
    - `nominal_state`: (𝔮̄, ζ̄) (2(6+n)).
    - `nominal_acceleration`: ζ̄̇ (6+n); read by `resolved` only.
    - `nominal_input`: ū (6+n); read by `transpose` only.
    - `u`: generalised acceleration command (6+n) [m/s² (3), rad/s² (3+n)].
    - `tau`: τ = M(𝔮) u (6+n), wrench on the vehicle in body axes and joint torques [N (3), N m
      (3+n)].
    - `lost` (1): 1 while the measured state is not finite, else 0.
    - `limited` (1): 1 while a limit cuts the command, else 0.

    It has no state. In place of a measured state that is not finite the law takes the nominal one,
    so that the command is the plan's own, without feedback. `u` and `tau` are what the limits leave
    of the law's command, see `limited_input`.

    Args:
        model: The controller's model of the robot and of the surface.
        config: The law and its gains.
        limits: Those of the real robot, of which the ones of u and τ are read; None: the law's
            command is passed on as it is.
    """

    def __init__(self, model: UvmsModel, config: AncillaryConfig, limits: Limits | None = None):
        super().__init__()
        for key in ("k", "sigma"):
            value = getattr(config, key)
            require(bool(0.0 < value < np.inf), key, value, "positive")
        self._model = model
        self._config = config
        self._limits = None if limits is None else _input_limits(limits, model.num_joints)
        self._state_port = self.DeclareVectorInputPort("state", 2 * model.size)
        self._nominal_state_port = self.DeclareVectorInputPort("nominal_state", 2 * model.size)
        acceleration = self.DeclareVectorInputPort("nominal_acceleration", model.size)
        nominal_input = self.DeclareVectorInputPort("nominal_input", model.size)
        resolved = isinstance(config, Resolved)
        self._law = resolved_command if resolved else transpose_command
        self._forward_port = acceleration if resolved else nominal_input
        read = (self._state_port, self._nominal_state_port, self._forward_port)
        self._command = self.DeclareCacheEntry(
            description="the command",
            value_producer=ValueProducer(
                allocate=lambda: AbstractValue.Make(()), calc=self._calc_command),
            prerequisites_of_calc={self.input_port_ticket(port.get_index()) for port in read})
        given = {self._command.ticket()}
        self.DeclareVectorOutputPort("u", model.size, self._calc_u, given)
        self.DeclareVectorOutputPort("tau", model.size, self._calc_tau, given)
        self.DeclareVectorOutputPort(
            "lost", 1, self._calc_lost, {self.input_port_ticket(self._state_port.get_index())})
        self.DeclareVectorOutputPort("limited", 1, self._calc_limited, given)

    def _calc_command(self, context, command):
        state, nominal = self._state_port.Eval(context), self._nominal_state_port.Eval(context)
        wanted = self._law(
            self._model, nominal if is_lost(state) else state, nominal,
            self._forward_port.Eval(context), *astuple(self._config))
        command.set_value(wanted if self._limits is None else _cut(wanted, *self._limits))

    def _calc_u(self, context, output):
        output.SetFromVector(self._command.Eval(context).u())

    def _calc_tau(self, context, output):
        output.SetFromVector(self._command.Eval(context).tau())

    def _calc_lost(self, context, output):
        output.SetFromVector([float(is_lost(self._state_port.Eval(context)))])

    def _calc_limited(self, context, output):
        output.SetFromVector([float(self._command.Eval(context).limited)])

    @staticmethod
    def AddToBuilder(builder: DiagramBuilder, model: UvmsModel, config: AncillaryConfig, *,
                     nominal: LeafSystem, state: OutputPort | None = None,
                     limits: Limits | None = None, name: str = "ancillary") -> "AncillaryFeedback":
        """Adds the feedback and connects it to a system with a `NominalMpc`'s output ports.

        Args:
            builder: Where to add it.
            model: The controller's model.
            config: The law and its gains.
            nominal: Gives nominal_state, nominal_acceleration and nominal_input.
            state: Gives (𝔮, ζ); left to the caller if None.
            limits: Those of the real robot; None: the command is not limited.
            name: Name of the system.
        """
        feedback = AncillaryFeedback(model, config, limits)
        builder.AddNamedSystem(name, feedback)
        for port in ("nominal_state", "nominal_acceleration", "nominal_input"):
            builder.Connect(nominal.GetOutputPort(port), feedback.GetInputPort(port))
        if state is not None:
            builder.Connect(state, feedback.GetInputPort("state"))
        return feedback
