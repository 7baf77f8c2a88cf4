"""Computes the certificate of a scenario: constants, tube, sets, terminal set, first plan.

    limits ──▶ declared set ──▶ constants ──▶ tube ──▶ tightened sets ──▶ terminal set ──▶ plan

Each arrow adds its conditions to the certificate. It stops at the first stage that leaves nothing
to go on with: then the certificate is void, and says which condition failed first.
"""

from dataclasses import replace

import numpy as np

from uvms_drake.certificate.cache import cached
from uvms_drake.certificate.certificate import Certificate, TerminalResult, fingerprint
from uvms_drake.certificate.conditions import Condition, LemmaConstants, paper_conditions
from uvms_drake.certificate.constants import Constant, estimate_constants
from uvms_drake.certificate.constraint_set import ConstraintSet
from uvms_drake.certificate.covering import prove_constants
from uvms_drake.certificate.settings import check_settings
from uvms_drake.certificate.terminal_set import largest_radius
from uvms_drake.certificate.tube_image import tube_image
from uvms_drake.certificate.tubes import (
    resolved_tube,
    smallest_k,
    transpose_tube,
    transpose_velocity_radius,
)
from uvms_drake.control.ancillary import Resolved
from uvms_drake.control.limits import (
    TubeRadii,
    check_limits,
    joint_limits,
    resolved_radii,
    tightened_parts,
)
from uvms_drake.control.nominal_mpc import FEASIBLE, FIRST_SOLVE_ITERATIONS
from uvms_drake.control.scp import SequentialConvexSolver
from uvms_drake.errors import InvalidParameter, require, vector, within
from uvms_drake.model.contact import PlaneLaw, SpringLaw, make_surface_law
from uvms_drake.model.uvms_model import UvmsModel
from uvms_drake.scenario import Scenario
from uvms_drake.station import make_ocp, start_state

PROVEN = {"task": "Jx_max", "position": "J_position_max", "orientation": "J_attitude_max"}
"""Constants that decide the tube of `resolved`, by block of rows."""
REACHED = 1e-6
"""Distance to the terminal set, in ‖ξ‖_P, that counts as none."""
OUTSIDE = 0.01
"""How far off a plane the declared set reaches [m]; nothing changes any more further away."""


def certify(scenario: Scenario) -> Certificate:
    """Returns the certificate of a scenario; void or not.

    Raises:
        InvalidParameter: A value of the scenario has no meaning.
    """
    model = check_inputs(scenario)
    declared = declared_set(scenario, model)
    constants = constants_of(scenario, model, declared)
    draft = Certificate(
        scenario=scenario.name, law=type(scenario.ancillary).__name__.lower(),
        k=scenario.ancillary.k, sigma=scenario.ancillary.sigma,
        d_bound=scenario.disturbance.bound, constants=tuple(constants.values()),
        paper=_paper(constants, scenario), **fingerprint(scenario))
    if isinstance(scenario.ancillary, Resolved):
        tube, conditions = resolved_radii_of(scenario, model, declared, constants)
    else:
        tube, conditions = _transpose(scenario, model, constants)
    draft = replace(draft, tube=tube, conditions=(*conditions, Condition(
        "current, which the controller does not know", float(np.linalg.norm(scenario.current)),
        "<=", 0.0)))
    if not draft.certified:
        return draft
    draft = draft.adding(room_of(scenario, tube, model))
    return _with_terminal_set(draft, tube, scenario) if draft.certified else draft


def check_inputs(scenario: Scenario) -> UvmsModel:
    """Returns the controller's model, if the scenario would have a meaning without any tube.

    Raises:
        InvalidParameter: It would not.
    """
    with within("certificate"):
        check_settings(scenario.certificate)
    with within("surface"):
        surface = make_surface_law(scenario.surface)
    model = UvmsModel.load(scenario.model, surface)
    vector("current", scenario.current, 3)
    require(scenario.seed >= 0, "seed", scenario.seed, "zero or positive")
    check_limits(scenario.limits, model.num_joints)
    for owner, keys in (("ancillary", ("k", "sigma")), ("disturbance", ("bound",))):
        with within(owner):
            for key in keys:
                value = getattr(getattr(scenario, owner), key)
                positive = value > 0.0 or (key == "bound" and value == 0.0)
                require(bool(positive and value < np.inf), key, value,
                        "zero or positive" if key == "bound" else "positive")
    none = np.zeros(model.size)
    without_tube = replace(scenario, tube=TubeRadii(u=none, tau=none))
    start_state(without_tube, make_ocp(without_tube))
    return model


def certified_once(scenario: Scenario) -> Certificate:
    """Returns the certificate of a scenario, from the cache if nothing has changed since."""
    data = cached({"certificate": fingerprint(scenario)},
                  lambda: certify(scenario).to_data())
    return replace(Certificate.from_data(data), scenario=scenario.name)


def declared_set(scenario: Scenario, model: UvmsModel) -> ConstraintSet:
    """Returns the set that the constants are suprema over: the limits of the real robot."""
    limits, task = scenario.limits, scenario.task
    q_lower, q_upper = joint_limits(limits, model.q_lower, model.q_upper)
    largest = scenario.certificate.force_range * np.asarray(task.force, dtype=float)
    depth = 0.0
    if isinstance(model.surface, PlaneLaw):
        with within("task"):
            pose = model.surface.pose_for(largest, np.zeros(6) if task.pose is None else task.pose)
            depth = float(model.surface.depth(pose[:3]))
    return ConstraintSet(
        q_lower=q_lower, q_upper=q_upper, roll=limits.roll, pitch=limits.pitch,
        tip_pitch=limits.tip_pitch, nu1=limits.nu1, nu2=limits.nu2, qdot=limits.qdot,
        depth_min=-OUTSIDE, depth_max=max(depth, OUTSIDE),
        force_max=max(float(np.linalg.norm(largest[:3])), 1.0))


def constants_of(scenario: Scenario, model: UvmsModel, declared: ConstraintSet
                 ) -> dict[str, Constant]:
    """Returns the estimated and the proven constants by name, from the cache if they are there."""
    settings = scenario.certificate
    key = {"set": {name: np.asarray(value).tolist() for name, value in vars(declared).items()},
           "surface": repr(scenario.surface), "samples": settings.constant_samples,
           "safety_factor": settings.safety_factor, "seed": settings.seed,
           "files": fingerprint(scenario)["files"]}

    def compute() -> dict:
        found = estimate_constants(
            model, declared, samples=settings.constant_samples,
            safety_factor=settings.safety_factor, seed=settings.seed)
        found |= prove_constants(model, declared, seed=settings.seed)
        return {name: constant.to_data() for name, constant in found.items()}

    return {name: Constant.from_data(data) for name, data in cached(key, compute).items()}


def lemma_constants(constants: dict[str, Constant]) -> LemmaConstants:
    """Returns what the paper's Lemma assumes, Lipschitz constants in χ with the joints held."""
    value = {name: constant.value for name, constant in constants.items()}
    return LemmaConstants(J_min=value["J_min"], J_max=value["J_max"], J_dot=value["J_dot_max"],
                          L_c=value["L_c_chi"], L_1=value["L_1_chi"], L_2=value["L_2"])


def resolved_radii_of(scenario: Scenario, model: UvmsModel, declared: ConstraintSet,
                      constants: dict[str, Constant]) -> tuple[TubeRadii, tuple[Condition, ...]]:
    """Returns the tube of the law `resolved`; see `tubes.resolved_tube` and `tube_image`."""
    k, sigma, d = scenario.ancillary.k, scenario.ancillary.sigma, scenario.disturbance.bound
    settings = scenario.certificate
    gains = {block: constants[name].value for block, name in PROVEN.items()}
    e, position, orientation = (resolved_tube(k, sigma, d, gains[block]).e
                                for block in ("task", "position", "orientation"))
    image = tube_image(
        model, declared, np.asarray(scenario.limits.u, dtype=float), d_bound=d,
        gains=(gains["position"], gains["orientation"]), k=k, sigma=sigma,
        samples=settings.tube_samples, safety_factor=settings.safety_factor, seed=settings.seed)
    tube = TubeRadii(
        e=e, position=position, orientation=orientation,
        joints=resolved_tube(k, sigma, d, 1.0).e,
        z=float(np.linalg.norm([image.nu1, image.nu2, image.qdot])), nu1=image.nu1, nu2=image.nu2,
        qdot=image.qdot, roll=image.roll, pitch=image.pitch, u=image.u, tau=image.tau)
    return tube, (Condition("σ, above ω = sup‖J_x⁻¹J̇_x‖", sigma, ">", image.omega),)


def _transpose(scenario: Scenario, model: UvmsModel, constants: dict[str, Constant]
               ) -> tuple[TubeRadii, tuple[Condition, ...]]:
    """Returns the tube of the law `transpose`; see `tubes.transpose_tube`.

    The joints are not in this tube: for an arm with self-motion it is void.
    """
    k, sigma, d = scenario.ancillary.k, scenario.ancillary.sigma, scenario.disturbance.bound
    lemma = lemma_constants(constants)
    found = transpose_tube(lemma, k, sigma, d)
    z = transpose_velocity_radius(found, sigma)
    u = np.full(model.size, k * found.r)
    tube = TubeRadii(e=found.e, position=found.e, orientation=found.e, joints=np.inf, z=z, nu1=z,
                     nu2=z, qdot=z, roll=np.inf, pitch=np.inf, u=u, tau=np.full_like(u, np.inf))
    return tube, (*found.conditions, Condition(
        "n, joints that χ does not determine (the tube is in χ alone)",
        float(model.num_joints), "<=", 0.0))


def _paper(constants: dict[str, Constant], scenario: Scenario) -> dict[str, float]:
    """Returns what the paper's Lemma gives for the same constants and gains, for comparison."""
    k, sigma, d = scenario.ancillary.k, scenario.ancillary.sigma, scenario.disturbance.bound
    lemma = lemma_constants(constants)
    tubes = paper_conditions(lemma, k, sigma, d)
    least = smallest_k(lemma)
    return {"printed radius": tubes.printed.e, "corrected radius": tubes.corrected.e,
            "comparison system radius": transpose_tube(lemma, k, sigma, d).e,
            "smallest k": least.k, "at σ": least.sigma}


def room_of(scenario: Scenario, tube: TubeRadii, model: UvmsModel) -> list[Condition]:
    """Returns a condition for every limit: the tube must leave something of it."""
    q_lower, q_upper = joint_limits(scenario.limits, model.q_lower, model.q_upper)
    return [Condition(f"tube in limits.{name}", radius, "<", room)
            for name, radius, room in tightened_parts(scenario.limits, tube, q_lower, q_upper)]


def _with_terminal_set(draft: Certificate, tube: TubeRadii, scenario: Scenario) -> Certificate:
    settings = scenario.certificate
    try:
        ocp = make_ocp(draft.applied_to(scenario))
        start = start_state(draft.applied_to(scenario), ocp)
    except InvalidParameter as error:
        return draft.adding([Condition(str(error), np.nan, "<=", 0.0)])
    radius, check = largest_radius(ocp, settings.terminal_samples, settings.seed)
    terminal = TerminalResult(radius=radius, limiting=check.limiting, margins=check.margins,
                              samples=check.samples, P=ocp.terminal.P, gain=ocp.terminal.gain)
    worst = min(check.margins.values())
    draft = replace(draft, terminal=terminal, bounds=ultimate_bounds(tube, scenario, ocp.model))
    draft = draft.adding([
        Condition("terminal set, ε", radius, ">", 0.0),
        Condition(f"terminal set, worst margin ({check.limiting})", worst, ">=", 0.0)])
    return draft.adding(_first_plan(draft, scenario, start)) if draft.certified else draft


def _first_plan(draft: Certificate, scenario: Scenario, start: np.ndarray) -> list[Condition]:
    """Returns the assumption of the Theorem: the FHOCP is feasible at t = 0.

    And that the plan does not press harder than the declared set reaches, which no limit of the
    MPC sees to.
    """
    ocp = make_ocp(draft.applied_to(scenario))
    solution = SequentialConvexSolver(ocp).solve(
        ocp.resting_plan(0.0, start), FIRST_SOLVE_ITERATIONS)
    if solution.plan is None or solution.evaluation is None:
        return [Condition("first plan found", 0.0, ">=", 1.0)]
    violation, slack = solution.evaluation.violation, solution.evaluation.terminal_slack
    chi = ocp.model.task_pose(solution.plan.config)[:, :6]
    pressed = np.linalg.norm(ocp.model.surface.force(chi, np.zeros_like(chi))[:, :3], axis=1)
    desired = float(np.linalg.norm(np.asarray(scenario.task.force)[:3]))
    return [Condition("first plan, violation of a limit", violation, "<=", FEASIBLE),
            Condition("first plan, distance to the terminal set", slack, "<=", REACHED),
            Condition("first plan, force on the surface", float(np.max(pressed)), "<=",
                      scenario.certificate.force_range * desired)]


def ultimate_bounds(tube: TubeRadii, scenario: Scenario, model: UvmsModel) -> dict[str, float]:
    """Returns what is left once the nominal state has come to the task.

    `position` [m] and `orientation` [rad] of the end-effector, and `force` [N], the largest
    ‖force part of 𝔉 − 𝔉_des‖: a plane's over the depth ± `position` and the speed
    ‖𝔭̇‖ ≤ 2σ `position` that goes with it (‖𝔢̇_p‖ ≤ σE + gR = 2σE, see `tubes.resolved_tube`); a
    spring's from the norms of the blocks of K.
    """
    surface, sigma = model.surface, scenario.ancillary.sigma
    tube = resolved_radii(tube)
    assert tube.position is not None and tube.orientation is not None  # now they are filled in
    out = {"position": tube.position, "orientation": tube.orientation}
    desired = np.asarray(scenario.task.force, dtype=float)
    if isinstance(surface, PlaneLaw):
        shifts = tube.position * np.array([-1.0, 1.0])
        rates = 2.0 * sigma * tube.position * np.array([-1.0, 1.0])
        chi = np.tile(surface.pose_for(desired, scenario.task.pose), (4, 1))
        chi_dot = np.zeros((4, 6))
        chi[:, :3] += np.repeat(shifts, 2)[:, None] * surface.normal
        chi_dot[:, :3] = np.tile(rates, 2)[:, None] * surface.normal
        error = surface.force(chi, chi_dot)[:, :3] - desired[:3]
        out["force"] = float(np.max(np.linalg.norm(error, axis=1)))
    if isinstance(surface, SpringLaw):
        K = surface.K
        out["force"] = float(np.linalg.norm(K[:3, :3], 2) * tube.position
                             + np.linalg.norm(K[:3, 3:], 2) * tube.orientation)
    return out
