"""Errata of the MPC's cost and of (sec:simulation_results): E6 to E11."""

import math
from copy import copy
from dataclasses import replace

import numpy as np

from uvms_drake.control.mpc.planner import FIRST_SOLVE_ITERATIONS
from uvms_drake.control.ocp.ocp import MpcConfig
from uvms_drake.control.ocp.scp import SequentialConvexSolver
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.frames.euler import pose_difference, wrap_angle
from uvms_drake.papers.nikou2018.errata import paper
from uvms_drake.papers.nikou2018.errata.paper import (
    Erratum,
    configuration,
    erratum,
    number,
    numbers,
    robot,
)
from uvms_drake.papers.nikou2018.kinematic_certificate import kinematic_tubes
from uvms_drake.papers.nikou2018.kinematics import FIRST_ITERATIONS, Bounds, KinematicMpc
from uvms_drake.station.problem import make_ocp
from uvms_drake.station.scenario.scenario import load_scenario

SPRING = "girona500_bilateral"
"""Scenario with the paper's surface law."""
SETTLING, HOLDING = 100, 40
"""Samples until the MPC of E6 settles, and for that of E9 to hold the task against w."""
SMALL, TINY = 0.01, 1e-4
"""ε below which a terminal set counts as small (‖e(0)‖_P = 1.6), and weight of all but the end of
the horizon, to look for the smallest ε."""


def settled(u_ref: float) -> tuple[np.ndarray, np.ndarray, float, float]:
    """Returns how the nominal MPC of `girona500_bilateral` settles, started at the task.

    Args:
        u_ref: Input without cost, as a fraction of u_eq; zero is printed.

    Returns:
        χ − χ_des (SETTLING, 6) at the samples [m, rad], the force part of 𝔉 − 𝔉_des at the end (3,)
        [N], the norm of u_eq, and that of ζ̄ at the end.
    """
    ocp = copy(make_ocp(load_scenario(SPRING)))
    ocp.task_cost = replace(ocp.task_cost, u_ref=u_ref * ocp.u_eq)
    model, solver, errors = ocp.model, SequentialConvexSolver(ocp), []
    assert isinstance(model, ContactModel)
    start = np.concatenate([model.configuration(ocp.y_des), np.zeros(model.size)])
    plan = ocp.resting_plan(0.0, start)
    plan = solver.solve(plan, FIRST_SOLVE_ITERATIONS).plan or plan
    for _ in range(SETTLING):
        guess = ocp.continued(plan)
        plan = solver.solve(guess, 1).plan or guess
        errors.append(model.task_pose(plan.config[0])[:6] - ocp.y_des[:6])
    chi = ocp.y_des[:6] + np.array([errors[-1], np.zeros(6)])
    force = model.surface.force(chi, np.zeros_like(chi))[:, :3]
    return (np.array(errors), force[0] - force[1], float(np.linalg.norm(ocp.u_eq)),
            float(np.linalg.norm(plan.zeta[0])))


def hold_input() -> Erratum:
    """E6: the equilibrium of the loop with a stage cost ‖ū‖²_R, and with ‖ū − ū_eq‖²_R."""
    (errors, force, needed, _), (own_errors, own_force, *_) = settled(0.0), settled(1.0)
    tip, own_tip = (float(np.linalg.norm(each[-1, :3])) for each in (errors, own_errors))
    return erratum("E6", tip > 1e-5 > own_tip, needed=needed, tip_mm=1e3 * tip,
                   force=np.linalg.norm(force), own_tip_mm=1e3 * own_tip,
                   own_force=np.linalg.norm(own_force))


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


def terminal_penalty() -> Erratum:
    """E7: the smallest J̲ for which P = ½I₆ is a terminal penalty, and λ_min(J Jᵀ) at χ_des."""
    best, q = paper.best_posture()
    left = least_increase(robot().kinematics(configuration(paper.CHI_DES, q)).J_chi)
    return erratum("E7", decrease_gains(paper.J_MIN) is None and left > 0.0, J_min=paper.J_MIN,
                   best=best, left=left)


def norm_at_tip_pitch(tip_pitch: float) -> float:
    """Returns ‖J‖ at q = 0, where the end-effector is pitched by −π/2 relative to the vehicle."""
    config = np.zeros(robot().size)
    config[4] = np.pi / 2 + tip_pitch
    return float(np.linalg.norm(robot().kinematics(config).J_chi, 2))


def simulation_numbers() -> Erratum:
    """E8: the printed numbers, put into the printed conditions."""
    w = paper.AMPLITUDE * float(np.linalg.norm(np.ones(6)))
    tubes = kinematic_tubes(paper.J_MIN, paper.L_C, paper.SIGMA, paper.W_BOUND)
    found = paper.estimated_J_min()
    pitches = (-1.4, -1.56)
    steep = [norm_at_tip_pitch(pitch) for pitch in pitches]
    corrected = f"{tubes.corrected:.3g}" if tubes.condition.holds else "infinite"
    wrong = (w > paper.W_BOUND * (1.0 + 1e-9) or not tubes.condition.holds or found < paper.J_MIN
             or abs(tubes.corrected - paper.TUBE) > 0.01 * paper.TUBE)
    return erratum("E8", wrong, bound=paper.W_BOUND, sigma=paper.SIGMA, J_min=paper.J_MIN,
                   L_c=paper.L_C, tube=paper.TUBE, w=w, least_sigma=paper.L_C / paper.J_MIN,
                   by_formula=tubes.printed, corrected=corrected, found=found, steep=steep,
                   pitches=[number(pitch) for pitch in pitches])


def initial_configuration() -> Erratum:
    """E10: configurations with the printed χ(0), and the end-effector's pitch at 𝔮 = 0."""
    model = robot()
    pitch = float(model.kinematics(np.zeros(model.size)).chi[4])
    q_a, q_b = paper.Q_START, paper.Q_START_OTHER
    config = configuration(paper.CHI_START, np.array([q_a, q_b]))
    off = max(float(np.max(np.abs(pose_difference(chi, paper.CHI_START))))
              for chi in model.kinematics(config).chi)
    apart = float(np.max(np.abs(wrap_angle(config[1] - config[0])[3:])))
    end = configuration(paper.CHI_DES, paper.Q_DES)
    allowed = all(map(paper.is_allowed, config))
    reached = "reached" if off < paper.SAME else f"missed by {off:.2g}"
    return erratum("E10", off < paper.SAME and apart > 0.1 and allowed, reached=reached,
                   apart=apart, eta_a=numbers(config[0, :6]), eta_b=numbers(config[1, :6]),
                   q_a=numbers(q_a), q_b=numbers(q_b), eta_end=numbers(end[:6]),
                   q_end=numbers(paper.Q_DES), within="both" if allowed else "not both",
                   pitch=number(pitch / np.pi))


def printed_mpc(stage_weight: float) -> KinematicMpc:
    """Returns the FHOCP of (sec:simulation_results) with P = ½I₆ and any weight of Q and R."""
    model = robot()
    task = np.repeat([1.0, 0.0], [6, model.num_joints])
    mpc = MpcConfig(
        horizon=paper.HORIZON, time_step=paper.TIME_STEP, weight_y=stage_weight * task,
        weight_zeta=np.full(model.size, stage_weight), terminal_weight=paper.WEIGHT * task,
        terminal_set=False)
    angles = np.array([np.inf, paper.PITCH_LIMIT, np.inf])
    return KinematicMpc(model, mpc, np.concatenate([paper.CHI_DES, paper.Q_DES]), Bounds(
        np.full(3, paper.SPEED), np.concatenate([-angles, model.q_lower]),
        np.concatenate([angles, model.q_upper])))


def hold(measured: bool) -> tuple[float, float]:
    """Returns the largest jump of ȳ at a sample, and ‖χ − χ_des‖ at the end [m, rad].

    The paper's MPC is at χ_des, with solves from the measured or the nominal state.

    Weights, limits, T and h are the printed ones. The feedback is `resolved`, for which
    𝔢̇_y = −σ𝔢_y + (w, 0) exactly; w̃ acts along the first axis.
    """
    mpc = printed_mpc(paper.WEIGHT)
    model = mpc.model
    w = paper.W_BOUND * np.eye(model.size)[0]
    decay = math.exp(-paper.SIGMA * paper.TIME_STEP)
    error, jump = np.zeros(model.size), 0.0
    plan, y = mpc.resting(configuration(paper.CHI_DES, paper.Q_DES)), mpc.y_des
    for _ in range(HOLDING):
        plan = mpc.continued(mpc.solve(plan, 1))
        error = decay * error + (1.0 - decay) / paper.SIGMA * w
        y = model.task_pose(plan.config[0]) + error
        if measured:
            jump = max(jump, float(np.linalg.norm(error)))
            plan = mpc.plan(model.configuration(y), plan.zeta)
            error = np.zeros(model.size)
    return jump, float(np.linalg.norm(pose_difference(y[:6], paper.CHI_DES)))


def initial_state() -> Erratum:
    """E9: the nominal trajectory jumps, and the tube is left, if solves start at the real state."""
    (jump, off), (own_jump, own_off) = hold(True), hold(False)
    radius = paper.W_BOUND / paper.SIGMA
    smallest = math.sqrt(paper.WEIGHT) * (off - radius)
    return erratum("E9", jump > 1e-9 and off > radius >= own_off, w=paper.W_BOUND,
                   jump_mm=1e3 * jump, off_mm=1e3 * off, seconds=HOLDING * paper.TIME_STEP,
                   radius_mm=1e3 * radius, smallest=smallest, own_jump_mm=1e3 * own_jump,
                   own_off_mm=1e3 * own_off)


def reach(q: np.ndarray, stage_weight: float) -> tuple[float, float, float]:
    """Returns ‖ē(T)‖_P, the largest ‖d𝔭̄/dt‖ [m/s] and violation of the first plan from q.

    `TINY` is for the smallest ε: a local optimum from a plan that stays, a smaller one may exist.
    """
    mpc = printed_mpc(stage_weight)
    plan = mpc.solve(mpc.resting(configuration(paper.CHI_START, q)), FIRST_ITERATIONS)
    end = pose_difference(mpc.model.task_pose(plan.config[-1])[:6], paper.CHI_DES)
    J = mpc.model.kinematics(plan.config[:-1]).J_chi
    speeds = np.linalg.norm((J @ plan.zeta[..., None])[:, :3, 0], axis=1)
    return (math.sqrt(paper.WEIGHT) * float(np.linalg.norm(end)), float(np.max(speeds)),
            mpc.value(plan).violation)


def first_horizon() -> Erratum:
    """E11: the smallest ε that the first horizon reaches, from two 𝔮(0) with the printed χ(0)."""
    q_a, q_b = paper.Q_START, paper.Q_START_OTHER
    (a, _, over_a), (b, speed, over_b), (printed, *_) = (
        reach(q_a, TINY), reach(q_b, TINY), reach(q_a, paper.WEIGHT))
    distance = float(np.linalg.norm(paper.CHI_START[:3] - paper.CHI_DES[:3]))
    small = [radius < SMALL and over < 1e-6 for radius, over in ((a, over_a), (b, over_b))]
    return erratum("E11", small[0] != small[1], a=a, b=b, q_a=numbers(q_a), q_b=numbers(q_b),
                   by_printed=printed, distance=distance, seconds=distance / paper.SPEED,
                   speed=speed)
