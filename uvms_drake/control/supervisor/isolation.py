"""Isolation of a thruster that sticks or is dead, by the disturbance that an observer sees.

A thruster whose force is off by f exerts the wrench b f, b its column of the thrust map. If one
column explains the observed wrench w, the robot cuts the power of that thruster and goes on with
the others; an axis that they do not drive for themselves is given up, see `ThrusterModel.without`.
It is looked for from half of the threshold on until shortly after the trip, before the retreat's
own motion, the turn into the flow and saturated thrusters are in w, and never cut if it alone
drives an axis. A contact force that is not read is in w, too: so only after a trip by drift or a
deviation, while the force is read and the drift above its threshold, and if the same thruster is
found for a while. Later it is looked for again, whatever the cause was, for as long from the last
drift below half of the threshold on: while the robot stands off the wall, with fixes.
"""

import numpy as np

from uvms_drake.model.propulsion.thrusters import ThrusterModel
from uvms_drake.model.uvms_model import UvmsModel, configuration_rate_matrix

ISOLATION = 1.0
"""Time after the trip, or after the last small drift, in which a thruster is isolated [s]."""
SUSPICION = 0.5
"""Ratio of the drift to its threshold from which on one is looked for."""
CONFIRMED = 0.1
"""Time for which it has to be the same one [s]."""
UNEXPLAINED = 0.5
"""Largest part of w, weighted, that its column may leave. A current along an axis leaves 0.7: of
two thrusters abreast, one alone turns the vehicle, too."""
OFF = 0.12
"""Least |f| over the largest force of a thruster."""


def wrench_of(model: UvmsModel, config: np.ndarray, disturbance: np.ndarray) -> np.ndarray:
    """Returns the wrench w (6,) on the vehicle [N, N m] by which η is disturbed.

    δ = [J_η M⁻¹ (w, 0)], η̇ = J_η ζ.

    Args:
        model: Supplies M.
        config: 𝔮 (6+n,).
        disturbance: δ̂ of η (6,) [m/s², rad/s²].
    """
    M = model.mass_matrix(model.kinematics(config))
    mobility = np.linalg.solve(M.T, configuration_rate_matrix(config)[:6].T).T[:, :6]
    wrench: np.ndarray = np.linalg.solve(mobility, disturbance)
    return wrench


def faulty_thruster(thrusters: ThrusterModel, wrench: np.ndarray) -> int:
    """Returns the number, from 1, of the thruster that explains a wrench (6,); 0 for none.

    It is fitted on the driven axes, each over its largest force or moment.
    """
    B, driven = thrusters.B[thrusters.driven], thrusters.driven
    largest = np.maximum(-thrusters.lower, thrusters.upper)
    weights = 1.0 / (np.abs(B) @ largest)
    columns, w = weights[:, None] * B, weights * wrench[driven]
    forces = columns.T @ w / np.sum(columns**2, axis=0)
    left = np.linalg.norm(w[:, None] - columns * forces, axis=0)
    best = int(np.argmin(left))
    others = np.any(np.delete(columns, best, 1) != 0.0, axis=1)
    return best + 1 if (
        left[best] < UNEXPLAINED * np.linalg.norm(w) and abs(forces[best]) > OFF * largest[best]
        and others.all()) else 0
