"""Errors of the model and a current, unknown to the controller and about as large as d̃ covers.

They act as a disturbance, and the tube holds wherever d comes from. So they are scaled down until
the disturbance that they induce takes no more than a share of d̃; the drawn disturbance gets the
rest. The scale is an estimate along the first plan. The run measures the induced one, and
does not count as one inside of the bounds if it was too much. Where d̃ is zero nothing is covered:
then the scenario's own errors are the largest that are drawn, and every run counts.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from uvms_drake.actuation.thrusters import with_errors
from uvms_drake.campaign.induced_disturbance import predicted_disturbance
from uvms_drake.common.errors import InvalidParameter
from uvms_drake.control.ocp.ocp import Ocp
from uvms_drake.control.plan.plan import DynamicPlan
from uvms_drake.model.signals.sensor_actuator import Actuator
from uvms_drake.model.uvms_model import UvmsModel
from uvms_drake.plant.disturbance import ConstantDisturbance
from uvms_drake.plant.model_error import FACTORS, ModelError
from uvms_drake.plant.unknowns import Unknowns
from uvms_drake.plant.uvms_plant import make_uvms_plant
from uvms_drake.station.motions.dynamic import make_simulated_uvms
from uvms_drake.station.scenario.scenario import Scenario

SHARE = 0.5
"""Part of d̃ that is reserved for everything unknown."""
PREDICTED = 0.9
"""Part of that share which the prediction along the first plan may use; later plans differ."""
LIKELY = 0.4
"""Probability that a quantity is unknown in a run."""
LARGEST_SHIFT, LARGEST_TURN, LARGEST_CURRENT = 0.01, 0.05, 0.1
"""Largest displacement [m] and turn [rad] of the surface, and largest current [m/s]."""
TRIM = 0.1
"""Largest error of the buoyancy over that of other quantities: robots are trimmed."""
LARGEST_PAYLOAD = 0.5
"""Largest payload [kg]."""
AT_FULL_SIZE = 0.25
"""Probability of an error of the size that a scenario declares."""
SMALLER = 0.8
ATTEMPTS = 10


class DrawnErrors(NamedTuple):
    """Relative errors, the surface's displacement, the current, the payload; zero where known."""

    mass: float = 0.0
    added_mass: float = 0.0
    drag: float = 0.0
    buoyancy_lever: float = 0.0
    stiffness: float = 0.0
    shift: np.ndarray | float = 0.0
    """Displacement of the surface (3,) [m]."""
    turn: np.ndarray | float = 0.0
    """Turn of the surface (3,) [rad]."""
    current: np.ndarray | float = 0.0
    """Velocity of the water (3,) [m/s]."""
    buoyancy: float = 0.0
    payload: float = 0.0
    """Mass of the payload [kg]."""

    def of_robot(self, known: ModelError, scale: float = 1.0) -> ModelError:
        """Returns the error of the model with `scale` times that of the robot added."""
        relative = {name: getattr(known, name) * (1.0 + scale * getattr(self, name))
                    for name in FACTORS}
        payload = replace(known.payload, mass=known.payload.mass + scale * self.payload)
        return replace(known, **relative, payload=payload)

    def put_into(self, scenario: Scenario, scale: float = 1.0) -> Scenario:
        """Returns the scenario with `scale` times all of it, added to its own errors."""
        surface = scenario.surface_error
        return replace(
            scenario, model_error=self.of_robot(scenario.model_error, scale),
            surface_error=replace(
                surface, stiffness=surface.stiffness * (1.0 + scale * self.stiffness),
                shift=surface.shift + scale * self.shift, turn=surface.turn + scale * self.turn),
            current=np.asarray(scenario.current, dtype=float) + scale * self.current)


def check_draws(robot: str, known: ModelError, largest: float) -> None:
    """Raises `InvalidParameter` if a robot cannot have an error that may be drawn.

    Args:
        robot: Name or folder of the robot.
        known: Its declared errors.
        largest: Largest relative error.
    """
    drawn = DrawnErrors(mass=largest, payload=LARGEST_PAYLOAD).of_robot(known)
    try:
        make_uvms_plant(robot, disturbance=ConstantDisturbance(), error=drawn)
    except InvalidParameter as error:
        raise InvalidParameter(
            "--model-error", largest, "0 for this robot, or numbers in its file: a campaign draws "
            f"errors up to this, and {error.key} must be {error.allowed}") from None


def draw_errors(largest: float, rng: np.random.Generator) -> DrawnErrors:
    """Returns errors of any size up to the largest, of some quantities and at least one.

    Args:
        largest: Largest relative error.
        rng: Source of the draws.
    """
    unknown = rng.uniform(size=len(DrawnErrors._fields)) < LIKELY
    unknown[rng.integers(len(unknown))] = True
    relative = (largest * rng.uniform(-1.0, 1.0, 5)).tolist()
    vectors = [size * rng.uniform() * direction / np.linalg.norm(direction)
               for size, direction in zip((LARGEST_SHIFT, LARGEST_TURN, LARGEST_CURRENT),
                                          rng.normal(size=(3, 3)), strict=True)]
    trim, payload = TRIM * largest * rng.uniform(-1.0, 1.0), LARGEST_PAYLOAD * rng.uniform()
    values = [*relative, *vectors, trim, payload]
    return DrawnErrors(*(value if drawn else 0.0
                      for value, drawn in zip(values, unknown, strict=True)))


def with_unknowns(scenario: Scenario, ocp: Ocp[DynamicPlan], plan: DynamicPlan, largest: float,
                  rng: np.random.Generator) -> Scenario:
    """Returns the scenario with unknown errors and current, about as large as d̃ covers.

    If the draw cannot be made small enough, the scenario is returned unchanged.

    Args:
        scenario: Scenario of which the controller knows everything.
        ocp: Problem of the scenario.
        plan: First plan of the scenario.
        largest: Largest relative error.
        rng: Source of the draws.
    """
    share = max(SHARE, scenario.model_error.share)
    margin = PREDICTED * share * scenario.disturbance.d_bound
    unknowns, scale = draw_errors(largest, rng), 1.0
    shared = replace(scenario, model_error=replace(scenario.model_error, share=share))
    for _ in range(ATTEMPTS):
        candidate = unknowns.put_into(shared, scale)
        induced = predicted_disturbance(
            make_simulated_uvms(candidate, ConstantDisturbance()), candidate.current,
            candidate.waves, candidate.disturbance, plan, ocp)
        if induced <= margin:
            return candidate
        scale *= SMALLER * margin / induced
    return scenario


def as_declared(declared: Unknowns, rng: np.random.Generator) -> Unknowns:
    """Returns declared unknowns drawn up to their declared size.

    An error of either sign is drawn, a current from any horizontal direction, up or down, and a
    wave of any direction and phase: those that a certificate counts,
    `certificate.declared_unknowns`. In one draw of four each has all of its size. Parameters that
    are known stay known.

    Args:
        declared: The largest unknowns.
        rng: Source of the draws.
    """
    part = partial(_part, rng)

    def heading() -> float:
        return float(rng.uniform(-np.pi, np.pi))

    known, current = declared.error, declared.current
    relative = {name: 1.0 + (getattr(known, name) - 1.0) * part() for name in FACTORS}
    shift, carried = part() * np.asarray(known.buoyancy_shift, dtype=float), abs(part())
    payload = replace(known.payload, mass=carried * known.payload.mass,
                      displaced=carried * known.payload.displaced)
    toward, along = heading(), part() * float(np.hypot(*current[:2]))
    water = np.array([along * np.cos(toward), along * np.sin(toward), part() * current[2]])
    # Drawn after the others, and only where they are declared.
    friction = known.joint_friction
    if friction.largest > 0.0:
        stiff = abs(part())
        friction = replace(friction, coulomb=stiff * np.asarray(friction.coulomb, dtype=float),
                           static=stiff * np.asarray(friction.static, dtype=float))
    waves = [replace(wave, amplitude=abs(part()) * wave.amplitude, direction=heading(),
                     phase=heading()) for wave in declared.waves]
    error = replace(known, **relative, buoyancy_shift=shift, payload=payload,
                    joint_friction=friction)
    return Unknowns(error, water, waves)


def as_declared_thrusters(actuation: Sequence[Actuator], model: UvmsModel, rng: np.random.Generator
                          ) -> list[Actuator]:
    """Returns the actuation with the error of each thruster drawn as `as_declared` draws."""
    return with_errors(actuation, model,
                       lambda count: np.array([_part(rng) for _ in range(count)]))


def _part(rng: np.random.Generator) -> float:
    """Returns a drawn error over its declared size, of either sign."""
    size = 1.0 if rng.uniform() < AT_FULL_SIZE else rng.uniform()
    return float(rng.choice([-1.0, 1.0]) * size)
