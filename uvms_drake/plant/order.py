"""Conversion between the orders of `MultibodyPlant` and of the paper; see `model.coordinates`."""

import numpy as np
from pydrake.systems.framework import Context

from uvms_drake.common.wiring import WiredSystem, output_of
from uvms_drake.model.coordinates import Coordinates


class ToPaperOrder(WiredSystem):
    """Conversion of the state of a plant to (𝔮, ζ), and of its acceleration to ζ̇.

    With v = T(𝔮) ζ, T orthogonal, ζ̇ = Tᵀ(v̇ − Ṫζ).

    .. pydrake_system::

        name: ToPaperOrder
        input_ports:
        - plant_state
        - v_dot (for acceleration)
        output_ports:
        - state
        - acceleration

    - `plant_state` (nq + nv): from `plant.get_state_output_port()`.
    - `v_dot` (nv): v̇ in the plant's order, e.g. of `Hydrodynamics`.
    - `state` (2 (6 + n)): 𝔮 [m, rad] in World, ζ [m/s, rad/s] in body axes.
    - `acceleration` (6 + n) [m/s², rad/s²]: ζ̇, the vehicle's part in body axes.

    This system does not have any state.

    Args:
        coordinates: Coordinates of the robot in the plant.
    """

    def __init__(self, coordinates: Coordinates):
        super().__init__()
        self.coordinates = coordinates
        self._plant_state_port = self.DeclareVectorInputPort(
            "plant_state", coordinates.num_positions + coordinates.num_velocities)
        self._v_dot_port = self.DeclareVectorInputPort("v_dot", coordinates.num_velocities)
        output_of(self, "state", 2 * coordinates.size,
                  lambda c: coordinates.from_drake(self._plant_state_port.Eval(c)),
                  {self.input_port_ticket(self._plant_state_port.get_index())})
        output_of(self, "acceleration", coordinates.size,
                  lambda c: coordinates.acceleration_from_drake(
                      self._plant_state_port.Eval(c), self._v_dot_port.Eval(c)),
                  {self.all_input_ports_ticket()})


class ToDrakeOrder(WiredSystem):
    """Conversion of a generalised force τ or acceleration from the paper's order to the plant's.

    With v = T(𝔮) ζ, T orthogonal, the output is T w: a force keeps its power, and d added to ζ̇ is
    the same as T d added to v̇.

    .. pydrake_system::

        name: ToDrakeOrder
        input_ports:
        - plant_state
        - paper_order (optional)
        output_ports:
        - drake_order

    - `plant_state` (nq + nv): from `plant.get_state_output_port()`.
    - `paper_order` (6 + n): w, e.g. τ [N, N m] or d [m/s², rad/s²], the vehicle's part in body
      axes; unconnected means zero.
    - `drake_order` (nv): T w; to an input of `Hydrodynamics`.

    This system does not have any state.

    Args:
        coordinates: Coordinates of the robot in the plant.
    """

    def __init__(self, coordinates: Coordinates):
        super().__init__()
        self._coordinates = coordinates
        self._plant_state_port = self.DeclareVectorInputPort(
            "plant_state", coordinates.num_positions + coordinates.num_velocities)
        self._vector_port = self.DeclareVectorInputPort("paper_order", coordinates.size)
        output_of(self, "drake_order", coordinates.num_velocities, self._in_drake_order,
                  {self.all_input_ports_ticket()})

    def _in_drake_order(self, context: Context) -> np.ndarray:
        if not self._vector_port.HasValue(context):
            return np.zeros(self._coordinates.num_velocities)
        return self._coordinates.vector_to_drake(
            self._plant_state_port.Eval(context), self._vector_port.Eval(context))
