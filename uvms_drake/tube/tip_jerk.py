"""The jerk of the planned end-effector, by which it is off a parabola between two knots."""

import numpy as np

from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.euler import rotation_matrix
from uvms_drake.model.spatial import times
from uvms_drake.model.uvms_model import configuration_rate
from uvms_drake.tube.constraint_set import ConstraintSet

DIFFERENCE = 1e-3
"""Step of the differences [s]."""


def tip_jerk(model: ContactModel, planned: ConstraintSet, step: float, tool_angle: float,
             samples: int, seed: int = 0) -> float:
    """Returns the largest |d³(n·𝔭)/dt³| [m/s³] that was found over the intervals of plans.

    In an interval ζ̄̇ is constant, so it is (ζ₁ − ζ₀)/h for two velocities of the set: one and its
    opposite at most, half of the time. A random search: an estimate from below.

    Args:
        model: The controller's; without contact, which has no part in it.
        planned: The set of the plans' states; `contact_measure` has no meaning here.
        step: h [s].
        tool_angle: Largest angle between n and the tip's x-axis [rad].
        samples: Number of intervals looked at.
        seed: Seed of the search.
    """
    rng = np.random.default_rng(seed)
    config, before = planned.sample(model, samples, rng)
    after = planned.sample(model, samples, rng)[1]
    after = np.where(rng.uniform(size=(samples, 1)) < 0.5, -before, after)
    rate = (after - before) / step
    zeta = before + rng.uniform(size=(samples, 1)) * (after - before)
    off = tool_angle * np.sqrt(rng.uniform(size=samples))
    about = rng.uniform(-np.pi, np.pi, samples)
    n_E = np.stack([np.cos(off), np.sin(off) * np.cos(about), np.sin(off) * np.sin(about)], -1)
    n = times(rotation_matrix(model.task_pose(config)[:, 3:6]), n_E)

    def speed(time: float) -> np.ndarray:
        """Returns n·𝔭̇ (m,) a little later, 𝔮 by the midpoint rule."""
        middle = zeta + 0.5 * time * rate
        at = config + 0.5 * time * configuration_rate(config, zeta)
        moved = config + time * configuration_rate(at, middle)
        J = model.kinematics(moved).J_chi[:, :3]
        return np.sum(n * times(J, zeta + time * rate), axis=-1)

    jerk = (speed(DIFFERENCE) - 2.0 * speed(0.0) + speed(-DIFFERENCE)) / DIFFERENCE**2
    return float(np.max(np.abs(jerk)))
