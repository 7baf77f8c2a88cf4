"""Thrust allocation as a system: from the commanded wrench to commands for the thrusters."""

import numpy as np
from pydrake.systems.framework import Context, DiagramBuilder, LeafSystem, OutputPort

from uvms_drake.common.wiring import added, output_of
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
        self._state_port, self._force_port = state, force
        m = allocation.thrusters.size
        output_of(self, "command", m, lambda c: self._command(tau.Eval(c)[:6]), {tau.ticket()})
        output_of(self, "shortfall", 6, lambda c: allocation.shortfall(tau.Eval(c)[:6]),
                  {tau.ticket()})
        output_of(self, "hover", m, self._hover, {state.ticket(), force.ticket()})

    def _command(self, wrench: np.ndarray) -> np.ndarray:
        return self._allocation.thrusters.commands_of(self._allocation.forces(wrench))

    def _hover(self, context: Context) -> np.ndarray:
        model, still = self._model, np.zeros(self._model.size)
        kinematics = model.kinematics(self._state_port.Eval(context)[: model.size])
        tau = model.inverse_dynamics(kinematics, still, still, self._force_port.Eval(context))
        return self._command(tau[:6])

    @staticmethod
    def AddToBuilder(builder: DiagramBuilder, model: UvmsModel, allocation: Allocation, *,
                     tau: OutputPort, state: OutputPort, force: OutputPort,
                     name: str = "allocation") -> "ThrusterAllocation":
        """Adds the allocation and connects it; the arguments are its constructor's and inputs."""
        return added(builder, name, ThrusterAllocation(model, allocation),
                     tau=tau, state=state, force=force)
