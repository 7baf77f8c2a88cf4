"""How far pose and force can be off the task, once the nominal state has come to it."""

import numpy as np

from uvms_drake.control.limits import TubeRadii, force_radius, resolved_radii
from uvms_drake.model.surface.law import PlaneLaw, SpringLaw
from uvms_drake.model.uvms_model import UvmsModel
from uvms_drake.station.scenario import Scenario


def ultimate_bounds(tube: TubeRadii, scenario: Scenario, model: UvmsModel,
                    tip_speed: float | None = None) -> dict[str, float]:
    """Returns what is left once the nominal state has come to the task.

    `position` [m] and `orientation` [rad] of the end-effector, and `force` [N], the largest
    ‖force part of 𝔉 − 𝔉_des‖: a plane's over the depth ± `position` and the speed that goes with
    it; a spring's from the norms of the blocks of K.

    Args:
        tube: The radii.
        scenario: Task and gains.
        model: The controller's model.
        tip_speed: Bound of ‖𝔢̇_p‖ [m/s]. By default that of the law `resolved`, σE + gR = 2σE, see
            `tubes.resolved_tube`; of the kinematics it is σE + w̃ = 2σE too.
    """
    surface, tube = model.surface, resolved_radii(tube)
    assert tube.position is not None and tube.orientation is not None  # now they are filled in
    if tip_speed is None:
        tip_speed = 2.0 * scenario.ancillary.sigma * tube.position
    out = {"position": tube.position, "orientation": tube.orientation}
    desired = np.asarray(scenario.task.force, dtype=float)
    if isinstance(surface, PlaneLaw):
        signs = np.array([-1.0, 1.0])
        chi = np.tile(surface.pose_for(desired, scenario.task.pose), (4, 1))
        chi_dot = np.zeros((4, 6))
        chi[:, :3] += np.repeat(tube.position * signs, 2)[:, None] * surface.normal
        chi_dot[:, :3] = np.tile(tip_speed * signs, 2)[:, None] * surface.normal
        error = surface.force(chi, chi_dot)[:, :3] - desired[:3]
        out["force"] = float(np.max(np.linalg.norm(error, axis=1)))
    if isinstance(surface, SpringLaw):
        out["force"] = force_radius(tube, surface)
    return out
