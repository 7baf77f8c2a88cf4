"""The scenario of each run, drawn from (seed, index).

Inside of the bounds everything that the certificate covers is drawn: starts with a feasible first
plan, certified surfaces and desired forces with a terminal set of their own at any position and
heading, disturbances and adversaries of the full size d̃, solves that fail, are delayed or dropped.
In half of the runs, if model errors are requested, d̃ is shared with `model_uncertainty`; unknowns
that the scenario declares are drawn in every run.
"""

from dataclasses import replace

import numpy as np

from uvms_drake.campaign.campaign import Campaign
from uvms_drake.campaign.drawn_contact import drawn_contact
from uvms_drake.campaign.model_uncertainty import (
    as_declared,
    as_declared_thrusters,
)
from uvms_drake.certificate.certify import first_plan
from uvms_drake.common.errors import InvalidParameter, RunFailed
from uvms_drake.control.limits import Limit
from uvms_drake.control.mpc.solver_faults import DroppedPeriod, SolverFailure, SolverTimeout
from uvms_drake.model.signals.fault import Fault
from uvms_drake.plant.adversary import KINDS, ROWS, AdversarialDisturbance
from uvms_drake.plant.disturbance import (
    ConstantDisturbance,
    Disturbance,
    RandomDisturbance,
    SinusoidalDisturbance,
)
from uvms_drake.station.problem import first_problem, load_model, make_ocp, start_state
from uvms_drake.station.scenario.scenario import Scenario, Start

POSE_REACH = np.array([0.1, 0.1, 0.1, 0.03, 0.03, 0.1])
"""Largest distance of the vehicle from the scenario's start [m, rad]."""
PERIODS = (0.5, 10.0)
"""Range of a disturbance's period, drawn uniformly in its logarithm [s]."""
FAULT_LIKELY, FAULT_RATES = 0.25, (0.05, 0.5)
"""Probability that a run has faults of the solver, and range of the probability per sample."""
ATTEMPTS = 100


def vary(campaign: Campaign, index: int) -> Scenario:
    """Returns the scenario of a run: a pure function of its arguments.

    Raises:
        RunFailed: No draw has a feasible first plan.
    """
    base = campaign.base
    model = load_model(base)
    ocp = make_ocp(base, model)
    for attempt in range(ATTEMPTS):
        rng = np.random.Generator(np.random.Philox(
            np.random.SeedSequence([campaign.seed, index, attempt])))
        # A start with a feasible first plan.
        scenario = replace(base, name=f"{base.name}-{index}", seed=int(rng.integers(2**31)),
                           start=_start(base.start, ocp.limits["q"], rng))
        try:
            start = start_state(scenario, ocp)
        except InvalidParameter:
            continue
        first = first_problem(base, ocp, start)
        plan, conditions = first_plan(first, start)
        if plan is None or not all(condition.holds for condition in conditions):
            continue
        # An unknown surface, the disturbance, faults, and the unknowns that the scenario declares.
        scenario = drawn_contact(scenario, first, rng)
        unknown = as_declared(scenario.unknowns, rng)
        return replace(
            scenario, disturbance=_disturbance(scenario.disturbance, model.size, rng),
            faults=[*scenario.faults, *_faults(rng)], model_error=unknown.error,
            current=unknown.current, waves=list(unknown.waves),
            actuation=as_declared_thrusters(scenario.actuation, model, rng))
    raise RunFailed(f"run {index}: none of {ATTEMPTS} draws has a feasible first plan")


def _start(declared: Start, joints: Limit, rng: np.random.Generator) -> Start:
    """Returns a start: the vehicle near the declared one, the arm anywhere within its limits.

    The arm is interpolated by a uniform fraction towards a uniform posture.
    """
    eta = np.asarray(declared.eta, dtype=float) + POSE_REACH * rng.uniform(-1.0, 1.0, 6)
    q = np.asarray(declared.q, dtype=float)
    posture = rng.uniform(joints.lower, joints.upper)
    return Start(eta=eta, q=q + rng.uniform() * (posture - q))


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
