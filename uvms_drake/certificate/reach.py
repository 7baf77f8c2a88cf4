"""How hard the robot presses: forces of the declared set, of a plan, and of the tube about it."""

import numpy as np

from uvms_drake.control.limits import TubeRadii, resolved_radii
from uvms_drake.control.plan import Plan
from uvms_drake.model.contact import PlaneLaw, SpringLaw
from uvms_drake.model.uvms_model import UvmsModel
from uvms_drake.scenario import Scenario

AT_START = 1.1
"""How many times the force at the start the declared set reaches."""


def largest_force(scenario: Scenario, model: UvmsModel) -> float:
    """Returns the largest norm of a force on the surface in the declared set [N].

    It is `force_range` times the desired one, or what the surface asks for at the start, and at
    least 1 N.
    """
    desired = float(np.linalg.norm(np.asarray(scenario.task.force, dtype=float)[:3]))
    start = model.task_pose(np.concatenate([scenario.start.eta, scenario.start.q]))[:6]
    at_start = float(np.linalg.norm(model.surface.force(start, np.zeros(6))[:3]))
    return max(scenario.certificate.force_range * desired, AT_START * at_start, 1.0)


def pressed_force(model: UvmsModel, plan: Plan) -> float:
    """Returns the largest norm of the force of a plan's poses at its knots [N]."""
    chi = model.task_pose(plan.config)[:, :6]
    return float(np.max(np.linalg.norm(
        model.surface.force(chi, np.zeros_like(chi))[:, :3], axis=1)))


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
        K = surface.K
        out["force"] = float(np.linalg.norm(K[:3, :3], 2) * tube.position
                             + np.linalg.norm(K[:3, 3:], 2) * tube.orientation)
    return out
