"""The nominal MPC's problem of a scenario: model, task and limits put together, and its start."""

from dataclasses import replace

import numpy as np

from uvms_drake.common.errors import require, vector, within
from uvms_drake.control.dynamic_ocp import DynamicOcp
from uvms_drake.control.kinematic_ocp import KinematicOcp
from uvms_drake.control.limits import NominalLimits, tighten
from uvms_drake.control.ocp import Ocp
from uvms_drake.model.surface.law import make_surface_law, static_force
from uvms_drake.model.uvms_model import UvmsModel
from uvms_drake.station.scenario import Scenario
from uvms_drake.tube.terminal_set import largest_radius


def load_model(scenario: Scenario) -> UvmsModel:
    """Returns the controller's model of robot and surface."""
    with within("surface"):
        surface = make_surface_law(scenario.surface)
    return UvmsModel.load(scenario.model, surface)


def make_kinematic_ocp(scenario: Scenario, model: UvmsModel | None = None) -> KinematicOcp:
    """Returns the problem of a scenario with kinematic motion; see `motions.make_ocp`."""
    model = model or load_model(scenario)
    y_des, limits = _task(scenario, model, accelerations=False)
    with within("mpc"):
        return KinematicOcp(model, scenario.mpc, y_des, limits)


def make_dynamic_ocp(scenario: Scenario, model: UvmsModel | None = None) -> DynamicOcp:
    """Returns the problem of a scenario with dynamic motion; see `motions.make_ocp`."""
    model = model or load_model(scenario)
    y_des, limits = _task(scenario, model, accelerations=True)
    with within("mpc"):
        ocp = DynamicOcp(model, scenario.mpc, y_des, limits)
    require(bool(np.all(np.abs(ocp.u_eq) <= limits.u)), "limits.u", scenario.limits.u,
            f"at least |u_eq| + tube.u = {np.abs(ocp.u_eq) + scenario.tube.u}, to hold the task")
    return ocp


def retargeted_ocp(scenario: Scenario, force: np.ndarray, model: UvmsModel | None = None
                   ) -> DynamicOcp:
    """Returns the problem of another desired force (6,), with a terminal set of its own.

    The tube stays the scenario's: it holds for all forces within `limits.static_force`.

    Raises:
        InvalidParameter: The force cannot be held within the limits.
    """
    settings, model = scenario.certificate, model or load_model(scenario)
    other = replace(scenario, task=replace(scenario.task, force=force))
    ocp = make_dynamic_ocp(other, model)
    radius, _ = largest_radius(ocp, settings.terminal_samples, settings.seed)
    return make_dynamic_ocp(replace(other, mpc=replace(other.mpc, terminal_radius=radius)), model)


def _task(scenario: Scenario, model: UvmsModel, *, accelerations: bool
          ) -> tuple[np.ndarray, NominalLimits]:
    """Returns y_des (6+n,) and the limits that the tube leaves."""
    surface = model.surface
    limits = tighten(scenario.limits, scenario.tube, model.q_lower, model.q_upper, surface,
                     accelerations=accelerations)
    task = scenario.task
    with within("task"):
        force = vector("force", task.force, 6)
        pose = None if task.pose is None else vector("pose", task.pose, 6)
        posture = vector("posture", task.posture, model.num_joints)
        y_des = np.concatenate([surface.pose_for(force, pose), posture])
        config = model.configuration(y_des)
        _check_force("force", force, model, y_des, limits)
        _check_configuration("pose", "posture", config, y_des, limits)
    return y_des, limits


def start_state(scenario: Scenario, ocp: Ocp) -> np.ndarray:
    """Returns (𝔮, ζ) at t = 0 (2(6+n),), at rest.

    Raises:
        InvalidParameter: The start is outside of the nominal limits.
    """
    with within("start"):
        eta = vector("eta", scenario.start.eta, 6)
        q = vector("q", scenario.start.q, ocp.model.num_joints)
        config = np.concatenate([eta, q])
        y = ocp.model.task_pose(config)
        _check_configuration("eta", "q", config, y, ocp.limits)
        _check_force("eta", eta, ocp.model, y, ocp.limits)
    return np.concatenate([config, np.zeros_like(config)])


def _check_force(key: str, value: np.ndarray, model: UvmsModel, y: np.ndarray,
                 limits: NominalLimits) -> None:
    """Raises unless the surface is pressed no harder at rest at y than the limits allow."""
    if limits.static_force is not None:
        pressed = float(static_force(model.surface, y[:6]))
        require(pressed <= limits.static_force, key, value,
                f"such that the static force, {pressed:.4g} N, is at most "
                f"{limits.static_force:.4g} N, what the tube leaves of limits.static_force")


def _check_configuration(pose_key: str, joint_key: str, config: np.ndarray, y: np.ndarray,
                         limits: NominalLimits) -> None:
    """Raises unless a configuration 𝔮 and its y = (χ, q) are within the nominal limits."""
    q, eta = config[6:], config[:6]
    require(bool(np.all((limits.q_lower <= q) & (q <= limits.q_upper))), joint_key, q,
            f"within the joint limits less the tube, {limits.q_lower} to {limits.q_upper}")
    for name, angle, limit in (("roll", eta[3], limits.roll), ("pitch", eta[4], limits.pitch)):
        require(abs(angle) <= limit, pose_key, eta,
                f"such that the vehicle's {name}, {angle:.3g}, is within ±{limit:.3g}")
    require(abs(y[4]) <= limits.tip_pitch, pose_key, eta,
            f"such that the tip's pitch, {y[4]:.3g}, is within ±{limits.tip_pitch:.3g}")
