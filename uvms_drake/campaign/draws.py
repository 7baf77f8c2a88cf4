"""The scenario of each run, drawn from (seed, index), and the distribution in words.

Drawn is everything that a scenario declares: starts with a feasible first plan, walls of the class
and desired forces that it allows, disturbances and adversaries of the full size d̃, solves that
fail, are delayed or dropped, and unknowns of model, thrusters and water up to their declared size.
A fifth of the runs is at a corner: every unknown, and every parameter of the wall, at its bound.
"""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from uvms_drake.actuation.thrusters import largest_error, with_errors
from uvms_drake.campaign.campaign import Campaign
from uvms_drake.campaign.drawn_contact import about_drawn, drawn_contact, never_pressed
from uvms_drake.certificate.certify import first_plan
from uvms_drake.common.errors import InvalidParameter, RunFailed
from uvms_drake.control.limits import Limit
from uvms_drake.control.mpc.solver_faults import DroppedPeriod, SolverFailure, SolverTimeout
from uvms_drake.control.ocp.ocp import Ocp
from uvms_drake.model.signals.fault import Fault
from uvms_drake.plant.adversary import KINDS, ROWS, AdversarialDisturbance
from uvms_drake.plant.disturbance import (
    ConstantDisturbance,
    Disturbance,
    RandomDisturbance,
    SinusoidalDisturbance,
)
from uvms_drake.plant.model_error import (
    BODIES,
    COEFFICIENTS,
    FACTORS,
    LEAST_FACTOR,
    AxisFactors,
    Unknowns,
)
from uvms_drake.plant.waves import largest_speed
from uvms_drake.station.problem import first_problem, limits_of, load_model, make_ocp, start_state
from uvms_drake.station.scenario.scenario import Scenario, Start
from uvms_drake.station.supervision import supervisor_of

POSE_REACH = np.array([0.1, 0.1, 0.1, 0.03, 0.03, 0.1])
"""Largest distance of the vehicle from the scenario's start [m, rad]."""
AT_FULL_SIZE = 0.25
"""Probability of an unknown of the size that a scenario declares."""
PERIODS = (0.5, 10.0)
"""Range of a disturbance's period, drawn uniformly in its logarithm [s]."""
FAULT_LIKELY, FAULT_RATES = 0.25, (0.05, 0.5)
"""Probability that a run has faults of the solver, and range of the probability per sample."""
CORNER = 0.2
"""Probability of a run with all unknowns, and all parameters of the wall, at their bounds."""
ATTEMPTS = 100


def vary(campaign: Campaign, index: int) -> Scenario:
    """Returns the scenario of a run: a pure function of its arguments."""
    return draw(campaign, index)[0]


def draw(campaign: Campaign, index: int) -> tuple[Scenario, dict[str, int]]:
    """Returns the scenario of a run, and how it was drawn: a pure function of its arguments.

    `starts` and `walls` are the numbers of those that were drawn, of which the last was accepted;
    `corner` is 1 if all unknowns, and all parameters of the wall, are at their bounds, else 0.

    Raises:
        RunFailed: No draw has a feasible first plan.
    """
    base = campaign.base
    model = load_model(base)
    ocp, joints = make_ocp(base, model), limits_of(base, model)["q"]
    base = replace(base, supervisor=supervisor_of(base, model))
    for attempt in range(ATTEMPTS):
        rng = np.random.Generator(np.random.Philox(
            np.random.SeedSequence([campaign.seed, index, attempt])))
        # A start with a feasible first plan.
        scenario = replace(base, name=f"{base.name}-{index}", seed=int(rng.integers(2**31)),
                           start=_start(base, joints, rng))
        first = first_feasible(scenario, ocp)
        if first is None:
            continue
        # An unknown surface, the disturbance, faults, and the unknowns that the scenario declares.
        corner = bool(rng.uniform() < CORNER)
        likely = 1.0 if corner else AT_FULL_SIZE
        scenario, walls = drawn_contact(scenario, first, rng, likely)
        unknown = drawn_unknowns(scenario.unknowns, rng, likely)
        return replace(
            scenario, disturbance=_disturbance(scenario.disturbance, model.size, rng),
            faults=[*scenario.faults, *_faults(rng)], model_error=unknown.error,
            current=unknown.current, waves=list(unknown.waves),
            actuation=with_errors(scenario.actuation, model, partial(_parts, rng, likely))
        ), {"starts": attempt + 1, "walls": walls, "corner": int(corner)}
    raise RunFailed(f"run {index}: none of {ATTEMPTS} draws has a feasible first plan")


def first_feasible(scenario: Scenario, ocp: Ocp) -> Ocp | None:
    """Returns the problem at the start of a scenario; None if no first plan of it is feasible."""
    try:
        start = start_state(scenario, ocp)
    except InvalidParameter:
        return None
    first = first_problem(scenario, ocp, start)
    plan, conditions = first_plan(first, start)
    feasible = plan is not None and all(condition.holds for condition in conditions)
    return first if feasible else None


def never_drawn(scenario: Scenario) -> list[str]:
    """Returns the values of a scenario's own run that no draw has, by the test of the draws."""
    ocp = make_ocp(scenario)
    first = first_feasible(scenario, ocp)
    return ["start: it has no feasible first plan"] if first is None else never_pressed(
        scenario, first)


def _start(base: Scenario, joints: Limit, rng: np.random.Generator) -> Start:
    """Returns a start: the vehicle near the declared one, the arm as `draws.joints` has it.

    The arm is interpolated by a uniform fraction towards a uniform posture within its limits.
    """
    eta = np.asarray(base.start.eta, dtype=float) + POSE_REACH * rng.uniform(-1.0, 1.0, 6)
    q, reach = np.asarray(base.start.q, dtype=float), base.draws.joints
    far = reach if np.size(reach) else np.inf
    posture = rng.uniform(np.maximum(joints.lower, q - far), np.minimum(joints.upper, q + far))
    return Start(eta=eta, q=q + rng.uniform() * (posture - q))


def drawn_unknowns(declared: Unknowns, rng: np.random.Generator, likely: float = AT_FULL_SIZE
                   ) -> Unknowns:
    """Returns declared unknowns drawn up to their declared size.

    An error is of either sign, a current from any horizontal direction, up or down, and a wave of
    any direction and phase. Parameters that are known stay known.

    Args:
        declared: The largest unknowns.
        rng: Source of the draws.
        likely: Probability of each to be of its full size.
    """
    part = partial(_part, rng, likely)

    def heading() -> float:
        return float(rng.uniform(-np.pi, np.pi))

    known, current = declared.error, declared.current
    relative = {name: max(LEAST_FACTOR, 1.0 + (getattr(known, name) - 1.0) * part())
                for name in FACTORS}
    first, carried = part(), abs(part())
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
    shift = np.asarray(known.buoyancy_shift, dtype=float)
    if np.any(shift):
        shift = shift * np.append(first, _parts(rng, likely, 2))
    by_axis: dict[str, Any] = {body: AxisFactors(**{
        name: np.maximum(LEAST_FACTOR, 1.0 + (size - 1.0) * _parts(rng, likely, 6))
        for name in COEFFICIENTS
        if np.any((size := known.by_axis(body, name)) != 1.0)})
        for body in BODIES if getattr(known, body) is not None}
    error = replace(known, **relative, **by_axis, buoyancy_shift=shift, payload=payload,
                    joint_friction=friction)
    return Unknowns(error, water, waves)


def _part(rng: np.random.Generator, likely: float) -> float:
    """Returns a drawn error over its declared size, of either sign."""
    size = 1.0 if rng.uniform() < likely else rng.uniform()
    return float(rng.choice([-1.0, 1.0]) * size)


def _parts(rng: np.random.Generator, likely: float, count: int) -> np.ndarray:
    return np.array([_part(rng, likely) for _ in range(count)])


def _disturbance(declared: Disturbance, size: int, rng: np.random.Generator) -> Disturbance:
    """Returns a disturbance of the full bound: an adversary of any kind, or a random one."""
    bound, weights = declared.bound, declared.weights
    period = float(np.exp(rng.uniform(*np.log(PERIODS))))
    phase = float(rng.uniform(0.0, 2.0 * np.pi))
    kind = str(rng.choice([*KINDS, "random"]))
    direction = rng.normal(size=size)
    if kind == "random":
        return RandomDisturbance(bound, bandwidth=1.0 / period, weights=weights)
    if kind == "constant":
        return ConstantDisturbance(bound, direction, weights=weights)
    if kind == "sinusoid":
        return SinusoidalDisturbance(
            bound, direction, 2.0 * np.pi / period, phase, weights=weights)
    return AdversarialDisturbance(
        bound, kind, str(rng.choice(list(ROWS))), direction, int(rng.integers(size)), period, phase,
        weights=weights)


def _faults(rng: np.random.Generator) -> list[Fault]:
    """Returns a fault at random samples that the theory covers, or none."""
    fault = (SolverFailure, SolverTimeout, DroppedPeriod)[rng.integers(3)]
    probability = float(rng.uniform(*FAULT_RATES))
    return [fault(probability)] if rng.uniform() <= FAULT_LIKELY else []


def declared_distribution(scenario: Scenario) -> Iterator[str]:
    """Yields a sentence for each part of the distribution that `vary` draws from."""
    x, _, _, roll, _, yaw = POSE_REACH
    yield (f"start: vehicle uniform within {x:g} m, {roll:g} rad of roll and pitch and {yaw:g} rad "
           "of yaw of the declared pose; the arm uniform on the line from its declared posture to "
           f"one that is uniform {_within(scenario.draws.joints)}its limits; a draw without a "
           "feasible first plan within the tube is repeated")
    yield from about_drawn(scenario)
    if sizes := _sizes(scenario.unknowns, largest_error(scenario.actuation)):
        yield (f"unknown, up to: {', '.join(sizes)}; each of either sign where it has one, and no "
               f"factor below {LEAST_FACTOR:g}; of its full size with the probability "
               f"{AT_FULL_SIZE:g}, else of a uniform part of it")
    if (found := scenario.identified) is not None:
        yield from (found.log_sentences()[0], found.excitation(scenario.limits))
    yield (f"corners: with the probability {CORNER:g} all unknowns, and all parameters of the "
           "wall, are at their bounds at once, with any signs")
    if scenario.disturbance.bound > 0.0:
        yield (f"disturbance: random or of any adversary, of the full bound "
               f"{scenario.disturbance.bound:g}")
    yield "sensors: noise, bias and drift as each declares them, with a seed of the run"
    low, high = FAULT_RATES
    yield (f"solver: with the probability {FAULT_LIKELY:g} samples that fail, are late "
           f"or are dropped, each with a probability that is uniform from {low:g} to {high:g}")


def _within(reach: np.ndarray) -> str:
    each = ", ".join(f"{part:g}" for part in reach)
    return f"within ({each}) rad of it and " if each else "within "


def _sizes(unknowns: Unknowns, of_thrusters: float) -> list[str]:
    """Returns the sizes of the declared unknowns, with their names."""
    error, current = unknowns.error, unknowns.current
    sizes = [f"{name.replace('_', ' ')} {abs(getattr(error, name) - 1.0):.3g}" for name in FACTORS
             if getattr(error, name) != 1.0]
    sizes += [f"{name.replace('_', ' ')} of the {body} by axis {np.max(size):.3g}"
              for body in BODIES for name in COEFFICIENTS
              if np.any(size := np.abs(error.by_axis(body, name) - 1.0))]
    if np.any(error.buoyancy_shift):
        sizes.append(f"centre of buoyancy {np.linalg.norm(error.buoyancy_shift):.3g} m")
    if error.payload.present:
        sizes.append(f"payload {error.payload.mass:g} kg")
    if error.joint_friction.largest > 0.0:
        sizes.append(f"joint friction {error.joint_friction.largest:g} N m")
    if np.any(current):
        sizes.append(f"current {np.hypot(*current[:2]):.3g} m/s from any heading and "
                     f"{abs(current[2]):.3g} m/s up or down")
    if unknowns.waves:
        sizes.append(f"waves {largest_speed(unknowns.waves):.3g} m/s of any heading and phase")
    if of_thrusters > 0.0:
        sizes.append(f"force of each thruster off by {of_thrusters:.3g} of it")
    return sizes
