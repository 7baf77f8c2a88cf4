"""How the simulated robot differs from the one that the controller knows."""

import re
from dataclasses import dataclass, replace

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex

from uvms_drake.common.errors import require
from uvms_drake.model.hydrodynamics_data import BodyHydrodynamics, HydrodynamicParameters

INERTIAL = re.compile(r"<(mass|i[xyz][xyz])>\s*([^<]*?)\s*</\1>")
FACTORS = ("mass", "added_mass", "drag", "buoyancy_lever")


@dataclass
class ModelError:
    """The simulated robot's parameters over the controller's; 1 where they are the same."""

    mass: float = 1.0
    """Of masses and inertias, and of the displaced volumes: a robot is trimmed before it dives."""
    added_mass: float = 1.0
    drag: float = 1.0
    buoyancy_lever: float = 1.0
    """Of the distance from the centre of mass to that of buoyancy, of each body."""
    share: float = 0.0
    """Part of d̃ that is left to what the error induces; the disturbance takes the rest."""

    @property
    def size(self) -> float:
        """Returns the largest relative error; zero if there is none."""
        return max(abs(getattr(self, name) - 1.0) for name in FACTORS)


def check_model_error(error: ModelError) -> None:
    """Raises `InvalidParameter` for the first factor that no robot can have."""
    for name in FACTORS:
        value = getattr(error, name)
        require(bool(0.1 <= value <= 10.0), name, value, "between 0.1 and 10")
    require(bool(0.0 <= error.share < 1.0), "share", error.share, "at least 0 and below 1")


def scaled_inertias(sdf: str, factor: float) -> str:
    """Returns the text of an SDFormat file with its masses and inertias multiplied."""
    return INERTIAL.sub(
        lambda found: f"<{found[1]}>{float(factor * float(found[2]))!r}</{found[1]}>", sdf)


def scaled_hydrodynamics(parameters: HydrodynamicParameters, error: ModelError,
                         plant: MultibodyPlant, instance: ModelInstanceIndex
                         ) -> HydrodynamicParameters:
    """Returns what the water does to the simulated robot; the bodies are those of `plant`."""
    return replace(parameters, bodies={
        name: _scaled(body, error, plant.GetBodyByName(name, instance).default_com())
        for name, body in parameters.bodies.items()})


def _scaled(body: BodyHydrodynamics, error: ModelError, com: np.ndarray) -> BodyHydrodynamics:
    lever = np.asarray(body.center_of_buoyancy, dtype=float) - com
    return replace(
        body, displaced_volume=error.mass * body.displaced_volume,
        center_of_buoyancy=com + error.buoyancy_lever * lever,
        added_mass=[replace(item, matrix=error.added_mass * np.asarray(item.matrix, dtype=float))
                    for item in body.added_mass],
        drag=[replace(item, linear=error.drag * np.asarray(item.linear, dtype=float),
                      quadratic=error.drag * np.asarray(item.quadratic, dtype=float))
              for item in body.drag])
