"""What the hand holds without the controller's knowing."""

from dataclasses import dataclass, field, replace

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import SpatialInertia, UnitInertia

from uvms_drake.common.errors import require, vector
from uvms_drake.model.description.hydrodynamics_file import AddedMass, BodyHydrodynamics
from uvms_drake.model.uvms import Uvms

NAME = "unknown_payload"
"""Of its body in the plant."""


@dataclass
class Payload:
    """A ball in the hand, which moves with the end-effector.

    Its weight, its buoyancy, its inertia and its added mass, half of the water that it displaces,
    act on the arm; its drag is left out. A wrist sensor does not feel it: what that feels is its
    `tool`.
    """

    mass: float = 0.0
    """Mass [kg]."""
    displaced: float = 0.0
    """Mass of the water that it displaces [kg]."""
    centre: np.ndarray = field(default_factory=lambda: np.zeros(3))
    """Its centre in the frame of the end-effector [m]."""

    def check(self) -> None:
        """Raises `InvalidParameter` for the first value that has no meaning."""
        for key in ("mass", "displaced"):
            require(0.0 <= getattr(self, key) <= 1e3, key, getattr(self, key), "from 0 to 1000 kg")
        centre = vector("centre", self.centre, 3)
        require(bool(np.max(np.abs(centre)) <= 10.0), "centre", centre, "within 10 m")


def with_payload(plant: MultibodyPlant, uvms: Uvms, payload: Payload) -> Uvms:
    """Adds a payload to the end-effector of a robot in a plant, which is not finalized."""
    parameters, centre = uvms.hydrodynamics, np.asarray(payload.centre, dtype=float)
    volume = payload.displaced / parameters.fluid_density
    radius = float(np.cbrt(0.75 * volume / np.pi))
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
