"""Trim: weight and buoyancy of a robot in still water, its arm in a fixed posture."""

from dataclasses import dataclass

import numpy as np
from pydrake.systems.framework import Context

from uvms_drake.model.uvms import Uvms


@dataclass(frozen=True)
class Trim:
    """Masses and their centres, in axes of the vehicle (FRD) about its origin."""

    mass: float
    """Dry mass m [kg]."""
    displaced_mass: float
    """Mass ρV of the displaced water [kg]."""
    center_of_mass: np.ndarray
    """Centre of mass p_BG (3,) [m]."""
    center_of_buoyancy: np.ndarray
    """Centre of buoyancy p_BC (3,) [m]; without buoyancy, that of mass."""

    @property
    def righting_lever(self) -> float:
        """Height z_G − z_C of the centre of buoyancy above that of mass [m]."""
        return float(self.center_of_mass[2] - self.center_of_buoyancy[2])


def middle_posture(uvms: Uvms) -> np.ndarray:
    """Returns the middle of the joints' limits (n,) [rad, m].

    For a joint without both it is zero, or the admissible value nearest to zero.
    """
    limits = np.array([[joint.position_lower_limits()[0], joint.position_upper_limits()[0]]
                       for joint in uvms.joints]).reshape(-1, 2)
    middle = np.clip(0.0, limits[:, 0], limits[:, 1])
    finite = np.all(np.isfinite(limits), axis=1)
    middle[finite] = limits[finite].mean(axis=1)
    return middle


def pose_joints(uvms: Uvms, context: Context, posture: np.ndarray) -> None:
    """Puts the joints of a plant's context at q (n,) [rad, m]."""
    q = uvms.plant.GetPositions(context)
    q[[joint.position_start() for joint in uvms.joints]] = posture
    uvms.plant.SetPositions(context, q)


def trim_of(uvms: Uvms, posture: np.ndarray) -> Trim:
    """Returns the trim of a robot in a finalized plant at the joints' q (n,) [rad, m]."""
    plant = uvms.plant
    context = plant.CreateDefaultContext()
    pose_joints(uvms, context, posture)
    masses, moments = np.zeros(2), np.zeros((2, 3))
    for index in plant.GetBodyIndices(uvms.model_instance):
        body = plant.get_body(index)
        X_VB = plant.CalcRelativeTransform(
            context, uvms.vehicle.body_frame(), body.body_frame())
        water = uvms.water(body)
        for i, (mass, center) in enumerate((
                (body.default_mass(), body.default_com()),
                (uvms.hydrodynamics.fluid_density * water.displaced_volume,
                 np.asarray(water.center_of_buoyancy, dtype=float)))):
            masses[i] += mass
            moments[i] += mass * (X_VB @ center)
    centers = moments / np.maximum(masses, 1e-300)[:, None]
    return Trim(float(masses[0]), float(masses[1]), centers[0],
                centers[1] if masses[1] > 0.0 else centers[0])
