"""Thrusters as systems: allocation of a wrench to commands, a power cut, and forces that follow."""

import numpy as np
from pydrake.systems import framework

from uvms_drake.common.wiring import WiredSystem, output_of
from uvms_drake.model.propulsion.allocation import Allocation
from uvms_drake.model.propulsion.thrusters import ThrusterModel
from uvms_drake.model.signals.sensor_actuator import SAFETY
from uvms_drake.model.uvms_model import UvmsModel


class ThrusterAllocation(WiredSystem):
    """Thruster commands for a wrench; see `Allocation`.

    .. pydrake_system::

        name: ThrusterAllocation
        input_ports:
        - tau
        - state
        - force
        - safety (optional)
        output_ports:
        - command
        - shortfall
        - hover

    - `tau` (6+n): (τ_v, τ_q), of which τ_v is read, in axes of B about its origin [N, N m].
    - `state`: (𝔮, ζ) (2(6+n)), the true one; read by `hover` only, as is the next.
    - `force`: 𝔉 (6), the true one [N, N m].
    - `safety` (5): of a `Supervisor`; a thruster that it isolates gets no command.
    - `command` (m): to the thrusters' drivers, in their own unit.
    - `shortfall` (6): part of τ_v that the thrusters cannot give at rest [N, N m].
    - `hover` (m): commands of static equilibrium at the present configuration.

    It has no state.

    Args:
        model: Supplies the wrench of hovering.
        allocation: Allocation to the thrusters of the controller's model.
    """

    def __init__(self, model: UvmsModel, allocation: Allocation):
        super().__init__()
        self._model, self._allocation = model, allocation
        tau, state, force = (self.DeclareVectorInputPort(name, size) for name, size in (
            ("tau", model.size), ("state", 2 * model.size), ("force", 6)))
        self._state_port, self._force_port = state, force
        self._safety_port = self.DeclareVectorInputPort("safety", len(SAFETY))
        m, given = allocation.thrusters.size, {tau.ticket(), self._safety_port.ticket()}
        output_of(self, "command", m, lambda c: self._command(
            tau.Eval(c)[:6], isolated_of(self._safety_port, c)), given)
        output_of(self, "shortfall", 6, lambda c: self._of(isolated_of(
            self._safety_port, c)).shortfall(tau.Eval(c)[:6]), given)
        output_of(self, "hover", m, self._hover, {state.ticket(), force.ticket()})

    def _of(self, isolated: int) -> Allocation:
        return self._allocation.others[isolated - 1] if isolated else self._allocation

    def _command(self, wrench: np.ndarray, isolated: int = 0) -> np.ndarray:
        return self._allocation.thrusters.commands_of(
            self._allocation.forces_without(isolated, wrench))

    def _hover(self, context: framework.Context) -> np.ndarray:
        model, still = self._model, np.zeros(self._model.size)
        kinematics = model.kinematics(self._state_port.Eval(context)[: model.size])
        tau = model.inverse_dynamics(kinematics, still, still, self._force_port.Eval(context))
        return self._command(tau[:6])


def isolated_of(port: framework.InputPort, context: framework.Context) -> int:
    """Returns the number of the isolated thruster, from 1, by `safety`; 0 for none."""
    return int(port.Eval(context)[SAFETY.index("isolated")]) if port.HasValue(context) else 0


class PowerCut(WiredSystem):
    """Commands that the thrusters get, whatever the fault of one whose power is cut.

    .. pydrake_system::

        name: PowerCut
        input_ports:
        - command
        - safety
        output_ports:
        - powered

    - `command`, `powered` (m): to the thrusters' drivers, and with that of no force for a thruster
      without power.
    - `safety` (5): of a `Supervisor`, with the thruster that it isolates.

    It has no state.

    Args:
        thrusters: Their curves.
    """

    def __init__(self, thrusters: ThrusterModel):
        super().__init__()
        command = self.DeclareVectorInputPort("command", thrusters.size)
        safety = self.DeclareVectorInputPort("safety", len(SAFETY))

        def powered(context: framework.Context) -> np.ndarray:
            out, isolated = command.Eval(context).copy(), isolated_of(safety, context)
            if isolated:
                out[isolated - 1] = thrusters.curves[isolated - 1].command_of(0.0)
            return out

        output_of(self, "powered", thrusters.size, powered, {command.ticket(), safety.ticket()})


class ThrusterDynamics(WiredSystem):
    """Forces of thrusters: their curves behind a dead time and a first-order lag.

    .. pydrake_system::

        name: ThrusterDynamics
        input_ports:
        - command
        - hover
        output_ports:
        - force

    - `command` (m): to the thrusters' drivers, in their own unit; sampled.
    - `hover` (m): stationary commands before the start; read there only.
    - `force` (m): present forces [N]; no feedthrough.

    The continuous state is the force (m). The discrete state is whether the simulation has started
    (1), and the static forces of the samples within the dead time, the oldest first ((steps + 1)
    m), which the lag follows. The curves are static, so they may precede the dead time.

    Args:
        thrusters: Their curves and lags.
        period: Time between two samples of the command [s].
        steps: Dead time in periods.
    """

    def __init__(self, thrusters: ThrusterModel, period: float, steps: int):
        super().__init__()
        self._thrusters, m = thrusters, thrusters.size
        self._command_port = self.DeclareVectorInputPort("command", m)
        self._hover_port = self.DeclareVectorInputPort("hover", m)
        self.DeclareContinuousState(m)
        self.DeclareDiscreteState(1)
        self.DeclareDiscreteState((steps + 1) * m)
        self.DeclareInitializationUnrestrictedUpdateEvent(self._begin)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._sample)
        output_of(self, "force", m, lambda c: c.get_continuous_state_vector().CopyToVector(),
                  {self.xc_ticket()})

    def _begin(self, context: framework.Context, state: framework.State) -> None:
        if not context.get_discrete_state(0).value()[0]:
            forces = self._thrusters.forces_of(self._hover_port.Eval(context))
            state.get_mutable_continuous_state().SetFromVector(forces)
            samples = state.get_mutable_discrete_state()
            samples.set_value(1, np.tile(forces, samples.value(1).size // forces.size))

    def _sample(self, context: framework.Context, state: framework.DiscreteValues) -> None:
        samples = context.get_discrete_state(1).value()
        newest = self._thrusters.forces_of(self._command_port.Eval(context))
        state.set_value(0, [1.0])
        state.set_value(1, np.append(samples[newest.size:], newest))

    def DoCalcTimeDerivatives(
        self, context: framework.Context, derivatives: framework.ContinuousState) -> None:
        """Sets the derivative ḟ of the forces."""
        force = context.get_continuous_state_vector().CopyToVector()
        followed = context.get_discrete_state(1).value()[: force.size]
        derivatives.SetFromVector((followed - force) / self._thrusters.lag)
