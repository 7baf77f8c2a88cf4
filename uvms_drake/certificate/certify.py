"""Computes the certificate of a scenario, stage by stage.

    declared class ──▶ constants ──▶ tube ──▶ unknowns ──▶ margins ──▶ supervisor
                   ──▶ second search ──▶ terminal set ──▶ first plan ──▶ arrival

Each of the `STAGES` adds its claims and conditions to a draft; certification stops at the first
with a condition that does not hold. The tube depends on the law, see `tube.laws.TUBES`; a law that
is not there has no certificate.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import asdict, replace
from typing import Any, NamedTuple

import numpy as np

from uvms_drake.certificate.arrival import arrival_of, arrives
from uvms_drake.certificate.assumptions import GUARANTEE, assumed_conditions, assumptions_of
from uvms_drake.certificate.certificate import Certificate, fingerprint, from_data, to_data
from uvms_drake.certificate.claims import TerminalResult
from uvms_drake.certificate.declared_unknowns import declared_effects
from uvms_drake.common.cache import cached
from uvms_drake.common.errors import InvalidParameter, require, within
from uvms_drake.common.progress import Progress, silent
from uvms_drake.control.limits import (
    HoldRadii,
    Limit,
    Limits,
    TubeRadii,
    joint_limits,
    resolved_radii,
)
from uvms_drake.control.limits.inputs import input_names
from uvms_drake.control.limits.pose import Joints
from uvms_drake.control.limits.static_force import StaticForce
from uvms_drake.control.mpc.planner import FIRST_SOLVE_ITERATIONS, REACHED
from uvms_drake.control.ocp.ocp import FEASIBLE, Ocp
from uvms_drake.control.ocp.solvers import make_solver
from uvms_drake.control.plan.plan import Plan
from uvms_drake.control.plan.points import Points
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.surface.law import NotOffered
from uvms_drake.model.surface.unknown_contact import UnknownContact
from uvms_drake.model.uvms_model import UvmsModel
from uvms_drake.station.contact.mission_legs import legs_of
from uvms_drake.station.contact.tube_in_contact import force_bounds, in_contact
from uvms_drake.station.problem import (
    check_inputs,
    disturbance_weights,
    first_problem,
    limits_of,
    make_ocp,
    start_state,
)
from uvms_drake.station.scenario.parts import command_path_of
from uvms_drake.station.scenario.scenario import Scenario
from uvms_drake.station.supervision import silent_conditions
from uvms_drake.station.true_wall import in_words, outside
from uvms_drake.tube.conditions import Condition, assumption, setting
from uvms_drake.tube.constants import Constant
from uvms_drake.tube.estimates import (
    LEAST_SHARE,
    CertificateSettings,
    Check,
    checked,
    no_estimates,
    together,
)
from uvms_drake.tube.law_tube import Basis, LawTube, constants_of
from uvms_drake.tube.laws import TUBES
from uvms_drake.tube.search.constraint_set import ConstraintSet
from uvms_drake.tube.terminal_set import largest_radius
from uvms_drake.tube.ultimate_bounds import ultimate_bounds

TIGHTENING = "control/theory.md#constraint-tightening"
TERMINAL = "control/theory.md#terminal-set"
FEASIBILITY = "control/theory.md#recursive-feasibility"
"""Theorems of the conditions."""
MORE = 1.2
"""Factor on the excess, for the tube that grows with a wider limit."""
ANGLES = ("roll", "pitch", "tip_pitch")
UNLIMITED = 1.0
"""‖𝔉‖ of the declared set where no force acts and none is limited [N]; nothing depends on it."""


class NotCertified(Exception):
    """A condition of a draft does not hold."""


class Draft:
    """Certificate in the making: the scenario, its model, and the results of the stages so far.

    Args:
        scenario: Scenario to certify.
        model: The controller's model.

    Attributes:
        certificate: The claims so far.
        basis: Data of the tube.
        found: Tube of the law, with the terms of a sensed contact.
        unproven: Second search for the estimates besides those of the tube.
        start: Start (𝔮, ζ) (2(6+n),).
    """

    basis: Basis
    found: LawTube
    unproven: Check
    start: np.ndarray

    def __init__(self, scenario: Scenario, model: ContactModel):
        self.scenario, self.model, self.unproven = scenario, model, no_estimates
        law, disturbance = scenario.ancillary, scenario.disturbance
        weights = disturbance_weights(scenario, model)
        self.certificate = Certificate(
            scenario=scenario.name, law=scenario.law, k=law.k, sigma=law.sigma,
            d_bound=disturbance.d_bound, weights=None if np.all(weights == 1.0) else weights,
            assumptions=assumptions_of(scenario, model), **fingerprint(scenario))

    def claim(self, **claims: Any) -> None:
        """Puts fields of the certificate in."""
        self.certificate = replace(self.certificate, **claims)

    def require(self, *conditions: Condition) -> None:
        """Adds conditions without which there is nothing to compute any more.

        Raises:
            NotCertified: One of them does not hold.
        """
        self.claim(conditions=(*self.certificate.conditions, *conditions))
        if not all(condition.holds for condition in conditions):
            raise NotCertified

    def with_claims(self) -> Scenario:
        """Returns the scenario with the certified tube and terminal set, as far as there are."""
        return self.certificate.applied_to(self.scenario)


def class_conditions(scenario: Scenario, model: ContactModel) -> list[Condition]:
    """Returns the condition that the scenario's own surface is of its declared class, if it is."""
    if scenario.contact.declared_wall() is None:
        return []
    departed = outside(scenario, model)
    reason = f"which is outside of its declared class: {in_words(departed)}" if departed else ""
    return [assumption("surface", reason, len(departed), topic="class of the wall",
                       theorem="model/surface/theory.md#class-of-surfaces")]


def declared(draft: Draft) -> None:
    """Compares the scenario with its declared class and with the premises, before any search."""
    scenario, model = draft.scenario, draft.model
    draft.require(*class_conditions(scenario, model), *assumed_conditions(scenario, model))


def constants(draft: Draft) -> None:
    """Searches for the constants of the law's tube, if a tube is known."""
    law = type(draft.scenario.ancillary)
    if law not in TUBES:
        draft.require(assumption(f"certificate of the law {law.__name__}", "none is known",
                                 topic="law", theorem=GUARANTEE))
    draft.basis = basis_of(draft.scenario, draft.model)


def tube(draft: Draft) -> None:
    """Computes the radii: those of the law, then the additional terms of a sensed contact."""
    scenario, law = draft.scenario, draft.scenario.ancillary
    found = TUBES[type(law)].tube(law, draft.basis)
    if all(condition.holds for condition in found.conditions):
        found = in_contact(found, scenario, draft.basis)
    draft.found = found
    wall = scenario.contact.declared_wall()
    legs = (legs_of(scenario.mission.checked(), wall, found.radii, found.conditions)
            if wall is not None and scenario.mission.steps and np.size(found.radii.u) else ())
    # These belong to the file even if the tube leaves nothing of a limit.
    draft.claim(constants=tuple(draft.basis.constants.values()), tube=found.radii, legs=tuple(legs),
                budget={name: dict(parts) for name, parts in found.budget.items()},
                margin=budget_margins(found.budget, limits_of(scenario, draft.model), draft.model))
    draft.require(*found.conditions)


def unknowns(draft: Draft) -> None:
    """Bounds the accelerations by declared unknowns, as a part of d."""
    if draft.scenario.unknowns.present:
        effects, draft.unproven, conditions = declared_effects(
            draft.scenario, draft.basis, draft.found.radii)
        draft.claim(unknowns=effects)
        draft.require(*conditions)


def margins(draft: Draft) -> None:
    """Compares the tube with every limit, before the second search, which takes long."""
    scenario = draft.scenario
    found = tightening_margins(draft.found, limits_of(scenario, draft.model))
    share = min((each.right / each.left for each in found if each.left > 0.0), default=1.0)
    advice = roomier(scenario.disturbance.bound, scenario.model_error.share, share)
    draft.require(*(each if each.holds else replace(each, advice=advice) for each in found))


def supervisor(draft: Draft) -> None:
    """Compares the quantities that the supervisor watches with its thresholds."""
    draft.require(*silent_conditions(draft.with_claims(), draft.model))


def second_search(draft: Draft) -> None:
    """Searches again for every number that is not proven."""
    settings = draft.scenario.certificate
    estimates = together(draft.found.check, draft.unproven)()
    draft.claim(estimates=estimates)
    draft.require(*(replace(each, advice=safer(settings, each.left))
                    for each in checked(estimates)))


def terminal_set(draft: Draft) -> None:
    """Computes the terminal set within the tightened limits, and the ultimate bounds."""
    settings, scenario = draft.scenario.certificate, draft.with_claims()
    try:
        ocp = make_ocp(scenario, draft.model)
        draft.start = start_state(scenario, ocp)
    except InvalidParameter as error:
        draft.require(assumption("left by the tube", str(error), theorem=TIGHTENING))
    radius, check = largest_radius(ocp, settings.terminal_samples, settings.seed)
    draft.claim(
        terminal=TerminalResult(
            radius=radius, limiting=check.limiting, margins=check.margins, samples=check.samples,
            P=ocp.terminal.P, gain=ocp.terminal.gain),
        bounds=ultimate_bounds(draft.found.radii, draft.model.surface, ocp.y_des[:6],
                               np.asarray(scenario.task.force, dtype=float)))
    least = min(check.margins.values())
    advice = stronger(scenario, check.limiting, least)
    draft.require(
        Condition("terminal set, ε", radius, ">", 0.0, advice, theorem=TERMINAL,
                  topic="terminal set"),
        Condition(f"terminal set, worst margin ({check.limiting})", least, ">=", 0.0, advice,
                  theorem=TERMINAL, topic="terminal set"))


def plan_from_start(draft: Draft) -> None:
    """Solves for the first plan, with the terminal set."""
    scenario = draft.with_claims()
    problem = first_problem(scenario, make_ocp(scenario, draft.model), draft.start)
    draft.require(*first_plan(problem, draft.start)[1])


def arrival(draft: Draft) -> None:
    """Simulates the nominal closed loop until it has reached a wall that is sensed."""
    if draft.scenario.contact.declared_wall() is not None:
        scenario = draft.with_claims()
        found = arrival_of(scenario, draft.model, draft.start)
        draft.claim(arrival=found)
        draft.require(arrives(scenario, found))


STAGES: dict[str, Callable[[Draft], None]] = {
    "declaration": declared, "constants": constants, "tube": tube, "unknowns": unknowns,
    "margins": margins, "supervisor": supervisor, "second search": second_search,
    "terminal set": terminal_set, "first plan": plan_from_start, "arrival": arrival}
"""Stages of a certificate; how long each takes differs from scenario to scenario."""


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
    draft = Draft(scenario, check_inputs(scenario, model))
    with suppress(NotCertified):
        try:
            for i, (name, stage) in enumerate(STAGES.items()):
                progress(f"{i + 1} of {len(STAGES)}: {name}", i / len(STAGES))
                stage(draft)
        except NotOffered as error:
            draft.require(assumption(
                f"certificate of the surface {error.value}", f"it must be {error.allowed}",
                topic="surface", theorem=GUARANTEE))
    return draft.certificate


def certified_once(scenario: Scenario, progress: Progress = silent,
                   model: ContactModel | None = None) -> Certificate:
    """Returns the certificate of a scenario, from the cache if nothing has changed since.

    Args:
        scenario: Scenario to certify.
        progress: As of `certify`; not called if the certificate is in the cache.
        model: As of `certify`.
    """
    def compute() -> dict:
        return to_data(certify(scenario, progress, model))

    certificate: Any = from_data(cached({"certificate": fingerprint(scenario)}, compute))
    return replace(certificate, scenario=scenario.name)


def declared_set(limits: Limits, model: UvmsModel, wall: UnknownContact | None = None
                 ) -> ConstraintSet:
    """Returns the set that the constants are suprema over: the limits of the real robot.

    Args:
        limits: The limits.
        model: The controller's model.
        wall: Bounds of a sensed contact, which has a limit of the tool's angle.
    """
    q_lower, q_upper = joint_limits(limits, model.q_lower, model.q_upper)
    return ConstraintSet(
        q_lower=q_lower, q_upper=q_upper, roll=limits.roll, pitch=limits.pitch,
        tip_pitch=limits.tip_pitch, nu1=limits.nu1, nu2=limits.nu2, qdot=limits.qdot,
        force_max=UNLIMITED if limits.static_force is None else limits.static_force,
        tool=None if wall is None else (float(np.arcsin(wall.direction[2])), wall.tool_angle))


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
    declared = declared_set(limits, model, scenario.contact.declared_wall())
    contact = force_bounds(scenario)
    weights = disturbance_weights(scenario, model)
    if names is None:
        names = TUBES[type(law)].constants(law, weights)

    # Constants, estimated and proven.
    key = {"names": names,
           "set": {name: np.asarray(value).tolist() for name, value in vars(declared).items()},
           "surface": repr(scenario.surface),
           "frame": np.asarray(scenario.task.frame, dtype=float).tolist(),
           "samples": settings.constant_samples,
           "safety_factor": settings.safety_factor, "seed": settings.seed,
           "files": fingerprint(scenario)["files"],
           "weights": weights.tolist()}

    def search() -> dict:
        found = constants_of(names, model, declared, weights, settings)
        return {name: asdict(constant) for name, constant in found.items()}

    constants = cached(key, search) if names else {}
    # Speeds and actuators.
    speeds = np.repeat([declared.nu1, declared.nu2, declared.qdot], [3, 3, model.num_joints])
    return Basis(
        model=model, declared=declared,
        constants={name: Constant(**data) for name, data in constants.items()},
        d_bound=scenario.disturbance.d_bound, weights=weights,
        u_limit=np.asarray(limits.u, dtype=float), settings=settings,
        contact=contact, forces=bool(
            limits.tau is not None or limits.thrusters is not None or limits.more),
        largest_rate=2.0 * speeds / scenario.mpc.time_step,
        command_path=command_path_of(actuation, model))


def tightening_margins(found: LawTube, limits: Mapping[str, Limit]) -> list[Condition]:
    """Returns a condition for every limit: the tube must leave something of it.

    Limits of one number come first, as they do among the settings. NaN in the place of the
    estimated radii marks each number that depends on one: the others are proven.
    """
    radii, conditions = resolved_radii(found.radii), []
    marked = resolved_radii(replace(found.radii, **{
        name: np.nan * value for name, value in vars(found.radii).items()
        if name in found.estimated and not isinstance(value, HoldRadii | None)}))
    for limit in sorted(limits.values(), key=lambda limit: limit.labels != [limit.name]):
        if limit.tube_takes(radii) is None:
            conditions.append(assumption(
                f"limits.{limit.name}", "no tightening by the tube is defined",
                topic="limit without tightening", theorem=TIGHTENING))
            continue
        conditions += [
            Condition(f"tube in limits.{label}", radius, "<", margin, theorem=TIGHTENING,
                      kind="tightening", topic=f"limits.{limit.name}", about=label,
                      proven=not np.isnan(mark))
            for (label, radius, margin), (_, mark, _) in zip(
                limit.margins(radii), limit.margins(marked), strict=True)]
    return conditions


def budget_margins(budget: Iterable[str], limits: Mapping[str, Limit], model: UvmsModel
                   ) -> dict[str, float]:
    """Returns the smallest limit of each radius of a budget that has one."""
    labels = {"attitude": ("roll", "pitch"), "depth_speed": ("contact_speed_n",),
              "joints": tuple(f"q{j + 1}" for j in range(model.num_joints))}
    none = resolved_radii(TubeRadii(u=np.zeros(model.size), tau=np.zeros(model.size)))
    margin = {label: size for limit in limits.values() for label, _, size in limit.margins(none)}
    return {name: min(known) for name in budget
            if (known := [margin[label] for label in labels.get(name, ()) if label in margin])}


def first_plan(ocp: Ocp, start: np.ndarray) -> tuple[Plan | None, list[Condition]]:
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


# Advice: a first guess at the size of a setting that helps; nothing of it is proven ---------------


def wider(limit: Limit, index: int, above: bool, excess: float, model: UvmsModel) -> str:
    """Returns the setting that widens a limit on the configuration by its excess, if allowed.

    Args:
        limit: One of `limits`.
        index: Index of the value that is beyond.
        above: Whether it is beyond the upper bound.
        excess: Excess, as of `Limit.excess`.
        model: Model of the robot, whose own joint limits stay.
    """
    if isinstance(limit, StaticForce):
        force = limit.bound + MORE * excess * limit.surface.stiffness_bound
        return setting(limits__static_force=_up(force, 2))
    if limit.name in ANGLES:
        return setting(**{f"limits__{limit.name}": _up(limit.bounds()[1][0] + MORE * excess, 3)})
    if isinstance(limit, Joints):
        sign = 1.0 if above else -1.0
        bounds = np.array(limit.bounds()[above], dtype=float)
        bounds[index] = sign * _up(sign * bounds[index] + MORE * excess, 3)
        if model.q_lower[index] <= bounds[index] <= model.q_upper[index]:
            return setting(**{"limits__q_upper" if above else "limits__q_lower": bounds})
    return ""


def roomier(bound: float, reserved: float, share: float) -> str:
    """Returns the disturbance whose tube about fits: a tube is about in proportion to it.

    Larger gains make a smaller tube, too, but take more of the inputs: no advice step by step.
    Where declared unknowns ask for the bound, it is not smaller.

    Args:
        bound: `disturbance.bound`.
        reserved: `model_error.share`.
        share: Fraction of this tube that fits into the limit with the smallest margin.
    """
    if not 0.0 < share <= 1.0:
        return ""
    if reserved > 0.0:
        return "smaller declared unknowns, with the disturbance.bound that they ask for"
    return setting(disturbance__bound=float(f"{share / MORE * bound:.2g}"))


def longer(horizon: int) -> str:
    """Returns a horizon that reaches further."""
    return setting(mpc__horizon=math.ceil(1.5 * horizon))


def stronger(scenario: Scenario, limiting: str, margin: float) -> str:
    """Returns the limit of an acceleration that has a missing margin; empty for other limits.

    Args:
        scenario: The scenario.
        limiting: Value with the smallest margin in the terminal set, as `u_surge, end of a step`.
        margin: Its margin.
    """
    channel = limiting.partition(",")[0].removeprefix("u_")
    bounds = np.asarray(scenario.limits.u, dtype=float)
    names = input_names(len(bounds) - 6)
    if margin >= 0.0 or channel not in names:
        return ""
    i = names.index(channel)
    return setting(**{f"limits__u__{i}": _up(float(bounds[i]) - MORE * margin, 3)})


def safer(settings: CertificateSettings, ratio: float) -> str:
    """Returns a safety factor with which an estimate exceeds the result of a second search.

    Also, not by more than one with power may miss. A factor beyond 1/`LEAST_SHARE` leaves none to a
    second search that finds the same, so the first one needs more samples then. Empty if neither
    is in its range.

    Args:
        settings: Settings of the estimates.
        ratio: That result over the estimate.
    """
    factor = settings.safety_factor
    less = math.floor(100.0 * factor * ratio / LEAST_SHARE) / 100.0
    if ratio < LEAST_SHARE and less >= 1.0:
        return setting(certificate__safety_factor=less)
    more = _up(1.02 * ratio * factor, 2)
    if not 1.0 < ratio < 2.0:
        return ""
    if more * LEAST_SHARE <= 1.0:
        return setting(certificate__safety_factor=more)
    return setting(certificate__tube_samples=10 * settings.tube_samples)


def _up(value: float, digits: int) -> float:
    return math.ceil(value * 10**digits) / 10**digits
