"""Errata of the MPC's cost: E6 and E7."""

import math
from copy import copy
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from uvms_drake.control.mpc.planner import FIRST_SOLVE_ITERATIONS
from uvms_drake.control.ocp.ocp import Ocp
from uvms_drake.control.ocp.scp import SequentialConvexSolver
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.surface.law import Surface, check_surface
from uvms_drake.papers.nikou2018.errata.erratum import Erratum
from uvms_drake.papers.nikou2018.errata.paper import (
    CHI_DES,
    J_MIN,
    best_posture,
    configuration,
    robot,
    uvms,
)
from uvms_drake.station.problem import make_dynamic_ocp
from uvms_drake.station.scenario.scenario import load_scenario

SETTLING = 100
"""Number of samples until the MPC settles."""


class RestPoint(NamedTuple):
    """Equilibrium of the loop with the nominal MPC."""

    tip: float
    """Distance ‖𝔭 − 𝔭_des‖ [m]."""
    force: float
    """Norm of the force part of 𝔉 − 𝔉_des [N]."""
    speed: float
    """Remaining norm ‖ζ̄‖ [m/s, rad/s]."""


def spring_ocp() -> tuple[Ocp, Surface]:
    """Returns the nominal problem of the scenario with the paper's surface law, and its surface."""
    scenario = load_scenario("girona500_bilateral")
    model = ContactModel(uvms(), check_surface(scenario.surface))
    return make_dynamic_ocp(scenario, model), model.surface


def rest_point(ocp: Ocp, surface: Surface, u_ref: np.ndarray) -> RestPoint:
    """Returns the equilibrium of the nominal MPC that starts at the task and weighs ū − u_ref."""
    ocp = copy(ocp)
    ocp.task_cost = replace(ocp.task_cost, u_ref=u_ref)
    model, solver = ocp.model, SequentialConvexSolver(ocp)
    start = np.concatenate([model.configuration(ocp.y_des), np.zeros(model.size)])
    plan = ocp.resting_plan(0.0, start)
    plan = solver.solve(plan, FIRST_SOLVE_ITERATIONS).plan or plan
    for _ in range(SETTLING):
        guess = ocp.continued(plan)
        plan = solver.solve(guess, 1).plan or guess
    chi = np.array([model.task_pose(plan.config[0])[:6], ocp.y_des[:6]])
    force = surface.force(chi, np.zeros_like(chi))[:, :3]
    return RestPoint(
        float(np.linalg.norm(chi[0, :3] - chi[1, :3])),
        float(np.linalg.norm(force[0] - force[1])), float(np.linalg.norm(plan.zeta[0])))


def hold_input(fraction: float = 0.0) -> Erratum:
    """E6: the equilibrium of the loop with a stage cost ‖ū − u_ref‖²_R.

    Args:
        fraction: u_ref as a fraction of ū_eq; the printed one is zero.
    """
    ocp, surface = spring_ocp()
    needed = float(np.linalg.norm(ocp.u_eq))
    printed, with_reference = (rest_point(ocp, surface, c * ocp.u_eq) for c in (fraction, 1.0))
    return Erratum(
        "E6", "The equilibrium needs a hold input", "eq:mpc_cost_function, eq:terminal_set_F",
        "ξ = 0 is an equilibrium for u = 0, and the stage cost has ‖ū‖²_R",
        f"‖f(𝔮_des, 0)‖ = {needed:.3g} m/s², rad/s² in girona500_bilateral; with ‖ū‖²_R the "
        f"nominal loop comes to rest {1e3 * printed.tip:.1f} mm and {printed.force:.1f} N off its "
        f"20 N task, with ‖ū − ū_eq‖²_R {1e3 * with_reference.tip:.1f} mm and "
        f"{with_reference.force:.1f} N",
        "Even without a disturbance 𝔉 does not go to 𝔉_des; the stage cost here has "
        "ū_eq = −f(𝔮_des, 0).",
        wrong=printed.tip > 1e-5 > with_reference.tip)


def decrease_gains(J_min: float) -> tuple[float, float] | None:
    """Returns the interval of c with c ≥ ½ + ½c²/J̲, None if it is empty.

    With ζ = −cJ⁺e, J⁺ the pseudoinverse, V = ½‖e‖² falls at c‖e‖² and the stage cost is
    ½‖e‖² + ½c²eᵀ(J Jᵀ)⁻¹e. The ends are the roots of c² − 2J̲c + J̲.
    """
    discriminant = J_min**2 - J_min
    if discriminant < 0.0:
        return None
    return J_min - math.sqrt(discriminant), J_min + math.sqrt(discriminant)


def least_increase(J: np.ndarray) -> float:
    """Returns max over ‖e‖ = 1 of min over ζ of V̇ + ½‖e‖² + ½‖ζ‖², V = ½‖e‖².

    The best ζ is −Jᵀe, which leaves ½eᵀ(I − J Jᵀ)e: no controller does better.
    """
    return 0.5 * (1.0 - float(np.linalg.eigvalsh(J @ J.T)[0]))


def terminal_penalty(J_min: float = J_MIN) -> Erratum:
    """E7: the smallest J̲ for which P = ½I₆ is a terminal penalty, and λ_min(J Jᵀ) at χ_des."""
    low, high = 1e-6, 2.0
    while high - low > 1e-12:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if decrease_gains(middle) else (middle, high)
    best, q = best_posture()
    left = least_increase(robot().kinematics(configuration(CHI_DES, q)).J_chi)
    return Erratum(
        "E7", "P = ½I₆ is no terminal penalty", "sec:simulation_results, eq:terminal_set_F",
        f"P = Q = ½I₆ and R = ½I₁₀, with J̲ = {J_min:.4g}",
        f"ζ_loc = −cJ⁺e needs c ≥ ½ + ½c²/J̲, so J̲ ≥ {high:.3f}; the best posture at χ_des has "
        f"λ_min(J Jᵀ) = {best:.3f} (estimated), where there are e for which no ζ whatsoever makes "
        f"V̇ + ℓ less than {left:.3f}‖e‖²",
        "The optimal cost need not fall from sample to sample; P has to be computed, and checked.",
        wrong=decrease_gains(J_min) is None and left > 0.0)
