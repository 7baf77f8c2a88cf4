"""Computes the certificate of a scenario: constants, tube, sets, terminal set, first plan.

    limits ──▶ declared set ──▶ constants ──▶ tube ──▶ tightened sets ──▶ terminal set ──▶ plan

Each arrow adds its conditions to the certificate. It stops at the first stage with a condition that
does not hold: then the scenario is not certified. The tube depends on the law, see
`law_tube.TUBES`; a law that is not there has no certificate.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from uvms_drake.actuation.ideal import IdealWrench
from uvms_drake.certificate.advice import longer, roomier, safer, wider
from uvms_drake.certificate.assumptions import assumptions_of, undriven_axes, unnamed_axes
from uvms_drake.certificate.cache import cached
from uvms_drake.certificate.certificate import Certificate, TerminalResult, fingerprint
from uvms_drake.certificate.declared_unknowns import (
    UnmodelledBounds,
    declared_sources,
    fitting_disturbance,
    payload_acceleration,
    payload_condition,
    unknown_effects,
    unknowns_condition,
    weights_of,
)
from uvms_drake.common.errors import InvalidParameter, require, within
from uvms_drake.common.progress import Progress, silent
from uvms_drake.common.schema import check_values
from uvms_drake.control.limits import (
    HoldRadii,
    Limit,
    Limits,
    TubeRadii,
    check_limits,
    joint_limits,
    resolved_radii,
)
from uvms_drake.control.mpc.planner import FIRST_SOLVE_ITERATIONS, REACHED
from uvms_drake.control.ocp.ocp import FEASIBLE, Ocp
from uvms_drake.control.ocp.solvers import make_solver
from uvms_drake.control.plan.plan import P, Plan
from uvms_drake.control.plan.points import Points
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.signals.sensor_actuator import Actuator
from uvms_drake.model.surface.law import NotOffered
from uvms_drake.model.uvms_model import UvmsModel
from uvms_drake.plant.unknowns import Unknowns
from uvms_drake.plant.waves import largest_speed
from uvms_drake.station.contact.mission_legs import legs_of
from uvms_drake.station.contact.tube_in_contact import force_bounds, in_contact
from uvms_drake.station.problem import (
    disturbance_weights,
    first_problem,
    limits_of,
    load_model,
    make_ocp,
    start_state,
)
from uvms_drake.station.scenario.parts import command_path_of, uncovered
from uvms_drake.station.scenario.scenario import Scenario
from uvms_drake.tube.conditions import Condition, assumption
from uvms_drake.tube.constants import Constant, estimate_constants
from uvms_drake.tube.covering import prove_constants
from uvms_drake.tube.estimates import (
    CertificateSettings,
    Estimate,
    unrefuted,
)
from uvms_drake.tube.law_tube import PROVEN, WEIGHTED, Basis, LawTube
from uvms_drake.tube.laws import TUBES
from uvms_drake.tube.search.constraint_set import ConstraintSet
from uvms_drake.tube.search.search_memo import active_memo
from uvms_drake.tube.terminal_set import largest_radius
from uvms_drake.tube.ultimate_bounds import ultimate_bounds

GUARANTEE = "control/theory.md#closed-loop-guarantee"
TIGHTENING = "control/theory.md#constraint-tightening"
TERMINAL = "control/theory.md#terminal-set"
FEASIBILITY = "control/theory.md#recursive-feasibility"
"""Theorems of the conditions."""
STAGES = 4
"""Number of stages of a certificate; how long each takes differs from scenario to scenario."""
BEGINS = (0.04, 0.7, 0.99)
"""Elapsed fractions of the time of a certificate at which tube, terminal set and first plan begin,
about, in the shipped scenarios."""
UNLIMITED = 1.0
"""‖𝔉‖ of the declared set where no force acts and none is limited [N]; nothing depends on it."""


def certify(scenario: Scenario, progress: Progress = silent,
            model: ContactModel | None = None) -> Certificate:
    """Returns the certificate of a scenario, certified or not.

    Args:
        scenario: Scenario to certify.
        progress: Called at the beginning of every stage.
        model: The controller's model; loaded if left out.

    Raises:
        InvalidParameter: A value of the scenario has no meaning.
    """
    assert active_memo() is None, "a certificate searches for itself"
    # Inputs, and a law without a tube, for which there is nothing to compute.
    model = check_inputs(scenario, model)
    law, disturbance = scenario.ancillary, scenario.disturbance
    weights = disturbance_weights(scenario, model)
    draft = Certificate(
        scenario=scenario.name, law=scenario.law, k=law.k, sigma=law.sigma,
        d_bound=disturbance.d_bound, weights=None if np.all(weights == 1.0) else weights,
        assumptions=assumptions_of(scenario, model), **fingerprint(scenario))
    if type(law) not in TUBES:
        return draft.adding([assumption(
            f"certificate of the law {type(law).__name__}", "none is known", topic="law",
            theorem=GUARANTEE)])
    try:
        # Tube without contact, then the additional terms of a sensed contact.
        progress(f"1 of {STAGES}: constants", 0.0)
        basis = basis_of(scenario, model)
        progress(f"2 of {STAGES}: tube", BEGINS[0])
        found = TUBES[type(law)].tube(law, basis)
        if all(condition.holds for condition in found.conditions):
            found = in_contact(found, scenario, basis)
        # These belong to the file even if the tube leaves nothing of a limit.
        limits = limits_of(scenario, model)
        draft = replace(
            draft, constants=tuple(basis.constants.values()), tube=found.radii, budget={
                name: dict(parts) for name, parts in found.budget.items()},
            margin=budget_margins(found.budget, limits, model),
            conditions=(*found.conditions, *assumed_conditions(scenario, model)))
        wall = scenario.contact.declared_wall()
        if scenario.mission.steps and wall is not None and np.size(found.radii.u):
            draft = replace(draft, legs=tuple(legs_of(
                scenario.mission.checked(), wall, found.radii, draft.conditions)))
        if not draft.certified:
            return draft
        # Declared unknowns, as a part of d.
        carried, robot_error = None, scenario.model_error
        if scenario.unknowns.present:
            bounds = UnmodelledBounds(scenario.model, basis, found.radii, scenario.seed)
            sources = partial(declared_sources, scenario.unknowns)
            effects = unknown_effects(sources, bounds, weights_of(disturbance, basis))
            carried = payload_acceleration(robot_error, disturbance, bounds, effects)
            draft = replace(draft, unknowns=effects).adding([
                *unknowns_condition(disturbance.bound, robot_error.share, effects, partial(
                    fitting_disturbance, disturbance, sources, bounds)),
                *payload_condition(robot_error.payload, carried)])
        if not draft.certified:
            return draft
        # Margins of the tightened limits, before the second search, which takes long.
        tightening, proven = how_many_are_proven(found, limits)
        draft = replace(
            draft.adding(advised(tightening_margins(found.radii, limits), disturbance.bound,
                                 robot_error.share)), tightening=tightening, proven=proven)
        if not draft.certified:
            return draft
        estimates = (*found.check(), *(
            Estimate(f"d by {each.name}", each.takes, each.second) for each in draft.unknowns),
            *([carried] if carried else []))
        draft = replace(draft.adding([
            replace(each, advice=safer(basis.settings.safety_factor, each.left))
            for each in unrefuted(estimates)]), estimates=estimates)
        if not draft.certified:
            return draft
        return _with_terminal_set(draft, found, scenario, model, progress)
    except NotOffered as error:
        return draft.adding([assumption(
            f"certificate of the surface {error.value}", f"it must be {error.allowed}",
            topic="surface", theorem=GUARANTEE)])


def assumed_conditions(scenario: Scenario, model: ContactModel | None = None) -> list[Condition]:
    """Returns the assumptions of the proofs that a scenario can give up; 0 where one is kept.

    Those that it cannot give up are `assumptions.assumptions_of`.
    """
    # Axes without a thruster, model errors, options of the MPC, parts of the loop.
    wall, actuation = scenario.contact.declared_wall(), scenario.actuation
    mpc, model = scenario.mpc, model or load_model(scenario)
    unnamed, undriven = unnamed_axes(actuation, model), ", ".join(undriven_axes(model))
    assumed: list[tuple[str, str, float]] = [
        *uncounted_unknowns(scenario.unknowns, actuation),
        ("surface_error", "which the controller does not know", scenario.surface_error.size),
        ("faults", "which the proofs do not cover", len(uncovered(scenario.faults))),
        ("mpc.initial_state", "plans start at the measured state", mpc.initial_state != "nominal"),
        ("mpc.terminal_weight", "P without a terminal controller", mpc.terminal_weight is not None),
        ("mpc.terminal_set", "none", not mpc.terminal_set),
        ("mpc.input_reference", "not the equilibrium's input",
         mpc.input_reference != "equilibrium"),
        *([] if wall is None else [("contact.tangential_lag", "delayed feedback of the friction",
                                    wall.tangential_lag)])]
    conditions = [
        assumption("axes that the robot's thrusters do not drive", "unnamed by an !IdealWrench"
                   + (f": {', '.join(unnamed)}" if unnamed else ""), len(unnamed),
                   advice=f"--set 'actuation=[!IdealWrench {{undriven: [{undriven}]}}]', for a "
                   "robot with other thrusters" if unnamed else "", theorem=GUARANTEE),
        *(assumption(key, reason, broken, theorem=GUARANTEE) for key, reason, broken in assumed),
        *(assumption(f"mpc.terms[{i}]", f"{type(term).__name__}, which the terminal set leaves out",
                     topic="mpc.terms", theorem=GUARANTEE) for i, term in enumerate(mpc.terms))]
    for key, parts in (("sensing", scenario.sensing), ("actuation", actuation)):
        conditions += [
            assumption(f"{key}[{i}]", f"{type(part).__name__}: {part.assumption()}", topic=key,
                       theorem=GUARANTEE)
            for i, part in enumerate(parts) if part.assumption() is not None
            and (wall is None or part.reading(0.0, 0.0) is None)]
    return conditions


def uncounted_unknowns(unknowns: Unknowns, actuation: Sequence[Actuator]
                       ) -> list[tuple[str, str, float]]:
    """Returns key, reason and size of the unknowns that `declared_unknowns` does not count.

    It counts them for a robot whose command acts at once.
    """
    counted = all(isinstance(part, IdealWrench) for part in actuation)
    sizes = {"current": float(np.linalg.norm(unknowns.current)),
             "waves": largest_speed(unknowns.waves), "model_error": unknowns.error.size}
    return [(key, "counted only where the command acts at once", 0.0 if counted else size)
            for key, size in sizes.items()]


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
    check_limits(scenario.limits, model.num_joints)
    disturbance_weights(scenario, model)
    none = np.zeros(model.size)
    without_tube = replace(scenario, tube=TubeRadii(u=none, tau=none))
    start_state(without_tube, make_ocp(without_tube, model))
    return model


def certified_once(scenario: Scenario, progress: Progress = silent,
                   model: ContactModel | None = None) -> Certificate:
    """Returns the certificate of a scenario, from the cache if nothing has changed since.

    Args:
        scenario: Scenario to certify.
        progress: As of `certify`; not called if the certificate is in the cache.
        model: As of `certify`.
    """
    def compute() -> dict:
        return certify(scenario, progress, model).to_data()

    data = cached({"certificate": fingerprint(scenario)}, compute)
    return replace(Certificate.from_data(data), scenario=scenario.name)


def declared_set(limits: Limits, model: UvmsModel) -> ConstraintSet:
    """Returns the set that the constants are suprema over: the limits of the real robot."""
    q_lower, q_upper = joint_limits(limits, model.q_lower, model.q_upper)
    return ConstraintSet(
        q_lower=q_lower, q_upper=q_upper, roll=limits.roll, pitch=limits.pitch,
        tip_pitch=limits.tip_pitch, nu1=limits.nu1, nu2=limits.nu2, qdot=limits.qdot,
        force_max=UNLIMITED if limits.static_force is None else limits.static_force)


def basis_of(scenario: Scenario, model: ContactModel, names: tuple[str, ...] | None = None
             ) -> Basis:
    """Returns the basis of a scenario's tube, its constants from the cache if they are there.

    ζ̄̇ is constant between two knots, at which the speeds are within limits.

    Args:
        scenario: Scenario of the tube.
        model: The controller's model.
        names: Names of the constants; those that the scenario's law needs if None.
    """
    law, limits = scenario.ancillary, scenario.limits
    actuation, settings = scenario.actuation, scenario.certificate
    limited = scenario.contact.force_limit(limits) is not None
    if not limited and not scenario.contact.takes_static_force(scenario.surface):
        raise NotOffered("surface", type(scenario.surface).__name__,
                         "one that has `static_force_rows`, for limits.static_force")
    require(limited, "limits.static_force", None,
            "a number [N], for a certificate: its constants are suprema over forces up to it")
    declared, contact = declared_set(limits, model), force_bounds(scenario)
    weights = disturbance_weights(scenario, model)
    if names is None:
        names = TUBES[type(law)].constants(law, weights)

    # Constants, estimated and proven.
    key = {"names": names,
           "set": {name: np.asarray(value).tolist() for name, value in vars(declared).items()},
           "surface": repr(scenario.surface), "samples": settings.constant_samples,
           "safety_factor": settings.safety_factor, "seed": settings.seed,
           "files": fingerprint(scenario)["files"],
           "weights": weights.tolist()}

    def search() -> dict:
        found = constants_of(names, model, declared, weights, settings)
        return {name: constant.to_data() for name, constant in found.items()}

    constants = cached(key, search) if names else {}
    # Speeds and actuators.
    speeds = np.repeat([declared.nu1, declared.nu2, declared.qdot], [3, 3, model.num_joints])
    return Basis(
        model=model, declared=declared,
        constants={name: Constant.from_data(data) for name, data in constants.items()},
        d_bound=scenario.disturbance.d_bound, weights=weights,
        u_limit=np.asarray(limits.u, dtype=float), settings=settings,
        contact=contact, forces=bool(
            limits.tau is not None or limits.thrusters is not None or limits.more),
        largest_rate=2.0 * speeds / scenario.mpc.time_step, time_step=scenario.mpc.time_step,
        command_path=command_path_of(actuation, model))


def constants_of(names: tuple[str, ...], model: ContactModel, declared: ConstraintSet,
                 weights: np.ndarray, settings: CertificateSettings) -> dict[str, Constant]:
    """Returns constants by name; those that decide the tube of `resolved` are proven.

    Args:
        names: Names of the constants.
        model: The prediction model.
        declared: Set of the suprema.
        weights: Diagonal of Ŵ, see `Basis`.
        settings: Effort of the searches.
    """
    ball = bool(np.all(weights == 1.0))
    norms = {name if ball else WEIGHTED[name]: name for name in PROVEN.values()}
    proven = prove_constants(
        model, declared, tuple(norms[name] for name in names if name in norms),
        seed=settings.seed, weights=weights)
    estimated = estimate_constants(
        model, declared, tuple(name for name in names if name not in norms),
        samples=settings.constant_samples, safety_factor=settings.safety_factor,
        seed=settings.seed)
    return estimated | {name: replace(proven[plain], name=name)
                        for name, plain in norms.items() if plain in proven}


def tightening_margins(tube: TubeRadii, limits: Mapping[str, Limit]) -> list[Condition]:
    """Returns a condition for every limit: the tube must leave something of it.

    Limits of one number come first, as they do among the settings.
    """
    conditions, tube = [], resolved_radii(tube)
    for limit in sorted(limits.values(), key=lambda limit: limit.labels != [limit.name]):
        if limit.tube_takes(tube) is None:
            conditions.append(assumption(
                f"limits.{limit.name}", "no tightening by the tube is defined",
                topic="limit without tightening", theorem=TIGHTENING))
        else:
            conditions += [
                Condition(f"tube in limits.{label}", radius, "<", margin, theorem=TIGHTENING,
                          kind="tightening", topic=f"limits.{limit.name}", about=label)
                for label, radius, margin in limit.margins(tube)]
    return conditions


def advised(margins: list[Condition], bound: float, reserved: float) -> list[Condition]:
    """Returns `tightening_margins` with an advice on those that fail, see `advice.roomier`."""
    share = min((each.right / each.left for each in margins if each.left > 0.0), default=1.0)
    advice = roomier(bound, reserved, share)
    return [each if each.holds else replace(each, advice=advice) for each in margins]


def budget_margins(budget: Iterable[str], limits: Mapping[str, Limit], model: UvmsModel
                   ) -> dict[str, float]:
    """Returns the smallest limit of each radius of a budget that has one."""
    labels = {"attitude": ("roll", "pitch"), "depth_speed": ("contact_speed[0]",),
              "joints": tuple(f"q{j + 1}" for j in range(model.num_joints))}
    none = resolved_radii(TubeRadii(u=np.zeros(model.size), tau=np.zeros(model.size)))
    margin = {label: size for limit in limits.values() for label, _, size in limit.margins(none)}
    return {name: min(known) for name in budget
            if (known := [margin[label] for label in labels.get(name, ()) if label in margin])}


def how_many_are_proven(found: LawTube, limits: Mapping[str, Limit]) -> tuple[int, int]:
    """Returns the number of limits that a tube tightens, and of those tightened by proven numbers.

    A number is estimated if it changes with the radii that are.
    """
    doubled = {name: 2.0 * getattr(found.radii, name) for name in found.estimated
               if not isinstance(getattr(found.radii, name), HoldRadii | None)}
    margins = [tightening_margins(radii, limits)
             for radii in (found.radii, replace(found.radii, **doubled))]
    pairs = [(old, new) for old, new in zip(*margins, strict=True) if old.left > 0.0]
    return len(pairs), sum(old.left == new.left for old, new in pairs)


def _with_terminal_set(draft: Certificate, found: LawTube, scenario: Scenario,
                       model: ContactModel, progress: Progress) -> Certificate:
    progress(f"3 of {STAGES}: terminal set", BEGINS[1])
    settings = scenario.certificate
    try:
        ocp = make_ocp(draft.applied_to(scenario), model)
        start = start_state(draft.applied_to(scenario), ocp)
    except InvalidParameter as error:
        return draft.adding([assumption("left by the tube", str(error), theorem=TIGHTENING)])
    radius, check = largest_radius(ocp, settings.terminal_samples, settings.seed)
    terminal = TerminalResult(radius=radius, limiting=check.limiting, margins=check.margins,
                              samples=check.samples, P=ocp.terminal.P, gain=ocp.terminal.gain)
    worst = min(check.margins.values())
    draft = replace(draft, terminal=terminal,
                    bounds=ultimate_bounds(
                        found.radii, model.surface, ocp.y_des[:6],
                        np.asarray(scenario.task.force, dtype=float)))
    draft = draft.adding([
        Condition("terminal set, ε", radius, ">", 0.0, theorem=TERMINAL, topic="terminal set"),
        Condition(f"terminal set, worst margin ({check.limiting})", worst, ">=", 0.0,
                  theorem=TERMINAL, topic="terminal set")])
    if not draft.certified:
        return draft
    progress(f"4 of {STAGES}: first plan", BEGINS[2])
    applied = draft.applied_to(scenario)  # With the terminal set.
    first = first_problem(applied, make_ocp(applied, model), start)
    return draft.adding(first_plan(first, start)[1])


def first_plan(ocp: Ocp[P], start: np.ndarray) -> tuple[P | None, list[Condition]]:
    """Returns the first plan and the assumption of the Theorem: the FHOCP is feasible at t = 0.

    Also that no angle and no depth of this plan leaves its limits between the knots. If the
    contact is sensed, a margin ensures it for every plan (`Limit.plan_takes`); else no limit of the
    MPC does, and later plans are not checked.

    Args:
        ocp: Problem with the tightened limits.
        start: (𝔮, ζ) (2(6+n),).
    """
    with within("mpc"):
        solver = make_solver(ocp)
    solution = solver.solve(
        ocp.resting_plan(0.0, start[: ocp.state_size]), FIRST_SOLVE_ITERATIONS)
    if solution.plan is None or solution.evaluation is None:
        return None, [assumption("first plan", "none found", theorem=FEASIBILITY)]
    violation, slack = solution.evaluation.violation, solution.evaluation.terminal_slack
    bulge = between_knots(ocp, solution.plan)
    where = f", of limits.{bulge.label} at {bulge.time:.3g} s" if bulge.label else ""
    return solution.plan, [
        Condition("first plan, violation of a limit", violation, "<=", FEASIBLE,
                  theorem=FEASIBILITY, topic="first plan"),
        Condition(f"first plan, violation between its knots [rad, m]{where}", bulge.excess, "<=",
                  FEASIBLE, bulge.advice, theorem="control/theory.md#motion-between-two-knots",
                  topic="first plan between knots"),
        Condition("first plan, distance to the terminal set", slack, "<=", REACHED,
                  longer(ocp.horizon) if slack > REACHED else "", theorem=FEASIBILITY,
                  topic="first plan to the terminal set")]


class KnotOvershoot(NamedTuple):
    """Largest excess of a plan over a limit between its knots."""

    excess: float = 0.0
    """Excess [rad, m]."""
    label: str = ""
    """Name of the limit's value; empty if the plan keeps all."""
    time: float = 0.0
    """Time of the largest excess [s]."""
    advice: str = ""
    """Setting that would help; empty if none is known."""


def between_knots(ocp: Ocp, plan: Plan, points: int = 9) -> KnotOvershoot:
    """Returns the largest excess of a plan over a limit on the configuration between its knots.

    Checked is every limit that bulges, but those of the input: roll, pitch, tip pitch, joints,
    the static force (over the stiffness), and those about speed that are not linear. They are taken
    as tightened by the tube, and can be left by h²/8 times their second derivative.
    """
    inside = np.linspace(0.0, plan.time_step, points + 2)[1:-1]
    times = plan.start_time + np.add.outer(np.arange(len(plan.config) - 1) * plan.time_step, inside)
    config, zeta = (np.array(each) for each in zip(
        *(plan.at(float(time))[:2] for time in times.ravel()), strict=True))
    at = Points(ocp.model, config, ocp.model.task_pose(config), zeta)
    worst = KnotOvershoot()
    for limit in ocp.limits.values():
        if not limit.overshoots or limit.about == "input":
            continue
        excess, values = limit.excess(at) - limit.between_knots_margin, limit.values(at)
        if excess.size == 0:  # Joints, of a robot that has none.
            continue
        point, i = np.unravel_index(np.argmax(excess), excess.shape)
        largest = float(excess[point, i])
        if largest > worst.excess:
            above = bool(2.0 * values[point, i] > limit.lower[i] + limit.upper[i])
            worst = KnotOvershoot(largest, limit.labels[i], float(times.ravel()[point]),
                          wider(limit, int(i), above, largest, ocp.model))
    return worst
