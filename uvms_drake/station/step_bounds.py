"""Largest steps of explicit integration schemes, and the fastest rate of friction."""

import math
from typing import TYPE_CHECKING

import numpy as np

from uvms_drake.model.uvms_model import UvmsModel
from uvms_drake.station.problem import true_surface

if TYPE_CHECKING:
    from uvms_drake.station.scenario.scenario import Scenario

ORDERS = {"explicit_euler": 1, "semi_explicit_euler": 1, "runge_kutta2": 2, "runge_kutta3": 3,
          "bogacki_shampine3": 3, "runge_kutta5": 5}
"""Orders of the explicit schemes: R is the Taylor polynomial of exp of this degree; Drake's fifth
order adds a term of no weight where R is accurate."""
ACCURACY = 0.05
"""Largest |R(hλ) − exp(hλ)|: the relative error of a deviation in a step."""


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


def largest_rate(scenario: "Scenario") -> float:
    """Returns the largest real rate for which the step of a scenario is accurate [1/s].

    It is infinite if no step is checked, or the step is chosen by the rates.
    """
    settings = scenario.simulator
    if settings.use_error_control or settings.max_step_size == 0.0:
        return np.inf
    return largest_step(settings.integration_scheme, np.array([-1.0])) / step_of(scenario)


def step_of(scenario: "Scenario") -> float:
    """Returns the largest step of the integrator [s], given the periods of events."""
    given = scenario.simulator.max_step_size or np.inf
    return min(given, scenario.log_period, scenario.mpc.time_step)


def friction_rate(scenario: "Scenario", model: UvmsModel, config: np.ndarray) -> float:
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
