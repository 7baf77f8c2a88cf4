"""The nominal MPC's problem of a scenario: model, task and limits put together, and its start."""

from dataclasses import replace

import numpy as np

from uvms_drake.common.errors import InvalidParameter, require, vector, within
from uvms_drake.common.schema import check_values
from uvms_drake.control.contact.contact_state import initial_contact_state, updated_contact_state
from uvms_drake.control.contact.press_target import SEARCH_DEPTH
from uvms_drake.control.contact.safe_region import bounds, safe_depth
from uvms_drake.control.limits import Limit, TubeRadii, check_limits, make_limits, tighten
from uvms_drake.control.limits.input_in_contact import ForceCone, UnderContact
from uvms_drake.control.limits.inputs import InputLimit
from uvms_drake.control.limits.pose import ANGLES
from uvms_drake.control.ocp.ocp import Ocp
from uvms_drake.control.ocp.tracking_ocp import TrackingOcp, TrackingTarget
from uvms_drake.control.plan.points import Points
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.robot import Robot
from uvms_drake.model.surface import BilateralSpring
from uvms_drake.model.surface.law import Surface, check_surface
from uvms_drake.model.surface.surface_class import heading_of
from uvms_drake.plant.model_check import sound_robot
from uvms_drake.plant.surface import displaced
from uvms_drake.station.contact.bounds import (
    largest_normal_force,
    safe_depth_margin,
    sensed_contact,
    sensing_of,
)
from uvms_drake.station.scenario.scenario import Scenario
from uvms_drake.tube.terminal_set import largest_radius


def load_model(scenario: Scenario, robot: Robot | None = None) -> ContactModel:
    """Returns the controller's model of robot and surface.

    Args:
        scenario: Robot, surface, contact and frame of the task.
        robot: The robot, if it is loaded and sound already.

    Raises:
        InvalidParameter: The surface has no meaning, the robot is none, see `sound_robot`, or the
            scenario has a simulation of its own.
    """
    require(not scenario.simulation, "simulation", scenario.simulation,
            "left out: a scenario with a simulation of its own has `run` and `certify` alone")
    with within("surface"):
        surface = check_surface(scenario.surface)
    with within("contact"):
        controller_surface = scenario.contact.controller_surface(surface)
    with within("task"):
        frame = vector("frame", scenario.task.frame, 3)
        require(not (np.any(frame) and isinstance(surface, BilateralSpring)), "frame", frame,
                "zero: the Euler angles of the paper's spring are about Σ_I")
    robot = robot or sound_robot(scenario.model)
    return ContactModel(robot.uvms, controller_surface, frame)


def make_ocp(scenario: Scenario, model: ContactModel | None = None) -> Ocp:
    """Returns the nominal MPC's problem.

    Args:
        scenario: Task, limits, tube and settings of the MPC.
        model: The controller's; loaded if it is left out.

    Raises:
        InvalidParameter: A value cannot be used, or the task cannot be held within the limits.
    """
    model = model or load_model(scenario)
    known = scenario.contact.declared_wall() is None
    return make_dynamic_ocp(scenario, model) if known else make_tracking_ocp(scenario, model)


def limits_of(scenario: Scenario, model: ContactModel) -> dict[str, Limit]:
    """Returns the limits of the real robot by name; the model is the controller's."""
    return make_limits(scenario.limits, model.q_lower, model.q_upper, model.surface,
                       thrusters=model.thrusters, slides=model.slides,
                       of_contact=scenario.contact.limits())


def disturbance_weights(scenario: Scenario, model: ContactModel) -> np.ndarray:
    """Returns the diagonal of Ŵ (6+n,), one for each component of d, the largest 1."""
    with within("disturbance"):
        return scenario.disturbance.relative_weights(model.size)


def true_surface(scenario: Scenario) -> Surface:
    """Returns the simulated surface, which the controller may not know."""
    return displaced(scenario.surface, scenario.surface_error)


def surface_heading(scenario: Scenario) -> float:
    """Returns the heading [rad] of a robot that faces the surface; 0 if it has no direction."""
    wall, normal = scenario.contact.declared_wall(), true_surface(scenario).normal
    if wall is None and normal is None:
        return 0.0
    return heading_of(-np.asarray(normal) if wall is None else wall.direction)


def shown_surface(scenario: Scenario, model: ContactModel) -> Surface:
    """Returns the surface for drawing and for task errors: the model's, if it has one."""
    if scenario.contact.declared_wall() is None:
        return model.surface
    return check_surface(true_surface(scenario))


def make_dynamic_ocp(scenario: Scenario, model: ContactModel) -> Ocp:
    """Returns the problem of a scenario with a known surface; see `make_ocp`."""
    y_des, limits = posed_task(scenario, model)
    with within("mpc"):
        ocp = Ocp(model, scenario.mpc, y_des, limits)
    at = replace(_at(model, y_des), zeta=np.zeros(model.size), u=ocp.u_eq)
    require(bool(np.all(np.abs(ocp.u_eq) <= limits["u"].upper)), "limits.u", scenario.limits.u,
            f"at least |u_eq| + tube.u = {np.abs(ocp.u_eq) + scenario.tube.u}, and "
            f"{limits['u'].complaint(at)}")
    for limit in (limit for limit in ocp.limits.values() if limit.about == "input"):
        require(bool(np.all(limit.excess(at) <= 0.0)), f"limits.{limit.name}",
                getattr(scenario.limits, limit.name, None), limit.complaint(at))
    return ocp


def make_tracking_ocp(scenario: Scenario, model: ContactModel) -> TrackingOcp:
    """Returns the problem of a sensed contact, for every target: its inputs leave room for forces.

    See `make_ocp`.
    """
    contact, force = sensed_contact(scenario), scenario.limits.static_force
    require(force is None, "limits.static_force", force,
            "left out (null) with a sensed contact, whose force contact.force limits")
    y_des, limits = posed_task(scenario, model)
    cone = ForceCone.of_surface(contact.walls, largest_normal_force(contact))
    limits = {name: UnderContact(limit, cone) if isinstance(limit, InputLimit) else limit
              for name, limit in limits.items()}
    with within("mpc"):
        return TrackingOcp(model, scenario.mpc, y_des, limits, contact.direction,
                           contact.walls.facets)


def first_problem(scenario: Scenario, ocp: Ocp, start: np.ndarray) -> Ocp:
    """Returns the problem at t = 0 from (𝔮, ζ) (2(6+n),): `ocp` itself, if the surface is known.

    With a sensed contact there is none at the start, and the target is further along n.
    """
    if not isinstance(ocp, TrackingOcp):
        return ocp
    contact, n, sensing = sensed_contact(scenario), ocp.direction, sensing_of(scenario)
    tip = np.append(ocp.model.task_pose(start[: ocp.model.size])[:3], np.zeros(3))
    known = updated_contact_state(contact.walls, sensing, np.zeros((2, 2)),
                                  initial_contact_state(sensing), tip, np.zeros(3))
    margin = safe_depth_margin(scenario)
    depth = float(safe_depth(contact.walls, known.apex, tip[:3], margin))
    across = ocp.y_des[:3] - (n @ ocp.y_des[:3]) * n
    return ocp.aimed(TrackingTarget(across + (depth + SEARCH_DEPTH) * n,
                                    bounds(contact.walls, known.apex, margin)))


def retargeted_ocp(scenario: Scenario, model: ContactModel, force: np.ndarray) -> Ocp:
    """Returns the problem of another desired force (6,), with a terminal set of its own.

    The tube stays the scenario's: it holds for all forces within `limits.static_force`.

    Raises:
        InvalidParameter: The force cannot be held within the limits.
    """
    settings = scenario.certificate
    other = replace(scenario, task=replace(scenario.task, force=force))
    ocp = make_dynamic_ocp(other, model)
    radius, _ = largest_radius(ocp, settings.terminal_samples, settings.seed)
    return make_dynamic_ocp(replace(other, mpc=replace(other.mpc, terminal_radius=radius)), model)


def posed_task(scenario: Scenario, model: ContactModel) -> tuple[np.ndarray, dict[str, Limit]]:
    """Returns y_des (6+n,) and the tightened limits."""
    surface, task = model.surface, scenario.task
    limits = tighten(limits_of(scenario, model), scenario.tube)
    with within("task"):
        force = vector("force", task.force, 6)
        pose = None if task.pose is None else vector("pose", task.pose, 6)
        posture = vector("posture", task.posture, model.num_joints)
        y_des = np.concatenate([surface.pose_for(force, pose), posture])
        # If a level tip does not help, the posture turns the vehicle too far.
        level = np.concatenate([y_des[:3], np.zeros(2), y_des[5:]])
        posture_alone = any(np.any(limit.excess(_at(model, level)) > 0.0)
                            for limit in limits.values() if limit.owner == "pose"
                            and limit.about == "pose" and limit.name in ANGLES)
        own = ("posture", posture) if posture_alone else (
            ("force", force) if pose is None else ("pose", pose))
        _check_pose(limits, _at(model, y_des), {
            "force": ("force", force), "joints": ("posture", posture), "pose": own})
    return y_des, limits


def _at(model: ContactModel, y: np.ndarray) -> Points:
    return Points(model, model.configuration(y), y)


def start_state(scenario: Scenario, ocp: Ocp) -> np.ndarray:
    """Returns (𝔮, ζ) at t = 0 (2(6+n),), at rest.

    Raises:
        InvalidParameter: The start is outside of the nominal limits.
    """
    with within("start"):
        eta = vector("eta", scenario.start.eta, 6)
        q = vector("q", scenario.start.q, ocp.model.num_joints)
        config = np.concatenate([eta, q])
        _check_pose(ocp.limits, Points(ocp.model, config, ocp.model.task_pose(config)), {
            "joints": ("q", q), "pose": ("eta", eta), "force": ("eta", eta)})
    return np.concatenate([config, np.zeros_like(config)])


def _check_pose(limits: dict[str, Limit], at: Points,
                owners: dict[str, tuple[str, np.ndarray]]) -> None:
    """Raises unless a pose is within the nominal limits.

    Args:
        limits: The tightened limits.
        at: The pose.
        owners: Key and value for a message, by the `owner` of a limit; the first one first.
    """
    of_pose = [limit for limit in limits.values() if limit.about == "pose"]
    for limit in sorted(of_pose, key=lambda limit: list(owners).index(limit.owner)):
        if np.any(limit.excess(at) > 0.0):
            raise InvalidParameter(*owners[limit.owner], limit.complaint(at))


def check_inputs(scenario: Scenario, model: ContactModel | None = None) -> ContactModel:
    """Returns the controller's model, if the scenario would have a meaning without any tube.

    Args:
        scenario: The scenario.
        model: The model, if it is loaded already.

    Raises:
        InvalidParameter: It would not.
    """
    model = model or load_model(scenario)
    check_values(scenario)
    if scenario.identified is not None:
        scenario.identified.check_robot(scenario.model)
    check_limits(scenario.limits, model.num_joints)
    if np.size(scenario.draws.joints):
        vector("draws.joints", scenario.draws.joints, model.num_joints)
    disturbance_weights(scenario, model)
    none = np.zeros(model.size)
    without_tube = replace(scenario, tube=TubeRadii(u=none, tau=none))
    start_state(without_tube, make_ocp(without_tube, model))
    return model
