"""A payload in the hand that the controller does not know of.

A ball of mass m and radius r displaces water of mass m_w. Its centre C, at c from the origin of the
end-effector E, accelerates by a_C = a_E + α × c + ω × (ω × c), the water by a_w. The hand exerts

    f = m (a_C − g) + m_w (g − a_w) + ½ m_w (a_C − a_w),     n = c × f + (2/5) m r² α            (1)

on it, about E: inertia and weight, buoyancy and the force of Froude and Krylov, added mass, which
has no moment about C. A wrist sensor feels (1) with the sign of the force on the wall.
"""

from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import SpatialInertia, UnitInertia
from pydrake.systems.framework import BasicVector, Context

from uvms_drake.common.constraints import Between, NotNegative, Vector, Within
from uvms_drake.common.wiring import WiredSystem
from uvms_drake.model.description.hydrodynamics_file import AddedMass, BodyHydrodynamics
from uvms_drake.model.frames.spatial import cross
from uvms_drake.model.uvms import Uvms

NAME = "unknown_payload"
"""Name of its body in the plant."""


@dataclass
class Payload:
    """A ball in the hand, which moves with the end-effector.

    Its weight, its buoyancy, its inertia and its added mass, half of the water that it displaces,
    act on the arm, and on a wrist sensor, whose model does not know of it; its drag is left out.
    """

    mass: Annotated[float, Between(0, 1000, " kg")] = 0.0
    """Mass [kg]."""
    displaced: Annotated[float, Between(0, 1000, " kg")] = 0.0
    """Mass of the water that it displaces [kg]."""
    centre: Annotated[np.ndarray, Vector(3), Within(10.0, "m")] = field(
        default_factory=lambda: np.zeros(3))
    """Its centre in the frame of the end-effector [m]."""
    acceleration: Annotated[float, NotNegative] = 0.0
    """Largest acceleration of any of its points in a certificate with a sensed contact, which
    verifies it [m/s²]."""

    @property
    def present(self) -> bool:
        """Whether there is one."""
        return self.mass > 0.0 or self.displaced > 0.0

    def radius(self, density: float) -> float:
        """Returns the radius of the ball [m] in water of a density [kg/m³]."""
        return float(np.cbrt(0.75 * (self.displaced / density) / np.pi))

    def largest_hold(self, density: float, gravity: float, water: float) -> tuple[float, float]:
        """Returns bounds of the norms of force [N] and moment [N m] of `holding_wrench`.

        With a of `acceleration` and a_w that of the water, m|g| and m_w|g| being opposite,

            ‖f‖ ≤ |m − m_w| g + (m + ½m_w) a + (3/2) m_w a_w,     ‖n‖ ≤ ‖c‖ ‖f‖ + (2/5) m r a.

        Args:
            density: Of the water [kg/m³].
            gravity: ‖g‖ [m/s²].
            water: Bound of ‖a_w‖ [m/s²].
        """
        mass, displaced = self.mass, self.displaced
        force = (abs(mass - displaced) * gravity
                 + (mass + 0.5 * displaced) * self.acceleration + 1.5 * displaced * water)
        moment = (float(np.linalg.norm(self.centre)) * force
                  + 0.4 * mass * self.radius(density) * self.acceleration)
        return force, moment


def holding_wrench(payload: Payload, density: float, acceleration: np.ndarray, omega: np.ndarray,
                   gravity: np.ndarray, water: np.ndarray) -> np.ndarray:
    """Returns (f, n) of (1) (..., 6) [N, N m] about E in its axes, in which all vectors are.

    Args:
        payload: The payload.
        density: Of the water [kg/m³].
        acceleration: (a_E, α) (..., 6) [m/s², rad/s²].
        omega: ω, angular velocity of E (..., 3) [rad/s].
        gravity: g (..., 3) [m/s²].
        water: a_w, acceleration of the water (..., 3) [m/s²].
    """
    c, alpha = np.asarray(payload.centre, dtype=float), acceleration[..., 3:]
    a_C = acceleration[..., :3] + cross(alpha, c) + cross(omega, cross(omega, c))
    force = (payload.mass * (a_C - gravity) + payload.displaced * (gravity - water)
             + 0.5 * payload.displaced * (a_C - water))
    moment = cross(c, force) + 0.4 * payload.mass * payload.radius(density) ** 2 * alpha
    return np.concatenate([force, moment], axis=-1)


def with_payload(plant: MultibodyPlant, uvms: Uvms, payload: Payload) -> Uvms:
    """Adds a payload to the end-effector of a robot in a plant, which is not finalized."""
    parameters, centre = uvms.hydrodynamics, np.asarray(payload.centre, dtype=float)
    volume = payload.displaced / parameters.fluid_density
    radius = payload.radius(parameters.fluid_density)
    about_centre = UnitInertia.SolidSphere(radius) if radius > 0.0 else UnitInertia()
    if radius == 0.0:
        about_centre.SetZero()
    inertia = SpatialInertia(payload.mass, np.zeros(3), about_centre).Shift(-centre)
    body = plant.AddRigidBody(NAME, uvms.model_instance, inertia)
    plant.WeldFrames(uvms.tip, body.body_frame())
    water = BodyHydrodynamics(
        displaced_volume=volume, center_of_buoyancy=centre,
        added_mass=[AddedMass(0.5 * payload.displaced * np.repeat([1.0, 0.0], 3), centre)])
    return replace(uvms, hydrodynamics=replace(
        parameters, bodies={**parameters.bodies, NAME: water}))


class PayloadWrench(WiredSystem):
    """Wrench by which the hand holds a payload, see (1).

    .. pydrake_system::

        name: PayloadWrench
        input_ports:
        - body_poses
        - body_spatial_velocities
        - body_spatial_accelerations
        - current_acceleration (optional)
        output_ports:
        - wrench
        - wrench_at_rest

    - `body_poses`, `body_spatial_velocities`, `body_spatial_accelerations`: from the plant's ports
      of these names.
    - `current_acceleration` (3) [m/s²]: of the water, in World; unconnected means none.
    - `wrench` (6) [N, N m]: about the origin of the end-effector, in its axes.
    - `wrench_at_rest` (6) [N, N m]: that part of it which is there without motion, weight and
      buoyancy. It is known before anything commands the robot.

    This system does not have any state.

    Args:
        plant: A finalized plant.
        uvms: Its robot, with the payload as `with_payload` adds it.
        payload: The payload.
    """

    def __init__(self, plant: MultibodyPlant, uvms: Uvms, payload: Payload):
        super().__init__()
        self._payload, self._density = payload, uvms.hydrodynamics.fluid_density
        self._index = int(plant.GetBodyByName(NAME, uvms.model_instance).index())
        self._gravity = plant.gravity_field().gravity_vector()
        self._ports = [
            self.DeclareAbstractInputPort(port.get_name(), port.Allocate()) for port in (
                plant.get_body_poses_output_port(), plant.get_body_spatial_velocities_output_port(),
                plant.get_body_spatial_accelerations_output_port())]
        self._water_port = self.DeclareVectorInputPort("current_acceleration", 3)
        self.DeclareVectorOutputPort("wrench", 6, self._calc, {self.all_input_ports_ticket()})
        self.DeclareVectorOutputPort("wrench_at_rest", 6, self._calc_at_rest,
                                     {self._ports[0].ticket()})

    def _calc_at_rest(self, context: Context, output: BasicVector) -> None:
        R_WE = self._ports[0].Eval(context)[self._index].rotation().matrix()
        output.SetFromVector(holding_wrench(self._payload, self._density, np.zeros(6), np.zeros(3),
                                            self._gravity @ R_WE, np.zeros(3)))

    def _calc(self, context: Context, output: BasicVector) -> None:
        X_WE, V_WE, A_WE = (port.Eval(context)[self._index] for port in self._ports)
        R_WE, water = X_WE.rotation().matrix(), np.zeros(3)
        if self._water_port.HasValue(context):
            water = self._water_port.Eval(context)
        acceleration = np.concatenate([A_WE.translational() @ R_WE, A_WE.rotational() @ R_WE])
        output.SetFromVector(holding_wrench(
            self._payload, self._density, acceleration, V_WE.rotational() @ R_WE,
            self._gravity @ R_WE, water @ R_WE))
