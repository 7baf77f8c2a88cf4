"""Tests of `papers.nikou2018.kinematics.ocp`: the problem of the paper's own simulation."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.solvers import SnoptSolver
from support import dh
from support.limits import bounded

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.control.ocp.nonlinear_solver import NonlinearSolver
from uvms_drake.control.ocp.ocp import TERMINAL_PENALTY
from uvms_drake.control.ocp.scp import SequentialConvexSolver
from uvms_drake.papers.nikou2018.kinematics.ocp import KinematicOcp
from uvms_drake.papers.nikou2018.kinematics.plan import KinematicPlan
from uvms_drake.station.motions.motions import make_ocp
from uvms_drake.station.scenario.scenario import load_scenario

H = 0.1  # s
SCENARIO = load_scenario("paper_kinematic")
START = np.concatenate([SCENARIO.start.eta, SCENARIO.start.q])


@pytest.fixture(scope="module")
def ocp() -> KinematicOcp:
    return make_ocp(SCENARIO)


@pytest.fixture
def plan(ocp) -> KinematicPlan:
    rng = np.random.default_rng(0)
    return KinematicPlan.from_velocities(0.0, H, START, rng.uniform(-0.5, 0.5, size=(7, 10)))


def scattered(count: int) -> list[np.ndarray]:
    """Returns configurations around the way from the start to the task."""
    rng = np.random.default_rng(1)
    scale = np.array([0.3, 0.3, 0.3, 0.2, 0.2, 0.3, 0.3, 0.2, 0.3, 0.5])
    way = rng.uniform(0.0, 1.0, size=count)
    task = np.array([-0.972, 0.0, 0.058, 0.0, 0.0, 0.0, 0.0, 1.0, 0.4, 1.0])
    return [START + s * (task - START) + scale * rng.uniform(-0.5, 0.5, size=10) for s in way]


def test_the_cost_is_the_sum_that_the_paper_writes(ocp, plan):
    """½‖e‖² + ½‖ζ‖² over T = 0.7 s and ½‖e‖² at its end; the joints weigh nothing."""
    chi_des = np.array([0.0, 0.0, 0.0, np.pi / 3, np.pi / 10, 0.0])
    e = np.array([dh.chi(config) for config in plan.config]) - chi_des
    cost = 0.5 * H * (np.sum(e[:-1] ** 2) + np.sum(plan.zeta**2)) + 0.5 * e[-1] @ e[-1]
    evaluation = ocp.evaluate(plan)
    assert evaluation.cost == pytest.approx(cost, rel=1e-8)
    assert (evaluation.terminal_slack, evaluation.violation) == (0.0, 0.0)


@pytest.mark.parametrize("block", [slice(0, 3), slice(3, 6), slice(6, 10)])
def test_a_speed_beyond_its_limit_is_a_violation(ocp, block):
    zeta = np.zeros((7, 10))
    zeta[2, block] = (ocp.limits["nu1"].upper[0] + 0.5) / np.sqrt(block.stop - block.start)
    plan = KinematicPlan.from_velocities(0.0, H, START, zeta)
    assert ocp.evaluate(plan).violation == pytest.approx(0.5, abs=1e-12)


def test_the_program_is_the_first_order_model_of_the_problem(ocp, plan, derivative):
    program = ocp.staged_program(plan)
    change = np.random.default_rng(2).normal(size=plan.zeta.shape)
    x, z, slope = np.zeros(10), [], 0.0
    for k in range(7):
        z.append(np.concatenate([x, change[k]]))
        slope += program.g[k] @ z[k]
        x = program.A[k] @ x + program.B[k] @ change[k]
    slope += program.g_end @ x

    def moved(s: float) -> KinematicPlan:
        return plan.redone(plan.start, plan.zeta + s * change)

    assert derivative(lambda s: ocp.evaluate(moved(s)).cost, 1e-4) == pytest.approx(slope, rel=1e-6)
    y = derivative(lambda s: ocp.model.task_pose(moved(s).config), 1e-5)
    np.testing.assert_allclose(y[1:-1], np.array(z)[1:, :10], atol=1e-6)
    np.testing.assert_allclose(y[-1], x, atol=1e-6)


def test_the_converged_plan_is_that_of_the_nonlinear_program(ocp):
    """SNOPT and the fast solver, from 8 configurations; speeds and joints reach their limits."""
    solver, reference = SequentialConvexSolver(ocp), NonlinearSolver(ocp, SnoptSolver())
    fastest = []
    for config in scattered(8):
        guess = ocp.resting_plan(0.0, config)
        one, other = solver.solve(guess, 50, 1e-10), reference.solve(guess)
        assert one.converged
        assert one.evaluation.violation < 1e-6
        assert one.evaluation.cost == pytest.approx(other.evaluation.cost, rel=1e-6)
        np.testing.assert_allclose(one.plan.zeta, other.plan.zeta, atol=5e-3)
        fastest.append(np.max(np.linalg.norm(one.plan.zeta[:, :3], axis=1)))
    assert max(fastest) > 0.9


def test_limits_on_speed_and_joints_are_kept_at_the_cost_of_the_nonlinear_program(ocp):
    limits = bounded(ocp, nu1=0.6, nu2=0.3, qdot=0.2, q_upper=ocp.limits["q"].upper - 0.02)
    tight = KinematicOcp(ocp.model, SCENARIO.mpc, ocp.y_des, limits)
    guess = tight.resting_plan(0.0, START)
    one = SequentialConvexSolver(tight).solve(guess, 50, 1e-10)
    other = NonlinearSolver(tight, SnoptSolver()).solve(guess)
    assert one.evaluation.cost == pytest.approx(other.evaluation.cost, rel=1e-6)
    for block, bound in ((slice(0, 3), 0.6), (slice(3, 6), 0.3), (slice(6, 10), 0.2)):
        assert np.max(np.linalg.norm(one.plan.zeta[:, block], axis=1)) == pytest.approx(
            bound, abs=1e-6)


RICCATI = replace(SCENARIO.mpc, terminal_weight=None, terminal_set=True, terminal_radius=0.5,
                  weight_y=np.repeat([0.5, 0.1], [6, 4]))


def test_the_terminal_penalty_is_twice_the_cost_of_the_terminal_controller(ocp):
    """On the linearisation, summed up to rest; and the terminal set costs what it says."""
    ocp = KinematicOcp(ocp.model, RICCATI, ocp.y_des, ocp.limits)
    J_x = ocp.model.task_jacobian(ocp.model.configuration(ocp.y_des))
    xi = np.random.default_rng(3).normal(size=10)
    start, cost = xi, 0.0
    for _ in range(1000):
        zeta = ocp.terminal.gain @ xi
        cost += H * (xi @ ocp.Q @ xi + zeta @ ocp.R @ zeta)
        xi = xi + H * J_x @ zeta
    assert np.linalg.norm(xi) < 1e-6
    assert start @ ocp.terminal.P @ start == pytest.approx(2.0 * cost, rel=1e-9)
    far = ocp.resting_plan(0.0, START)
    slack = ocp.evaluate(far).terminal_slack
    e = ocp.unwrapped(ocp.model.task_pose(START)) - ocp.y_des
    assert slack == pytest.approx(np.sqrt(e @ ocp.terminal.P @ e) - 0.5)
    without = KinematicOcp(ocp.model, replace(RICCATI, terminal_set=False), ocp.y_des, ocp.limits)
    assert ocp.evaluate(far).cost - without.evaluate(far).cost == pytest.approx(
        TERMINAL_PENALTY * slack)


def test_joints_without_weight_are_left_out_of_the_terminal_design(ocp):
    config = replace(RICCATI, weight_y=np.repeat([0.5, 0.0], [6, 4]))
    free = KinematicOcp(ocp.model, config, ocp.y_des, ocp.limits)
    assert not np.any(free.terminal.P[6:]) and not np.any(free.terminal.gain[:, 6:])
    assert np.linalg.matrix_rank(free.terminal.P) == len(free.terminal.root) == 6
    np.testing.assert_allclose(free.terminal.root.T @ free.terminal.root, free.terminal.P,
                               atol=1e-12)


@pytest.mark.parametrize(("key", "value", "says"), [
    ("weight_y", np.repeat([0.5, 0.1, 0.0], [6, 2, 2]), "zeros only"),
    ("weight_y", np.repeat([0.0, 0.5], [1, 9]), "6 positive numbers"),
    ("weight_zeta", np.zeros(10), "10 positive numbers"),
    ("terminal_weight", np.ones(6), "10 finite numbers"),
    ("terminal_radius", 0.0, "positive"),
    ("initial_state", "guessed", "nominal, measured"),
    ("input_reference", "none", "equilibrium, zero"),
])
def test_a_setting_without_meaning_is_refused(ocp, key, value, says):
    with pytest.raises(InvalidParameter, match=says):
        KinematicOcp(ocp.model, replace(SCENARIO.mpc, **{key: value}), ocp.y_des, ocp.limits)


def test_a_limit_on_the_force_is_kept_too(ocp):
    """0.02 N less than the plan without it has at its first knot."""
    def solved(problem: KinematicOcp) -> tuple[float, float]:
        guess = problem.resting_plan(0.0, START)
        one = SequentialConvexSolver(problem).solve(guess, 50, 1e-10)
        other = NonlinearSolver(problem, SnoptSolver()).solve(guess)
        assert one.evaluation.cost == pytest.approx(other.evaluation.cost, rel=1e-6)
        chi = problem.model.task_pose(one.plan.config)[1:, :6]
        return float(np.max(problem.model.surface.static_force(chi))), one.evaluation.cost

    free, cost = solved(ocp)
    limits = bounded(ocp, static_force=free - 0.02)
    pressed, dearer = solved(KinematicOcp(ocp.model, SCENARIO.mpc, ocp.y_des, limits))
    assert pressed == pytest.approx(free - 0.02, rel=1e-6)
    assert dearer > cost
