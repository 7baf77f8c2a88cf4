"""Thrust allocation as a system: from the commanded wrench to commands for the thrusters."""

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder, LeafSystem, OutputPort

from uvms_drake.common.wiring import added
from uvms_drake.model.propulsion.allocation import Allocation
from uvms_drake.model.uvms_model import UvmsModel


class ThrusterAllocation(LeafSystem):
    """Thruster commands for a wrench; see `Allocation`.

    .. pydrake_system::

        name: ThrusterAllocation
        input_ports:
        - tau
        - state
        - force
        output_ports:
        - command
        - shortfall
        - hover

    - `tau` (6+n): (τ_v, τ_q), of which τ_v is read, in axes of B about its origin [N, N m].
    - `state`: (𝔮, ζ) (2(6+n)), the true one; read by `hover` only, as is the next.
    - `force`: 𝔉 (6), the true one [N, N m].
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
        self._tau_port, self._state_port, self._force_port = tau, state, force
        m = allocation.thrusters.size
        self.DeclareVectorOutputPort("command", m, self._calc_command, {tau.ticket()})
        self.DeclareVectorOutputPort("shortfall", 6, self._calc_shortfall, {tau.ticket()})
        self.DeclareVectorOutputPort(
            "hover", m, self._calc_hover, {state.ticket(), force.ticket()})

    def _command(self, wrench: np.ndarray) -> np.ndarray:
        return self._allocation.thrusters.commands_of(self._allocation.forces(wrench))

    def _calc_command(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._command(self._tau_port.Eval(context)[:6]))

    def _calc_shortfall(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._allocation.shortfall(self._tau_port.Eval(context)[:6]))

    def _calc_hover(self, context: Context, output: BasicVector) -> None:
        model, still = self._model, np.zeros(self._model.size)
        kinematics = model.kinematics(self._state_port.Eval(context)[: model.size])
        tau = model.inverse_dynamics(kinematics, still, still, self._force_port.Eval(context))
        output.SetFromVector(self._command(tau[:6]))

    @staticmethod
    def AddToBuilder(builder: DiagramBuilder, model: UvmsModel, allocation: Allocation, *,
                     tau: OutputPort, state: OutputPort, force: OutputPort,
                     name: str = "allocation") -> "ThrusterAllocation":
        """Adds the allocation and connects it; the arguments are its constructor's and inputs."""
        return added(builder, name, ThrusterAllocation(model, allocation),
                     tau=tau, state=state, force=force)
