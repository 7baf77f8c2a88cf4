"""Chooses the integrator's step by the rates of the closed loop, or checks it, before a run.

A fixed step h multiplies a mode exp(λt) by R(hλ) instead of exp(hλ), with R the scheme's stability
function. A too large kh then changes the effect of the gain k. The rates λ are the eigenvalues of
the loop with plant, law and surface, linearised at the task, in contact, without a deviation, and
the rate of friction on the tip and in the joints. A sampled command is constant between samples:
the law does not cancel the surface then.
"""

import copy
import math
from dataclasses import replace

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, Diagram

from uvms_drake.common.errors import RunFailed, require
from uvms_drake.common.wiring import release
from uvms_drake.control.laws.law import AncillaryLaw
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.surface.law import Surface, check_surface
from uvms_drake.model.uvms_model import UvmsModel
from uvms_drake.plant.disturbance import ConstantDisturbance
from uvms_drake.station.contact.bounds import pressing_force
from uvms_drake.station.controller import IMPLICIT
from uvms_drake.station.diagram import make_station
from uvms_drake.station.problem import load_model, make_ocp, true_surface
from uvms_drake.station.scenario.scenario import Scenario, Start
from uvms_drake.station.true_wall import FARTHEST, surface_depth

ORDERS = {"explicit_euler": 1, "semi_explicit_euler": 1, "runge_kutta2": 2, "runge_kutta3": 3,
          "bogacki_shampine3": 3, "runge_kutta5": 5}
"""Orders of the explicit schemes: R is the Taylor polynomial of exp of this degree; Drake's fifth
order adds a term of no weight where R is accurate."""
ACCURACY = 0.05
"""Largest |R(hλ) − exp(hλ)|: the relative error of a deviation in a step."""
WITHOUT_ESTIMATE = ("explicit_euler", "semi_explicit_euler", "runge_kutta2")
"""Schemes without an estimate of the error: Drake takes fixed steps even if it is to control it."""
WAYS = 1e-6, 0.5, 400
"""Smallest and largest depth at which a force is looked for in a surface [m], and their number."""
DIFFERENCE = 1e-6
"""Difference of a state, to differentiate the loop [m, rad, m/s, rad/s]."""


def step_error(order: int, z: np.ndarray | complex) -> np.ndarray:
    """Returns |R(z) − exp(z)| (...) of an explicit scheme for z = hλ (...)."""
    taylor = sum(z**i / math.factorial(i) for i in range(order + 1))
    return np.abs(taylor - np.exp(z))


def largest_step(scheme: str, rates: np.ndarray) -> float:
    """Returns the largest accurate step h [s] of a scheme for rates λ (any) [1/s].

    The error grows with h as long as it is small, so that h is found by bisection.
    """
    fastest = float(np.max(np.abs(rates), initial=0.0))
    if scheme not in ORDERS or fastest == 0.0:
        return np.inf
    low, high = 0.0, 10.0 / fastest
    for _ in range(50):
        h = 0.5 * (low + high)
        accurate = np.max(step_error(ORDERS[scheme], h * rates)) <= ACCURACY
        low, high = (h, high) if accurate else (low, h)
    return low


def largest_rate(scenario: Scenario) -> float:
    """Returns the largest real rate for which the step of a scenario is accurate [1/s].

    It is infinite if no step is checked, or the step is chosen by the rates.
    """
    settings = scenario.simulator
    if settings.use_error_control or settings.max_step_size == 0.0:
        return np.inf
    return largest_step(settings.integration_scheme, np.array([-1.0])) / step_of(scenario)


def step_of(scenario: Scenario) -> float:
    """Returns the largest step of the integrator [s], given the periods of events."""
    given = scenario.simulator.max_step_size or np.inf
    return min(given, scenario.log_period, scenario.mpc.time_step)


def friction_rate(scenario: Scenario, model: UvmsModel, config: np.ndarray) -> float:
    """Returns the largest rate of the friction at 𝔮 (6+n,) and the task's force [1/s].

    It is the largest eigenvalue of M⁻¹(J_pᵀ c J_p + C_q), with c and C_q the largest slopes by
    speed of the friction on the tip and in the joints. At rest those slopes are zero, so the loop's
    eigenvalues there do not show it. It counts even if the law cancels the friction.
    """
    J, M = model.task_jacobian(config)[:3], model.mass_matrix(model.kinematics(config))
    force = float(np.linalg.norm(np.asarray(scenario.task.force, dtype=float)[:3]))
    C = true_surface(scenario).slip_damping(force) * J.T @ J
    C[6:, 6:] += np.diag(scenario.model_error.joint_friction.slopes(model.num_joints))
    L_inverse = np.linalg.inv(np.linalg.cholesky(M))
    return float(np.linalg.eigvalsh(L_inverse @ C @ L_inverse.T)[-1])


def loop_rates(station: Diagram, context: Context) -> np.ndarray:
    """Returns the eigenvalues of ∂ẋ/∂x of all continuous states x at a Context [1/s]."""
    x = context.get_continuous_state_vector().CopyToVector()
    columns = []
    for i in range(len(x)):
        ends = []
        for sign in (1.0, -1.0):
            moved = x.copy()
            moved[i] += sign * DIFFERENCE
            context.SetContinuousState(moved)
            ends.append(station.EvalTimeDerivatives(context).CopyToVector())
        columns.append((ends[0] - ends[1]) / (2.0 * DIFFERENCE))
    context.SetContinuousState(x)
    return np.linalg.eigvals(np.array(columns).T)


def with_step(scenario: Scenario, model: ContactModel | None = None) -> Scenario:
    """Returns a scenario with a step of the integrator above zero, checked if it was given.

    In place of zero it is the longest accurate one that divides `log_period`. Without a plan at
    the task a given step is not checked. The model is the controller's; loaded if left out.

    Raises:
        InvalidParameter: A given step is too long for the loop, or none could be chosen.
    """
    settings, model = scenario.simulator, model or load_model(scenario)
    scheme = settings.integration_scheme
    require(scheme in ORDERS or scheme in IMPLICIT, "simulator.integration_scheme", scheme,
            f"one of {', '.join((*ORDERS, *IMPLICIT))}")
    require(not settings.use_error_control or scheme not in WITHOUT_ESTIMATE,
            "simulator.use_error_control", True, f"false with {scheme}, which estimates no error")
    given, longest = settings.max_step_size > 0.0, step_of(scenario)
    step = longest
    if not settings.use_error_control and scheme in ORDERS:
        try:
            rates = _rates_at_task(scenario, model)
        except RunFailed as error:
            require(given, "simulator.max_step_size", settings.max_step_size, "positive: no plan "
                    f"holds the task, at whose rates it would be chosen: {error}")
            return scenario
        largest = largest_step(scheme, rates)
        if given:
            part = fastest_part(scenario.ancillary, scenario.surface, rates)
            require(longest <= largest, "simulator.max_step_size", settings.max_step_size,
                    f"at most {floored(largest):g} s with {scheme}: {part} has a rate of "
                    f"{np.max(np.abs(rates)):.3g} 1/s, and longer steps are inaccurate")
        else:
            step = longest / math.ceil(longest / largest)
    if given:
        return scenario
    # A chosen step may make a run take too long.
    scenario.check_cost(step)
    chosen = copy.copy(settings)
    chosen.max_step_size = step
    return replace(scenario, simulator=chosen)


def _rates_at_task(scenario: Scenario, model: ContactModel) -> np.ndarray:
    """Returns the rates of the loop and of friction at the task [1/s].

    Raises:
        RunFailed: No plan holds the task.
    """
    # At rest at the task, without a disturbance: an adversary's jumps with the state. A plan of any
    # length is constant there.
    quiet = replace(scenario, disturbance=ConstantDisturbance(bound=0.0), faults=[],
                    mpc=replace(scenario.mpc, horizon=1))
    ocp = make_ocp(quiet, model)
    config = model.configuration(ocp.y_des)
    wall = scenario.contact.declared_wall()
    if wall is not None:  # The depth of a task says nothing of an unknown wall.
        force = max([pressing_force(scenario), *(
            step.strongest for step in scenario.mission.steps)])
        n, chi = wall.direction, model.task_pose(config)[:6]
        away = n @ (model.task_pose(scenario.start.config)[:3] - chi[:3])
        chi[:3] += away * n
        config[:3] += (away + way_to_force(
            check_surface(true_surface(scenario)), chi, n, force)) * n
    station = make_station(
        replace(quiet, start=Start(eta=config[:6], q=config[6:])), model=model)
    simulator = Simulator(station)
    try:
        simulator.Initialize()
        simulator.AdvancePendingEvents()  # Sampled signals are constant from here on.
        rates = loop_rates(station, simulator.get_mutable_context())
    finally:
        release(station)
    return np.append(rates, -friction_rate(scenario, model, config))


def way_to_force(surface: Surface, chi: np.ndarray, direction: np.ndarray, force: float) -> float:
    """Returns the way along n from χ (6,) to where a surface exerts a force [m], or its largest.

    Zero if there is no surface.
    """
    touch = float(surface_depth(surface, chi[None], direction, FARTHEST)[0] - chi[:3] @ direction)
    if not math.isfinite(touch):
        return 0.0
    ways = touch + np.geomspace(*WAYS)
    forces = surface.static_force(chi + ways[:, None] * np.pad(direction, (0, 3)))
    return float(ways[np.argmax(np.minimum(forces, force))])


def fastest_part(law: AncillaryLaw, surface: Surface, rates: np.ndarray) -> str:
    """Returns the part of the closed loop that has its fastest rate, with the keys that change it.

    Args:
        law: Law of the loop.
        surface: Surface of the loop.
        rates: Rates of the loop, and at the end that of friction [1/s].
    """
    sizes = np.abs(rates)
    fastest = float(np.max(sizes))
    if sizes[-1] == fastest:
        creep = getattr(surface, "creep", None)
        of = "" if creep is None else f" (surface.friction, surface.creep = {creep:g} m/s)"
        return f"the friction on the end-effector and in the joints{of}"
    for key in ("k", "sigma"):
        if abs(fastest - getattr(law, key)) <= 0.02 * fastest:
            return f"the feedback law (ancillary.{key} = {getattr(law, key):g} 1/s)"
    return "the loop of law, surface and actuators"


def floored(step: float) -> float:
    """Returns a step rounded down to two digits."""
    unit = 10.0 ** (math.floor(math.log10(step)) - 1)
    return math.floor(step / unit) * unit
