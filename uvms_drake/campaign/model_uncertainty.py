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

import numpy as np

from uvms_drake.actuation.thrusters import with_errors
from uvms_drake.model.signals.sensor_actuator import Actuator
from uvms_drake.model.uvms_model import UvmsModel
from uvms_drake.plant.model_error import FACTORS
from uvms_drake.plant.unknowns import Unknowns

AT_FULL_SIZE = 0.25
"""Probability of an error of the size that a scenario declares."""


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
