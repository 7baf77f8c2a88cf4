"""Forces of other systems, such as Drake's `Propeller`, on a robot under water.

Frames: W is World, B a body with origin Bo, Bq a point of B. A spatial force F_Bq_W is a moment and
a force on B at Bq, in World, as Drake has it.
"""

from collections.abc import Iterable
from typing import cast

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.multibody.plant import ExternallyAppliedSpatialForce, MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable
from pydrake.systems.framework import BasicVector, Context

from uvms_drake.common.wiring import WiredSystem
from uvms_drake.plant.hydrodynamics import declare_workspace


def generalized_force(plant: MultibodyPlant, context: Context,
                      forces: Iterable[ExternallyAppliedSpatialForce]) -> np.ndarray:
    """Returns Σ JᵀF_Bq_W (nv,) [N, N m], J the Jacobian of the spatial velocity V_WBq in World.

    Args:
        plant: A finalized plant.
        context: Its Context, with the configuration.
        forces: The forces F_Bq_W, each with its body B and p_BoBq_B.
    """
    total, W = np.zeros(plant.num_velocities()), plant.world_frame()
    for force in forces:
        J = plant.CalcJacobianSpatialVelocity(
            context, JacobianWrtVariable.kV, plant.get_body(force.body_index).body_frame(),
            force.p_BoBq_B, W, W)
        total += force.F_Bq_W.get_coeffs() @ J
    return total


class AppliedForces(WiredSystem):
    """Sum of forces in the form of a `MultibodyPlant`, for a robot under water.

    At a port of the plant they would move its dry mass only. As an input of `Hydrodynamics` they
    move the water too.

    .. pydrake_system::

        name: AppliedForces
        input_ports:
        - plant_state
        - applied_spatial_force (optional)
        - applied_generalized_force (optional)
        output_ports:
        - generalized_force

    - `plant_state` (nq + nv): from `plant.get_state_output_port()`.
    - `applied_spatial_force`: list[ExternallyAppliedSpatialForce], e.g. of a `Propeller`, or of
      several systems through an `ExternallyAppliedSpatialForceMultiplexer`; unconnected means none.
    - `applied_generalized_force` (nv) [N, N m]: in the plant's order; unconnected means zero.
    - `generalized_force` (nv) [N, N m]: their sum, in the plant's order; to
      `Hydrodynamics.generalized_force`.

    This system does not have any state.

    Args:
        plant: A finalized plant.
    """

    def __init__(self, plant: MultibodyPlant):
        super().__init__()
        self._plant = plant
        self._workspace = declare_workspace(self, plant)
        self._plant_state_port = self.DeclareVectorInputPort(
            "plant_state", plant.num_multibody_states())
        self._spatial_port = self.DeclareAbstractInputPort(
            "applied_spatial_force", AbstractValue.Make([ExternallyAppliedSpatialForce()]))
        self._generalized_port = self.DeclareVectorInputPort(
            "applied_generalized_force", plant.num_velocities())
        self.DeclareVectorOutputPort(
            "generalized_force", plant.num_velocities(), self._calc_generalized_force,
            {self.all_input_ports_ticket()})

    def _calc_generalized_force(self, context: Context, output: BasicVector) -> None:
        total = np.zeros(self._plant.num_velocities())
        if self._spatial_port.HasValue(context):
            forces = cast(list[ExternallyAppliedSpatialForce], self._spatial_port.Eval(context))
            workspace = self._workspace.Eval(context).context
            self._plant.SetPositionsAndVelocities(
                workspace, cast(np.ndarray, self._plant_state_port.Eval(context)))
            total += generalized_force(self._plant, workspace, forces)
        if self._generalized_port.HasValue(context):
            total += cast(np.ndarray, self._generalized_port.Eval(context))
        output.SetFromVector(total)
