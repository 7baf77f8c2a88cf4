"""Ancillary feedback: keeps the real state in a tube about the nominal one.

u of (eq:dynamics) is a generalised acceleration: f contains M⁻¹, u is added to it. The command to
thrusters and joints is τ = M(𝔮) u, with the full inertia including added mass. The laws are in
`control.laws`.

An actuator saturates, and so does the command if the robot's input limits are given. Within the
certificate, and as far as the estimated radii of the input hold, no limit is active and the law's
own command is sent. A law that takes the thrusters' wrench leaves the saturation of the vehicle's
command to the thrusters, for clipping it here would disturb the tip: only the joints' is clipped.
"""

from dataclasses import replace
from functools import partial

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import Context

from uvms_drake.common.errors import require
from uvms_drake.common.finite import is_finite
from uvms_drake.common.schema import check_values
from uvms_drake.common.wiring import WiredSystem, cached, output_of
from uvms_drake.control.laws.law import AncillaryLaw, Command, Pair, pair_of
from uvms_drake.control.laws.outputs import POSE
from uvms_drake.control.limits import Limits, check_limits
from uvms_drake.control.supervisor.retreat import (
    WATCHING,
    RetreatSettings,
    filtered_torque,
    law_of_retreat,
)
from uvms_drake.model.propulsion.allocation import Allocation
from uvms_drake.model.signals.sensor_actuator import MEASURED_FORCE, VEHICLE_WRENCH
from uvms_drake.model.uvms_model import UvmsModel, configuration_rate_matrix

CUT = 0.02
"""Share of the largest force on an axis by which thrusters may miss the command: rounding of their
bias and of small commands is none."""


def limited_input(u: np.ndarray, tau: np.ndarray, M: np.ndarray, u_limit: np.ndarray,
                  tau_limit: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray, bool]:
    """Returns u and τ clipped to their limits, and whether they are clipped.

    First u ← clip(u, ±u_limit) and τ = M u, one component at a time, then likewise
    τ ← clip(τ, ±τ_limit) and u = M⁻¹τ; without a violation both are returned unchanged. τ is sent:
    where its own limits clip it, u follows from it and may exceed those of u.

    Args:
        u: (6+n,) [m/s² (3), rad/s² (3+n)].
        tau: M u (6+n,) [N (3), N m (3+n)].
        M: (6+n, 6+n).
        u_limit: Limits of |uᵢ| (6+n,).
        tau_limit: Limits of |τᵢ| (6+n,); None if τ is not limited.
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
    """Returns a command clipped by `limited_input`."""
    u, tau, limited = limited_input(command.u, command.tau, command.M, u_limit, tau_limit)
    return replace(command, u=u, tau=tau, limited=limited)


def _input_limits(limits: Limits, num_joints: int) -> tuple[np.ndarray, np.ndarray | None]:
    """Returns the limits of |uᵢ| and |τᵢ| (6+n,), or raises."""
    check_limits(limits, num_joints)
    tau = None if limits.tau is None else np.asarray(limits.tau, dtype=float)
    return np.asarray(limits.u, dtype=float), tau


def _of_joints(u_limit: np.ndarray, tau_limit: np.ndarray | None
               ) -> tuple[np.ndarray, np.ndarray | None]:
    """Returns the limits of |uᵢ| and |τᵢ| (6+n,) without those of the vehicle."""
    none = np.full(6, np.inf)
    return (np.append(none, u_limit[6:]),
            None if tau_limit is None else np.append(none, tau_limit[6:]))


class AncillaryFeedback(WiredSystem):
    """Ancillary law from nominal trajectory and measured state to acceleration and force.

    .. pydrake_system::

        name: AncillaryFeedback
        input_ports:
        - state
        - nominal_state
        - nominal_acceleration
        - nominal_input
        - force_measured (optional)
        - vehicle_wrench (optional)
        - estimate (optional)
        - preview (optional)
        - retreat (optional)
        output_ports:
        - u
        - tau
        - lost
        - limited
        - filtered
        - raised
        - pair

    - `state`: (𝔮, ζ) measured (2(6+n)), in the paper's order.
    - `nominal_state`: (𝔮̄, ζ̄) (2(6+n)).
    - `nominal_acceleration`: ζ̄̇ (6+n); read if the law needs it.
    - `nominal_input`: ū (6+n); likewise.
    - `force_measured`: 𝔉_s (6) [N, N m], force in Σ_I and torque conjugate to Euler rates, for a
      law that takes it in place of the force by the model's surface. It is the last finite one, of
      a `HoldLastValue`; while it is not finite, before the first one, the law takes the surface's.
    - `vehicle_wrench`: present τ_v (6) [N, N m] of the thrusters in body axes, for a law that
      takes it; see `VEHICLE_WRENCH`.
    - `estimate`: δ̂ (6+n) of a `RowObserver`, for a law with an observer.
    - `preview`: change of the plan's forces until they act (6+n), of a `FeedforwardPreview`.
    - `retreat`: mode, isolated thruster and reference of a `Supervisor` (2 + 2(6+n)); after its
      trip the joints are filtered and the vehicle's command is cut to the thrusters' forces.
    - `u`: generalised acceleration command (6+n) [m/s² (3), rad/s² (3+n)].
    - `tau`: τ = M(𝔮) u (6+n), wrench on the vehicle in body axes and joint torques [N (3), N m
      (3+n)].
    - `lost` (1): 1 while the measured state is not finite, else 0.
    - `limited` (1): 1 while a limit clips the law's command, or with a supervisor the thrusters
      cannot give it, else 0.
    - `filtered` (1): 1 while the filter of the joints cuts it, else 0.
    - `raised` (1): 1 while the law raises an exception or its command is not finite, else 0; the
      command is that of the retreat's law at the present place then.
    - `pair`: `Pair` of measured and nominal motion, also for a `TubeMonitor`.

    It has no state. A measured state that is not finite is replaced by the nominal one, so that the
    command is the plan's own, without feedback; after a trip by the retreat's reference, at rest
    and with no force on the tip: the forces of an equilibrium in the water. `u` and `tau` are the
    law's command clipped by `limited_input`.

    Args:
        model: The controller's model of the robot and of the surface.
        law: The law and its gains.
        limits: Limits of the real robot, of which those of u and τ are read; None: no clipping.
        safety: Settings of a supervisor's retreat; None: there is no supervisor.
        allocation: With a supervisor, allocation of the wrench to thrusters, to whose limits the
            command is cut.
    """

    def __init__(self, model: UvmsModel, law: AncillaryLaw, limits: Limits | None = None,
                 safety: RetreatSettings | None = None, allocation: Allocation | None = None):
        super().__init__()
        check_values(law)
        self._model, self._law = model, law
        self._limits = None
        if limits is not None:
            whole = _input_limits(limits, model.num_joints)
            self._limits = whole, _of_joints(*whole)
        self._safety, self._allocation = safety, allocation
        self._retreat_law = law_of_retreat(law, model.num_joints)
        self._state_port = self.DeclareVectorInputPort("state", 2 * model.size)
        self._nominal_state_port = self.DeclareVectorInputPort("nominal_state", 2 * model.size)
        self._acceleration_port = self.DeclareVectorInputPort("nominal_acceleration", model.size)
        self._input_port = self.DeclareVectorInputPort("nominal_input", model.size)
        self._optional_ports = {
            "contact": self.DeclareVectorInputPort(MEASURED_FORCE, 6),
            "wrench": self.DeclareVectorInputPort(VEHICLE_WRENCH, 6),
            "estimate": self.DeclareVectorInputPort("estimate", model.size),
            "preview": self.DeclareVectorInputPort("preview", model.size)}
        self._retreat_port = self.DeclareVectorInputPort("retreat", 2 + 2 * model.size)
        # One cache entry each for the two motions and for the command: all outputs read them.
        state, *others = (self.input_port_ticket(self.GetInputPort(name).get_index()) for name in (
            "state", "nominal_state", "nominal_acceleration", "nominal_input", MEASURED_FORCE,
            VEHICLE_WRENCH, "estimate", "preview", "retreat"))
        self._command = cached(self, "the command", self._wanted, {state, *others})
        given = {self._command.ticket()}
        output_of(self, "u", model.size, lambda c: self._command.Eval(c).u, given)
        output_of(self, "tau", model.size, lambda c: self._command.Eval(c).tau, given)
        output_of(self, "lost", 1, lambda c: [not is_finite(self._state_port.Eval(c))], {state})
        for name in ("limited", "filtered", "raised"):
            output_of(self, name, 1, partial(self._flag, name), given)
        self._pair_port = self.DeclareAbstractOutputPort(
            "pair", lambda: Value(object()), self._calc_pair, {state, others[0]})

    def _calc_pair(self, context: Context, output: AbstractValue) -> None:
        output.set_value(pair_of(self._model, self._state_port.Eval(context),
                                 self._nominal_state_port.Eval(context)))

    def _wanted(self, context: Context) -> Command:
        """Returns the law's command, within the limits."""
        # Both motions; a lost state is that of the plan, or of the retreat's reference at rest.
        mode, isolated, config, rate = WATCHING, 0, np.zeros(0), np.zeros(0)
        if self._safety is not None:
            retreat = self._retreat_port.Eval(context)
            (mode, isolated), reference = retreat[:2], retreat[2:]
            config, rate = reference[: self._model.size], reference[self._model.size:]
        lost = not is_finite(self._state_port.Eval(context))
        if lost:
            rate = np.zeros_like(rate)
            nominal = self._nominal_state_port.Eval(context) if mode == WATCHING else (
                np.append(config, rate))
            now = pair_of(self._model, nominal, nominal)
        else:
            now = self._pair_port.Eval(context)
        given = {field: port.Eval(context) for field, port in self._optional_ports.items()
                 if port.HasValue(context)}
        if "contact" in given and not is_finite(given["contact"]):
            del given["contact"]
        if lost and mode != WATCHING:
            given["contact"] = np.zeros(6)
        _ = now.J_x, now.J_x_dot, now.y  # Shared; y takes the kinematics of J_x.
        now = now.given(**given)
        # The command, within limits.
        if mode != WATCHING:
            wanted = self._of_retreat(now, config, rate, int(isolated))
        else:
            wanted = self._of_law(context, now) if self._safety is None else (
                self._wanted_safely(context, now))
        if self._limits is not None:
            whole, of_joints = self._limits
            wanted = _cut(wanted, *(whole if now.wrench is None else of_joints))
        if self._safety is None:
            return wanted
        return self._kept_within(wanted, now, self._safety, mode != WATCHING or wanted.raised,
                                 int(isolated))

    def _flag(self, name: str, context: Context) -> list[bool]:
        return [getattr(self._command.Eval(context), name)]

    def _of_law(self, context: Context, now: Pair) -> Command:
        """Returns the command of the law."""
        wanted = self._law.command(
            self._model, now, partial(self._acceleration_port.Eval, context),
            partial(self._input_port.Eval, context))
        if isinstance(wanted, Command):
            return wanted
        u, size = np.asarray(wanted, dtype=float), self._model.size
        require(u.shape == (size,), f"command of the law {self._law.name}", wanted,
                f"u ({size},), or a `Command`")
        M = self._model.mass_matrix(now.kinematics.at(0))
        return Command(u, M @ u, M)

    def _wanted_safely(self, context: Context, now: Pair) -> Command:
        """Returns the command of the law, or if it fails, of the retreat about the present place.

        Nothing moves at t = 0: an exception then is bad input, and passed on.
        """
        try:
            wanted = self._of_law(context, now)
            if is_finite(wanted.tau):
                return wanted
        except Exception:  # Whatever a law raises, the robot is in the water.
            if context.get_time() == 0.0:
                raise
        still = self._of_retreat(now, now.config[0], np.zeros_like(now.config[0]))
        return replace(still, raised=True)

    def _of_retreat(self, now: Pair, config: np.ndarray, rate: np.ndarray, isolated: int = 0
                    ) -> Command:
        """Returns the command of the retreat's law about a reference 𝔮 and its rate (6+n,).

        An axis that thrusters do not drive without an isolated one is given up.
        """
        model, size, law = self._model, self._model.size, self._retreat_law
        if isolated and self._allocation is not None:
            law = replace(law, undriven=[
                POSE[i] for i in self._allocation.others[isolated - 1].thrusters.undriven])
        zeta = np.linalg.solve(configuration_rate_matrix(config), rate)
        estimate = None if now.estimate is None else np.append(
            now.estimate[:6], np.zeros(model.num_joints))
        about = Pair(model, np.array([now.config[0], config]), np.array([now.zeta[0], zeta])).given(
            contact=now.contact, wrench=now.wrench, estimate=estimate)
        return law.command(model, about, lambda: np.zeros(size),
                                         lambda: np.zeros(size))

    def _kept_within(self, wanted: Command, now: Pair, safety: RetreatSettings, cut: bool,
                     isolated: int) -> Command:
        """Returns a command that the thrusters can give and with which no joint meets its stop.

        Without `cut`, the command as it is, to the bit; `limited` alone tells of thrusters that
        miss it.
        """
        model, tau, limited = self._model, wanted.tau, wanted.limited
        if self._allocation is not None and now.wrench is not None:
            allocation = self._allocation.others[isolated - 1] if isolated else self._allocation
            driven = allocation.thrusters.driven
            missing = allocation.shortfall(tau[:6])[driven]
            if (np.abs(missing) > CUT * allocation.largest).any():
                tau, limited = tau.copy(), True
                tau[driven] -= missing
        if not cut:
            return replace(wanted, limited=limited) if limited != wanted.limited else wanted
        measured, (config, _), (zeta, _) = now.kinematics.at(0), now.config, now.zeta
        torque, filtered = filtered_torque(
            safety, wanted.M, model.inverse_dynamics(
                measured, zeta, np.zeros_like(zeta), now.contact), tau,
            tau[:6] if now.wrench is None else now.wrench, config[6:], zeta[6:])
        if not filtered and tau is wanted.tau:
            return wanted
        tau = np.append(tau[:6], torque)
        return replace(wanted, tau=tau, u=np.linalg.solve(wanted.M, tau), limited=limited,
                       filtered=filtered)
