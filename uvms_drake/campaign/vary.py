"""What differs from run to run: start, desired force and disturbance, drawn from (seed, index).

Everything drawn is inside of what the certificate is about: starts from which the nominal MPC has a
plan into its terminal set, desired forces with a terminal set of their own, disturbances of the
full size d̃. The stiffness and pose of the surface and a current are not drawn: d̃ does not cover
what they induce. Errors of the model are drawn if they are asked for, and half of d̃ is left to what
they induce; whether that was enough is measured in every run. Masses are not among them: the arm is
heavy in water, and an error of 10 % in its mass alone induces more than twice the d̃ of the main
scenario. A robot can be weighed.
"""

from dataclasses import replace

import numpy as np

from uvms_drake.campaign.setup import Campaign, with_target
from uvms_drake.control.nominal_mpc import FEASIBLE, FIRST_SOLVE_ITERATIONS, REACHED
from uvms_drake.control.ocp import Ocp
from uvms_drake.control.scp import SequentialConvexSolver
from uvms_drake.errors import InvalidParameter, RunFailed
from uvms_drake.model.model_error import ModelError
from uvms_drake.plant.adversary import KINDS, ROWS, AdversarialDisturbance
from uvms_drake.plant.disturbance import (
    ConstantDisturbance,
    RandomDisturbance,
    SinusoidalDisturbance,
)
from uvms_drake.scenario import Scenario, Start
from uvms_drake.station import make_ocp, start_state, within_declared_set

POSE_REACH = np.array([0.1, 0.1, 0.1, 0.03, 0.03, 0.1])
"""How far the vehicle starts from the scenario's start, at most [m, rad]."""
PERIODS = (0.5, 10.0)
"""Range of a disturbance's period, drawn uniformly in its logarithm [s]."""
ATTEMPTS = 100
SHARE = 0.5
"""Of d̃, left to what an error of the model induces."""

Disturbance = (
    SinusoidalDisturbance | ConstantDisturbance | RandomDisturbance | AdversarialDisturbance)


def vary(campaign: Campaign, index: int) -> Scenario:
    """Returns the scenario of a run: a pure function of its arguments.

    What has no feasible first plan is drawn again, with the number of the attempt in the seed.

    Raises:
        RunFailed: No draw is feasible.
    """
    base = campaign.base
    for attempt in range(ATTEMPTS):
        rng = np.random.Generator(np.random.Philox(
            np.random.SeedSequence([campaign.seed, index, attempt])))
        target = campaign.targets[rng.integers(len(campaign.targets))]
        aimed = with_target(base, target)
        try:
            ocp = make_ocp(aimed)
            scenario = replace(
                aimed, name=f"{base.name}-{index}", start=_start(aimed, ocp, rng),
                disturbance=_disturbance(aimed, ocp.model.size, rng),
                seed=int(rng.integers(2**31)),
                model_error=_model_error(base.model_error, campaign.model_error, rng))
            start = start_state(scenario, ocp)
        except InvalidParameter:
            if attempt == 0:
                make_ocp(base)  # A scenario that cannot be used at all says so.
            continue
        if has_first_plan(ocp, start, base, scenario.task.force):
            return scenario
    raise RunFailed(f"run {index}: none of {ATTEMPTS} draws has a feasible first plan")


def _start(scenario: Scenario, ocp: Ocp, rng: np.random.Generator) -> Start:
    """Returns a start: the vehicle near the scenario's, the arm anywhere within its limits.

    The arm goes a uniform part of the way to a uniform posture.
    """
    eta = np.asarray(scenario.start.eta, dtype=float) + POSE_REACH * rng.uniform(-1.0, 1.0, 6)
    q = np.asarray(scenario.start.q, dtype=float)
    posture = rng.uniform(ocp.limits.q_lower, ocp.limits.q_upper)
    return Start(eta=eta, q=q + rng.uniform() * (posture - q))


def _disturbance(scenario: Scenario, size: int, rng: np.random.Generator) -> Disturbance:
    """Returns a disturbance of the full bound: an adversary of any kind, or a random one.

    Where no forces act the only adversary is `along_task_error`.
    """
    bound = scenario.disturbance.bound
    period = float(np.exp(rng.uniform(*np.log(PERIODS))))
    phase = float(rng.uniform(0.0, 2.0 * np.pi))
    kinds = ("along_task_error", "constant", "sinusoid") if scenario.kinematic else KINDS
    kind = str(rng.choice([*kinds, "random"]))
    direction = rng.normal(size=6 if scenario.kinematic else size)
    if kind == "random":
        return RandomDisturbance(bound, bandwidth=1.0 / period)
    if kind == "constant":
        return ConstantDisturbance(bound, direction)
    if kind == "sinusoid":
        return SinusoidalDisturbance(bound, direction, 2.0 * np.pi / period, phase)
    return AdversarialDisturbance(
        bound, kind, str(rng.choice(list(ROWS))), direction, int(rng.integers(size)), period, phase)


def _model_error(base: ModelError, largest: float, rng: np.random.Generator) -> ModelError:
    """Returns an error of added mass, drag and righting lever, each up to `largest` if not zero."""
    if largest == 0.0:
        return base
    added_mass, drag, lever = (float(1.0 + largest * x) for x in rng.uniform(-1.0, 1.0, 3))
    return ModelError(added_mass=added_mass, drag=drag, buoyancy_lever=lever, share=SHARE)


def kind_of(scenario: Scenario) -> str:
    """Returns what the disturbance of a run is called, in `KINDS` or "random"."""
    match scenario.disturbance:
        case AdversarialDisturbance(kind=kind):
            return kind
        case ConstantDisturbance():
            return "constant"
        case SinusoidalDisturbance():
            return "sinusoid"
        case _:
            return "random"


def has_first_plan(ocp: Ocp, start: np.ndarray, base: Scenario, force: np.ndarray) -> bool:
    """Returns whether what the certificate asks of the first plan holds from here.

    Within the limits, into the terminal set and, if forces act at all, pressing no harder than the
    declared set of `base` reaches.
    """
    solution = SequentialConvexSolver(ocp).solve(
        ocp.resting_plan(0.0, start[: ocp.state_size]), FIRST_SOLVE_ITERATIONS)
    value = solution.evaluation
    if solution.plan is None or value is None:
        return False
    if value.violation > FEASIBLE or value.terminal_slack > REACHED:
        return False
    return base.kinematic or within_declared_set(base, ocp.model, force, solution.plan)
