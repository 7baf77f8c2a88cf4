"""The parameters of a robot in the water: errors of its file, of which the dynamics are affine.

A parameter is a `ModelError` per unit: a factor less 1 of a coefficient by axis or of all displaced
volumes, or a displacement of the vehicle's centre of buoyancy [m].
"""

from collections.abc import Mapping
from dataclasses import replace
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from uvms_drake.model.links import Links, read_links
from uvms_drake.model.robot import Robot
from uvms_drake.plant.model_error import (
    BODIES,
    COEFFICIENTS,
    LARGEST_FACTOR,
    LEAST_FACTOR,
    AxisFactors,
    ModelError,
    simulated_uvms,
)

AXES = ("surge", "sway", "heave", "roll", "pitch", "yaw")
"""Names of the axes of a body, in Fossen's order."""
UNIT = 0.01
"""Error at which the links are read: all is linear in it, and added masses stay positive."""
LARGEST_SHIFT = 0.1
"""Largest displacement of the centre of buoyancy [m]."""
SHIFT, VOLUME = "vehicle.center_of_buoyancy", "displaced_volume"
UNITS = {"added_mass": ("kg", "kg m²"), "linear_drag": ("N s/m", "N m s/rad"),
         "quadratic_drag": ("N s²/m²", "N m s²/rad²")}
"""Units of the coefficients of a linear and of an angular axis."""


class Parameter(NamedTuple):
    """A parameter, as an error θ of the robot's file."""

    name: str
    """Such as `vehicle.added_mass.roll`."""
    error: ModelError
    """The error at θ = `UNIT`."""
    links: Links
    """The links at θ = `UNIT`."""
    value: float
    """Value in the file: that of the vehicle, or the sum over the arm's bodies."""
    unit: str
    """Its unit."""

    @property
    def relative(self) -> bool:
        """Whether θ is a factor less 1; otherwise it is in the parameter's unit."""
        return not self.name.startswith(SHIFT)

    @property
    def scale(self) -> float:
        """Standard deviation of θ before any log is seen."""
        return 0.02 if self.name == VOLUME or not self.relative else 1.0

    @property
    def bounds(self) -> tuple[float, float]:
        """Smallest and largest θ."""
        return ((LEAST_FACTOR - 1.0, LARGEST_FACTOR - 1.0) if self.relative
                else (-LARGEST_SHIFT, LARGEST_SHIFT))

    def value_at(self, theta: float) -> float:
        """Returns the value at an error θ."""
        return self.value * (1.0 + theta) if self.relative else self.value + theta


def parameters_of(robot: Robot | str) -> tuple[Links, list[Parameter]]:
    """Returns the links of a robot, and the parameters that its file has: those with an effect."""
    robot = Robot.load(robot) if isinstance(robot, str) else robot
    base, found = read_links(robot.uvms), list[Parameter]()
    for name, error, value, unit in _candidates(robot):
        links = read_links(simulated_uvms(robot, error))
        if any(not np.array_equal(getattr(base, part), getattr(links, part))
               for part in ("inertia", "weight", "drag_linear", "drag_quadratic")):
            found.append(Parameter(name, error, links, value, unit))
    return base, found


def _candidates(robot: Robot) -> list[tuple[str, ModelError, float, str]]:
    """Returns name, error at θ = `UNIT`, value and unit of each parameter that a file may have."""
    water, vehicle = robot.uvms.hydrodynamics, robot.uvms.vehicle
    center = robot.uvms.water(vehicle).center_of_buoyancy
    volume = sum(body.displaced_volume for body in water.bodies.values())
    found = [(VOLUME, ModelError(buoyancy=1.0 + UNIT), volume, "m³")]
    found += [(f"{SHIFT}.{axis}", ModelError(buoyancy_shift=UNIT * np.eye(3)[i]),
               float(center[i]), "m")
              for i, axis in enumerate("xyz")]
    for body, name, i in product(BODIES, COEFFICIENTS, range(6)):
        error = replace(ModelError(), **dict[str, Any]({
            body: AxisFactors(**{name: 1.0 + UNIT * np.eye(6)[i]})}))
        value = 0.0
        for key, each in water.bodies.items():
            if (key == vehicle.name()) == (body == "vehicle"):
                value += sum(float(_diagonal(item.matrix)[i]) for item in each.added_mass) if (
                    name == "added_mass") else sum(
                        float(getattr(item, name.removesuffix("_drag"))[i]) for item in each.drag)
        found.append((f"{body}.{name}.{AXES[i]}", error, value, UNITS[name][i // 3]))
    return found


def _diagonal(matrix: np.ndarray) -> np.ndarray:
    return np.asarray(matrix) if np.ndim(matrix) == 1 else np.diag(matrix)


def error_of(values: Mapping[str, float]) -> ModelError:
    """Returns the `ModelError` of errors θ by the names of parameters.

    The moment of the buoyancy is linear in both volume and displacement if the latter is that of
    the volume in the file.
    """
    volume = 1.0 + values.get(VOLUME, 0.0)
    error = ModelError(buoyancy=volume, buoyancy_shift=np.array([
        values.get(f"{SHIFT}.{axis}", 0.0) for axis in "xyz"]) / volume)
    by_axis: dict[str, Any] = {body: AxisFactors(**{name: 1.0 + np.array([
        values.get(f"{body}.{name}.{axis}", 0.0) for axis in AXES]) for name in COEFFICIENTS})
        for body in BODIES}
    return replace(error, **by_axis)
