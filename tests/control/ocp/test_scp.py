"""Tests of `uvms_drake.control.ocp.scp`, against SNOPT on the whole nonlinear program."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.solvers import SnoptSolver
from support.limits import with_limits

import uvms_drake as uv
from uvms_drake.control.convex.staged_solver import solve_staged
from uvms_drake.control.ocp.ocp import Ocp
from uvms_drake.control.ocp.scp import SequentialConvexSolver, Solution
from uvms_drake.control.ocp.solvers import NonlinearSolver
from uvms_drake.control.plan.plan import Plan

pytestmark = pytest.mark.slow

ITERATIONS, TOLERANCE = 300, 1e-10  # at most, and of the merit, for a converged solution
COMPARED = {"off": 6, "on": 4, "before": 2}
"""Of the states of `start_plans`, those from which SNOPT solves the problem too."""


@pytest.fixture(scope="module")
def solver(short_ocp) -> SequentialConvexSolver:
    return SequentialConvexSolver(short_ocp)


@pytest.fixture(scope="module")
def fast(solver, start_plans) -> dict[str, list[Solution]]:
    """The converged solutions from all states."""
    return {where: [solver.solve(guess, ITERATIONS, TOLERANCE) for guess in guesses]
            for where, guesses in start_plans.items()}


@pytest.fixture(scope="module")
def reference(short_ocp, start_plans) -> dict[str, list[Solution]]:
    """SNOPT's solutions from the first of the same guesses."""
    nlp = NonlinearSolver(short_ocp, SnoptSolver())
    return {where: [nlp.solve(guess) for guess in start_plans[where][:count]]
            for where, count in COMPARED.items()}


@pytest.mark.parametrize("where", ["off", "before", "on"])
def test_every_state_is_solved_to_a_feasible_plan_by_both_solvers(
        start_plans, fast, reference, where):
    assert len(reference[where]) == COMPARED[where]
    for solutions in (fast[where], reference[where]):
        for guess, solution in zip(start_plans[where], solutions, strict=False):
            assert solution.converged
            assert solution.evaluation.violation < 1e-6
            np.testing.assert_array_equal(solution.plan.config[0], guess.config[0])
            np.testing.assert_array_equal(solution.plan.zeta[0], guess.zeta[0])


def same_optimum(ocp: Ocp, one: Solution, other: Solution) -> bool:
    """Returns whether both solvers found the same, and checks that the fast one's is good.

    There may be several local optima; then the fast solver's is at most 0.1 % worse, and SNOPT,
    started there, finds nothing better.
    """
    cost = one.evaluation.cost
    if cost != pytest.approx(other.evaluation.cost, rel=1e-6):
        assert cost <= 1.001 * other.evaluation.cost
        confirmed = NonlinearSolver(ocp, SnoptSolver()).solve(one.plan)
        assert confirmed.evaluation.cost == pytest.approx(cost, rel=1e-6)
        return False
    assert one.evaluation.terminal_slack == pytest.approx(
        other.evaluation.terminal_slack, abs=1e-5)
    np.testing.assert_allclose(one.plan.zeta_dot, other.plan.zeta_dot, atol=5e-3)
    return True


def test_the_converged_cost_is_that_of_the_nonlinear_program(short_ocp, fast, reference):
    """In 10 states; on the wall there is one optimum, off it sometimes another one close by."""
    same = {where: [same_optimum(short_ocp, one, other) for one, other in zip(
        fast[where], reference[where], strict=False)] for where in ("off", "on")}
    assert all(same["on"])
    assert sum(same["off"]) >= 4


def test_where_contact_is_made_each_solver_confirms_the_others_optimum(
        short_ocp, solver, fast, reference):
    """In which interval to touch the wall is a choice: there are several local optima.

    From the same guess the two may take different ones, some percent apart; started at the other's
    plan neither finds anything better.
    """
    nlp = NonlinearSolver(short_ocp, SnoptSolver())
    for one, other in zip(fast["before"], reference["before"], strict=False):
        costs = one.evaluation.cost, other.evaluation.cost
        assert nlp.solve(one.plan).evaluation.cost == pytest.approx(costs[0], rel=1e-3)
        assert solver.solve(other.plan, ITERATIONS, TOLERANCE).evaluation.cost == pytest.approx(
            costs[1], rel=1e-3)
        assert costs[0] <= 1.1 * costs[1]


def test_some_limits_and_the_terminal_set_are_active(short_ocp, fast):
    """Otherwise the comparison would say nothing about them."""
    limits = short_ocp.limits
    plans = [solution.plan for each in fast.values() for solution in each]
    u = np.abs(np.vstack([np.vstack(short_ocp.inputs(plan)) for plan in plans]))
    assert np.sum(np.max(u, axis=0) > limits["u"].upper - 1e-6) >= 3
    zeta = np.vstack([plan.zeta for plan in plans])
    assert np.max(np.linalg.norm(zeta[:, :3], axis=1)) > limits["nu1"].upper[0] - 1e-6
    slacks = [solution.evaluation.terminal_slack for each in fast.values() for solution in each]
    assert np.min(slacks) == 0.0
    assert np.max(slacks) > 0.1


@pytest.mark.parametrize("where", ["off", "before", "on"])
def test_no_iteration_makes_the_plan_worse(short_ocp, solver, start_plans, where):
    """The merit is that of the true problem; a violation that the guess has may shrink."""
    for guess in start_plans[where]:
        plan, value = guess, short_ocp.evaluate(guess).merit
        for _ in range(6):
            solution = solver.solve(plan, 1)
            after = short_ocp.evaluate(solution.plan)
            assert solution.iterations == 1
            assert after.merit <= value
            assert solution.evaluation == after
            plan, value = solution.plan, after.merit


# Limits that the scenario does not have -----------------------------------------------------------


def solve_with_both(ocp: Ocp, guess: Plan) -> Solution:
    """Returns the fast solver's converged solution, after comparison with SNOPT's."""
    one = SequentialConvexSolver(ocp).solve(guess, ITERATIONS, TOLERANCE)
    other = NonlinearSolver(ocp, SnoptSolver()).solve(guess)
    assert one.converged
    assert other.converged
    assert one.evaluation.violation < 1e-6
    assert other.evaluation.violation < 1e-6
    same_optimum(ocp, one, other)
    return one


def forces(ocp: Ocp, plan: Plan) -> np.ndarray:
    """Returns |M(𝔮̄)ū| (2N, 10) at both ends of all intervals."""
    M = np.array([ocp.model.mass_matrix(ocp.model.kinematics(config)) for config in plan.config])
    begin, end = ocp.inputs(plan)
    return np.abs(np.einsum("kij,kj->ki", np.concatenate([M[:-1], M[1:]]),
                            np.concatenate([begin, end])))


@pytest.mark.parametrize(("where", "i"), [
    pytest.param("off", 2, marks=pytest.mark.long), ("on", 0)])
def test_limits_on_forces_are_kept_at_the_cost_of_the_nonlinear_program(
        short_ocp, start_plans, fast, where, i):
    """With 4/5 of the forces that the plan without such limits takes, in all channels."""
    free = fast[where][i]
    tau = 0.8 * np.max(forces(short_ocp, free.plan), axis=0)
    limited = solve_with_both(with_limits(short_ocp, tau=tau), start_plans[where][i])
    peaks = np.max(forces(short_ocp, limited.plan), axis=0) / tau
    assert np.max(peaks) < 1.0 + 1e-6
    assert np.sum(peaks > 1.0 - 1e-4) >= 5
    assert limited.evaluation.cost > 1.01 * free.evaluation.cost


ANGLES = {"roll": 3, "pitch": 4, "q_lower": 7, "q_upper": 8}
"""Limits that are to be active, and the coordinate that each is about."""


@pytest.mark.parametrize("kind", [
    "roll", "q_upper",
    *(pytest.param(kind, marks=pytest.mark.long) for kind in ("pitch", "q_lower"))])
def test_limits_on_attitude_and_joints_are_kept_at_the_cost_of_the_nonlinear_program(
        short_ocp, start_plans, fast, kind):
    """In the state from which the angle goes furthest, half as far."""
    def gone(plan: Plan) -> np.ndarray:
        angle = plan.config[:, ANGLES[kind]]
        angle = {"q_lower": -angle, "q_upper": angle}.get(kind, np.abs(angle))
        return angle - angle[0]

    cases = [(guess, solution) for where in ("off", "on") for guess, solution in zip(
        start_plans[where], fast[where], strict=True)]
    guess, free = max(cases, key=lambda case: np.max(gone(case[1].plan)))
    furthest = 0.5 * np.max(gone(free.plan))
    assert furthest > 1e-3
    start = guess.config[0, ANGLES[kind]]
    if kind in ("roll", "pitch"):
        bound = abs(start) + furthest
    else:
        joint = ANGLES[kind] - 6
        bound = getattr(short_ocp.limits["q"], kind.removeprefix("q_")).copy()
        bound[joint] = start - furthest if kind == "q_lower" else start + furthest
    limited = solve_with_both(with_limits(short_ocp, **{kind: bound}), guess)
    assert np.max(gone(limited.plan)) == pytest.approx(furthest, abs=1e-6)
    assert limited.evaluation.cost > free.evaluation.cost


@pytest.mark.parametrize("surface", [
    "plane", pytest.param("spring", marks=pytest.mark.long)])
def test_a_limit_on_the_force_is_kept_at_the_cost_of_the_nonlinear_program(
        short_ocp, start_plans, surface):
    """With 9/10 of the value of the plan without the limit at its second knot or later."""
    if surface == "plane":
        ocp, guess = with_limits(short_ocp, static_force=None), start_plans["on"][0]
    else:
        scenario = uv.load_scenario(
            "girona500_bilateral", ["mpc.horizon=5", "limits.static_force=null"])
        ocp = uv.make_ocp(scenario)
        guess = ocp.resting_plan(0.0, uv.start_state(scenario, ocp))

    def pressed(plan: Plan) -> float:
        chi = ocp.model.task_pose(plan.config)[1:, :6]
        return float(np.max(ocp.model.surface.static_force(chi)))

    free = SequentialConvexSolver(ocp).solve(guess, ITERATIONS, TOLERANCE)
    assert pressed(free.plan) > 15.0
    limited = solve_with_both(with_limits(ocp, static_force=0.9 * pressed(free.plan)), guess)
    assert pressed(limited.plan) == pytest.approx(0.9 * pressed(free.plan), rel=1e-6)
    assert limited.evaluation.cost > free.evaluation.cost


# Softened limits ---------------------------------------------------------------------------------


STEEP = np.array([
    -1.0049, 0.0935, -0.0855, 0.2786, -0.0621, -0.1433, 0.14, 1.0874, 0.5712, -0.2665])
"""A 𝔮 with so much roll that the inputs hardly hold it."""


def test_where_the_linearised_limits_cannot_be_kept_a_plan_is_found_all_the_same(short_ocp):
    """The relaxed program leads to where the limits themselves can be kept."""
    ocp = with_limits(
        short_ocp, nu1=0.24, nu2=0.19, qdot=0.2935, roll=0.296, pitch=0.296, tip_pitch=0.798,
        q_lower=np.array([-0.519, -0.146, -1.296, -3.139]),
        q_upper=np.array([1.459, 1.31, 0.729, 3.139]),
        u=np.array([0.24, 0.09, 0.19, 0.24, 0.34, 0.24, 5.0, 7.3, 7.0, 5.7]))
    guess = ocp.resting_plan(0.0, np.concatenate([STEEP, np.zeros(10)]))
    assert ocp.evaluate(guess).violation > 0.01
    program = ocp.staged_program(guess)
    hard = program.linear._replace(soft=np.zeros_like(program.linear.soft))
    assert solve_staged(replace(program, linear=hard)) is None
    assert solve_staged(program).excess > 1e-3
    solve_with_both(ocp, guess)


def test_a_start_too_fast_to_brake_is_reported_as_a_violation(short_ocp, solver, start_plans):
    guess = start_plans["off"][0]
    zeta = guess.zeta[0].copy()
    zeta[0] = 1.0  # m/s, with 0.2 s to come down to the limit
    solution = solver.solve(short_ocp.resting_plan(
        0.0, np.concatenate([guess.config[0], zeta])), 10)
    needed = (1.0 - short_ocp.limits["nu1"].upper[0]) / 0.2  # m/s²
    assert solution.evaluation.violation > 0.5 * needed


def test_limits_that_are_linear_are_not_softened_and_then_there_is_no_plan(
        short_ocp, solver, start_plans):
    config = start_plans["off"][0].config[0].copy()
    config[8] = short_ocp.limits["q"].upper[2] + 0.1  # rad, with 0.2 s to return at 0.3 rad/s
    solution = solver.solve(short_ocp.resting_plan(
        0.0, np.concatenate([config, np.zeros(10)])), 10)
    assert (solution.plan, solution.evaluation, solution.converged) == (None, None, False)
    assert solution.iterations == 1


# One iteration a sample against the reference -----------------------------------------------------


def closed_loop(ocp: Ocp, first: Plan, solve, samples: int) -> tuple[float, np.ndarray]:
    """Returns the cost of the nominal closed loop, and its states (samples, 20)."""
    plan, cost, states = first, 0.0, []
    for _ in range(samples):
        xi = ocp.errors(plan, ocp.unwrapped(ocp.model.task_pose(plan.config)))[0]
        du = ocp.inputs(plan)[0][0] - ocp.u_eq
        cost += ocp.time_step * (xi @ ocp.Q @ xi + du @ ocp.R @ du)
        states.append(plan.start)
        plan = solve(ocp.continued(plan))
    return float(cost), np.array(states)


def test_one_iteration_a_sample_costs_what_the_reference_costs(short_ocp, solver, start_plans):
    """On the wall, over 3 samples, from the same first plan: 0.1 %, and the same states."""
    first = solver.solve(start_plans["on"][1], ITERATIONS, TOLERANCE).plan
    reference = NonlinearSolver(short_ocp, SnoptSolver())
    cost, states = closed_loop(short_ocp, first, lambda guess: solver.solve(guess, 1).plan, 3)
    best, expected = closed_loop(short_ocp, first, lambda guess: reference.solve(guess).plan, 3)
    assert cost == pytest.approx(best, rel=1e-3)
    np.testing.assert_allclose(states, expected, atol=1e-3)
